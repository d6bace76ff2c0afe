"""Residuals of each pair with X and Z from all the others: what a new pose would show."""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.adjustment import Fit
from calib.robot_world.identifiability import examine
from calib.robot_world.methods import Method
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate, residuals
from calib.se3 import BoolArray, FloatArray

_FEWEST = 4
"""With one of three left out, two are left, which identify nothing."""

_PAIRS_AT_ONCE = 20_000

_ALL_OF_IT = 1e-9
"""Least part of the information, in any direction, that must be left without a pair."""


def left_out_residuals(
    chosen: Method, pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise | None
) -> FloatArray:
    """Residuals ``(N, 6)`` of one set, pair by pair, with X and Z from the others.

    NaN where the others do not identify X and Z. A pair that was left out already has its own.
    """
    residual: FloatArray = residuals(pairs.A, pairs.B, found.X, found.Z)[0]
    if int(used.sum()) < _FEWEST:
        residual[used] = np.nan
        return residual
    if found.fit is not None:
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
    """Residuals ``(N, 6)`` by solving N problems of N - 1 pairs."""
    N = len(A)
    others = np.array([[j for j in range(N) if j != i] for i in range(N)])
    at_once = max(1, _PAIRS_AT_ONCE // N)
    out = np.full((N, 6), np.nan)
    for first in range(0, N, at_once):
        rows = np.arange(first, min(first + at_once, N))
        sets = PairSets(A[others[rows]], B[others[rows]])
        rows = rows[~examine(sets).rank_deficient]
        if rows.size:
            left = chosen.run(PairSets(A[others[rows]], B[others[rows]]), noise)
            out[rows] = residuals(A[rows][:, None], B[rows][:, None], left.X, left.Z)[:, 0]
    return out
