"""The best weights by an interior-point method on a part of the pool that grows.

The problem is solved on a working set, by Newton's method with second derivatives; one pass over
the whole pool then proves a bound, and names the candidates that are missing from the set. The cost
of a pass grows with the pool, all else with the working set alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.relaxation.certificate import Certificate
from posedesign.selection.relaxation.relaxation import Relaxation, Smooth, room, sum_of_largest
from posedesign.selection.relaxation.working import best_outside, first_set, threshold

MOST_ROUNDS = 40
"""Working sets: a bound on work that ends by itself, when nothing outside the set is wanted."""

MOST_STEPS = 60
"""Newton steps on one working set; eight or nine were seen from equal weights."""

INNER = 0.2
"""Part of the tolerance to which a working set is solved."""

NEXT_IN_LINE = 0.8
"""Part of the least score that is chosen from which candidates are taken into the set."""

AT_ZERO = 1e-6
"""Weights below do not count, and leave the working set."""


Minimise = Callable[[Candidates, float], tuple[FloatArray, Smooth]]


class SmoothObjective(Protocol):
    """What is minimised here."""

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost, with its derivatives."""

    def certificate_of(self, smooth: Smooth) -> Certificate:
        """The proof that the derivative at some weights gives."""


@dataclass
class _Best:
    """The strongest proof so far."""

    bound: float = 0.0
    certificate: Certificate | None = None


def relax_smooth(
    objective: SmoothObjective, candidates: Candidates, count: int, tolerance: float
) -> Relaxation:
    """The best weights, and a bound that is within a part ``tolerance`` of what they cost."""

    def minimise(part: Candidates, sharp: float) -> tuple[FloatArray, Smooth]:
        return _minimise(objective, part, count, sharp)

    return relax_by(minimise, objective.certificate_of, candidates, count, tolerance)


def relax_by(
    minimise: Minimise,
    certificate_of: Callable[[Smooth], Certificate],
    candidates: Candidates,
    count: int,
    tolerance: float,
) -> Relaxation:
    """The best weights by any method that solves working sets.

    ``minimise``: of a working set and a tolerance: weights, and the cost with its derivatives
    there. ``certificate_of``: the proof that these give. ``count``: above 0, and less than there
    are candidates.
    """
    N = candidates.N
    working = _first(candidates, count)
    best = _Best()
    for _ in range(MOST_ROUNDS):
        part = candidates.take(working)
        weights, smooth = minimise(part, INNER * tolerance)
        proof = certificate_of(smooth)
        bound = proof.bound(candidates, count)
        if bound > best.bound:
            best = _Best(bound, proof)
        if best.bound >= (1.0 - tolerance) * smooth.cost:
            break
        grown = _grown(candidates, working, weights, smooth.Z, count)
        if grown is None:
            break  # the set has all that could help: what is left is the precision of the steps
        working = grown
    out = np.zeros(N)
    out[working] = weights
    return Relaxation(out, smooth.cost, best.certificate, best.bound)


def _first(candidates: Candidates, count: int) -> IntArray:
    return first_set(candidates, max(3 * count, 4 * candidates.p, 60))


def _grown(
    candidates: Candidates, working: IntArray, weights: FloatArray, Z: FloatArray, count: int
) -> IntArray | None:
    """The working set with the best of the rest, and without what does not count.

    None where nothing outside it would be taken.
    """
    scores = candidates.scores(Z)
    # those next in line, too: they will be wanted once the first have been taken in
    added = best_outside(scores, working, count, max(2 * count, 3 * candidates.p, 60))
    if added is None:
        return None
    least = threshold(scores, count)
    added = added[scores[added] > NEXT_IN_LINE * least]
    counts = (weights > AT_ZERO) | (scores[working] >= least)
    return np.sort(np.concatenate([working[counts], added]))


def _minimise(
    objective: SmoothObjective, part: Candidates, count: int, tolerance: float
) -> tuple[FloatArray, Smooth]:
    """Primal-dual Newton steps for weights ``(n,)`` in 0 .. 1 whose sum is ``count``.

    From equal weights every time: from those of the set before, near the walls, it takes twice the
    steps.
    """
    n = part.N
    # the distance to 1 is kept apart: a difference would round to zero
    w = np.full(n, count / n)
    rest = 1.0 - w
    smooth = objective.smooth(part, w)
    scores = part.scores(smooth.Z)
    known = float(np.sum(smooth.Z * part.known))
    mu = 0.1 * float(scores.mean()) * min(1.0, count / n)
    low, high = mu / w, mu / rest
    for _ in range(MOST_STEPS):
        gap = known + sum_of_largest(scores, count) - (known + scores @ w)
        complementarity = float(w @ low + rest @ high) / (2 * n)
        if gap <= tolerance:
            break
        target = 0.1 * complementarity
        right = scores + target / w - target / rest
        try:
            dw = _step(smooth.curvature, low / w + high / rest, right, count - w.sum())
        except np.linalg.LinAlgError:
            break  # so near to the walls that rounding decides; what is proven so far stays
        d_low = target / w - low - low / w * dw
        d_high = target / rest - high + high / rest * dw
        length = min(room(w, dw), room(rest, -dw))
        dual = min(room(low, d_low), room(high, d_high))
        w, rest = w + length * dw, rest - length * dw
        low, high = low + dual * d_low, high + dual * d_high
        smooth = objective.smooth(part, w)
        scores = part.scores(smooth.Z)
        known = float(np.sum(smooth.Z * part.known))
    return w, smooth


def _step(
    curvature: FloatArray, walls: FloatArray, right: FloatArray, missing: float
) -> FloatArray:
    """Newton step ``(n,)`` of the weights that adds what is ``missing`` to their sum."""
    matrix = curvature.copy()
    matrix[np.diag_indices(len(walls))] += walls
    factor = scipy.linalg.cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    both = np.column_stack([right, np.ones(len(walls))])
    a, b = scipy.linalg.cho_solve(factor, both, check_finite=False).T
    return np.asarray(a + (missing - a.sum()) / b.sum() * b)
