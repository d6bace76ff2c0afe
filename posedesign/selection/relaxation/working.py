"""The part of a pool that a relaxation is solved on, and how it grows.

At the optimum few candidates count in part: no more than there are entries in the information
matrix. One pass over the whole pool names those that are missing from the set.
"""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates

WELL_SEEN = 1e-2
"""Part of the pool's mean information that the first set has in every direction: a parameter that
few of a large pool see may be missing from a few drawn at random."""

AS_GOOD = 1e-12
"""Part by which a score may be below the least that is chosen and still be called as good."""


def first_set(candidates: Candidates, size: int) -> IntArray:
    """Candidates to begin with: spread over the pool, so that they see what the pool sees."""
    N = candidates.N
    if size >= N:
        return np.arange(N)
    # fixed: the same pool gives the same choice
    inside = np.zeros(N, dtype=bool)
    inside[np.random.default_rng(0).choice(N, size, replace=False)] = True
    values, vectors = np.linalg.eigh(candidates.whole / N)
    unit = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    for _ in range(candidates.p):
        M = candidates.take(np.flatnonzero(inside)).weighted(np.ones(int(inside.sum())))
        seen, directions = np.linalg.eigh(unit.T @ M @ unit / size)
        poor = unit @ directions[:, seen < WELL_SEEN]
        if not poor.shape[1]:
            break
        scores = np.where(inside, -1.0, candidates.scores(poor @ poor.T))
        inside[np.argpartition(scores, N - candidates.p)[N - candidates.p :]] = True
        if inside.all():
            break
    return np.flatnonzero(inside)


def threshold(scores: FloatArray, count: int) -> float:
    """The least of the ``count`` largest scores, ``count`` above zero."""
    return float(np.partition(scores, len(scores) - count)[len(scores) - count])


def best_outside(scores: FloatArray, working: IntArray, count: int, take: int) -> IntArray | None:
    """Candidates outside the working set that score best, up to ``take``.

    None where none of them would be among the ``count`` best.
    """
    outside = scores.copy()
    outside[working] = -np.inf
    least = threshold(scores, count)
    if not (outside >= least - AS_GOOD * abs(least)).any():
        return None
    take = min(take, len(scores) - len(working))
    return np.argpartition(outside, len(scores) - take)[len(scores) - take :]
