"""How certain a solution of A X = Z B is, and whether the noise given explains its residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from calib.posture_last import columns_of, turn
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.errors_of_pairs import derivatives
from calib.robot_world.methods import Method
from calib.robot_world.noise import Noise, PairNoise, propagate
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate
from calib.se3 import BoolArray, FloatArray

NOISE_DOUBT = 1e-4
"""Probability of residuals as large as those found below which the noise does not explain them."""

_RANK_TOLERANCE = 1e-12
"""Eigenvalue of the information, scaled to a unit diagonal, that counts as none."""

_SMALLEST = np.finfo(float).tiny
"""What stands for a noise of zero, which data without noise show."""


@dataclass(frozen=True)
class GoodnessOfFit:
    """Residuals of a solution in units of the noise given.

    Attributes
    ----------
    chi2 : float
        Sum of their squares.
    freedom : int
    probability : float
        Of one as large.
    excess : float
        How many times larger than the noise they are; 1 where chance may have made them as large.
    """

    chi2: float
    freedom: int
    probability: float
    excess: float


def goodness(pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise) -> GoodnessOfFit:
    """Compare the residuals of one solution with the noise given.

    Exact for the maximum of the likelihood; other methods leave somewhat larger residuals.
    """
    if found.fit is not None:
        chi2 = float(found.fit.cost[0])
    else:
        white, _ = linear_rows(pairs, noise.model(pairs), found.X, found.Z)
        chi2 = float((white[:, 0, used] ** 2).sum())
    freedom = 6 * int(used.sum()) - 12
    probability = float(chi2_distribution.sf(chi2, freedom))
    excess = 1.0 if probability > NOISE_DOUBT else float(np.sqrt(chi2 / freedom))
    return GoodnessOfFit(chi2, freedom, probability, excess)


def noise_shown(found: Estimate, residual: FloatArray, used: BoolArray) -> PairNoise:
    """Noise of B as the residuals ``(N, 6)`` of one solution show it, or as the method found it.

    Rotations and translations have six unknowns each.
    """
    if found.sigma is not None:
        turn_rad, shift_m = found.sigma[:, 0].tolist()
    else:
        square = (residual[used] ** 2).sum(axis=0).reshape(2, 3).sum(axis=-1)
        turn_rad, shift_m = np.sqrt(square / (3 * int(used.sum()) - 6)).tolist()
    return PairNoise(max(turn_rad, _SMALLEST), max(shift_m, _SMALLEST), "B")


def covariance_of(
    chosen: Method,
    pairs: PairSets,
    found: Estimate,
    used: BoolArray,
    excess: float,
    noise: Noise | None,
) -> FloatArray | None:
    """Covariance ``(12, 12)`` of one solution, the residuals being ``excess`` times the noise."""
    if noise is None:
        return None
    if found.fit is not None:
        return np.asarray(found.fit.covariance[0] * excess**2)
    A, B = pairs.A[0, used], pairs.B[0, used]
    return propagate(chosen.estimate, A, B, noise) * excess**2


def rank_of(pairs: PairSets, X: FloatArray, Z: FloatArray, used: BoolArray) -> int:
    """Directions of X and Z, of 12, that the pairs of one set see."""
    R_Z = pairs.spread(columns_of(Z[:, :3, :3]))
    J = derivatives(pairs.R_A, turn(R_Z, pairs.p_B))[..., used]
    J[:, 3:] /= pairs.size[0]
    information = J.reshape(12, -1) @ J.reshape(12, -1).T
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0.0, size, 1.0)
    return int((np.linalg.eigvalsh(information / np.outer(size, size)) > _RANK_TOLERANCE).sum())
