"""The best weights where the cost is not smooth: the longest axis, and conditions.

Matrix inequalities on working sets that grow as in :mod:`~posedesign.selection.relaxation.barrier`.
What the method returns is only believed as far as the proof that its dual gives.
"""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.relaxation.certificate import ConditionCertificate, MeanCertificate
from posedesign.selection.relaxation.relaxation import Relaxation
from posedesign.selection.relaxation.semidefinite import Inequality, Program
from posedesign.selection.relaxation.working import best_outside, first_set, threshold

MOST_ROUNDS = 30
"""Working sets; about eight are seen."""

MOST_RATIOS = 25
"""Ratios tried in the search for the smallest; about six are seen."""

INNER = 0.3
"""Part of the tolerance to which a working set is solved."""

SEEN = 1e-3
"""Weights above are taken to count; the method leaves others a little above zero."""

HOPELESS = 1e14
"""Ratio from which nothing is tried: eigenvalues so far apart are rounding."""

DECIDED = 0.1
"""Part of the slack at which a trial of a ratio has said what it can."""


def relax_smallest(
    candidates: Candidates, K: FloatArray, count: int, tolerance: float
) -> Relaxation:
    """The weights with the largest smallest eigenvalue of the information about ``Kᵀ x``.

    ``max t`` with ``M(w) - t K Kᵀ`` positive semidefinite; its dual variable is the proof.
    """
    proof = MeanCertificate(np.eye(candidates.p), K, np.inf)
    bound = proof.bound(candidates, count)
    working = _start(candidates, count)
    for _ in range(MOST_ROUNDS):
        part = candidates.take(working)
        w, Z, cost = _smallest(part, K, count, INNER * tolerance)
        own = MeanCertificate(Z, K, np.inf)
        reached = own.bound(candidates, count)
        if reached > bound:
            proof, bound = own, reached
        grown = _grown(working, w, candidates.scores(Z), count)
        if bound >= (1.0 - tolerance) * cost or grown is None:
            break
        working = grown
    return Relaxation(_spread(candidates.N, working, w), cost, proof, bound)


def _smallest(
    part: Candidates, K: FloatArray, count: int, tolerance: float
) -> tuple[FloatArray, FloatArray, float]:
    """Weights, the dual, and the cost, on a working set."""

    def cost_of(w: FloatArray) -> float:
        return float(np.linalg.eigvalsh(K.T @ np.linalg.solve(part.weighted(w), K))[-1])

    best_w = np.full(part.N, min(1.0, count / part.N))
    best, proven, best_Z = cost_of(best_w), 0.0, np.eye(part.p)
    if count >= part.N:
        return best_w, best_Z, best
    B = K @ K.T / (2.0 * best)  # in units of which the first t is 1
    M = part.weighted(best_w)
    program = Program(part, count, [Inequality(1.0, -B[None])], np.array([-1.0]))
    mu = 1.0 / float(np.sum(np.linalg.inv(M - B) * B))
    for point in program.points(best_w, np.ones(1), mu):
        found = cost_of(point.w)
        if found < best:
            best, best_w = found, point.w
        reached = MeanCertificate(point.Y[0], K, np.inf).bound(part, count)
        if reached > proven:
            proven, best_Z = reached, point.Y[0]
        if proven >= (1.0 - tolerance) * best:
            break
    return best_w, best_Z, best


def relax_condition(
    candidates: Candidates,
    count: int,
    tolerance: float,
    lowest: FloatArray,
    highest: FloatArray,
    *,
    root: bool,
) -> Relaxation:
    """The weights with the smallest ratio of extreme eigenvalues, parameters rescaled at best.

    ``F <= M(w) <= ratio F`` with a diagonal F between the bounds, up to a common factor: for a
    given ratio a linear program over matrices. The solution of one ratio has a smaller one of its
    own, its duals prove another, and the next ratio tried lies between the two.

    ``lowest``, ``highest`` (p,): between which the squares of the scales lie. ``root``: the cost is
    the root of the ratio.
    """
    tolerance = 2.0 * tolerance if root else tolerance
    bound, proof = (
        0.0,
        ConditionCertificate(np.eye(candidates.p), np.eye(candidates.p), lowest, highest),
    )
    working = _start(candidates, count)
    for _ in range(MOST_ROUNDS):
        search = _RatioSearch(candidates.take(working), count, lowest, highest)
        search.run(INNER * tolerance)
        own = ConditionCertificate(search.Y, search.Z, lowest, highest)
        reached = own.bound(candidates, count)
        if reached > bound:
            proof, bound = own, reached
        # what raises the small eigenvalues more than it raises the large ones is wanted
        scores = candidates.scores(search.Y) - candidates.scores(search.Z) / search.proven
        grown = _grown(working, search.w, scores, count)
        if bound >= (1.0 - tolerance) * search.ratio or grown is None:
            break
        working = grown
    weights = _spread(candidates.N, working, search.w)
    if root:
        return Relaxation(
            weights, float(np.sqrt(search.ratio)), _Root(proof), float(np.sqrt(bound))
        )
    return Relaxation(weights, search.ratio, proof, bound)


class _Root(ConditionCertificate):
    """The proof for the root of a ratio."""

    def __init__(self, proof: ConditionCertificate) -> None:
        super().__init__(proof.Y, proof.Z, proof.lowest, proof.highest)

    def bound(self, candidates: Candidates, count: int) -> float:
        return float(np.sqrt(super().bound(candidates, count)))


class _RatioSearch:
    """The smallest ratio on a working set.

    ``w`` (n,): the best weights found. ``ratio``: of these. ``Y``, ``Z`` (p, p): duals of the
    strongest proof, on the working set. ``proven``: what it proves there.
    """

    def __init__(
        self, part: Candidates, count: int, lowest: FloatArray, highest: FloatArray
    ) -> None:
        self._part, self._count = part, count
        self._lowest, self._highest = lowest, highest
        self._shape, self._rows, start = _diagonals(lowest, highest)
        self.w = np.full(part.N, min(1.0, count / part.N))
        if not np.isfinite(highest).all():
            start = np.diag(part.weighted(self.w))
        self._f = self._fitted(self.w, start)
        self.ratio = self._own(self.w, self._f)
        self.Y = self.Z = np.eye(part.p)
        self.proven = 1.0

    def _fitted(self, w: FloatArray, f: FloatArray) -> FloatArray:
        """Unknowns of a diagonal F, times what makes it as large as it may be below ``M(w)``."""
        scale = np.sqrt(f @ self._shape)
        values = np.linalg.eigvalsh(self._part.weighted(w) / np.outer(scale, scale))
        return np.asarray(f * max(values[0], np.finfo(float).eps * values[-1]))

    def _own(self, w: FloatArray, f: FloatArray) -> float:
        F = f @ self._shape
        if not (F > 0.0).all():
            return np.inf
        scale = np.sqrt(F)
        values = np.linalg.eigvalsh(self._part.weighted(w) / np.outer(scale, scale))
        return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf

    def run(self, tolerance: float) -> None:
        """Try ratios until the best is as small as what is proven, but for a part ``tolerance``."""
        if self._count >= self._part.N or not self.ratio < HOPELESS:
            return
        for _ in range(MOST_RATIOS):
            before = (self.ratio, self.proven)
            self._try(float(np.sqrt(self.ratio * max(self.proven, self.ratio / 16.0))), tolerance)
            if self.proven >= (1.0 - tolerance) * self.ratio or (self.ratio, self.proven) == before:
                break

    def _try(self, ratio: float, tolerance: float) -> None:
        """Look for ``F <= M(w) <= ratio F``, with as little slack as there must be."""
        part, q = self._part, len(self._shape)
        w0 = 0.9 * self.w + 0.1 * self._count / part.N  # off the walls
        f0 = self._fitted(w0, self._f)
        F = f0 @ self._shape
        diagonal = np.zeros((q + 1, part.p, part.p))
        j = np.arange(part.p)
        diagonal[:q, j, j] = self._shape
        below, above = -diagonal, diagonal.copy()
        below[q, j, j] = above[q, j, j] = F
        rules = [Inequality(1.0, below), Inequality(-1.0 / ratio, above)]
        cost = np.concatenate([np.zeros(q), [1.0]])
        rows = np.column_stack([self._rows, np.zeros(len(self._rows))])
        program = Program(part, self._count, rules, cost, rows)
        slack = max(0.5, 2.0 * self._own(w0, f0) / ratio)
        M = part.weighted(w0)
        inside = [M + np.diag((slack - 1.0) * F), np.diag((1.0 + slack) * F) - M / ratio]
        mu = 1.0 / sum(float(np.diag(np.linalg.inv(S)) @ F) for S in inside)
        for point in program.points(w0, np.concatenate([f0, [slack]]), mu):
            own = self._own(point.w, point.x[:q])
            if own < self.ratio:
                self.ratio, self.w, self._f = own, point.w, point.x[:q]
            reached = ConditionCertificate(
                point.Y[0], point.Y[1], self._lowest, self._highest
            ).bound(part, self._count)
            if reached > self.proven:
                self.proven, (self.Y, self.Z) = reached, point.Y
            if self.proven >= (1.0 - tolerance) * self.ratio:
                break
            if point.gap <= DECIDED * abs(point.x[q]):
                break


def _diagonals(
    lowest: FloatArray, highest: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unknowns of which a diagonal between bounds, up to a common factor, is made.

    Returns ``shape`` (q, p): the diagonal for each unknown. ``rows`` (l, q): of what must not be
    negative. ``start`` (q,): unknowns in the middle.
    """
    p = len(lowest)
    if not np.isfinite(highest).all():
        return np.eye(p), np.zeros((0, p)), np.ones(p)
    free = np.flatnonzero(highest - lowest > 1e-6 * highest)
    fixed = np.ones(p, dtype=bool)
    fixed[free] = False
    shape = np.zeros((1 + len(free), p))
    shape[0] = np.where(fixed, highest, 0.0)
    shape[1 + np.arange(len(free)), free] = 1.0
    k = np.arange(len(free))
    rows = np.zeros((2 * len(free), 1 + len(free)))
    rows[k, 1 + k], rows[k, 0] = 1.0, -lowest[free]
    rows[len(free) + k, 1 + k], rows[len(free) + k, 0] = -1.0, highest[free]
    start = np.concatenate([[1.0], (lowest[free] + highest[free]) / 2.0])
    return shape, rows, start


def _start(candidates: Candidates, count: int) -> IntArray:
    return first_set(candidates, max(4 * count, 6 * candidates.p, 100))


def _grown(working: IntArray, w: FloatArray, scores: FloatArray, count: int) -> IntArray | None:
    """The working set with the best of the rest; None where nothing outside would be taken."""
    added = best_outside(scores, working, count, max(2 * count, 60))
    if added is None:
        return None
    kept = working[(w > SEEN) | (scores[working] >= threshold(scores, count))]
    return np.sort(np.concatenate([kept, added]))


def _spread(N: int, working: IntArray, w: FloatArray) -> FloatArray:
    weights = np.zeros(N)
    weights[working] = w
    return weights
