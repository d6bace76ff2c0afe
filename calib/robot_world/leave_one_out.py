"""Residuals of each pair with X and Z from all the others: what a new pose would show."""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.errors_of_pairs import Fit
from calib.robot_world.identifiability import examine
from calib.robot_world.methods import Method
from calib.robot_world.noise import Noise, PairCovariances
from calib.robot_world.pairs import PairSets, own_order
from calib.robot_world.results import Estimate, residuals
from calib.se3 import BoolArray, FloatArray, IntArray

_FEWEST = 4
"""With one of three left out, two are left, which identify nothing."""

_FEW = 5
"""Pairs up to which one of them bears so much that a single step without it falls short."""

_GROUPS, _FEWEST_GROUPS, _PAIRS_IN_ALL = 100, 10, 200_000
"""Of more pairs than these, so many groups are left out one after the other, and fewer where all of
them together would have too many pairs: the time is linear in N. Without a tenth of many pairs X
and Z are as good as without one."""

_PAIRS_AT_ONCE = 20_000

_ALL_OF_IT = 1e-9
"""Least part of the information, in any direction, that must be left without a pair."""


def left_out_residuals(
    chosen: Method, pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise | None
) -> FloatArray:
    """Residuals ``(N, 6)`` of one set, pair by pair, with X and Z from the others.

    NaN where the others do not identify X and Z. A pair that was left out already has its own.
    Without a likelihood, of more than a hundred pairs a hundred groups are left out one by one, and
    of thousands fewer, ten at least.
    """
    residual: FloatArray = residuals(pairs.A, pairs.B, found.X, found.Z)[0]
    if int(used.sum()) < _FEWEST:
        residual[used] = np.nan
        return residual
    each = isinstance(noise, PairCovariances)
    if found.fit is not None and (each or int(used.sum()) > _FEW):
        X, Z = _by_one_step(found.fit)
        error = residuals(pairs.A[0][:, None], pairs.B[0][:, None], X, Z)[:, 0]
        error[np.isnan(error).any(axis=-1)] = np.nan
        residual[used] = error[used]
    else:
        residual[used] = _by_solving(chosen, pairs.A[0, used], pairs.B[0, used], noise)
    return residual


def _by_one_step(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(N, 4, 4)`` without each pair of the first set.

    At the least sum of squares the gradient of all rows is zero, so that without a pair it is the
    opposite of that pair's own. One step from there is enough: the next one is smaller by the size
    of the residual rotations in radians.
    """
    J = fit.jacobian[:, :, 0].transpose(2, 1, 0)  # (N, 6, 12)
    white = fit.white[:, 0].T
    size = np.sqrt(np.diag(fit.information[0]))
    J = J / size
    rest = fit.information[0] / np.outer(size, size) - np.swapaxes(J, -1, -2) @ J
    gradient = np.swapaxes(J, -1, -2) @ white[..., None]
    values, vectors = np.linalg.eigh(rest)
    seen = values[:, 0] > _ALL_OF_IT
    inverse = 1.0 / np.where(values > _ALL_OF_IT, values, 1.0)
    step = (vectors @ (inverse[..., None] * (np.swapaxes(vectors, -1, -2) @ gradient)))[..., 0]
    step = np.where(seen[:, None], step / size, np.nan)
    moved = []
    for T, at in ((fit.X[0], 0), (fit.Z[0], 6)):
        turn = np.where(seen[:, None], step[:, at : at + 3], 0.0)
        R = se3.rotation_exp(turn) @ T[:3, :3]
        moved.append(se3.transform(R, T[:3, 3] + step[:, at + 3 : at + 6]))
    return moved[0], moved[1]


def _by_solving(chosen: Method, A: FloatArray, B: FloatArray, noise: Noise | None) -> FloatArray:
    """Residuals ``(N, 6)`` by solving without each pair, or of many without each group."""
    N = len(A)
    order = own_order(A)
    out = np.full((N, 6), np.nan)
    count = min(N, max(_FEWEST_GROUPS, min(_GROUPS, _PAIRS_IN_ALL // N)))
    # every so many: a stretch of the order has poses of one kind, without which the rest is poorer
    for size, groups in _equal([order[k::count] for k in range(count)]):
        others = np.array([np.setdiff1d(order, group) for group in groups])
        at_once = max(1, _PAIRS_AT_ONCE // N)
        for first in range(0, len(groups), at_once):
            rows = slice(first, first + at_once)
            sets = PairSets(A[others[rows]], B[others[rows]])
            seen = ~examine(sets).rank_deficient
            if seen.any():
                left = chosen.run(PairSets(sets.A[seen], sets.B[seen]), noise)
                own = groups[rows][seen].reshape(-1, size)
                out[own] = residuals(A[own], B[own], left.X, left.Z)
    return out


def _equal(groups: list[IntArray]) -> list[tuple[int, IntArray]]:
    """Groups of equal size together: ``(size, (count, size))``."""
    sizes = {len(group) for group in groups}
    return [(size, np.array([g for g in groups if len(g) == size])) for size in sorted(sizes)]
