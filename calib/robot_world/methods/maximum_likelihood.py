"""The likeliest X and Z of A X = Z B, by an adjustment of A, of B or of both.

From the rotations in closed form and the translations that go with them, a few steps of
:mod:`calib.robot_world.adjustment`. Where the noise is not known, its two sizes, that of rotation
and that of translation, are estimated with X and Z, as if B alone had errors: each is what the
residuals of its own rows show, over the share of them that X and Z have not taken up (variance
components, Förstner 1979).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.robot_world.adjustment import adjust
from calib.robot_world.errors_of_pairs import ErrorModel, Isotropic
from calib.robot_world.estimate import Estimate, Fit, residuals
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

_ROUNDS = 100
"""Rounds of X and Z, and of the noise by them: a few are usual."""

_SETTLED = 1e-6
"""Relative change of the noise from round to round that counts as none."""

_STEPS_A_ROUND = 3

_FEWEST_FOR_BOTH = 4
"""Pairs from which on both sizes of the noise are estimated. Of fewer the ratio of the two is that
of the closed form: three pairs have as many rows of translation as unknowns that these can decide,
and the likelihood then grows without limit as their noise goes to zero."""

_MOST = 10.0
"""Largest noise of translation that is estimated, as part of the translations; of rotation, π."""

_LEAST = 1e-9
"""Least noise that is estimated: of rotation [rad], and of translation as part of the translations.
Data without noise have rounding left, which is not independent from pair to pair."""


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
    least = np.stack([np.full(pairs.T, _LEAST), _LEAST * pairs.size])
    most = np.stack([np.full(pairs.T, np.pi), _MOST * pairs.size])
    square = residuals(pairs.A, pairs.B, X, Z) ** 2
    sums = np.stack([square[..., :3].sum(axis=-1), square[..., 3:].sum(axis=-1)])
    sigma = np.sqrt((counted * sums).sum(axis=-1) / _freedom(counted, np.array([[6.0], [6.0]])))
    sigma = np.clip(sigma, least, most)
    count = np.zeros(pairs.T, dtype=np.intp)
    moving = np.ones(pairs.T, dtype=bool)
    for _ in range(_ROUNDS):
        model = estimated_model(pairs, sigma)
        fit = adjust(pairs, model, X, Z, weights=weights, iterations=_STEPS_A_ROUND)
        X, Z, count = fit.X, fit.Z, count + np.where(moving, fit.iterations, 0)
        new = _shown(fit, sigma, counted, widening, (least, most))
        change = np.abs(new / sigma - 1.0).max(axis=0)
        # set by set, so that none depends on its company
        sigma = np.where(moving, new, sigma)
        moving &= change > _SETTLED
        if not moving.any():
            break
    fit = adjust(pairs, estimated_model(pairs, sigma), X, Z, weights=weights)
    fit = replace(fit, iterations=count + fit.iterations, converged=fit.converged & ~moving)
    return fit, sigma


def estimated_model(pairs: PairSets, sigma: FloatArray) -> ErrorModel:
    """Errors of B alone, of rotation and translation ``(2, T)``, no smaller than rounding."""
    least = np.stack([np.full(pairs.T, _LEAST), _LEAST * pairs.size])
    sigma = np.maximum(sigma, least)
    return Isotropic(pairs.spread(np.concatenate([np.zeros_like(sigma), sigma])))


def _shown(
    fit: Fit,
    sigma: FloatArray,
    counted: FloatArray,
    widening: float,
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Noise ``(2, T)`` that the rows of a fit by another show, X and Z moving with it.

    Of the rows of rotation and of translation their squares, gradients and information are all that
    it takes; each time the change shrinks to a tenth or so.
    """
    _, _, T, N = fit.jacobian.shape
    J = fit.jacobian.reshape(12, 2, 3, T, N).transpose(1, 3, 0, 2, 4).reshape(2, T, 12, 3 * N)
    white = fit.white.reshape(2, 3, T, N).transpose(0, 2, 1, 3).reshape(2, T, 3 * N, 1)
    own, right, square = J @ np.swapaxes(J, -1, -2), J @ white, (white**2).sum(axis=(2, 3))
    count = counted.sum(axis=-1)
    few = count < _FEWEST_FOR_BOTH
    new, moving = sigma, np.ones(T, dtype=bool)
    for _ in range(_ROUNDS):
        ratio = (sigma / new) ** 2
        each = ratio[..., None, None]
        covariance = replace(fit, information=(each * own).sum(axis=0)).covariance
        step = -covariance @ (each * right).sum(axis=0)
        rows = np.maximum(square + ((2.0 * right + own @ step) * step).sum(axis=(2, 3)), 0.0)
        taken = (each * own * covariance).sum(axis=(2, 3))
        rows, freedom = ratio * rows, _freedom(counted, taken)
        # of few pairs X and Z may take up one of the two whole: there the ratio stays
        rows = np.where(few, rows.sum(axis=0), rows)
        freedom = np.where(few, np.maximum(6.0 * count - 12.0, 1.0), freedom)
        found = np.clip(new * widening * np.sqrt(rows / freedom), *bounds)
        change = np.abs(found / new - 1.0).max(axis=0)
        # set by set, so that none depends on its company
        new = np.where(moving, found, new)
        moving &= change > _SETTLED
        if not moving.any():
            break
    return new


def _freedom(counted: FloatArray, taken: FloatArray) -> FloatArray:
    """Degrees of freedom ``(2, T)`` of the rows of rotation and of translation."""
    return np.asarray(np.maximum(3.0 * counted.sum(axis=-1) - taken, 1.0))
