"""A short round through places, searched with a fixed amount of work.

Up to three legs at once are replaced by shorter ones to near places, in all ways that leave one
round (the 3-opt of [Lin1965]_ over neighbour lists, by the gain criterion of
[LinKernighan1973]_); then kicks: two neighbouring stretches are swapped [MartinOtto1991]_, the
places where that was done are improved, and what is longer than before is taken back. Costs are
whole numbers and the chances are seeded: the same costs give the same round on every machine,
however busy it is.

References
----------
.. [Lin1965] S. Lin, "Computer solutions of the traveling salesman problem", Bell System Technical
   Journal 44, 1965.
.. [LinKernighan1973] S. Lin and B. W. Kernighan, "An effective heuristic algorithm for the
   traveling-salesman problem", Operations Research 21, 1973.
.. [MartinOtto1991] O. Martin, S. W. Otto and E. W. Felten, "Large-step Markov chains for the
   traveling salesman problem", Complex Systems 5, 1991.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from random import Random

import numpy as np

from calib.se3 import IntArray

NEAREST = 12
"""Nearest places of each that it is joined to on trial. With eight, rounds of 500 places with half
of the legs blocked were 1 % longer after as many kicks."""

LONGEST_SWAPPED = 100
"""Most places of each of two stretches that are swapped."""

SEED = 1

_TURNS = (
    ((1, 3, 0),),
    ((1, 3, 0), (3, 5, 0)),
    ((1, 5, 0), (3, 1, 2)),
    ((1, 2, 0), (2, 5, 0), (4, 1, 2)),
    ((1, 5, 0), (4, 2, 1)),
)
"""The stretches to be turned round for each kind of exchange: first place, last place, and the
place before it, by their numbers among the ends of the legs."""

_Exchange = tuple[int, int, tuple[int, ...]]
"""What an exchange of legs gains, its kind, and the ends of its legs."""


class Tour:
    """A round through places that is improved, and repaired where costs rise.

    ``cost`` (N, N): whole numbers, the same there and back. The search begins with the round from
    place 0 always on to the nearest that is left.
    """

    def __init__(self, cost: IntArray) -> None:
        self._count = len(cost)
        self._cost: list[list[int]] = cost.tolist()
        self._near: list[list[int]] = [[]] * self._count
        self._find_near(cost.copy(), range(self._count))
        self._random = Random(SEED)  # noqa: S311 - no secret, but the same on every machine
        self._order = self._nearest_next()
        self._at = [0] * self._count  # where in the order each place is
        self._number()
        self._length = sum(map(self._leg, self._order, self._order[1:] + self._order[:1]))
        self._improve(self._order[:])

    @property
    def order(self) -> list[int]:
        """The round, from place 0 on."""
        start = self._at[0]
        return self._order[start:] + self._order[:start]

    def kick(self, times: int) -> None:
        """Improve by so many kicks, each of which is taken back if it made the round longer."""
        if self._count < 5:
            return
        for _ in range(times):
            order, at, length = self._order[:], self._at[:], self._length
            self._improve(self._swap_stretches())
            if self._length > length:
                self._order, self._at, self._length = order, at, length

    def set_legs(self, legs: IntArray, cost: IntArray) -> None:
        """Take new costs ``(L,)`` of legs between places ``(L, 2)``; improve the round there."""
        for (one, other), length in zip(legs.tolist(), cost.tolist(), strict=True):
            self._cost[one][other] = self._cost[other][one] = length
        places: list[int] = np.unique(legs).tolist()
        apart = np.array([self._cost[place] for place in places])
        self._find_near(apart, places)
        self._length = sum(map(self._leg, self._order, self._order[1:] + self._order[:1]))
        self._improve(places)

    def _find_near(self, apart: IntArray, places: Sequence[int]) -> None:
        """Find the nearest others of some places, by costs ``(P, N)``, the nearest first."""
        apart[np.arange(len(places)), places] = apart.max(initial=0) + 1
        nearest = np.argsort(apart, axis=1, kind="stable")[:, : min(NEAREST, self._count - 1)]
        for place, near in zip(places, nearest.tolist(), strict=True):
            self._near[place] = near

    def _leg(self, start: int, end: int) -> int:
        return self._cost[start][end]

    def _nearest_next(self) -> list[int]:
        left, order = list(range(1, self._count)), [0]
        while left:
            order.append(min(left, key=self._cost[order[-1]].__getitem__))
            left.remove(order[-1])
        return order

    def _number(self) -> None:
        for k, place in enumerate(self._order):
            self._at[place] = k

    def _improve(self, places: list[int]) -> None:
        """Improve about some places, and about those that are changed by it, until none helps."""
        queue, waiting = deque(places), set(places)
        while queue:
            place = queue.popleft()
            waiting.discard(place)
            while changed := self._exchange(place):
                more = [other for other in changed if other not in waiting]
                queue.extend(more)
                waiting.update(more)

    def _exchange(self, first: int) -> tuple[int, ...]:
        """Make the best exchange that removes a leg beside a place; returns the ends of its legs.

        Empty where none makes the round shorter. The ends stand in the order in which they are
        found: ``first`` and ``end`` of the leg that is removed, a place ``near`` the end, to which
        it is joined, and a neighbour ``then`` of that place; the leg between these two is removed,
        and so on, until the last end is joined to ``first``.
        """
        cost, order, at, count = self._cost, self._order, self._at, self._count
        found: _Exchange = 0, 0, ()  # what is gained, kind, ends
        for step in (1, -1):
            end = order[(at[first] + step) % count]
            removed, of_end = cost[first][end], cost[end]
            for near in self._near[end]:
                left = removed - of_end[near]
                if left <= found[0]:
                    break
                if near == first:
                    continue
                then = order[(at[near] - step) % count]
                if then != end:
                    gone = left + cost[near][then]
                    if gone - cost[then][first] > found[0]:
                        found = gone - cost[then][first], 0, (first, end, near, then)
                    found = self._beyond_a_path(found, (first, end, near, then), step, gone)
                then = order[(at[near] + step) % count]
                gone = left + cost[near][then]
                found = self._beyond_a_ring(found, (first, end, near, then), step, gone)
        gain, kind, ends = found
        if ends:
            self._length -= gain
            for one, other, before in _TURNS[kind]:
                self._turn(ends[one], ends[other], ends[before])
        return ends

    def _beyond_a_path(
        self, found: _Exchange, ends: tuple[int, int, int, int], step: int, gone: int
    ) -> _Exchange:
        """The best third leg where two exchanged legs leave a path from the first place."""
        cost, order, at, count = self._cost, self._order, self._at, self._count
        first, end, near, then = ends
        start, of_then, best = at[end], cost[then], found[0]
        number = (at[near] - start) * step % count  # of places on from `end`, away from `first`
        for third in self._near[then]:
            left = gone - of_then[third]
            if left <= best:
                break
            if third == near:
                continue
            inside = (at[third] - start) * step % count < number
            last = order[(at[third] + (step if inside else -step)) % count]
            gain = left + cost[third][last] - cost[last][first]
            if gain > best and last != then:
                best = gain
                found = gain, 1 if inside else 2, (*ends, third, last)
        return found

    def _beyond_a_ring(
        self, found: _Exchange, ends: tuple[int, int, int, int], step: int, gone: int
    ) -> _Exchange:
        """The best third leg where two exchanged legs leave a ring apart: one of the ring."""
        cost, order, at, count = self._cost, self._order, self._at, self._count
        first, end, near, then = ends
        start, of_then, best = at[end], cost[then], found[0]
        number = (at[near] - start) * step % count
        for third in self._near[then]:
            left = gone - of_then[third]
            if left <= best:
                break
            place = (at[third] - start) * step % count
            if place >= number:
                continue
            for onward in (step, -step) if place else (step,):
                last = order[(at[third] + onward) % count]
                gain = left + cost[third][last] - cost[last][first]
                if gain > best:
                    best = gain
                    found = gain, 3 if onward == step else 4, (*ends, third, last)
        return found

    def _turn(self, first: int, last: int, before: int) -> None:
        """Turn round the stretch from one place, which stands beside ``before``, to another.

        Or all the rest, which is the same round, where that is shorter.
        """
        order, at, count = self._order, self._at, self._count
        i, j = at[first], at[last]
        if order[(at[before] + 1) % count] != first:
            i, j = j, i
        size = (j - i) % count + 1
        if 2 * size > count:
            i, j, size = (j + 1) % count, (i - 1) % count, count - size
        if i <= j:
            stretch = order[i : j + 1]
            stretch.reverse()
            order[i : j + 1] = stretch
            for k, place in enumerate(stretch, start=i):
                at[place] = k
            return
        for _ in range(size // 2):
            a, b = order[i], order[j]
            order[i], order[j], at[a], at[b] = b, a, j, i
            i, j = (i + 1) % count, (j - 1) % count

    def _swap_stretches(self) -> list[int]:
        """Swap two neighbouring stretches drawn at random; returns the ends of changed legs."""
        count, draw = self._count, self._random.randrange
        longest = min(LONGEST_SWAPPED, (count - 2) // 2)
        start, a, b = draw(count), 1 + draw(longest), 1 + draw(longest)
        self._order = self._order[start:] + self._order[:start]
        one, other = self._order[1 : 1 + a], self._order[1 + a : 1 + a + b]
        before, after = self._order[0], self._order[(1 + a + b) % count]
        leg = self._leg
        self._length += leg(before, other[0]) + leg(other[-1], one[0]) + leg(one[-1], after)
        self._length -= leg(before, one[0]) + leg(one[-1], other[0]) + leg(other[-1], after)
        self._order[1 : 1 + a + b] = other + one
        self._number()
        return [before, one[0], one[-1], other[0], other[-1], after]
