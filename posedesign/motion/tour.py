"""A short round through places, searched with a fixed amount of work.

Lin and Kernighan's search [LinKernighan1973]_ over the nearest places, to a depth of three
exchanges, and stretches of up to three places moved elsewhere [Or1976]_; then kicks: two
neighbouring stretches are swapped [MartinOtto1991]_, the places where that was done are improved,
and what is longer than before is taken back. Costs are whole numbers and the chances are seeded:
the same costs give the same round on every machine, however busy it is.

References
----------
.. [LinKernighan1973] S. Lin and B. W. Kernighan, "An effective heuristic algorithm for the
   traveling-salesman problem", Operations Research 21, 1973.
.. [Or1976] I. Or, "Traveling salesman-type combinatorial problems and their relation to the
   logistics of regional blood banking", PhD thesis, Northwestern University, 1976.
.. [MartinOtto1991] O. Martin, S. W. Otto and E. W. Felten, "Large-step Markov chains for the
   traveling salesman problem", Complex Systems 5, 1991.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from random import Random

import numpy as np

from calib.se3 import IntArray

NEAREST = 10
"""Nearest places of each that it is joined to on trial. Of costs that are largest differences of
points in six dimensions eight miss more; twelve take longer for the same length."""

BREADTHS = (5, 3, 1)
"""Exchanges that are followed at each depth. A depth of five took twice the time for rounds of 55
to 500 places that were as long."""

LONGEST_SHIFT = 3
"""Most places that are moved together: longer stretches hardly ever gain."""

LONGEST_SWAPPED = 30
"""Most places of each of two stretches that are swapped. A swap of near places is improved in
their neighbourhood, so that a kick takes about as long among many places as among few."""

SEED = 1


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
        self._touched: list[int] = []
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

    def _beside(self, place: int, step: int) -> int:
        """The place so many steps on, back where negative."""
        return self._order[(self._at[place] + step) % self._count]

    def _improve(self, places: list[int]) -> None:
        """Improve about some places, and about those that are changed by it, until none helps."""
        queue, waiting = deque(places), set(places)
        while queue:
            place = queue.popleft()
            waiting.discard(place)
            while self._exchange(place) or self._shift(place):
                more = [other for other in self._touched if other not in waiting]
                queue.extend(dict.fromkeys(more))
                waiting.update(more)

    def _exchange(self, first: int) -> bool:
        """Exchange legs, the first of them beside a place, so that the round is shorter."""
        for step in (1, -1):
            self._touched = [first]
            if self._deepen(first, step, self._cost[first][self._beside(first, step)], 0):
                return True
        return False

    def _deepen(self, first: int, step: int, removed: int, depth: int) -> bool:
        """Replace the leg from ``first`` by one to a place near its end; and so on from there.

        ``removed``: length of the legs that are removed so far less that of the added ones. The
        order is a round again after each replacement, by the leg that is replaced next.
        """
        cost, order, at, count = self._cost, self._order, self._at, self._count
        end = self._beside(first, step)
        options = []
        for near in self._near[end]:
            left = removed - cost[end][near]
            if left <= 0:
                break
            k = at[near] - step
            following = order[k if k < count else 0]
            if near != first and following != end:
                options.append((left + cost[following][near], near, following))
        options.sort(key=lambda option: -option[0])
        last = depth + 1 == len(BREADTHS)
        for left, near, following in options[: BREADTHS[depth]]:
            gain = left - cost[following][first]
            if last and gain <= 0:
                continue
            self._turn(end, following, step)
            self._touched += (end, near, following)
            if gain > 0:
                self._length -= gain
                return True
            onward = 1 if self._beside(first, 1) == following else -1
            if self._deepen(first, onward, left, depth + 1):
                return True
            del self._touched[-3:]
            self._turn(following, end, onward)
            step = 1 if self._beside(first, 1) == end else -1
        return False

    def _turn(self, first: int, last: int, step: int) -> None:
        """Turn round the stretch from one place to another in the direction of ``step``.

        Or all the rest, which is the same round, where that is shorter.
        """
        order, at, count = self._order, self._at, self._count
        i, j = (at[first], at[last]) if step == 1 else (at[last], at[first])
        size = (j - i) % count + 1
        if 2 * size > count:
            i, j, size = (j + 1) % count, (i - 1) % count, count - size
        if i <= j:
            order[i : j + 1] = order[i : j + 1][::-1]
            for k in range(i, j + 1):
                at[order[k]] = k
            return
        for _ in range(size // 2):
            a, b = order[i], order[j]
            order[i], order[j], at[a], at[b] = b, a, j, i
            i, j = (i + 1) % count, (j - 1) % count

    def _shift(self, first: int) -> bool:
        """Move a stretch that begins or ends with a place to between two others, if that gains."""
        cost, order, at, count = self._cost, self._order, self._at, self._count
        i = at[first]
        for step in (1, -1):
            before = order[(i - step) % count]
            for size in range(1, min(LONGEST_SHIFT, count - 3) + 1):
                last = order[(i + step * (size - 1)) % count]
                after = order[(i + step * size) % count]
                taken = cost[before][first] + cost[last][after] - cost[before][after]
                for near in self._near[first]:
                    left = taken - cost[first][near]
                    if left <= 0:
                        break
                    away = (at[near] - i) * step % count
                    if away < size:  # in the stretch
                        continue
                    for side in (1, -1):
                        if size <= away + side < count:
                            other = order[(at[near] + step * side) % count]
                            gain = left + cost[near][other] - cost[last][other]
                            if gain > 0:
                                self._move(first, step, size, near, other)
                                self._length -= gain
                                self._touched = [before, after, near, other, first, last]
                                return True
        return False

    def _move(self, first: int, step: int, size: int, near: int, other: int) -> None:
        """Put the stretch of so many places from ``first`` on between two, it beside ``near``."""
        i, count = self._at[first], self._count
        stretch = [self._order[(i + step * k) % count] for k in range(size)]
        taken = set(stretch)
        rest = [place for place in self._order if place not in taken]
        k = rest.index(near)
        if rest[(k + 1) % len(rest)] == other:
            self._order = rest[: k + 1] + stretch + rest[k + 1 :]
        else:
            self._order = rest[:k] + stretch[::-1] + rest[k:]
        self._number()

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
