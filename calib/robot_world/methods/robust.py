"""The likeliest X and Z of the pairs that agree, and which pairs those are.

Many sets of a few pairs each are solved in closed form, so that no gross error has a say in where
the search starts; the one whose better half of residuals is the smallest wins (least median of
squares, Rousseeuw 1984). From there the pairs that the noise explains are taken, X and Z are
adjusted to them, and both again, until the choice stands still. Where the noise is unknown it is
what the chosen pairs show, made up for what choosing by size cuts off.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from calib.chance import chi2_quantile, chi2_tail, f_bound
from calib.robot_world.adjustment import adjust, linear_rows
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.estimate import Estimate, Fit, residuals
from calib.robot_world.methods.maximum_likelihood import (
    as_estimate,
    with_estimated_noise,
)
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets, own_order
from calib.robot_world.sizes import estimated_model
from calib.se3 import BoolArray, FloatArray, IntArray

CHANCE = 1e-3
"""Probability that a good pair is left out: three numbers of rotation, three of translation."""

DRAWS = 200
"""Sets of pairs that are tried: with two of five pairs wrong, all of them have a wrong one with a
probability of 1e-12."""

_DRAWN = 4
"""Pairs in each: one more than the fewest, since three often turn about nearly one axis."""

_BEST = 8
"""Candidates that are refined on their better halves before one is chosen."""

_ROUNDS = 30
_SETS_AT_ONCE, _RESIDUALS_AT_ONCE = 4000, 10_000

_KEPT = 1.0 - CHANCE


@cache
def widening() -> float:
    """Standard deviation over what those of six normal numbers show that are left.

    The sum of their squares may not exceed its quantile: E[s | s < c] / 6 = F_8(c) / F_6(c).
    """
    return float(np.sqrt(_KEPT / (1.0 - chi2_tail(chi2_quantile(_KEPT, 6), 8))))


@cache
def _median_square(count: int) -> float:
    """Median sum of the squares of so many normal numbers."""
    return float(chi2_quantile(0.5, count))


_TINY_SHARE = 1e-9
"""Added to 1 - H: a pair without which X and Z are not identified has no residual of its own."""

_TINY = 1e-300
"""What stands for zero where data without noise leave nothing."""


def estimate(pairs: PairSets, noise: Noise | None = None) -> Estimate:
    """X and Z of T problems at once, from the pairs that agree; weights are 0 for those left out.

    Without a noise it is estimated, on B. Of fewer than five pairs none can be told to be wrong.
    The draws are always the same ones, so that a result can be had again.
    """
    X, Z = _consensus(pairs)
    first = estimated_model(pairs, _shown(pairs, X, Z)) if noise is None else noise.model(pairs)
    used = _near(pairs, first, X, Z)
    fit, sigma = _fitted(pairs, noise, X, Z, used)
    moving = np.arange(pairs.T)
    for _ in range(_ROUNDS):
        now = _explained(_sets(pairs, moving), noise, sigma, fit.of(moving), used[moving], moving)
        changed = (now != used[moving]).any(axis=1)
        moving = moving[changed]
        if not moving.size:
            break
        used[moving] = now[changed]
        again, shown = _fitted(
            _sets(pairs, moving), noise, fit.X[moving], fit.Z[moving], used[moving]
        )
        fit = fit.with_others(moving, again)
        if sigma is not None and shown is not None:
            sigma[:, moving] = shown
    return as_estimate(fit, sigma, used.astype(float))


def _sets(pairs: PairSets, trials: IntArray) -> PairSets:
    return pairs if len(trials) == pairs.T else PairSets(pairs.A[trials], pairs.B[trials])


def _fitted(
    pairs: PairSets, noise: Noise | None, X: FloatArray, Z: FloatArray, used: BoolArray
) -> tuple[Fit, FloatArray | None]:
    """Adjust X and Z to the pairs used, and the noise where it is unknown."""
    weights = used.astype(float)
    if noise is None:
        return with_estimated_noise(pairs, X, Z, weights, widening())
    return adjust(pairs, noise.model(pairs), X, Z, weights=weights), None


def _consensus(pairs: PairSets) -> tuple[FloatArray, FloatArray]:
    """Starts X and Z ``(T, 4, 4)`` in which gross errors have no say."""
    T, N = pairs.T, pairs.N
    rng = np.random.default_rng(0)
    few = min(_DRAWN, N)
    draws = np.argsort(rng.random((DRAWS, N)), axis=1)[:, :few]
    at_once = max(1, _SETS_AT_ONCE // DRAWS)
    X, Z = np.empty((2, T, 4, 4))
    for first in range(0, T, at_once):
        rows = slice(first, min(first + at_once, T))
        # so that the same pairs are drawn in whatever order they come
        order = own_order(pairs.A[rows])[..., None, None]
        A, B = (np.take_along_axis(T[rows], order, axis=1) for T in (pairs.A, pairs.B))
        candidates = _solved(A, B, np.tile(draws, (len(A), 1, 1)))
        for kept in (_BEST, _BEST, 1):
            best = _best(A, B, *candidates, kept)
            candidates = (
                np.take_along_axis(candidates[0], best[..., None, None], axis=1),
                np.take_along_axis(candidates[1], best[..., None, None], axis=1),
            )
            if kept > 1:
                candidates = _solved(A, B, _better_half(A, B, *candidates))
        X[rows], Z[rows] = candidates[0][:, 0], candidates[1][:, 0]
    return X, Z


def _solved(A: FloatArray, B: FloatArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(T, K, 4, 4)`` of the pairs ``(T, K, few)`` of sets ``(T, N, 4, 4)``."""
    T, K, few = index.shape
    trial = np.arange(T)[:, None, None]
    drawn = (M[trial, index].reshape(T * K, few, 4, 4) for M in (A, B))
    sets = PairSets(*drawn, tentative=True)
    X, Z = sets.rotations_first
    return X.reshape(T, K, 4, 4), Z.reshape(T, K, 4, 4)


def _sizes(
    A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residual angles and distances ``(T, K, N)`` of candidates ``(T, K, 4, 4)``."""
    T, K, N = *X.shape[:2], A.shape[1]
    angle, distance = np.empty((2, T, K, N))
    at_once = max(1, _RESIDUALS_AT_ONCE // (T * N))
    # columns by rows, and rows by columns, with the pairs last
    of_A = A[..., :3, :].transpose(0, 3, 2, 1).reshape(T, 4, 3 * N)
    of_B = B.transpose(0, 2, 3, 1).reshape(T, 4, 4 * N)
    for first in range(0, K, at_once):
        some = slice(first, first + at_once)
        AX = np.swapaxes(X[:, some], -1, -2).reshape(T, -1, 4) @ of_A
        ZB = Z[:, some, :3].reshape(T, -1, 4) @ of_B
        off = AX.reshape(T, -1, 4, 3, N) - ZB.reshape(T, -1, 3, 4, N).swapaxes(2, 3)
        off *= off
        square = off.sum(axis=3)
        distance[:, some] = np.sqrt(square[:, :, 3])
        # the chord |R - 1|_F of a rotation by θ is √8 sin(θ/2)
        half_sine = np.sqrt(np.minimum(square[:, :, :3].sum(axis=2) / 8.0, 1.0))
        angle[:, some] = 2.0 * np.arcsin(half_sine)
    return angle, distance


def _half(count: int) -> int:
    """Pairs that are taken to be good: more than half, by half of the fewest."""
    return min((count + 4) // 2, count)


def _best(A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, kept: int) -> IntArray:
    """The candidates ``(T, kept)`` whose better halves are smallest, in rotation times distance."""
    half = _half(A.shape[1])
    value = np.zeros(X.shape[:2])
    for size in _sizes(A, B, X, Z):
        value += np.log(np.partition(size, half - 1, axis=-1)[..., half - 1] + _TINY)
    return np.asarray(np.argsort(value, axis=1)[:, :kept])


def _better_half(A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray) -> IntArray:
    """Indices ``(T, K, half)`` of the pairs that candidates fit best."""
    half = _half(A.shape[1])
    worse = np.zeros((*X.shape[:2], A.shape[1]))
    for size in _sizes(A, B, X, Z):
        median = np.partition(size, half - 1, axis=-1)[..., half - 1 : half]
        worse = np.maximum(worse, size / (median + _TINY))
    return np.asarray(np.argsort(worse, axis=-1)[..., :half])


def _shown(pairs: PairSets, X: FloatArray, Z: FloatArray) -> FloatArray:
    """Noise of rotation and translation ``(2, T)`` by the median residual of candidates."""
    error = residuals(pairs.A, pairs.B, X, Z)
    sizes = [np.linalg.norm(error[..., part], axis=-1) for part in (slice(0, 3), slice(3, 6))]
    return np.stack([np.median(size, axis=1) / np.sqrt(_median_square(3)) for size in sizes])


def _near(pairs: PairSets, model: ErrorModel, X: FloatArray, Z: FloatArray) -> BoolArray:
    """Pairs ``(T, N)`` whose residuals by candidates the noise explains, or as the median shows.

    The candidates are worse than the noise, and a noise given may be too small for all.
    """
    square = (linear_rows(pairs, model, X, Z)[0] ** 2).sum(axis=0)
    return np.asarray(square <= _more(square) * chi2_quantile(_KEPT, 6))


def _explained(
    pairs: PairSets,
    noise: Noise | None,
    sigma: FloatArray | None,
    fit: Fit,
    used: BoolArray,
    trials: IntArray,
) -> BoolArray:
    """Pairs ``(T, N)`` whose residuals the noise explains, when X and Z are from those used.

    Each pair is held against X and Z of the others: residuals of pairs that had a say in them are
    smaller than the noise, those of pairs that had none are larger. With H what X and Z add,
    ``r (1 - H)⁻¹ r`` and ``r (1 + H)⁻¹ r`` are χ² of 6 degrees of freedom, or 6 F where the noise
    is estimated from the pairs used.
    """
    if sigma is not None:
        model = estimated_model(pairs, sigma[:, trials])
    elif noise is not None:
        model = noise.model(pairs)
    rows, J = linear_rows(pairs, model, fit.X, fit.Z)
    r, J = rows.transpose(1, 2, 0), J.transpose(2, 3, 1, 0)  # (T, N, 6), (T, N, 6, 12)
    H = J @ fit.covariance[:, None] @ np.swapaxes(J, -1, -2)
    spread = np.eye(6) * (1.0 + _TINY_SHARE) + np.where(used, -1.0, 1.0)[..., None, None] * H
    square = (r * _divided(r, spread)).sum(axis=-1)
    if sigma is None:
        return np.asarray(square <= _more(square) * chi2_quantile(_KEPT, 6))
    # the white rows of the pairs used have a mean square of one: the rest of them shows the noise
    freedom = 6.0 * used.sum(axis=1, keepdims=True) - 12.0
    left = freedom / widening() ** 2 - np.where(used, square, 0.0)
    others = freedom - 6.0 * used
    told = others > 0.0
    bound = f_bound(CHANCE, 6.0, np.where(told, others, 1.0))
    return np.asarray(~told | (square * others <= 6.0 * bound * np.maximum(left, 0.0)))


def _divided(r: FloatArray, spread: FloatArray) -> FloatArray:
    """``spread⁻¹ r`` of vectors ``(T, N, 6)``.

    Pairs that identify nothing can make a matrix singular to the last bit; what becomes of them is
    told by the rank of their equations, later and by name.
    """
    try:
        return np.asarray(np.linalg.solve(spread, r[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(np.nan_to_num(spread)) @ r[..., None])[..., 0])


def _more(square: FloatArray) -> FloatArray:
    """Factor ``(T, 1)`` by which the median of sums of six squares ``(T, N)`` exceeds its own."""
    median = np.median(square, axis=-1, keepdims=True)
    return np.asarray(np.maximum(median / _median_square(6), 1.0))
