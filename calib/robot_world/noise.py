"""Noise of measured pose pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError, near_names, one_line
from calib.robot_world.errors_of_pairs import ErrorModel, General, Isotropic
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

Side = Literal["A", "B", "both"]
Axes = Literal["to", "from"]

LEAST_NOISE = 1e-15
"""Least standard deviation [rad, m] but 0: rounding is of that size."""


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
            if not (is_number(value) and (value == 0.0 or value >= LEAST_NOISE)):
                raise InputError(
                    f"{name} of the noise is {one_line(value)}",
                    hint=f"give a standard deviation: 0, or {LEAST_NOISE:g} or more",
                    name=name,
                    value=value,
                    bound=0.0,
                )
        _check_choice("on", self.on, get_args(Side), "noise on")

    @property
    def is_positive(self) -> bool:
        """Whether there is noise on rotation and on translation, as a likelihood needs it."""
        return self.rotation_rad > 0.0 and self.translation_m > 0.0

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations ``(6,)`` of (w, v)."""
        return np.repeat([self.rotation_rad, self.translation_m], 3).astype(float)

    def model(self, pairs: PairSets) -> ErrorModel:
        """Errors of the pairs.

        Raises
        ------
        InputError
            A standard deviation of zero: there is no likelihood where something is exact.
        """
        for name in ("rotation_rad", "translation_m"):
            if getattr(self, name) <= 0.0:
                raise InputError(
                    f"{name} of the noise is 0",
                    hint="the likeliest X and Z need some noise, however small, on rotation and "
                    "translation",
                    name=name,
                    value=0.0,
                )
        one = np.array([self.rotation_rad, self.translation_m])
        sides = np.concatenate([one * (self.on != "B"), one * (self.on != "A")])
        return Isotropic(sides[:, None])

    def roots(self, A: FloatArray, B: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
        """Matrices ``(1, 6, 6)`` that turn white numbers into errors of A and of B, or None."""
        root = np.diag(self.sigma)[None]
        return (None if self.on == "B" else root), (None if self.on == "A" else root)


@dataclass(frozen=True, eq=False)
class PairCovariances:
    """Independent noise of the measured transforms with any covariance."""

    A: ArrayLike | None = None
    B: ArrayLike | None = None
    """A, B (6, 6) or (N, 6, 6): covariance of the errors (w, v) [rad, m] of every A or B, or of
    each; None where that side has none. What a camera sees is often far less certain along its axis
    than across it."""
    axes: Axes = "to"
    """The axes that w and v are given in: those of the frame that the transform maps to (the base
    for A = T_base_flange), or those that it maps from (the flange; the camera for B =
    T_target_camera)."""

    def __post_init__(self) -> None:
        if self.A is None and self.B is None:
            raise InputError("no covariance is given", hint="give that of A, of B or of both")
        _check_choice("axes", self.axes, get_args(Axes), "there are no axes")
        for name in ("A", "B"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _checked_covariance(getattr(self, name), name))

    @classmethod
    def of_seen_target(cls, B: ArrayLike, covariance: ArrayLike) -> PairCovariances:
        """Noise of a camera that sees the target at ``T_camera_target``, the inverse of B.

        A small error of what it sees turns the camera about the target, far from its origin: as
        an error of B it is much larger along the target than across it.

        Parameters
        ----------
        B : array_like (N, 4, 4)
            ``T_target_camera``.
        covariance : array_like (6, 6) or (N, 6, 6)
            Of the errors (w, v) [rad, m] of ``T_camera_target``, in the axes of the camera: of its
            turn, and of where the origin of the target is seen.
        """
        T_target_camera = se3.check_transforms(B, "B").reshape(-1, 4, 4)
        seen = se3.inverse(T_target_camera)[:, :3, 3]
        # S = B⁻¹ with errors (w, v): R_B exp(-w), p_B + R_B (w × p_S - v), in axes of the camera
        M = np.zeros((len(seen), 6, 6))
        M[:, :3, :3] = M[:, 3:, 3:] = -np.eye(3)
        M[:, 3:, :3] = -se3.skew(seen)
        return cls(B=M @ _checked_covariance(covariance, "B") @ M.transpose(0, 2, 1), axes="from")

    def times(self, factor: float) -> PairCovariances:
        """The same noise with all covariances times a factor."""
        A, B = (None if C is None else factor * np.asarray(C) for C in (self.A, self.B))
        return PairCovariances(A, B, self.axes)

    @property
    def on(self) -> Side:
        """The transforms that carry noise."""
        if self.A is not None:
            return "A" if self.B is None else "both"
        return "B"

    def model(self, pairs: PairSets) -> ErrorModel:
        """Errors of the pairs; see :meth:`PairNoise.model`."""
        return General(self._covariance("A", pairs.A), self._covariance("B", pairs.B))

    def roots(self, A: FloatArray, B: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
        """Matrices ``(S, 6, 6)`` that turn white numbers into errors of A and of B, or None."""
        first, second = self._covariance("A", A), self._covariance("B", B)
        return (
            None if first is None else np.asarray(np.linalg.cholesky(first)),
            None if second is None else np.asarray(np.linalg.cholesky(second)),
        )

    def _covariance(self, name: str, T: FloatArray) -> FloatArray | None:
        """Covariances ``(S, 6, 6)`` in the axes that transforms ``(..., N, 4, 4)`` map to."""
        given = getattr(self, name)
        if given is None:
            return None
        count, pairs = len(given), T.shape[-3]
        _check_count(name, count, pairs)
        T = T.reshape(-1, 4, 4)
        every = np.tile(given, (len(T) // count, 1, 1))
        if self.axes == "to":
            return every
        R = np.zeros((len(T), 6, 6))
        R[:, :3, :3] = R[:, 3:, 3:] = T[:, :3, :3]
        return np.asarray(R @ every @ np.swapaxes(R, -1, -2))


Noise: TypeAlias = PairNoise | PairCovariances

NoiseShown = Literal["B", "shown"]
"""Noise to be estimated: of B, the same in all directions; or as the residuals show it."""


def is_number(value: object) -> bool:
    """Whether it is one finite real number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _check_choice(name: str, value: object, known: tuple[str, ...], said: str) -> None:
    if not isinstance(value, str) or value not in known:
        text = one_line(value)
        raise InputError(f"{said} {text}", hint=near_names(text, known), name=name, value=value)


def check_noise_given(noise: object) -> None:
    """Refuse what is no noise of pairs, None among it."""
    if not isinstance(noise, PairNoise | PairCovariances):
        raise InputError(
            f"the noise is {one_line(noise)}, neither PairNoise nor PairCovariances",
            hint="say PairNoise(rotation_rad, translation_m)",
            name="noise",
        )


def check_noise(noise: object, N: int) -> None:
    """Refuse what is neither noise of N pairs nor one to be estimated.

    Raises
    ------
    InputError
        Something else, or covariances of another number of pairs.
    """
    if noise is None:
        return
    if not isinstance(noise, str):
        check_noise_given(noise)
    elif noise not in get_args(NoiseShown):
        raise InputError(
            f"the noise is {one_line(noise)}, which is none",
            hint='give PairNoise or PairCovariances, or have it estimated: "B" is that of B, the '
            'same in all directions, "shown" what the residuals show',
            name="noise",
            value=noise,
        )
    if isinstance(noise, PairCovariances):
        for name, given in (("A", noise.A), ("B", noise.B)):
            if given is not None:
                _check_count(name, len(np.asarray(given)), N)


def _check_count(name: str, count: int, pairs: int) -> None:
    """Refuse covariances of another number of pairs."""
    if count not in (1, pairs):
        raise InputError(
            f"{count} covariances of {name} for {pairs} pairs",
            hint="give one, or one for each pair",
            name=name,
            value=count,
            bound=pairs,
        )


def _checked_covariance(value: ArrayLike, name: str) -> FloatArray:
    """Covariances ``(1 or N, 6, 6)``, finite, symmetric and positive definite."""
    C = se3.numbers(value, f"the covariance of {name}")
    if C.ndim not in (2, 3) or C.shape[-2:] != (6, 6) or not C.size:
        raise InputError(
            f"the covariance of {name} has shape {C.shape}, not (6, 6) or (N, 6, 6)", name=name
        )
    if not np.isfinite(C).all():
        raise InputError(f"the covariance of {name} is not finite and symmetric", name=name)
    size = np.sqrt(np.abs(np.diagonal(C, axis1=-2, axis2=-1)))
    lengths = size[..., :, None] * size[..., None, :]
    if (np.abs(C - np.swapaxes(C, -1, -2)) > 1e-9 * lengths).any():
        raise InputError(f"the covariance of {name} is not finite and symmetric", name=name)
    if not (size > 0).all() or np.linalg.eigvalsh(C / lengths).min() < 1e-12:
        raise InputError(
            f"the covariance of {name} is not positive definite",
            hint="rotation (rad) comes first, then translation (m); no direction is exact",
            name=name,
        )
    return C.reshape(-1, 6, 6)


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
