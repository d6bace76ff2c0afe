"""The best weights by semidefinite programming, where the cost is not smooth: E and conditions.

cvxpy with Clarabel, on working sets that grow as in :mod:`~posedesign.selection.relaxation.barrier`.
What the solver returns is only believed as far as the proof that its dual gives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.relaxation.certificate import ConditionCertificate, MeanCertificate
from posedesign.selection.relaxation.relaxation import Relaxation

if TYPE_CHECKING:
    import cvxpy as cp

MOST_ROUNDS = 12
"""Working sets; about five are seen."""

MOST_RATIOS = 25
"""Ratios tried in the search for the smallest; about five are seen."""

SEEN = 1e-7
"""Weights above are taken to count; the solver leaves others a little above zero."""


def relax_smallest(
    candidates: Candidates, K: FloatArray, count: int, tolerance: float
) -> Relaxation:
    """The weights with the largest smallest eigenvalue of the information about ``Kᵀ x``.

    ``max t`` with ``M(w) - t K Kᵀ`` positive semidefinite; its dual variable is the proof.
    """
    proof = MeanCertificate(np.eye(candidates.p), K, np.inf)
    bound = proof.bound(candidates, count)
    working, weights, cost = _start(candidates, count), np.zeros(candidates.N), np.inf
    for _ in range(MOST_ROUNDS):
        part = candidates.take(working)
        found = _smallest(part, K, min(count, part.N))
        if found is None:
            break
        w, Z = found
        weights = _spread(candidates.N, working, w)
        C = np.linalg.inv(part.weighted(w))
        cost = min(cost, float(np.linalg.eigvalsh(K.T @ C @ K)[-1]))
        candidate = MeanCertificate(Z, K, np.inf)
        if candidate.bound(candidates, count) > bound:
            proof, bound = candidate, candidate.bound(candidates, count)
        grown = _grown(working, w, candidates.scores(Z), count)
        if bound >= (1.0 - tolerance) * cost or grown is None:
            break
        working = grown
    return Relaxation(weights, cost, proof, bound)


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
    given ratio a semidefinite program. The solution of one ratio has a smaller one of its own, which
    is tried next; the duals of each give a proof.

    Parameters
    ----------
    candidates : Candidates
    count : int
    tolerance : float
    lowest, highest : ndarray (p,)
        Between which the squares of the scales lie.
    root : bool
        The cost is the root of the ratio.
    """
    bound, proof = 1.0, None
    working, weights, cost = _start(candidates, count), np.zeros(candidates.N), np.inf
    for _ in range(MOST_ROUNDS):
        part = candidates.take(working)
        found = _ratio(part, min(count, part.N), lowest, highest, tolerance)
        if found is None:
            break
        w, Y, Z, cost = found
        weights = _spread(candidates.N, working, w)
        candidate = ConditionCertificate(Y, Z, lowest, highest)
        reached = candidate.bound(candidates, count)
        if reached > bound or proof is None:
            proof, bound = candidate, max(bound, reached)
        # what raises the small eigenvalues more than it raises the large ones is wanted
        grown = _grown(working, w, candidates.scores(Y) - candidates.scores(Z) / cost, count)
        if bound >= (1.0 - tolerance) * cost or grown is None:
            break
        working = grown
    if root and proof is not None:
        return Relaxation(weights, float(np.sqrt(cost)), _Root(proof), float(np.sqrt(bound)))
    return Relaxation(weights, cost, proof, bound)


class _Root(ConditionCertificate):
    """The proof for the root of a ratio."""

    def __init__(self, proof: ConditionCertificate) -> None:
        super().__init__(proof.Y, proof.Z, proof.lowest, proof.highest)

    def bound(self, candidates: Candidates, count: int) -> float:
        """See :meth:`Certificate.bound`."""
        return float(np.sqrt(super().bound(candidates, count)))


def _start(candidates: Candidates, count: int) -> IntArray:
    size = min(candidates.N, max(4 * count, 6 * candidates.p, 100))
    if size == candidates.N:
        return np.arange(size)
    return np.sort(np.random.default_rng(0).choice(candidates.N, size, replace=False))


def _grown(working: IntArray, w: FloatArray, scores: FloatArray, count: int) -> IntArray | None:
    """The working set with the best of the rest; None where nothing outside would be taken."""
    inside = np.zeros(len(scores), dtype=bool)
    inside[working] = True
    least = np.partition(scores, len(scores) - count)[len(scores) - count] if count else 0.0
    outside = np.where(inside, -np.inf, scores)
    if not (outside > least).any():
        return None
    take = min(max(2 * count, 60), int((~inside).sum()))
    added = np.argpartition(outside, len(scores) - take)[len(scores) - take :]
    kept = working[(w > SEEN) | (scores[working] >= least)]
    return np.sort(np.concatenate([kept, added]))


def _spread(N: int, working: IntArray, w: FloatArray) -> FloatArray:
    weights = np.zeros(N)
    weights[working] = np.clip(w, 0.0, 1.0)
    return weights


def _information(part: Candidates, w: cp.Variable) -> cp.Expression:
    """``M(w)`` as an expression: one product, however many candidates."""
    import cvxpy as cp

    each = np.swapaxes(part.J, 1, 2) @ part.J
    flat = each.reshape(part.N, -1)
    return cp.reshape(flat.T @ w, (part.p, part.p), order="C") + part.known


def _smallest(part: Candidates, K: FloatArray, count: int) -> tuple[FloatArray, FloatArray] | None:
    import cvxpy as cp

    w, t = cp.Variable(part.N), cp.Variable()
    size = float(np.linalg.eigvalsh(K @ K.T)[-1])
    above = _information(part, w) - t * (K @ K.T) / size >> 0
    problem = cp.Problem(cp.Maximize(t), [above, w >= 0.0, w <= 1.0, cp.sum(w) == count])
    if not _solved(problem) or above.dual_value is None:
        return None
    return np.asarray(w.value), np.asarray(above.dual_value)


def _ratio(
    part: Candidates, count: int, lowest: FloatArray, highest: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray, FloatArray, float] | None:
    """Weights, the two duals, and the ratio, on a working set."""
    import cvxpy as cp

    w, F, unit = cp.Variable(part.N), cp.Variable(part.p), cp.Variable()
    slack = cp.Variable()
    ratio = cp.Parameter(nonneg=True)
    M = _information(part, w)
    # a diagonal that is bounded below, so that nothing is solved by making it vanish
    below = M - cp.diag(F) + slack * np.eye(part.p) >> 0
    inverse = cp.Parameter(nonneg=True)
    above = cp.diag(F) - inverse * M + slack * np.eye(part.p) >> 0
    rules = [below, above, w >= 0.0, w <= 1.0, cp.sum(w) == count, unit >= 0.0]
    bounded = np.isfinite(highest)
    if bounded.any():
        rules += [F[bounded] <= unit * highest[bounded]]
    rules += [unit * lowest <= F] if lowest.any() else [F >= 0.0]
    problem = cp.Problem(cp.Minimize(slack), rules)
    best: tuple[FloatArray, FloatArray, FloatArray, float] | None = None
    trial = _own_ratio(part, np.full(part.N, count / part.N), np.sqrt(np.diag(part.whole)))
    proven = 1.0
    for _ in range(MOST_RATIOS):
        ratio.value = trial
        inverse.value = 1.0 / trial
        if not _solved(problem) or below.dual_value is None:
            break
        weights = np.clip(np.asarray(w.value), 0.0, 1.0)
        Y, Z = np.asarray(below.dual_value), np.asarray(above.dual_value)
        proven = max(proven, ConditionCertificate(Y, Z, lowest, highest).bound(part, count))
        own = _own_ratio(part, weights, np.sqrt(np.maximum(F.value, 1e-300)))
        if best is None or own < best[3]:
            best = (weights, Y, Z, own)
        if proven >= (1.0 - 0.3 * tolerance) * best[3]:
            break
        # where the own ratio does not come down the truth lies between it and what is proven
        trial = own if own < 0.999 * trial else float(np.sqrt(proven * min(own, trial)))
    if best is None:
        return None
    return best[0], Y, Z, best[3]


def _own_ratio(part: Candidates, weights: FloatArray, scale: FloatArray) -> float:
    values = np.linalg.eigvalsh(part.weighted(weights) / np.outer(scale, scale))
    return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf


def _solved(problem: cp.Problem) -> bool:
    import cvxpy as cp

    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return False
    return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)
