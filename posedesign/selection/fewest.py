"""The fewest poses of a pool that reach a value, and how few cannot.

From above: poses are taken in one by one until the value is reached, then exchange is tried with
fewer and fewer. From below: the relaxation of a number of poses proves that none of as many can
reach it. Where the two meet the number is proven.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria import Criterion, criterion_by_name
from posedesign.selection.select import STARTS, select
from posedesign.selection.selection import Fewest, Selection
from posedesign.selection.small import ENUMERATED

ROUGH = 0.02
"""Part to which bounds are sharpened while the number of poses is looked for."""

MOST_CONDITION_POSES = 200
"""Poses that a condition number is tried with at most: more of them need not lower it."""


def select_fewest(
    blocks: ArrayLike,
    criterion: str | Criterion,
    value: float = 1.0,
    *,
    known: ArrayLike | None = None,
    keep: Sequence[int] = (),
    interest: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    starts: int = STARTS,
) -> Fewest:
    """Choose the fewest poses of a pool that reach a value of a criterion.

    Parameters
    ----------
    blocks, known, keep, interest, names, starts
        As of :func:`~posedesign.selection.select.select`.
    value : float
        To be reached, as the criterion is shown. 1 for
        :func:`~posedesign.selection.criteria.registry.wanted_deviations`.

    Raises
    ------
    InputError
        Blocks or a value that cannot be used.
    NotIdentifiableError
        The whole pool cannot identify some of the parameters, which are named.
    """
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"a wanted value of {value:g}", hint="it must be above zero", name="value")
    pool = Candidates(blocks, known, names)
    pool.check_identifiable()
    if not isinstance(criterion, Criterion):
        criterion_by_name(criterion, pool.p, pool.N, interest)  # told before anything is computed
    return _Search(pool, blocks, criterion, value, keep, known, interest, names, starts).run()


class _Search:
    """Between the most that are needed and the fewest that are proven."""

    def __init__(
        self,
        pool: Candidates,
        blocks: ArrayLike,
        criterion: str | Criterion,
        value: float,
        keep: Sequence[int],
        known: ArrayLike | None,
        interest: Sequence[int] | None,
        names: Sequence[str] | None,
        starts: int,
    ) -> None:
        self._pool, self._blocks, self._criterion, self._value = pool, blocks, criterion, value
        self._keep, self._known, self._names, self._starts = keep, known, names, starts
        self._interest = interest
        self._offered = len(np.union1d(pool.distinct(), np.asarray(keep, dtype=np.intp)))
        self._found: dict[int, Selection] = {}
        self._monotone = self._criterion_of(pool.N).falls_with_poses
        self._least = max(1, len(keep), 0 if known is not None else int(np.ceil(pool.p / pool.m)))

    def _criterion_of(self, count: int) -> Criterion:
        """The criterion; O1 is another one for each number of poses."""
        if isinstance(self._criterion, Criterion):
            return self._criterion
        return criterion_by_name(self._criterion, self._pool.p, count, self._interest)

    def _enough(self, cost: float, count: int) -> bool:
        # rounding of the last digits must not ask for a pose more
        return bool(cost <= self._criterion_of(count).cost_of(self._value) * (1.0 + 1e-9))

    def run(self) -> Fewest:
        """Bracket, halve, report."""
        most = self._offered if self._monotone else min(self._offered, MOST_CONDITION_POSES)
        upper = self._reached_from(most)
        if upper is None:
            best = self._choose(most)
            least = most if self._monotone else self._least
            return Fewest(best, None, self._value, reached=False, at_least=least)
        lower = self._proven_from(upper) if self._monotone else self._least
        low = lower
        while low < upper:
            middle = (low + upper) // 2
            if self._does(middle):
                upper = middle
            else:
                low = middle + 1
        fewer = self._choose(upper - 1) if upper > self._least else None
        return Fewest(self._choose(upper), fewer, self._value, reached=True, at_least=lower)

    def _reached_from(self, most: int) -> int | None:
        """A number of poses that does, by doubling."""
        if self._monotone and not self._enough(self._cost_of_all(), self._offered):
            return None
        count = min(max(self._least, 4), most)
        while not self._does(count):
            if count == most:
                return None
            count = min(2 * count, most)
        return count

    def _cost_of_all(self) -> float:
        return self._criterion_of(self._offered).on(self._pool).cost(np.arange(self._pool.N))

    def _proven_from(self, upper: int) -> int:
        """The fewest poses that are not proven to be too few."""
        low, high = self._least, upper
        objective = None if len(self._keep) else self._criterion_of(upper).on(self._pool)
        while low < high:
            middle = (low + high) // 2
            if middle in self._found or self._few_choices(middle) or objective is None:
                chosen = self._choose(middle)
                bound = chosen.criterion.cost_of(chosen.bound)
            else:
                bound = objective.relax(middle, ROUGH).bound
            if self._enough(bound, middle):
                high = middle
            else:
                low = middle + 1
        return low

    def _few_choices(self, count: int) -> bool:
        """Whether all choices are tried: what that proves is the most there is to prove."""
        kept = len(self._keep)
        return comb(self._offered - kept, count - kept) <= ENUMERATED

    def _does(self, count: int) -> bool:
        found = self._choose(count)
        return self._enough(found.criterion.cost_of(found.value), count)

    def _choose(self, count: int) -> Selection:
        if count not in self._found:
            self._found[count] = select(
                self._blocks,
                count,
                self._criterion,
                known=self._known,
                keep=self._keep,
                interest=self._interest,
                names=self._names,
                starts=self._starts,
                tolerance=ROUGH,
            )
        return self._found[count]
