"""The search for the best choice, once candidates and a criterion are given.

Greedy, exchange and excursions look at one pose at a time, and each stops where no single change
helps. Which optimum that is depends on where it starts, so several starts are made, the best of
them from the relaxation. Of few candidates all choices, or all exchanges from many starts, are
judged at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from calib.one_thread import one_blas_thread
from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.certificate import Relaxation
from posedesign.selection.criterion import NO_GAIN, Criterion, Objective
from posedesign.selection.information import InformationState

METHODS = {
    "exchange": "each pose exchanged for the best of the pool, until none helps; several starts",
    "detmax": "exchange, then excursions to more and to fewer poses (DetMax)",
    "greedy": "the best single pose taken in, again and again",
    "rounding": "the poses that count most in the convex relaxation, as they are",
}

MOST_PASSES = 30
"""Passes over all chosen poses; more than a handful are not seen."""

EXCURSION = 5
"""Poses more, or fewer, than wanted that an excursion goes to at most (Mitchell 1974)."""

ENUMERATED = 5_000
"""Choices up to which all are tried: that takes less time than a search."""

AT_ONCE = 5_000
"""Neighbours of all starts together that are judged in one step of the search, of
:data:`_FEW_PARAMETERS`; fewer of more, by the time that a matrix takes."""

_FEW_PARAMETERS = 6

USUAL = 24
"""Parameters up to which that is so; with more each takes longer, with their cube."""

FEWEST_STARTS, MOST_STARTS = 12, 64
"""Starts of the search; of 20 candidates, 8 of which are chosen, each finds the best choice by a
condition number in about one of ten."""

NEAR = 1e-4
"""Part of the best cost within which choices are judged again, without squaring their condition."""

_UNCLEAR = 1_000
"""Choices that see so little that only the same can tell, up to which that is done."""

GOOD_ENOUGH, SMALL = 0.98, 1000
"""Efficiency from which no further start is made, of smooth criteria in pools of more than so many
candidates: what it could still gain is less than a pose in fifty. Others take little time."""

PATIENCE, WORTH_IT = 2, 2e-3
"""In pools of more candidates no further start is made after so many in a row that brought less
than this part."""

OPTIMAL = 1e-6
"""Part of its cost within which a choice that is as good as the bound is not searched further."""

SHORTLIST = 20_000
"""Candidates that the exchange works on: the best by the relaxation, where there are more."""

SHORTLIST_WORK = 2.5e7
"""Products of a step of the exchange over the shortlist: of many parameters it is shorter. A choice
by 90 parameters out of the best 1,000 of 2,982 was as good as out of all, in a quarter of the time;
out of the best 500 it was 3 % worse."""

BEFORE_MANY = 2
"""Starts that are made one after the other in pools so small that many are made at once."""

UNSEEN = 1e-9
"""Part of the pool's mean information that is added to that of the weights, lest it is singular."""


def greedy(objective: Objective, count: int, kept: IntArray) -> IntArray:
    """A choice of ``count``: the best single pose taken in, again and again."""
    state = objective.state(kept, count)
    first = objective.stages[0]
    for _ in range(count - len(kept)):
        _take_best(first, state)
        if state.chosen.sum() % 10 == 0:
            state.refresh()
    return state.rows


def _take_best(objective: Objective, state: InformationState) -> None:
    best = objective.best_with_each(state)
    # where all cost infinitely much, any
    state.take(int(np.argmin(state.chosen)) if best is None else best)


def exchange(
    objective: Objective, rows: IntArray, kept: IntArray, passes: int = MOST_PASSES
) -> IntArray:
    """Put the best of the pool in place of one pose after the other, until none helps.

    The modified exchange of Cook and Nachtsheim 1980, after Fedorov 1972. ``passes``: over all
    chosen poses, at most.
    """
    for stage in objective.stages:
        state = objective.state(rows, len(rows))
        for _ in range(passes):
            if not _pass(stage, state, kept):
                break
            state.refresh()
        rows = state.rows
    return rows


def _pass(objective: Objective, state: InformationState, kept: IntArray) -> bool:
    """Try every chosen pose once, those first that are missed least; whether any was exchanged."""
    free = np.setdiff1d(state.rows, kept)
    free = free[np.argsort(objective.costs(state, free, -1.0), kind="stable")]
    changed = False
    for row in free.tolist():
        before = state.snapshot
        state.drop(row)
        best = objective.best_with_each(state, than=row)
        if best is None:
            state.snapshot = before
        else:
            state.take(best)
            changed = True
    return changed


def excursions(objective: Objective, rows: IntArray, kept: IntArray) -> IntArray:
    """DetMax of Mitchell 1974: some poses more or fewer, then back, for as long as that helps."""
    rows = exchange(objective, rows, kept)
    best, found = objective.cost(rows), rows
    step = 1
    while step <= EXCURSION:
        improved = False
        for up_first in (True, False):
            state = objective.state(found, len(rows))
            for up in (up_first, not up_first):
                for _ in range(step):
                    _go(objective, state, kept, up=up)
            cost = objective.cost(state.rows)
            if cost < (1.0 - NO_GAIN) * best:
                best, found, improved = cost, state.rows, True
        step = 1 if improved else step + 1
    return found


def _go(objective: Objective, state: InformationState, kept: IntArray, *, up: bool) -> None:
    if up:
        if state.chosen.all():
            return
        _take_best(objective, state)
        return
    free = np.setdiff1d(state.rows, kept)
    if len(free):
        state.drop(int(free[np.argmin(objective.costs(state, free, -1.0))]))


def starts(
    candidates: Candidates,
    weights: FloatArray | None,
    count: int,
    kept: IntArray,
    number: int,
    rng: np.random.Generator,
) -> list[IntArray]:
    """Choices to begin with: the heaviest of the relaxation, then drawn by its weights.

    Half of the draws are uniform over the pool: the relaxation may favour what a choice of whole
    poses does not want.
    """
    free = np.setdiff1d(np.arange(candidates.N), kept)
    more = count - len(kept)
    found = []
    if weights is not None:
        heaviest = free[np.argsort(-weights[free], kind="stable")][:more]
        found.append(np.sort(np.concatenate([kept, heaviest])))
    while len(found) < number:
        chance = np.ones(len(free))
        if weights is not None and len(found) % 2:
            chance = weights[free] + 1e-3 * count / len(free)
        # the largest of exponential variates by weight: a draw without replacement
        key = rng.exponential(size=len(free)) / chance
        drawn = free[np.argpartition(key, more - 1)[:more]] if more else free[:0]
        found.append(np.sort(np.concatenate([kept, drawn])))
    return found


def best_of_all(objective: Objective, count: int, kept: IntArray) -> IntArray | None:
    """The best of all choices; None where too many of them cannot be judged all at once."""
    candidates = objective.candidates
    free = np.setdiff1d(np.arange(candidates.N), kept)
    drawn = np.array(list(combinations(free.tolist(), count - len(kept))), dtype=np.intp)
    choices = np.sort(np.column_stack([np.tile(kept, (len(drawn), 1)), drawn]), axis=1)
    costs = objective.of_choices(choices)
    unclear = ~np.isfinite(costs)
    if count * candidates.m < candidates.p and not candidates.known.any():
        return np.asarray(choices[0])  # too few rows, whatever is chosen
    if unclear.sum() > _UNCLEAR:
        return None
    near = choices[unclear | (costs <= (1.0 + NEAR) * costs.min())]
    return np.asarray(near[int(np.argmin([objective.cost(rows) for rows in near]))])


def starts_for(candidates: Candidates, count: int, kept: IntArray) -> int:
    """How many starts :func:`many_starts` is worth; 0 in pools that are too large."""
    neighbours = (count - len(kept)) * (candidates.N - count)
    neighbours *= max(1, round((candidates.p / USUAL) ** 3))
    at_once = int(AT_ONCE / max(1.0, (candidates.p / _FEW_PARAMETERS) ** 3))
    number = min(MOST_STARTS, at_once // max(neighbours, 1))
    return number if number >= FEWEST_STARTS else 0


def many_starts(
    objective: Objective, first: IntArray, kept: IntArray, number: int, rng: np.random.Generator
) -> IntArray:
    """Exchange from many starts at once: the best of all exchanges is made, till none helps.

    ``first`` (T, n): choices to begin with, besides those that are drawn. ``number``: of starts in
    all.
    """
    candidates, n = objective.candidates, first.shape[1]
    free = np.setdiff1d(np.arange(candidates.N), kept)
    more = n - len(kept)
    key = rng.uniform(size=(max(number - len(first), 0), len(free)))
    drawn = free[np.argsort(key, axis=1)[:, :more]]
    states = np.vstack([first, np.column_stack([np.tile(kept, (len(drawn), 1)), drawn])])
    done: list[IntArray] = []
    while len(states):
        states = np.unique(np.sort(states, axis=1), axis=0)
        states, finished = _step(objective, states, kept)
        done.extend(finished)
    ends = np.unique(done, axis=0)
    return np.asarray(ends[int(np.argmin([objective.cost(rows) for rows in ends]))])


def _step(
    objective: Objective, states: IntArray, kept: IntArray
) -> tuple[IntArray, list[IntArray]]:
    """States ``(T, n)`` after the best exchange of each, and those that none helps."""
    candidates = objective.candidates
    T, n = states.shape
    inside = np.zeros((T, candidates.N), dtype=bool)
    inside[np.arange(T)[:, None], states] = True
    outside = np.nonzero(~inside)[1].reshape(T, -1)
    free = states[~np.isin(states, kept)].reshape(T, -1)
    # state, pose that goes, pose that comes
    shape = (T, free.shape[1], outside.shape[1])
    rest = np.broadcast_to(states[:, None, :], (*shape[:2], n)).copy()
    rest[np.broadcast_to(states[:, None, :], rest.shape) == free[:, :, None]] = -1
    neighbours = np.broadcast_to(rest[:, :, None, :], (*shape, n)).copy()
    comes = np.broadcast_to(outside[:, None, :, None], neighbours.shape)
    gone = neighbours < 0
    neighbours[gone] = comes[gone]
    flat = neighbours.reshape(-1, n)
    costs = objective.of_choices(flat).reshape(T, -1)
    own = objective.of_choices(states)
    best = np.argmin(costs, axis=1)
    better = costs[np.arange(T), best] < (1.0 - NO_GAIN) * own
    following = flat.reshape(T, -1, n)[np.arange(T), best]
    return following[better], list(states[~better])


@dataclass(frozen=True, eq=False)
class Found:
    """What a search came to: rows ``(n,)``, and the cost of each start."""

    rows: IntArray
    costs: list[float]


class Search:
    """Of ``count`` out of distinct candidates, of which ``kept`` are in it anyway."""

    def __init__(
        self, candidates: Candidates, criterion: Criterion, count: int, kept: IntArray
    ) -> None:
        self._candidates, self._criterion = candidates, criterion
        self._count, self._kept = count, kept
        self._objective = criterion.on(candidates)

    def all_tried(self, method: str) -> tuple[Found, Relaxation] | None:
        """The best of all choices, and that it is; None where there are too many to try."""
        kept = len(self._kept)
        choices = comb(self._candidates.N - kept, self._count - kept)
        searching = method in ("exchange", "detmax") and choices <= ENUMERATED
        if choices > 1 and not searching:
            return None
        rows = best_of_all(self._objective, self._count, self._kept)
        if rows is None:
            return None
        cost = self._objective.cost(rows)
        weights = np.zeros(self._candidates.N)
        weights[rows] = 1.0
        return Found(rows, [cost]), Relaxation(weights, cost, None, cost)

    @one_blas_thread
    def relax(self, tolerance: float) -> Relaxation | None:
        """The relaxation over what is free, with what is kept taken for known.

        None where the information is singular to the last digit, and nothing can be proven.
        """
        free = np.setdiff1d(np.arange(self._candidates.N), self._kept)
        part = self._candidates
        if len(self._kept):
            part = part.knowing(self._kept).take(free)
        try:
            found = self._criterion.on(part).relax(self._count - len(self._kept), tolerance)
        except np.linalg.LinAlgError:
            return None
        weights = np.ones(self._candidates.N)
        weights[free] = found.weights
        return Relaxation(weights, found.cost, found.certificate, found.bound)

    def run(
        self,
        method: str,
        number: int,
        relaxed: Relaxation | None,
        rng: np.random.Generator,
        passes: int = MOST_PASSES,
    ) -> Found:
        """Search by a method, from a number of starts."""
        short, objective, kept = self._shortlist(relaxed)
        if method == "greedy":
            rows = short[greedy(objective, self._count, kept)]
            return Found(rows, [self._objective.cost(rows)])
        improve: dict[str, Callable[[Objective, IntArray, IntArray], IntArray]] = {
            "exchange": lambda objective, rows, kept: exchange(objective, rows, kept, passes),
            "detmax": excursions,
            "rounding": lambda objective, rows, kept: rows,
        }
        number, many = 1 if method == "rounding" else number, 0
        if number > 1 and self._objective.rugged:
            many = starts_for(self._candidates, self._count, self._kept)
            number = min(number, BEFORE_MANY) if many else number
        own = None if relaxed is None else relaxed.weights[short]
        first = starts(objective.candidates, own, self._count, kept, number, rng)
        bound = 0.0 if relaxed is None else relaxed.bound
        ends: list[IntArray] = []
        costs: list[float] = []
        for start in first:
            ends.append(short[improve[method](objective, start, kept)])
            costs.append(self._objective.cost(ends[-1]))
            if self._enough(costs, bound):
                break
        if many and not self._enough(costs, bound):
            found = many_starts(self._objective, np.array(ends), self._kept, many, rng)
            ends.append(found)
            costs.append(self._objective.cost(found))
        return Found(ends[int(np.argmin(costs))], costs)

    def _enough(self, costs: list[float], bound: float) -> bool:
        best = min(costs)
        if self._candidates.N <= SMALL:
            return (1.0 - OPTIMAL) * best <= bound
        before = min(costs[:-PATIENCE], default=np.inf)
        if not self._objective.rugged and GOOD_ENOUGH * best <= bound:
            return True
        return bool(before * (1.0 - WORTH_IT) < best < np.inf)

    def _shortlist(self, relaxed: Relaxation | None) -> tuple[IntArray, Objective, IntArray]:
        """Candidates that the exchange works on: those that add most at the relaxation."""
        pool, N = self._candidates, self._candidates.N
        size = min(SHORTLIST, int(SHORTLIST_WORK / (pool.m * pool.p**2)))
        size = max(size, 2 * self._count, pool.p)
        if size >= N:
            return np.arange(N), self._objective, self._kept
        weights: FloatArray = np.ones(N) if relaxed is None else relaxed.weights
        M = pool.weighted(weights * (self._count / float(weights.sum())))
        # what the weights leave unseen must not stop here
        C = np.linalg.inv(M + UNSEEN * self._count / N * pool.whole)
        scores = pool.scores(np.asarray(C))
        if relaxed is not None:
            scores[weights > OPTIMAL] = np.inf
        scores[self._kept] = np.inf
        short = np.sort(np.argpartition(scores, N - size)[N - size :])
        return short, self._criterion.on(pool.take(short)), np.searchsorted(short, self._kept)
