"""The likeliest X and Z of A X = Z B, by an adjustment of A, of B or of both.

From the rotations in closed form and the translations that go with them, a few steps of
:mod:`calib.robot_world.adjustment`. Where the noise is not known, its two sizes are estimated with
X and Z, as if B alone had errors: see :mod:`calib.robot_world.sizes`.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.adjustment import adjust
from calib.robot_world.estimate import Estimate, Fit
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets
from calib.robot_world.sizes import Sizes
from calib.se3 import FloatArray


def estimate(pairs: PairSets, noise: Noise | None = None) -> Estimate:
    """X and Z of T problems at once; without a noise that of each set is estimated, on B."""
    X, Z = pairs.rotations_first
    if noise is None:
        fit, sigma = with_estimated_noise(pairs, X, Z)
        return as_estimate(fit, sigma)
    return as_estimate(adjust(pairs, noise.model(pairs), X, Z), None)


def as_estimate(fit: Fit, sigma: FloatArray | None, used: FloatArray | None = None) -> Estimate:
    """What an adjustment has found; sigma ``(2, T)`` is the noise where it was estimated."""
    return Estimate(fit.X, fit.Z, fit.iterations, fit.converged, fit=fit, sigma=sigma, weights=used)


def with_estimated_noise(
    pairs: PairSets,
    X: FloatArray,
    Z: FloatArray,
    weights: FloatArray | None = None,
    widening: float = 1.0,
) -> tuple[Fit, FloatArray]:
    """Adjust X and Z ``(T, 4, 4)`` and the noise of B together.

    That noise is standard deviations ``(2, T)`` of rotation [rad] and translation [m]. Weights
    ``(T, N)`` are 1 for the pairs that count, 0 for the others; where those were chosen by their
    residuals, the deviations are larger than what they show by ``widening``.
    """
    counted = np.ones((pairs.T, pairs.N)) if weights is None else weights
    sizes = Sizes(pairs, X, Z, counted, widening)
    fit = adjust(pairs, sizes.model, X, Z, weights=weights, sizes=sizes)
    return fit, sizes.sigma
