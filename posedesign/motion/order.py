"""The order in which places are visited, and how long a round through them takes.

Functions of arrays alone: what lies between two places, and whether the way is clear, is in the
costs that they are given.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from calib.se3 import FloatArray, IntArray

LIBRARY_S_PER_PAIR = 2e-5
LIBRARY_S_PER_PLACE = 4e-3
"""Time that the library has to find an order of more than twenty places [s]: so much for each two
of them, and at most for each. It stops by the clock and its chances cannot be seeded, so that its
answer could differ from run to run: those for 28, 60, 100 and 150 poses of a plan's pool did not,
six sets of each, nor by twice and four times as much time or half of it; those for 200 did in
some."""

ENOUGH = 0.4
"""Share of that time in which the library has to have had the processor. On a busy machine it gets
a small part of it, and orders of 27 to 60 places differed from run to run; it is then asked again,
with more time."""

_MOST_WAITING = 1000
"""Times the library's time after which its answer is taken as it is, whatever it got."""

WORTH = 1e-4
"""Share by which the library's order must be shorter to be taken: an order that depends on no clock
is better than one that is shorter by rounding."""

MANY = 200
"""Places beyond which an order is not sought from the nearest place next: that takes minutes to
improve for thousands of places, and the library's takes seconds and is shorter."""

_EXACT_TO = 20
"""Places up to which the library's answer is the best, whatever its time."""

_STEPS = 65535
"""Largest whole number that the library takes for a cost."""

_LONGEST_LEGS = 3.0
"""Costs beyond so many times the longest leg of an order that is already short count as equal: no
short order has them, and the others are rounded more finely."""

_NO_GAIN = 1e-12
"""Share of the whole length below which a gain is rounding; without a bound a search could turn in
circles."""

_LONGEST_SHIFT = 3
"""Most places that are moved together in an improvement: longer ones hardly ever gain (Or 1976)."""


def shortest_order(
    cost: FloatArray,
    *,
    closed: bool = False,
    thorough: bool = True,
    before: Sequence[int] | None = None,
) -> list[int]:
    """A short way through all places from place 0, or a short round from and to it.

    The nearest place next, then improved by turning stretches round and by moving up to three
    places elsewhere until neither gains; beside it, the order of the library ``fast-tsp`` improved
    in the same way, where that is shorter. Up to 20 places the library's order is the best for
    symmetric costs; beyond, it is a search of limited time (:data:`LIBRARY_S_PER_PAIR`).

    ``cost`` (N, N): from each place (row) to each; infinite where there is no way. Need not be
    symmetric. ``closed``: whether the way back to place 0 counts. ``thorough``: False: without the
    library. ``before``: an order, e.g. by costs of which a few have risen since, that is improved
    in place of one by the nearest place next. All places are in the order, 0 first.
    """
    ends = _with_end(cost, closed)
    start = _nearest_next(ends) if before is None else np.array([*before, len(cost)])
    if thorough and before is None and len(cost) > MANY:
        start = _by_library(ends, start, closed)
        thorough = False
    path = _improved(ends, start)
    if thorough and len(cost) > 3:
        other = _improved(ends, _by_library(ends, path, closed))
        if _length(ends, other) < (1.0 - WORTH) * _length(ends, path):
            path = other
    if closed:
        back = np.concatenate([[0], path[-2:0:-1], path[-1:]])
        path = _near_end_first(ends, path, back)
    return [int(i) for i in path[:-1]]


def _with_end(cost: FloatArray, closed: bool) -> FloatArray:
    """Costs ``(N + 1, N + 1)`` with the end of the way as a last place, all of them finite."""
    count = len(cost)
    ends = np.zeros((count + 1, count + 1))
    ends[:count, :count] = cost
    if closed:
        ends[:count, count] = cost[:, 0]
    ends[count] = ends[:, count]
    finite = ends[np.isfinite(ends)]
    # more than any order without such a way
    ends[~np.isfinite(ends)] = 1.0 + (count + 1) * finite.max(initial=0.0)
    return ends


def _length(cost: FloatArray, path: IntArray) -> float:
    return float(cost[path[:-1], path[1:]].sum())


def _near_end_first(cost: FloatArray, path: IntArray, back: IntArray) -> IntArray:
    """The shorter of the two ways round; of equal ones, that which begins with the shorter leg."""
    gain = _length(cost, path) - _length(cost, back)
    if abs(gain) > _NO_GAIN * _length(cost, path):
        return back if gain > 0 else path
    first = cost[path[0], path[1]], cost[back[0], back[1]]
    return back if first[1] < first[0] else path


def _nearest_next(cost: FloatArray) -> IntArray:
    """From place 0 always on to the nearest that is left; the end last."""
    end = len(cost) - 1
    left = np.ones(end, dtype=bool)
    path = [0]
    for _ in range(end):
        left[path[-1]] = False
        if left.any():
            path.append(int(np.argmin(np.where(left, cost[path[-1], :end], np.inf))))
    return np.array([*path, end], dtype=np.intp)


def _improved(cost: FloatArray, path: IntArray) -> IntArray:
    """The path after all changes that shorten it, the best first; its ends stay."""
    if len(path) < 4:
        return path
    while True:
        along = cost[np.ix_(path, path)]  # by places of the path: neighbours stand side by side
        options = [_best_turn(along)]
        options += [
            _best_shift(along, size) for size in range(1, min(_LONGEST_SHIFT, len(path) - 3) + 1)
        ]
        gain, changed = max(options, key=lambda option: option[0])
        if gain <= _NO_GAIN * _length(cost, path):
            return path
        path = path[changed]


def _best_turn(along: FloatArray) -> tuple[float, IntArray]:
    """The stretch that is best turned round (2-opt): what it gains, and the order of places then.

    ``along`` (L, L): costs between the places of a path, in its order.
    """
    onward, backward = np.diagonal(along, 1), np.diagonal(along, -1)
    # what the legs inside the stretch i .. j gain when they are run the other way
    turned = np.concatenate([[0.0], np.cumsum(onward - backward)])[1:-1]
    gain = onward[:-1, None] - along[:-2, 1:-1] + onward[1:] - along[1:-1, 2:]
    gain += turned - turned[:, None]
    gain[np.tri(len(gain), dtype=bool)] = -np.inf
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    changed = np.arange(len(along))
    changed[i + 1 : j + 2] = changed[i + 1 : j + 2][::-1].copy()
    return float(gain[i, j]), changed


def _best_shift(along: FloatArray, size: int) -> tuple[float, IntArray]:
    """The stretch of some places that is best moved elsewhere (Or-opt), perhaps turned round."""
    legs, count = np.diagonal(along, 1), len(along) - 1 - size
    first = np.arange(1, count + 1)  # of the stretch, (S,)
    last = first + size - 1
    taken = legs[first - 1] + legs[last] - along[first - 1, last + 1]
    inside = np.zeros(count)
    for k in range(size - 1):
        inside += np.diagonal(along, -1)[first + k] - legs[first + k]
    heads, tails = slice(1, count + 1), slice(size, count + size)
    as_is = along[:-1, heads].T + along[tails, 1:] - legs
    turned = along[:-1, tails].T + along[heads, 1:] - legs + inside[:, None]
    gain = taken[:, None] - np.minimum(as_is, turned)  # shape (S, L - 1), by where it could go
    place = np.arange(len(legs))
    gain[(place >= first[:, None] - 1) & (place <= last[:, None])] = -np.inf
    s, p = np.unravel_index(int(np.argmax(gain)), gain.shape)
    stretch = np.arange(first[s], last[s] + 1)
    if turned[s, p] < as_is[s, p]:
        stretch = stretch[::-1]
    rest = np.delete(np.arange(len(along)), np.arange(first[s], last[s] + 1))
    target = int(p) + 1 if p < first[s] else int(p) + 1 - size
    return float(gain[s, p]), np.insert(rest, target, stretch)


def _by_library(cost: FloatArray, path: IntArray, closed: bool) -> IntArray:
    """The library's order, by costs that are symmetric whole numbers.

    Costs of there and back are averaged. An open way is a round through one more place, which is
    next to place 0 and from which every other place is equally far.
    """
    end = len(cost) - 1
    legs = cost[path[:-1], path[1:]]
    blocked = cost.max()
    limit = _LONGEST_LEGS * legs[legs < blocked].max(initial=0.0)
    if limit == 0.0:
        return path
    both = np.minimum(0.5 * (cost + cost.T), limit) / limit
    whole = np.rint(_STEPS * both).astype(np.int64)
    np.fill_diagonal(whole, 0)
    if closed:
        whole = whole[:end, :end]
    else:
        whole[end, 1:end] = whole[1:end, end] = _STEPS
        whole[0, end] = whole[end, 0] = 0
    seconds = len(whole) * min(LIBRARY_S_PER_PAIR * len(whole), LIBRARY_S_PER_PLACE)
    tour = _worked_on(whole, seconds)
    start = tour.index(0)
    tour = [*tour[start:], *tour[:start]]
    if not closed:
        tour = tour if tour[-1] == end else [0, *tour[:0:-1]]
        if tour[-1] != end:  # costs that are all equal: any place may be next to place 0
            return path
        tour = tour[:-1]
    return np.array([*tour, end], dtype=np.intp)


def _worked_on(whole: IntArray, seconds: float) -> list[int]:
    """The library's round for costs ``(N, N)``, after enough seconds of a processor."""
    import fast_tsp

    budget = seconds
    while True:
        start = time.thread_time()
        tour: list[int] = fast_tsp.find_tour(whole, budget, max_threads=1, candidates="nearest")
        worked = time.thread_time() - start
        exact = len(whole) <= _EXACT_TO  # done sooner
        if exact or worked >= ENOUGH * seconds or budget > _MOST_WAITING * seconds:
            return tour
        budget *= 4.0


def legs_of(order: list[int], *, closed: bool) -> list[tuple[int, int]]:
    """The pairs of places that an order goes between; the way back to its first at the end."""
    if len(order) < 2:
        return []
    return list(pairwise([*order, order[0]] if closed else order))
