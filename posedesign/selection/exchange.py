"""Choices made better pose by pose: greedy, exchange, excursions.

All look at one pose at a time, and each stops where no single change helps. Which optimum that is
depends on where it starts, so several starts are made, the best of them from the relaxation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria import Objective
from posedesign.selection.information_state import Ledger

NO_GAIN = 1e-9
"""Relative gains below are rounding: exchanging for them could go on for ever."""

MOST_PASSES = 30
"""Passes over all chosen poses; more than a handful are not seen."""

EXCURSION = 5
"""Poses more, or fewer, than wanted that an excursion goes to at most (Mitchell 1974)."""

Method = Callable[[Objective, IntArray, IntArray], IntArray]


def greedy(objective: Objective, count: int, kept: IntArray) -> IntArray:
    """A choice of ``count``: the best single pose taken in, again and again.

    ``kept``: candidates that are in it anyway.
    """
    ledger = objective.ledger(kept, count)
    first = objective.stages[0]
    for _ in range(count - len(kept)):
        _take_best(first, ledger)
        if ledger.chosen.sum() % 10 == 0:
            ledger.refresh()
    return ledger.rows


def _take_best(objective: Objective, ledger: Ledger) -> None:
    best = objective.best_with_each(ledger)
    # where all cost infinitely much, any
    ledger.take(int(np.argmin(ledger.chosen)) if best is None else best)


def exchange(objective: Objective, rows: IntArray, kept: IntArray) -> IntArray:
    """Put one pose after the other in place of the best of the pool, until none helps.

    The modified exchange of Cook and Nachtsheim 1980, after Fedorov 1972.
    """
    for stage in objective.stages:
        ledger = objective.ledger(rows, len(rows))
        for _ in range(MOST_PASSES):
            if not _pass(stage, ledger, kept):
                break
            ledger.refresh()
        rows = ledger.rows
    return rows


def _pass(objective: Objective, ledger: Ledger, kept: IntArray) -> bool:
    """Try every chosen pose once, those first that are missed least; whether any was exchanged."""
    free = np.setdiff1d(ledger.rows, kept)
    free = free[np.argsort(objective.costs_without(ledger, free), kind="stable")]
    changed = False
    for row in free.tolist():
        before = ledger.state
        ledger.drop(row)
        own = float(objective.costs(ledger, np.array([row]), 1.0)[0])
        best = objective.best_with_each(ledger, (1.0 - NO_GAIN) * own)
        if best is None:
            ledger.state = before
        else:
            ledger.take(best)
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
            ledger = objective.ledger(found, len(rows))
            for up in (up_first, not up_first):
                for _ in range(step):
                    _go(objective, ledger, kept, up=up)
            cost = objective.cost(ledger.rows)
            if cost < (1.0 - NO_GAIN) * best:
                best, found, improved = cost, ledger.rows, True
        step = 1 if improved else step + 1
    return found


def _go(objective: Objective, ledger: Ledger, kept: IntArray, *, up: bool) -> None:
    if up:
        if ledger.chosen.all():
            return
        _take_best(objective, ledger)
        return
    free = np.setdiff1d(ledger.rows, kept)
    if len(free):
        ledger.drop(int(free[np.argmin(objective.costs_without(ledger, free))]))


def as_given(objective: Objective, rows: IntArray, kept: IntArray) -> IntArray:
    """The start itself: the candidates that count most in the relaxation."""
    return rows


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
