"""Small pools, where all choices, or all exchanges from many starts, are judged at once."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from calib.se3 import IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria import Objective

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

NO_GAIN = 1e-9
"""Relative gains below are rounding."""

NEAR = 1e-4
"""Part of the best cost within which choices are judged again, without squaring their condition."""

_UNCLEAR = 1_000
"""Choices that see so little that only the same can tell, up to which that is done."""


def number_of_choices(candidates: Candidates, count: int, kept: IntArray) -> int:
    """How many choices there are."""
    return comb(candidates.N - len(kept), count - len(kept))


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
