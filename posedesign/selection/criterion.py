"""A criterion, and what it comes to on one pool of candidates.

Every criterion is brought to a *cost* that is made small. For all but the condition numbers the
cost is a mean variance: geometric (D), arithmetic (A, I), largest (E, G). Its inverse is then a
concave, homogeneous function of the information, an information function in the sense of
Pukelsheim, Optimal Design of Experiments, 1993, chapter 5, and a bound that no choice of the pool
can beat follows from any positive semidefinite matrix: see
:mod:`~posedesign.selection.certificate`. The efficiency of a choice is the bound over its cost:
.97 says that the best that can be had from any n poses of the pool takes at least .97 n poses'
worth of measuring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.selection.candidates import RANK_TOLERANCE, Candidates
from posedesign.selection.certificate import Relaxation
from posedesign.selection.information import InformationState

NO_GAIN = 1e-9
"""Relative gains below are rounding: exchanging for them could go on for ever."""

FIRST_BATCH, LARGEST_BATCH = 32, 1024
"""Candidates whose costs are computed at once where those that cannot be best are left out."""


@dataclass(frozen=True, eq=False)
class Criterion:
    """What is made best."""

    name: str
    title: str  # in words
    smaller_is_better: bool  # of the value that is shown
    on: Callable[[Candidates], Objective]  # the objective that it comes to on a pool
    shown: Callable[[float], float]
    cost_of: Callable[[float], float]
    """shown, cost_of: from the cost to the value that people know the criterion by, and back."""
    falls_with_poses: bool = True
    """More poses never cost more: of variances, not of condition numbers."""


class Objective(ABC):
    """The cost of choices out of one pool: smaller is better, infinite where not all is seen."""

    width: int
    """Numbers of temporaries for each candidate in :meth:`costs`."""

    has_floor = False
    """Whether :meth:`at_least` takes much less time than :meth:`costs`."""

    rugged = False
    """Whether the cost has edges: exchanges then end in many places that are not best."""

    def __init__(self, candidates: Candidates) -> None:
        self.candidates = candidates

    @property
    def stages(self) -> Sequence[Objective]:
        """Objectives for the exchange, one after the other: smoother ones first."""
        return (self,)

    def state(self, rows: IntArray, count: int) -> InformationState:
        return InformationState(self.candidates, rows, count)

    @abstractmethod
    def cost(self, rows: IntArray) -> float:
        """Of a choice, computed without squaring its condition where that can be helped."""

    @abstractmethod
    def costs(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        """Of the state's choice with each of some candidates ``(n,)`` taken in, or put back.

        ``part``: of the candidates. ``sign``: +1: taken in; -1: put back.
        """

    @abstractmethod
    def of_choices(self, choices: IntArray) -> FloatArray:
        """Cost ``(T,)`` of choices ``(T, n)`` of a small pool, all at once.

        To fewer digits than :meth:`cost`; infinite where few digits would be left.
        """

    @abstractmethod
    def relax(self, count: int, tolerance: float) -> Relaxation:
        """The best that fractions of candidates, ``count`` in all, can be, with its proof."""

    def costs_with_each(self, state: InformationState) -> FloatArray:
        """Cost ``(N,)`` of the choice with each candidate besides; infinite for those in it."""
        out = np.empty(self.candidates.N)
        for part in self.candidates.chunks(self.width):
            out[part] = self.costs(state, part, 1.0)
        out[state.chosen] = np.inf
        return out

    def at_least(
        self, state: InformationState, part: slice | IntArray, near: int | None
    ) -> FloatArray:
        """Numbers ``(n,)`` that the costs with each of some candidates are not below.

        They are to be sharp for candidates like ``near``; by default for the choice as it is.
        """
        return np.zeros(self.candidates.N)[part]

    def best_with_each(
        self, state: InformationState, limit: float = np.inf, than: int | None = None
    ) -> int | None:
        """The candidate that costs least besides the choice; None where none is below ``limit``.

        ``than``: the candidate that it has to be better than, in place of a limit.

        Most candidates are far from the best: they are left out by what they cost at least, the
        others are tried in the order of it until none that is left can be better.
        """
        if not self.has_floor:
            costs = self.costs_with_each(state)
            limit = limit if than is None else (1.0 - NO_GAIN) * costs[than]
            best = int(np.argmin(costs))
            return best if costs[best] < limit else None
        if than is not None:
            limit = (1.0 - NO_GAIN) * float(self.costs(state, np.array([than]), 1.0)[0])
        floor = np.empty(self.candidates.N)
        for part in self.candidates.chunks(self.width):
            floor[part] = self.at_least(state, part, None)
        floor[state.chosen] = np.inf
        found: int | None = None
        left, size = np.flatnonzero(floor < limit), FIRST_BATCH
        left = left[np.argsort(floor[left], kind="stable")]
        while len(left):
            batch, left = left[:size], left[size:]
            costs = self.costs(state, batch, 1.0)
            best = int(np.argmin(costs))
            if costs[best] < limit:
                found, limit = int(batch[best]), float(costs[best])
            left = left[floor[left] < limit]
            if len(left) > size:
                # once more, sharp where the best of this batch is
                floor[left] = np.maximum(floor[left], self.at_least(state, left, int(batch[best])))
                left = left[floor[left] < limit]
                left = left[np.argsort(floor[left], kind="stable")]
            size = min(2 * size, LARGEST_BATCH)
        return found


def covariance_of_root(root: FloatArray) -> FloatArray | None:
    """Covariance ``(p, p)`` of rows ``(M, p)`` of information; None where not all is seen."""
    length = np.linalg.norm(root, axis=0)
    if len(root) < len(length) or not length.all():
        return None
    _, values, Vt = np.linalg.svd(root / length, full_matrices=False)
    if values[-1] <= RANK_TOLERANCE * values[0]:
        return None
    half = Vt / values[:, None] / length
    return np.asarray(half.T @ half)


def over_scenarios(criterion: Criterion, scenarios: int, *, worst: bool = False) -> Criterion:
    """A criterion over several scenarios: a choice that stays good when the truth is another.

    The blocks of a pose are stacked, one scenario after the other: ``(N, S m, p)``. Each scenario
    has its own information; the cost of a choice is the mean of theirs, or the largest. A bound for
    each scenario is one for their mean, and the largest of them for the largest.
    """
    if scenarios < 1:
        raise InputError(f"{scenarios} scenarios", hint="take one at least", name="scenarios")

    def on(candidates: Candidates) -> ScenariosObjective:
        if candidates.m % scenarios:
            raise InputError(
                f"blocks of {candidates.m} rows are not those of {scenarios} scenarios",
                hint="stack the blocks of all scenarios: (N, S m, p)",
                name="blocks",
            )
        parts = np.split(candidates.J, scenarios, axis=1)
        each = [criterion.on(candidates.with_blocks(part)) for part in parts]
        return ScenariosObjective(candidates, each, worst=worst)

    title = f"{criterion.title}, {'at worst' if worst else 'in the mean'} of scenarios"
    return replace(criterion, title=title, on=on)


class ScenariosObjective(Objective):
    """The objectives of all scenarios as one, on candidates of stacked blocks."""

    def __init__(self, candidates: Candidates, each: Sequence[Objective], *, worst: bool) -> None:
        super().__init__(candidates)
        self._each, self._worst = tuple(each), worst
        self.width = max(objective.width for objective in each)
        self.rugged = worst or any(objective.rugged for objective in each)

    @property
    def stages(self) -> Sequence[Objective]:
        stages = zip(*(objective.stages for objective in self._each), strict=True)
        return [ScenariosObjective(self.candidates, one, worst=self._worst) for one in stages]

    def state(self, rows: IntArray, count: int) -> InformationState:
        return _States([objective.state(rows, count) for objective in self._each])

    def _over(self, costs: Sequence[FloatArray] | Sequence[float]) -> FloatArray:
        stacked = np.asarray(costs)
        return np.asarray(stacked.max(axis=0) if self._worst else stacked.mean(axis=0))

    def cost(self, rows: IntArray) -> float:
        return float(self._over([objective.cost(rows) for objective in self._each]))

    def costs(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        if not isinstance(state, _States):
            raise TypeError("scenarios need their own state")
        pairs = zip(self._each, state.each, strict=True)
        return self._over([objective.costs(own, part, sign) for objective, own in pairs])

    def of_choices(self, choices: IntArray) -> FloatArray:
        return self._over([objective.of_choices(choices) for objective in self._each])

    def relax(self, count: int, tolerance: float) -> Relaxation:
        found = [objective.relax(count, tolerance) for objective in self._each]
        return Relaxation(
            np.mean([one.weights for one in found], axis=0),
            float(self._over([one.cost for one in found])),
            None,
            float(self._over([one.bound for one in found])),
        )


class _States(InformationState):
    """One choice, kept in every scenario."""

    def __init__(self, each: Sequence[InformationState]) -> None:
        self.each = tuple(each)

    @property
    def chosen(self) -> BoolArray:  # type: ignore[override]
        return self.each[0].chosen

    @property
    def snapshot(self) -> tuple[object, ...]:
        return tuple(state.snapshot for state in self.each)

    @snapshot.setter
    def snapshot(self, before: tuple[Any, ...]) -> None:
        for state, own in zip(self.each, before, strict=True):
            state.snapshot = own

    def refresh(self) -> None:
        for state in self.each:
            state.refresh()

    def take(self, row: int) -> None:
        for state in self.each:
            state.take(row)

    def drop(self, row: int) -> None:
        for state in self.each:
            state.drop(row)
