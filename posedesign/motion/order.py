"""The order in which places are visited, and how long a round through them takes.

Functions of arrays alone: what lies between two places, and whether the way is clear, is in the
costs that they are given.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.motion.tour import Tour

KICKS_PER_PLACE = 10
"""Kicks of a thorough search. Rounds of 28 to 501 places, free and with half of the legs blocked,
are then .9 % longer at most than those of a Lin-Kernighan-Helsgaun search."""

LONGEST_SHIFT = 3
"""Most places that are moved together in an improvement by costs that differ there and back."""

BITS = 30
"""Digits of the largest cost as a whole number: rounding takes away what arithmetic differs by from
machine to machine, and no time that counts."""

_NO_GAIN = 1e-12
"""Share of the whole length below which a gain is rounding; without a bound a search could turn in
circles."""


class OrderSearch:
    """A short order of places from place 0, repaired where ways turn out to be blocked.

    ``cost`` (N, N): from each place (row) to each; infinite where there is no way. Need not be
    symmetric: the search is by the mean of there and back, and its order is improved by the costs
    themselves. ``closed``: whether the way back to place 0 counts.
    """

    def __init__(self, cost: FloatArray, *, closed: bool = False) -> None:
        self._closed, self._count = closed, len(cost)
        largest = cost[np.isfinite(cost)].max(initial=0.0)
        self._unit = np.ldexp(1.0, int(np.frexp(largest)[1]) - BITS)
        # more than any order without such a way
        self._blocked = (len(cost) + 2) * 2**BITS
        self._ends = self._with_end(cost)
        self._tour = Tour(self._there_and_back())

    @property
    def order(self) -> list[int]:
        """All places, 0 first."""
        tour, end = self._tour.order, self._count
        if not self._closed:
            k = tour.index(end)  # next to place 0 where one leg more does not count for more
            tour = tour[:k] if k == end else [0, *tour[:k:-1], *tour[k - 1 : 0 : -1]]
        costs = self._ends.astype(float)
        path = np.array([*tour, end], dtype=np.intp)
        if self._closed:  # the better way round, where there and back differ
            path = _near_end_first(costs, path, _back(path))
        path = _improved(costs, path)
        if self._closed:
            path = _near_end_first(costs, path, _back(path))
        return [int(place) for place in path[:-1]]

    def search(self) -> None:
        """Search thoroughly, with a fixed amount of work."""
        self._tour.kick(KICKS_PER_PLACE * self._count)

    def change(self, legs: Sequence[tuple[int, int]], cost: FloatArray) -> None:
        """Take new costs ``(L,)`` of ways, and repair the order about their ends.

        ``legs``: pairs of places. Infinite where there turned out to be no way.
        """
        if not legs:
            return
        pairs = np.array(legs, dtype=np.intp)
        starts, ends = pairs.T
        self._ends[starts, ends] = self._whole(cost)
        if self._closed:  # the way back to place 0 is that to the end
            back = starts[ends == 0]
            self._ends[back, self._count] = self._ends[self._count, back] = self._ends[back, 0]
        self._tour.set_legs(pairs, self._ends[starts, ends] + self._ends[ends, starts])

    def _whole(self, cost: FloatArray) -> IntArray:
        """Costs as whole numbers."""
        finite = np.isfinite(cost)
        whole = np.full(cost.shape, self._blocked, dtype=np.int64)
        whole[finite] = np.rint(cost[finite] / self._unit)
        return whole

    def _with_end(self, cost: FloatArray) -> IntArray:
        """Costs ``(N + 1, N + 1)`` as whole numbers; the end of the order is a last place."""
        count = self._count
        ends = np.zeros((count + 1, count + 1), dtype=np.int64)
        ends[:count, :count] = self._whole(cost)
        if self._closed:
            ends[:count, count] = ends[count, :count] = ends[:count, 0]
        return ends

    def _there_and_back(self) -> IntArray:
        """Costs of the round: twice the mean of there and back.

        An open order is a round over its end, which lies between the last place and place 0.
        """
        both = self._ends + self._ends.T
        if self._closed:
            return both[:-1, :-1]
        both[-1, 1:-1] = both[1:-1, -1] = 2 * self._blocked
        both[-1, 0] = both[0, -1] = 0
        return both


def shortest_order(cost: FloatArray, *, closed: bool = False, thorough: bool = True) -> list[int]:
    """Return a short order of all places from place 0, or of a round from and to it.

    See :class:`OrderSearch`. ``thorough``: False: improved until no exchange of legs gains, without
    kicks.
    """
    found = OrderSearch(cost, closed=closed)
    if thorough:
        found.search()
    return found.order


def _length(cost: FloatArray, path: IntArray) -> float:
    return float(cost[path[:-1], path[1:]].sum())


def _back(path: IntArray) -> IntArray:
    """The other way round, from the same place to the same end."""
    return np.concatenate([path[:1], path[-2:0:-1], path[-1:]])


def _near_end_first(cost: FloatArray, path: IntArray, back: IntArray) -> IntArray:
    """The shorter of the two ways round; of equal ones, that which begins with the shorter leg."""
    gain = _length(cost, path) - _length(cost, back)
    if abs(gain) > _NO_GAIN * _length(cost, path):
        return back if gain > 0 else path
    first = cost[path[0], path[1]], cost[back[0], back[1]]
    return back if first[1] < first[0] else path


def _improved(cost: FloatArray, path: IntArray) -> IntArray:
    """The path after all changes that shorten it, the best first; its ends stay."""
    if len(path) < 4:
        return path
    while True:
        along = cost[np.ix_(path, path)]  # by places of the path: neighbours stand side by side
        options = [_best_turn(along)]
        options += [
            _best_shift(along, size) for size in range(1, min(LONGEST_SHIFT, len(path) - 3) + 1)
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


def legs_of(order: list[int], *, closed: bool) -> list[tuple[int, int]]:
    """The pairs of places that an order goes between; the way back to its first at the end."""
    if len(order) < 2:
        return []
    return list(pairwise([*order, order[0]] if closed else order))
