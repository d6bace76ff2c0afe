"""How certain a solution of A X = Z B is, and whether the noise given explains its residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from calib.batch_last import columns_of, turn
from calib.robot_world.adjustment import adjust
from calib.robot_world.errors_of_pairs import derivatives
from calib.robot_world.methods import Method, maximum_likelihood
from calib.robot_world.noise import LEAST_NOISE, Noise, PairNoise
from calib.robot_world.pairs import PairSets
from calib.robot_world.propagation import propagate
from calib.robot_world.results import Estimate
from calib.robot_world.serial import widening
from calib.se3 import BoolArray, FloatArray

NOISE_DOUBT = 1e-4
"""Probability of residuals as large as those found below which the noise does not explain them."""

_RANK_TOLERANCE = 1e-12
"""Eigenvalue of the information, scaled to a unit diagonal, that counts as none."""


@dataclass(frozen=True)
class GoodnessOfFit:
    """Residuals of a solution in units of the noise given.

    Attributes
    ----------
    chi2 : float
        Sum of their squares at the likeliest X and Z.
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


def goodness(
    pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise
) -> GoodnessOfFit | None:
    """Compare the residuals of one set with the noise given.

    At its likeliest X and Z, whatever method has found others: what a method leaves more than
    these says nothing of the noise. None where the noise has no likelihood, a part of it being 0.
    """
    if isinstance(noise, PairNoise) and not noise.is_positive:
        return None
    fit = found.fit
    if fit is None:
        X, Z = pairs.rotations_first
        weights = used[None].astype(float)
        fit = adjust(pairs, noise.model(pairs), X, Z, weights=weights)
    chi2, freedom = float(fit.cost[0]), 6 * int(used.sum()) - 12
    probability, excess = judged(fit.cost, freedom)
    return GoodnessOfFit(chi2, freedom, float(probability[0]), float(excess[0]))


def judged(chi2: FloatArray, freedom: FloatArray | int) -> tuple[FloatArray, FloatArray]:
    """Probabilities of values of χ² as large ``(T,)``, and how many times the noise they are.

    1 where chance may have made them as large.
    """
    probability = np.asarray(chi2_distribution.sf(chi2, freedom))
    return probability, np.where(probability > NOISE_DOUBT, 1.0, np.sqrt(chi2 / freedom))


def noise_shown(found: Estimate, residual: FloatArray, used: BoolArray) -> PairNoise:
    """Noise of B as the residuals ``(N, 6)`` of one solution show it, or as the method found it.

    Rotations and translations have six unknowns each.
    """
    if found.sigma is not None:
        turn_rad, shift_m = found.sigma[:, 0].tolist()
    else:
        square = (residual[used] ** 2).sum(axis=0).reshape(2, 3).sum(axis=-1)
        turn_rad, shift_m = np.sqrt(square / (3 * int(used.sum()) - 6)).tolist()
    return PairNoise(max(turn_rad, LEAST_NOISE), max(shift_m, LEAST_NOISE), "B")


def covariance_of(
    chosen: Method,
    pairs: PairSets,
    found: Estimate,
    used: BoolArray,
    excess: float,
    given: bool,
    noise: Noise | None,
) -> FloatArray | None:
    """Covariance ``(12, 12)`` of one solution, the residuals being ``excess`` times the noise.

    By the noise, given or not, and by runs of pairs whose errors follow each other: see
    :mod:`calib.robot_world.serial`. Those widen what any method says by as much as maximum
    likelihood.
    """
    if noise is None:
        return None
    if found.fit is not None:
        factor = widening(found.fit, used[None], np.array([excess]), noise_known=given)[0]
        return np.asarray(found.fit.covariance[0] * excess**2 * np.outer(factor, factor))
    A, B = pairs.A[0, used], pairs.B[0, used]
    factor = np.ones(12)
    likeliest = maximum_likelihood.estimate(PairSets(A[None], B[None])).fit
    if likeliest is not None:
        factor = widening(likeliest, np.ones((1, len(A)), dtype=bool))[0]
    return propagate(chosen.estimate, A, B, noise, excess) * np.outer(factor, factor)


def rank_of(pairs: PairSets, X: FloatArray, Z: FloatArray, used: BoolArray) -> int:
    """Directions of X and Z, of 12, that the pairs of one set see."""
    R_Z = pairs.spread(columns_of(Z[:, :3, :3]))
    J = derivatives(pairs.R_A, turn(R_Z, pairs.p_B))[..., used]
    J[:, 3:] /= pairs.size[0]
    information = J.reshape(12, -1) @ J.reshape(12, -1).T
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0.0, size, 1.0)
    return int((np.linalg.eigvalsh(information / np.outer(size, size)) > _RANK_TOLERANCE).sum())
