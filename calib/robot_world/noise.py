"""Noise of measured pose pairs, and its way through a method to X and Z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from calib import se3
from calib.errors import InputError, near_names
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate
from calib.se3 import FloatArray

Side = Literal["A", "B", "both"]
Estimator = Callable[[PairSets], Estimate]

NOISE_DOUBT = 1e-4
"""Probability of residuals as large as those found below which the noise does not explain them."""

_STEP = 1e-5
"""Step of the central differences [rad, m]: its square, the share that the next order takes, and
the rounding of a solution divided by it are both far below a thousandth."""

_PAIRS_AT_ONCE = 20_000
"""Pairs that one call of the method sees: bounds the memory to some 100 MB."""


@dataclass(frozen=True)
class PairNoise:
    """Independent noise of the measured transforms, the same in all directions.

    A measured transform is ``R = exp([w]) R_true``, ``p = p_true + v`` with independent normal
    components of w and v.

    Attributes
    ----------
    rotation_rad, translation_m : float
        Standard deviations of each component of w [rad] and of v [m].
    on : {"B", "A", "both"}
        The transforms that carry it: those of the camera (B), of the robot (A), or both.
    """

    rotation_rad: float
    translation_m: float
    on: Side = "B"

    def __post_init__(self) -> None:
        for name in ("rotation_rad", "translation_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(
                    f"{name} of the noise is {value}",
                    hint="give a standard deviation, 0 or more",
                    name=name,
                    value=value,
                    bound=0.0,
                )
        if self.on not in get_args(Side):
            raise InputError(
                f"noise on {self.on!r}",
                hint=near_names(self.on, get_args(Side)),
                name="on",
                value=self.on,
            )

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations ``(6,)`` of (w, v)."""
        return np.repeat([self.rotation_rad, self.translation_m], 3).astype(float)

    def excess(self, residuals: FloatArray, X: FloatArray) -> float:
        """How many times larger than this noise the residuals ``(N, 6)`` of a solution are.

        1 where chance may have made them as large as they are. Exact for methods that weigh the
        pairs alike; others leave somewhat larger residuals.
        """
        sides = 2.0 if self.on == "both" else 1.0
        lever = 0.0 if self.on == "B" else 2.0 / 3.0 * float(X[:3, 3] @ X[:3, 3])
        turn, shift = self.rotation_rad**2, self.translation_m**2
        # noise in the rotation of A moves the origin of X as well
        variance = np.repeat([sides * turn, sides * shift + lever * turn], 3)
        seen = variance > 0
        freedom = (len(residuals) - 2) * int(seen.sum())  # X and Z take two poses
        chi2 = float(np.sum(residuals[:, seen] ** 2 / variance[seen]))
        if freedom <= 0 or chi2_distribution.sf(chi2, freedom) > NOISE_DOUBT:
            return 1.0
        return float(np.sqrt(chi2 / freedom))


def perturb(T: FloatArray, error: FloatArray) -> FloatArray:
    """Transforms ``(..., 4, 4)`` with errors (w, v) ``(..., 6)``: exp([w]) R and p + v."""
    return se3.transform(
        se3.rotation_exp(error[..., :3]) @ T[..., :3, :3], T[..., :3, 3] + error[..., 3:]
    )


def difference(T: FloatArray, reference: FloatArray) -> FloatArray:
    """Errors (w, v) ``(..., 6)`` by which transforms differ from others: undoes ``perturb``."""
    turn = T[..., :3, :3] @ np.swapaxes(reference[..., :3, :3], -1, -2)
    shift = T[..., :3, 3] - reference[..., :3, 3]
    return np.concatenate([se3.rotation_log(turn), shift], axis=-1)


def propagate(estimate: Estimator, A: FloatArray, B: FloatArray, noise: PairNoise) -> FloatArray:
    """Covariance ``(12, 12)`` of X and Z by the first order of the method itself.

    Parameters
    ----------
    estimate : callable
        The method, for arrays ``(T, N, 4, 4)``.
    A, B : ndarray (N, 4, 4)
        Measured transforms.
    noise : PairNoise
        Their noise.

    Returns
    -------
    ndarray (12, 12)
        In the order and frames of :class:`~calib.robot_world.results.RobotWorldResult`.

    Notes
    -----
    The derivatives of (X, Z) with respect to the six errors of each pair are central differences
    of the method: 12 N problems for each noisy side, solved in batches.
    """
    covariance = np.zeros((12, 12))
    sides: tuple[Side, ...] = ("A", "B") if noise.on == "both" else (noise.on,)
    for side in sides:
        J = _jacobian(estimate, A, B, side) * np.tile(noise.sigma, len(A))
        covariance += J @ J.T
    return covariance


def _jacobian(estimate: Estimator, A: FloatArray, B: FloatArray, side: Side) -> FloatArray:
    """Derivatives ``(12, 6N)`` of the errors of X and Z by those of one side's transforms."""
    N = len(A)
    at_once = max(1, _PAIRS_AT_ONCE // (2 * N))
    blocks = []
    for first in range(0, 6 * N, at_once):
        column = np.arange(first, min(first + at_once, 6 * N))
        step = np.zeros((len(column), N, 6))
        step[np.arange(len(column)), column // 6, column % 6] = _STEP
        steps = np.concatenate([step, -step])
        ends = estimate(
            PairSets(
                perturb(A, steps if side == "A" else np.zeros_like(steps)),
                perturb(B, steps if side == "B" else np.zeros_like(steps)),
            )
        )
        moved = [difference(T[: len(column)], T[len(column) :]) for T in (ends.X, ends.Z)]
        blocks.append(np.concatenate(moved, axis=-1) / (2.0 * _STEP))
    return np.concatenate(blocks).T
