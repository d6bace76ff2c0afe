"""Choices under limits: the best fractions with their proof, whole choices, and the best of all.

The fractions: Newton steps on the logarithm of the cost, each a quadratic programme under the
limits that cvxpy hands to Clarabel. Its derivative proves a bound (:class:`MeanCertificate`) with
what any times within the limits gather at most of it, which the dual of a linear programme says.
The whole choice: the linear programme over whole times (HiGHS), then poses put back and others
taken in for as long as that helps, and again with a part of them drawn by chance. In small pools it
is proven to be the best there is, or replaced by it, by outer approximation (Duran and Grossmann
1986): the cost is convex in the times, so that its tangents bound it from below, and a programme of
whole times finds where they are lowest.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any, cast

import numpy as np

from calib.errors import InputError, NotIdentifiableError
from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.certificate import Relaxation, Smooth
from posedesign.selection.criterion import NO_GAIN, Criterion, Objective
from posedesign.selection.information import InformationState
from posedesign.selection.limits import Cut, Limits
from posedesign.selection.search import Found
from posedesign.selection.variances import DeviationObjective, SpectrumObjective, VolumeObjective

MeanObjective = VolumeObjective | SpectrumObjective | DeviationObjective

WHOLE_POOL = 800
"""Candidates that quadratic programmes begin with at most: p (p + 1), twice as many as the best
fractions need to have (Caratheodory; Pukelsheim 1993, 8.2), where those are fewer."""

MOST_SETS, MOST_STEPS = 25, 40
"""Working sets, and steps on each; a handful of both are seen."""

INNER = 0.3
"""Part of the tolerance to which a working set is solved."""

SEEN = 1e-7
"""Part of the pool's mean information that the first fractions have in every direction."""

SHORTLIST = 300
"""Candidates that whole choices are made of: those that count in the fractions, then the best."""

COUNTS = 1e-6
"""Times from which a candidate counts in the fractions."""

ROOM = 2.0
"""Times more than in the fractions that a candidate may be measured in a whole choice."""

PATIENCE = 6
"""Times, for each start, that a part of a choice is put back and made anew without a gain."""

HALF = 0.5
"""Part of the poses drawn anew, by turns with all. With a sixth, filled by the best, 7 of 14
choices of 30 out of 500 ended up to 0.3 % below the best that is known."""

SMALL = 40
"""Candidates up to which the best choice of all is looked for."""

MOST_CUTS = 60
"""Tangents that it takes at most; what is proven by then is the bound."""

SHORTEST = 1e-3
"""Part of a step that is tried at least."""

CLOSED = 1e-6
"""Part of the cost from which the bound has met it."""


def mean_objective(criterion: Criterion, candidates: Candidates) -> MeanObjective:
    """The objective on a pool, of a kind that limits go with; InputError for others."""
    objective = criterion.on(candidates)
    smallest = isinstance(objective, SpectrumObjective) and objective.rugged
    if smallest or not isinstance(objective, MeanObjective):
        raise InputError(
            f"{criterion.name} does not go with costs, constraints or repeats",
            hint="take D, A, O5, or errors of functions of the parameters",
            name="criterion",
        )
    return objective


def relax_under(
    objective: MeanObjective, candidates: Candidates, limits: Limits, tolerance: float
) -> tuple[Relaxation, FloatArray]:
    """The best fractions of times within limits, and a bound that no choice within them beats.

    Returns
    -------
    Relaxation
    array (N,)
        By how much each candidate lowers the logarithm of the cost there.

    Raises
    ------
    InputError
        No choice is within the limits.
    NotIdentifiableError
        None within them tells all parameters apart.
    """
    w = _first(candidates, limits)
    scores = candidates.scores(np.asarray(np.linalg.inv(candidates.weighted(w))))
    few = min(WHOLE_POOL, candidates.p * max(candidates.p + 1, 15))
    working = _largest(np.where(w > 0.0, np.inf, scores), few)
    proven, cost = 0.0, np.inf
    for _ in range(MOST_SETS):
        part, own = candidates.take(working), limits.take(working)
        w_part, smooth = _minimise(objective, part, own, w[working], INNER * tolerance)
        w = np.zeros(candidates.N)
        w[working], cost = w_part, smooth.cost
        proof = objective.certificate_of(smooth)
        bound = proof.bound_by(candidates, lambda each: limits.most_gathered(each)[0])
        proven = max(proven, bound)
        if proven >= (1.0 - tolerance) * cost or len(working) == candidates.N:
            break
        # those outside that gather most there (simplicial decomposition: von Hohenbalken 1977), and
        # those that the prices of the limits come nearest to letting in
        _, wanted, reduced = limits.most_gathered(candidates.scores(smooth.Z))
        reduced[wanted > 0.0] = np.inf
        reduced[working] = -np.inf
        more = _largest(reduced, max(3 * candidates.p, 100))
        if len(working) + len(more) > WHOLE_POOL:
            working = working[(w_part > 1e-9) | (own.least > 0.0)]
        working = np.union1d(working, more)
    return Relaxation(w, cost, None, proven), candidates.scores(smooth.Z)


def _largest(scores: FloatArray, count: int) -> IntArray:
    """The ``count`` largest, ascending."""
    if count >= len(scores):
        return np.arange(len(scores))
    return np.sort(np.argpartition(scores, len(scores) - count)[len(scores) - count :])


def _first(candidates: Candidates, limits: Limits) -> FloatArray:
    """Fractions within the limits that see all: the mean of what gathers most of what is unseen."""
    _, w, _ = limits.most_gathered(candidates.lengths)
    found = [w]
    mean = candidates.whole / candidates.N
    values, vectors = np.linalg.eigh(mean)
    unit = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    for _ in range(2 * candidates.p):
        M = candidates.weighted(np.mean(found, axis=0))
        seen, directions = np.linalg.eigh(unit.T @ M @ unit)
        if seen[0] > SEEN and len(found) > 2:
            return np.asarray(np.mean(found, axis=0))
        poor = unit @ directions[:, :1]
        found.append(limits.most_gathered(candidates.scores_of_root(poor))[1])
    M = candidates.weighted(np.mean(found, axis=0))
    if np.linalg.eigvalsh(unit.T @ M @ unit)[0] > SEEN:
        return np.asarray(np.mean(found, axis=0))
    raise NotIdentifiableError(
        list(candidates.names), ["no choice within the limits tells all parameters apart"]
    )


def _minimise(
    objective: MeanObjective, part: Candidates, limits: Limits, w: FloatArray, tolerance: float
) -> tuple[FloatArray, Smooth]:
    """Newton steps under limits until the derivative promises no more than ``tolerance``."""
    functions = len(objective.L) if isinstance(objective, DeviationObjective) else 1
    largest = functions > 1
    shares = np.full(functions, 1.0 / functions) if largest else None
    smooth = _smooth(objective, part, w, shares)
    for _ in range(MOST_STEPS):
        bound = objective.certificate_of(smooth).bound_by(
            part, lambda each: limits.most_gathered(each)[0]
        )
        if bound >= (1.0 - tolerance) * smooth.cost:
            break
        step, shares = _step(objective, part, limits, w, smooth, shares)
        # of the largest of errors, which has edges, any descent will do
        gain = 0.0 if largest else float(part.scores(smooth.Z) @ step)
        length = 1.0
        while length > SHORTEST:
            after = _smooth(objective, part, np.maximum(w + length * step, 0.0), shares)
            if np.log(after.cost / smooth.cost) <= -0.1 * length * gain:
                break
            length /= 2.0
        w, smooth = np.maximum(w + length * step, 0.0), after
    return w, smooth


def _smooth(
    objective: MeanObjective, part: Candidates, w: FloatArray, shares: FloatArray | None
) -> Smooth:
    if shares is None:
        return objective.smooth(part, w)
    return cast(DeviationObjective, objective).lagrangian(part, w, shares)


def _step(
    objective: MeanObjective,
    part: Candidates,
    limits: Limits,
    w: FloatArray,
    smooth: Smooth,
    shares: FloatArray | None,
) -> tuple[FloatArray, FloatArray | None]:
    """The step of a quadratic programme under the limits, and the shares that it gives errors."""
    cp: Any = import_module("cvxpy")  # takes half a second to load
    d = cp.Variable(part.N)
    H = smooth.curvature + 1e-10 * np.trace(smooth.curvature) / part.N * np.eye(part.N)
    bend = 0.5 * cp.quad_form(d, cp.psd_wrap(H))
    A, b = limits.inequalities()
    kept = [d >= limits.least - w, d <= limits.most - w]
    kept += [A @ d <= b - A @ w] if len(A) else []
    if shares is None:
        cp.Problem(cp.Minimize(bend - part.scores(smooth.Z) @ d), kept).solve(solver=cp.CLARABEL)
        return np.zeros(part.N) if d.value is None else np.asarray(d.value), None
    now = cast(DeviationObjective, objective).errors(part, w)
    top = cp.Variable()
    edges = np.log(now.squares) - now.slopes.T @ d <= top
    cp.Problem(cp.Minimize(bend + top), [edges, *kept]).solve(solver=cp.CLARABEL)
    if d.value is None:
        return np.zeros(part.N), shares
    found = np.maximum(np.asarray(edges.dual_value), 1e-12)
    return np.asarray(d.value), found / found.sum()


@dataclass(frozen=True, eq=False)
class Copies:
    """A part of the pool, each candidate as often as it may be measured."""

    objective: Objective
    limits: Limits
    owner: IntArray  # (C,) candidate of each copy
    back: IntArray  # (n,) into the pool

    @classmethod
    def of(
        cls, criterion: Criterion, candidates: Candidates, limits: Limits, ranks: FloatArray
    ) -> Copies:
        """Of the candidates of highest rank, and those that have to be there."""
        back = _largest(np.where(limits.least > 0.0, np.inf, ranks), SHORTLIST)
        own = limits.take(back)
        owner = np.repeat(np.arange(len(back)), own.most.astype(np.intp))
        part = candidates.take(back[owner])
        return cls(criterion.on(part), own, owner, back)

    def times(self, rows: IntArray) -> IntArray:
        """Times ``(n,)`` of each candidate in a choice of copies."""
        return np.bincount(self.owner[rows], minlength=len(self.back))

    def rows(self, times: IntArray) -> IntArray:
        """Copies that make a choice of times ``(n,)``."""
        first = np.searchsorted(self.owner, np.arange(len(self.back)))
        return np.concatenate(
            [np.arange(at, at + many) for at, many in zip(first, times, strict=True)]
        ).astype(np.intp)


def search_under(
    criterion: Criterion,
    candidates: Candidates,
    limits: Limits,
    relaxed: Relaxation,
    scores: FloatArray,
    starts: int,
    rng: np.random.Generator,
) -> Found:
    """Whole choices within limits, improved pose by pose.

    Raises
    ------
    InputError
        No whole choice is within the limits, or none was found in time.
    """
    ranks = np.where(relaxed.weights > COUNTS, np.inf, scores)
    # whole times are near the fractions; copies that are not wanted only take time
    few = limits.within(np.ceil(relaxed.weights) + ROOM)
    copies = Copies.of(criterion, candidates, few, ranks)
    # near the fractions first: what each candidate adds there says nothing of few of them alone
    near = limits.within(np.ceil(relaxed.weights - COUNTS))
    first = near.whole(relaxed.weights) or limits.whole(scores)
    if first is None:
        raise InputError(
            "no whole number of times of each pose keeps all limits at once",
            hint="loosen one of them: a lower limit, the number of poses, or the budget",
            name="constraints",
        )
    inside = np.zeros(candidates.N, dtype=bool)
    inside[copies.back] = True
    times = first[0][copies.back] if not first[0][~inside].any() else None
    if times is None:  # the shortlist has what the fractions want, not what whole times need
        found = copies.limits.whole(scores[copies.back])
        times = None if found is None else found[0]
    if times is None:
        rows = np.repeat(np.arange(candidates.N), first[0])
        return Found(rows, [criterion.on(candidates).cost(rows)])
    best = _improved(copies, copies.rows(times))
    cost = copies.objective.cost(best)
    costs, in_vain = [cost], 0
    even = np.ones(len(copies.back))
    # the fractions may favour what whole choices do not want
    by_fractions = relaxed.weights[copies.back] + 1e-3 * len(best) / len(even)
    draws = ((HALF, by_fractions), (HALF, even), (1.0, even))
    while in_vain < PATIENCE * starts and (1.0 - CLOSED) * cost > relaxed.bound:
        rows = _improved(copies, _remade(copies, best, *draws[in_vain % len(draws)], rng))
        new = copies.objective.cost(rows)
        in_vain += 1
        if new < (1.0 - NO_GAIN) * cost:
            best, cost, in_vain = rows, new, 0
            costs.append(new)
    rows = np.repeat(copies.back, copies.times(best))
    return Found(np.sort(rows), costs)


def _remade(
    copies: Copies, rows: IntArray, part: float, chances: FloatArray, rng: np.random.Generator
) -> IntArray:
    """A choice of which a part, drawn by chance, is put back, and others are drawn for it.

    ``chances`` (n,): of each candidate.
    """
    state = copies.objective.state(rows, len(rows))
    for _ in range(max(1, round(part * len(rows)))):
        free = _free(copies, state)
        if not len(free):
            break
        state.drop(int(rng.choice(free)))
    while len(let_in := _let_in(copies, copies.times(state.rows))):
        key = rng.exponential(size=len(let_in)) / chances[copies.owner[let_in]]
        state.take(int(let_in[np.argmin(key)]))
    kept = copies.limits.keeps(copies.limits.rows @ copies.times(state.rows))
    return state.rows if kept else rows


def _free(copies: Copies, state: InformationState) -> IntArray:
    """Chosen copies that may be put back, one of each candidate."""
    rows = state.rows
    times = copies.times(rows)
    last = np.append(copies.owner[rows][1:] != copies.owner[rows][:-1], True)
    return rows[last & (times > copies.limits.least)[copies.owner[rows]]]


def _let_in(copies: Copies, times: IntArray, without: int = -1) -> IntArray:
    """Copies that the limits let in besides a choice of times ``(n,)``, one of each candidate.

    Those alone that a limit lacks, where one does.
    """
    limits = copies.limits
    sums = limits.rows @ times
    lacking = limits.lacking(sums)
    let_in = limits.not_above(sums[:, None] + limits.rows) & (times < limits.most)
    if lacking.any():
        let_in &= (limits.rows[lacking] > 0.0).any(axis=0)
    if without >= 0:
        let_in[without] = False
    candidates = np.flatnonzero(let_in)
    return np.asarray(np.searchsorted(copies.owner, candidates) + times[candidates])


def _fill(
    copies: Copies, state: InformationState, without: int = -1, below: float = np.inf
) -> float:
    """Take in the best that the limits let in until none is left.

    What the last one costs; infinite where there is none, or some limit is not kept. The last one
    is not taken in where it costs no less than ``below``.
    """
    cost, times = np.inf, copies.times(state.rows)
    let_in = _let_in(copies, times, without)
    while len(let_in):
        costs = copies.objective.costs(state, let_in, 1.0)
        best = int(np.argmin(costs))
        cost, copy = float(costs[best]), int(let_in[best])
        times[copies.owner[copy]] += 1
        let_in = _let_in(copies, times, without)
        if cost >= below and not len(let_in):
            return cost
        state.take(copy)
    return cost if copies.limits.keeps(copies.limits.rows @ times) else np.inf


def _improved(copies: Copies, rows: IntArray) -> IntArray:
    """Put back one pose after the other and fill again, for as long as that helps."""
    state = copies.objective.state(rows, len(rows))
    _fill(copies, state)
    cost = copies.objective.cost(state.rows)
    helped = True
    while helped:
        helped = False
        free = _free(copies, state)
        order = np.argsort(copies.objective.costs(state, free, -1.0), kind="stable")
        for row in free[order].tolist():
            if row not in free:
                continue
            before = state.snapshot
            state.drop(row)
            worth = (1.0 - NO_GAIN) * cost
            new = _fill(copies, state, int(copies.owner[row]), worth)
            if new < worth:
                cost, helped, free = new, True, _free(copies, state)
            else:
                state.snapshot = before
        state.refresh()
    return state.rows


def best_under(
    objective: MeanObjective,
    candidates: Candidates,
    limits: Limits,
    relaxed: Relaxation,
    found: Found,
) -> tuple[Found, Relaxation]:
    """The best of all choices of a small pool, or the best found with what is proven by then."""
    best, cost, proven = found.rows, min(found.costs), relaxed.bound
    cuts = [_tangent(objective, candidates, relaxed.weights)]
    cuts.append(_tangent_near(objective, candidates, best, relaxed.weights))
    for _ in range(MOST_CUTS):
        if proven >= (1.0 - CLOSED) * cost:
            break
        next_best = limits.whole(np.zeros(candidates.N), cuts)
        if next_best is None:
            break
        times, lowest = next_best
        proven = max(proven, float(np.exp(lowest - 1e-8 * max(1.0, abs(lowest)))))
        rows = np.repeat(np.arange(candidates.N), times)
        new = objective.cost(rows)
        if new < cost:
            best, cost = rows, new
        cuts.append(_tangent_near(objective, candidates, rows, relaxed.weights))
    proven = min(proven, cost)
    return Found(best, [cost]), Relaxation(relaxed.weights, relaxed.cost, None, proven)


def _tangent(objective: MeanObjective, candidates: Candidates, w: FloatArray) -> Cut:
    """The tangent of the logarithm of the cost at fractions of times ``(N,)``."""
    if isinstance(objective, DeviationObjective) and len(objective.L) > 1:
        now = objective.errors(candidates, w)
        k = int(np.argmax(now.squares))
        level, scores = float(np.log(now.squares[k])), now.slopes[:, k]
    else:
        smooth = objective.smooth(candidates, w)
        level, scores = float(np.log(smooth.cost)), candidates.scores(smooth.Z)
    return Cut(level + float(scores @ w), scores)


def _tangent_near(
    objective: MeanObjective, candidates: Candidates, rows: IntArray, inside: FloatArray
) -> Cut:
    """The tangent at a choice; a little inside of it where the choice does not see everything."""
    w = np.bincount(rows, minlength=candidates.N).astype(float)
    if not np.isfinite(objective.cost(rows)):
        w = 0.99 * w + 0.01 * inside
    return _tangent(objective, candidates, w)
