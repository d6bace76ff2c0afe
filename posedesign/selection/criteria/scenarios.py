"""A criterion over several scenarios: a choice that stays good when the truth is not as described.

The blocks of a pose are stacked, one scenario after the other: ``(N, S m, p)``. Each scenario has
its own information; the cost of a choice is the mean of theirs, or the largest. A bound for each
scenario is one for their mean, and the largest of them for the largest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria.base import Criterion, Objective
from posedesign.selection.information_state import Ledger
from posedesign.selection.relaxation import Relaxation

Over = Callable[[FloatArray], FloatArray]


class OverScenarios(Criterion):
    """A criterion in its mean over scenarios, or where it is worst.

    ``criterion``: in each scenario. ``scenarios``: number S of them. ``worst``: the worst counts;
    otherwise the mean cost.
    """

    def __init__(self, criterion: Criterion, scenarios: int, *, worst: bool = False) -> None:
        if scenarios < 1:
            raise InputError(f"{scenarios} scenarios", hint="take one at least", name="scenarios")
        self._each, self._scenarios, self._worst = criterion, scenarios, worst
        self.name = criterion.name
        self.title = f"{criterion.title}, {'at worst' if worst else 'in the mean'} of scenarios"
        self.smaller_is_better = criterion.smaller_is_better
        self.falls_with_poses = criterion.falls_with_poses

    def on(self, candidates: Candidates) -> ScenariosObjective:
        if candidates.m % self._scenarios:
            raise InputError(
                f"blocks of {candidates.m} rows are not those of {self._scenarios} scenarios",
                hint="stack the blocks of all scenarios: (N, S m, p)",
                name="blocks",
            )
        parts = np.split(candidates.J, self._scenarios, axis=1)
        return ScenariosObjective(
            candidates,
            [self._each.on(candidates.with_blocks(part)) for part in parts],
            worst=self._worst,
        )

    def shown(self, cost: float) -> float:
        return self._each.shown(cost)

    def cost_of(self, value: float) -> float:
        return self._each.cost_of(value)


class ScenariosObjective(Objective):
    """The objectives of all scenarios as one.

    ``candidates``: of stacked blocks.
    """

    def __init__(self, candidates: Candidates, each: Sequence[Objective], *, worst: bool) -> None:
        super().__init__(candidates)
        self._each, self._worst = tuple(each), worst

    @property
    def width(self) -> int:
        return max(objective.width for objective in self._each)

    @property
    def stages(self) -> Sequence[Objective]:
        stages = zip(*(objective.stages for objective in self._each), strict=True)
        return [ScenariosObjective(self.candidates, one, worst=self._worst) for one in stages]

    def ledger(self, rows: IntArray, count: int) -> Ledger:
        return _Ledgers([objective.ledger(rows, count) for objective in self._each])

    def _over(self, costs: Sequence[FloatArray] | Sequence[float]) -> FloatArray:
        stacked = np.asarray(costs)
        return np.asarray(stacked.max(axis=0) if self._worst else stacked.mean(axis=0))

    def cost(self, rows: IntArray) -> float:
        return float(self._over([objective.cost(rows) for objective in self._each]))

    def costs(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        if not isinstance(ledger, _Ledgers):
            raise TypeError("scenarios need their own ledger")
        pairs = zip(self._each, ledger.each, strict=True)
        return self._over([objective.costs(own, part, sign) for objective, own in pairs])

    def of_choices(self, choices: IntArray) -> FloatArray:
        return self._over([objective.of_choices(choices) for objective in self._each])

    @property
    def rugged(self) -> bool:
        return self._worst or any(objective.rugged for objective in self._each)

    def relax(self, count: int, tolerance: float) -> Relaxation:
        found = [objective.relax(count, tolerance) for objective in self._each]
        return Relaxation(
            np.mean([one.weights for one in found], axis=0),
            float(self._over([one.cost for one in found])),
            None,
            float(self._over([one.bound for one in found])),
        )


class _Ledgers(Ledger):
    """One choice, kept in every scenario."""

    def __init__(self, each: Sequence[Ledger]) -> None:
        self.each = tuple(each)

    @property
    def chosen(self) -> BoolArray:  # type: ignore[override]
        return self.each[0].chosen

    @property
    def state(self) -> tuple[object, ...]:
        return tuple(ledger.state for ledger in self.each)

    @state.setter
    def state(self, before: tuple[Any, ...]) -> None:
        for ledger, own in zip(self.each, before, strict=True):
            ledger.state = own

    def refresh(self) -> None:
        for ledger in self.each:
            ledger.refresh()

    def take(self, row: int) -> None:
        for ledger in self.each:
            ledger.take(row)

    def drop(self, row: int) -> None:
        for ledger in self.each:
            ledger.drop(row)
