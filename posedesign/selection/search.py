"""The search for the best choice, once a pool and a criterion are given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection import exchange as steps
from posedesign.selection import small
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria import Criterion, Objective
from posedesign.selection.relaxation import Relaxation

METHODS = {
    "exchange": "each pose exchanged for the best of the pool, until none helps; several starts",
    "detmax": "exchange, then excursions to more and to fewer poses (DetMax)",
    "greedy": "the best single pose taken in, again and again",
    "rounding": "the poses that count most in the convex relaxation, as they are",
}

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

BEFORE_MANY = 2
"""Starts that are made one after the other in pools so small that many are made at once."""


UNSEEN = 1e-9
"""Part of the pool's mean information that is added to that of the weights, lest it is singular."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a search came to.

    ``rows`` (n,). ``costs``: of each start.
    """

    rows: IntArray
    costs: list[float]


class Search:
    """Of n out of distinct candidates.

    ``kept``: candidates that are in it anyway.
    """

    def __init__(
        self, candidates: Candidates, criterion: Criterion, count: int, kept: IntArray
    ) -> None:
        self._candidates, self._criterion = candidates, criterion
        self._count, self._kept = count, kept
        self._objective = criterion.on(candidates)

    def all_tried(self, method: str) -> tuple[Found, Relaxation] | None:
        """The best of all choices, and that it is; None where there are too many to try."""
        choices = small.number_of_choices(self._candidates, self._count, self._kept)
        searching = method in ("exchange", "detmax") and choices <= small.ENUMERATED
        if choices > 1 and not searching:
            return None
        rows = small.best_of_all(self._objective, self._count, self._kept)
        if rows is None:
            return None
        cost = self._objective.cost(rows)
        weights = np.zeros(self._candidates.N)
        weights[rows] = 1.0
        return Found(rows, [cost]), Relaxation(weights, cost, None, cost)

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
        self, method: str, number: int, relaxed: Relaxation | None, rng: np.random.Generator
    ) -> Found:
        """Search by a method, from a number of starts."""
        short, objective, kept = self._shortlist(relaxed)
        if method == "greedy":
            rows = short[steps.greedy(objective, self._count, kept)]
            return Found(rows, [self._objective.cost(rows)])
        improve: Callable[[Objective, IntArray, IntArray], IntArray] = {
            "exchange": steps.exchange,
            "detmax": steps.excursions,
            "rounding": steps.as_given,
        }[method]
        number = 1 if method == "rounding" else number
        many = 0
        if number > 1 and self._objective.rugged:
            many = small.starts_for(self._candidates, self._count, self._kept)
            number = min(number, BEFORE_MANY) if many else number
        own = None if relaxed is None else relaxed.weights[short]
        first = steps.starts(objective.candidates, own, self._count, kept, number, rng)
        bound = 0.0 if relaxed is None else relaxed.bound
        ends: list[IntArray] = []
        costs: list[float] = []
        for start in first:
            ends.append(short[improve(objective, start, kept)])
            costs.append(self._objective.cost(ends[-1]))
            if self._enough(costs, bound):
                break
        if many and not self._enough(costs, bound):
            found = small.many_starts(self._objective, np.array(ends), self._kept, many, rng)
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
        if N <= SHORTLIST:
            return np.arange(N), self._objective, self._kept
        weights: FloatArray = np.ones(N) if relaxed is None else relaxed.weights
        M = pool.weighted(weights * (self._count / float(weights.sum())))
        # what the weights leave unseen must not stop here
        C = np.linalg.inv(M + UNSEEN * self._count / N * pool.whole)
        scores = pool.scores(np.asarray(C))
        if relaxed is not None:
            scores[weights > OPTIMAL] = np.inf
        scores[self._kept] = np.inf
        short = np.sort(np.argpartition(scores, N - SHORTLIST)[N - SHORTLIST :])
        return short, self._criterion.on(pool.take(short)), np.searchsorted(short, self._kept)
