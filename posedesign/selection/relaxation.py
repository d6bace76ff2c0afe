"""The best weights of candidates where the cost is smooth, or the largest of smooth errors.

Interior-point methods with second derivatives on a part of the pool that grows: at the optimum few
candidates count in part, no more than there are entries in the information matrix. One pass over
the whole pool proves a bound, and names the candidates that are missing from the set. The cost of a
pass grows with the pool, all else with the working set alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.certificate import Certificate, Relaxation, Smooth, sum_of_largest

WELL_SEEN = 1e-2
"""Part of the pool's mean information that the first set has in every direction: a parameter that
few of a large pool see may be missing from a few drawn at random."""

FIRST_SET, TAKEN_IN = 160, 120
"""Candidates of the first set, and of those taken in at once, at most because of the parameters:
of 90 parameters with priors some 150 count at the optimum, and sets twice as large take twice as
long."""

AS_GOOD = 1e-12
"""Part by which a score may be below the least that is chosen and still be called as good."""

MOST_SETS = 40
"""Working sets: a bound on work that ends by itself, when nothing outside the set is wanted."""

MOST_STEPS = 60
"""Newton steps on one working set; about ten were seen from equal weights."""

INNER = 0.2
"""Part of the tolerance to which a working set is solved."""

NEXT_IN_LINE = 0.8
"""Part of the least score that is chosen from which smooth costs take candidates into the set."""

AT_ZERO = 1e-6
"""Weights below do not count, and leave the working set."""

BOLD, TIMID, LONG = 0.1, 0.4, 0.7
"""What the complementarity is aimed at, after a step that was longer than ``LONG`` or shorter."""


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


class Certified(Protocol):
    """A cost that proofs can be given for."""

    def certificate_of(self, smooth: Smooth) -> Certificate:
        """The proof that the derivative at some weights gives."""


class SmoothObjective(Certified, Protocol):
    """A smooth cost of weights."""

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost, with its derivatives."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Mean square errors ``(K,)`` at some weights, and less the derivatives of their logarithms."""

    squares: FloatArray
    slopes: FloatArray  # shape (n, K)


class LargestObjective(Certified, Protocol):
    """The largest of several smooth errors."""

    def errors(self, candidates: Candidates, weights: FloatArray) -> Errors:
        """Of weights ``(n,)``."""

    def lagrangian(self, candidates: Candidates, weights: FloatArray, shares: FloatArray) -> Smooth:
        """The largest error with the derivatives of the mean of the logarithms by ``shares``."""


Kind = TypeVar("Kind", bound=Certified)


def relax_by(
    minimise: Callable[[Kind, Candidates, int, float], tuple[FloatArray, Smooth]],
    objective: Kind,
    candidates: Candidates,
    count: int,
    tolerance: float,
) -> Relaxation:
    """The best weights, and a bound that is within a part ``tolerance`` of what they cost.

    ``minimise``: solves a working set, such as :func:`minimise_smooth`. ``count`` is above 0, and
    less than there are candidates.
    """

    def solve(part: Candidates) -> Solved:
        weights, smooth = minimise(objective, part, count, INNER * tolerance)
        proof = objective.certificate_of(smooth)
        return Solved(weights, smooth.cost, proof, lambda pool: pool.scores(smooth.Z))

    p = candidates.p
    first = max(3 * count, min(4 * p, FIRST_SET), 60)
    take = max(2 * count, min(3 * p, TAKEN_IN), 60)
    sizes = first, take, AT_ZERO
    return relax_on_sets(solve, candidates, count, tolerance, sizes, next_in_line=NEXT_IN_LINE)


@dataclass(frozen=True, eq=False)
class Solved:
    """The best of a working set: weights ``(n,)``, cost, proof, and how much each is wanted."""

    weights: FloatArray
    cost: float
    proof: Certificate
    scores: Callable[[Candidates], FloatArray]  # of a pool, (N,)


def relax_on_sets(
    solve: Callable[[Candidates], Solved],
    candidates: Candidates,
    count: int,
    tolerance: float,
    sizes: tuple[int, int, float],
    proof: Certificate | None = None,
    next_in_line: float | None = None,
) -> Relaxation:
    """Weights of working sets that grow until none is missing, or the bound is near the cost.

    ``sizes``: candidates to begin with, those that are taken in at most, and the weight from which
    one stays. ``proof``: that is known. ``next_in_line``: part of the least score that is chosen
    from which others come in, too: they will be wanted once the first have been taken in.
    """
    first, most, at_zero = sizes
    N, working = candidates.N, first_set(candidates, first)
    proven = 0.0 if proof is None else proof.bound(candidates, count)
    for _ in range(MOST_SETS):
        found = solve(candidates.take(working))
        bound = found.proof.bound(candidates, count)
        if bound > proven:
            proof, proven = found.proof, bound
        out = np.zeros(N)
        out[working] = found.weights
        if proven >= (1.0 - tolerance) * found.cost:
            break
        scores = found.scores(candidates)
        outside = scores.copy()
        outside[working] = -np.inf
        least = float(np.partition(scores, N - count)[N - count])
        if not (outside >= least - AS_GOOD * abs(least)).any():
            break  # the set has all that could help: what is left is the precision of the steps
        take = min(most, N - len(working))
        added = np.argpartition(outside, N - take)[N - take :]
        if next_in_line is not None:
            added = added[scores[added] > next_in_line * least]
        counts = (found.weights > at_zero) | (scores[working] >= least)
        working = np.sort(np.concatenate([working[counts], added]))
    return Relaxation(out, found.cost, proof, proven)


def minimise_smooth(
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
        matrix = smooth.curvature.copy()
        matrix[np.diag_indices(n)] += low / w + high / rest
        try:
            dw = newton_step(matrix, scores + target / w - target / rest, n, count - w.sum())
        except np.linalg.LinAlgError:
            break  # so near to the walls that rounding decides; what is proven so far stays
        d_low = target / w - low - low / w * dw
        d_high = target / rest - high + high / rest * dw
        length = min(reach(w, dw), reach(rest, -dw))
        dual = min(reach(low, d_low), reach(high, d_high))
        w, rest = w + length * dw, rest - length * dw
        low, high = low + dual * d_low, high + dual * d_high
        smooth = objective.smooth(part, w)
        scores = part.scores(smooth.Z)
        known = float(np.sum(smooth.Z * part.known))
    return w, smooth


def minimise_largest(
    objective: LargestObjective, part: Candidates, count: int, tolerance: float
) -> tuple[FloatArray, Smooth]:
    """Weights ``(n,)`` in 0 .. 1 whose sum is ``count`` with the least of the largest errors.

    A primal-dual interior-point method for ``min τ`` such that ``log v_k(w) <= τ`` for every
    function k: the logarithm of each error is a convex function of the weights. Each has a slack of
    its own, which meets the error only in the end: held to it at every step, steps would be as
    short as the errors are curved.
    """
    n = part.N
    w = np.full(n, count / n)
    rest = 1.0 - w
    now = objective.errors(part, w)
    top = float(np.log(now.squares).max()) + 1.0
    slack = top - np.log(now.squares)
    shares = 1.0 / slack / (1.0 / slack).sum()
    mu = float(shares @ slack) / len(shares)
    low, high = mu / w, mu / rest
    best_w, best = w, objective.lagrangian(part, w, shares)
    proof, proven, aim = best, 0.0, BOLD
    for _ in range(MOST_STEPS):
        smooth = objective.lagrangian(part, w, shares)
        if smooth.cost < best.cost:
            best_w, best = w, smooth
        bound = objective.certificate_of(smooth).bound(part, count)
        if bound > proven:
            proven, proof = bound, smooth
        if proven >= (1.0 - tolerance) * best.cost:
            break
        gap = float(shares @ slack + w @ low + rest @ high)
        mu = aim * gap / (len(shares) + 2 * n)
        # what the slacks miss of the errors, which are curved; a step takes it up to first order
        missing = top - np.log(now.squares) - slack
        pull = (mu - shares * missing) / slack
        steep = shares / slack
        matrix = np.empty((n + 1, n + 1))
        matrix[:n, :n] = smooth.curvature + np.diag(low / w + high / rest)
        matrix[:n, :n] += (now.slopes * steep) @ now.slopes.T
        matrix[:n, n] = matrix[n, :n] = now.slopes @ steep
        matrix[n, n] = steep.sum()
        right = np.append(mu / w - mu / rest + now.slopes @ pull, pull.sum() - 1.0)
        try:
            change = newton_step(matrix, right, n, count - float(w.sum()))
        except np.linalg.LinAlgError:
            break
        dw, d_top = change[:n], float(change[n])
        d_slack = missing + d_top + now.slopes.T @ dw
        d_shares = pull - shares - steep * (d_top + now.slopes.T @ dw)
        d_low, d_high = mu / w - low - low / w * dw, mu / rest - high + high / rest * dw
        length = min(reach(w, dw), reach(rest, -dw), reach(slack, d_slack))
        dual = min(reach(shares, d_shares), reach(low, d_low), reach(high, d_high))
        w, rest, top = w + length * dw, rest - length * dw, top + length * d_top
        slack = slack + length * d_slack
        now = objective.errors(part, w)
        shares = shares + dual * d_shares
        low, high = low + dual * d_low, high + dual * d_high
        aim = BOLD if min(length, dual) > LONG else TIMID
    return best_w, Smooth(best.cost, proof.Z, best.curvature, proof.weights_of_functions)


def newton_step(matrix: FloatArray, right: FloatArray, n: int, missing: float) -> FloatArray:
    """Newton step whose first n entries add what is ``missing`` to their sum; spoils ``matrix``."""
    from scipy.linalg import cho_factor, cho_solve

    ones = np.append(np.ones(n), np.zeros(len(right) - n))
    factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    a, b = cho_solve(factor, np.column_stack([right, ones]), check_finite=False).T
    return np.asarray(a + (missing - a[:n].sum()) / b[:n].sum() * b)


def reach(values: FloatArray, change: FloatArray) -> float:
    """How far a step may go before some value is no longer above zero; 1 at most."""
    falling = change < 0.0
    if not falling.any():
        return 1.0
    return min(1.0, 0.98 * float((values[falling] / -change[falling]).min()))
