"""What is known of the motions between the postures of one cell: detours, and approaches.

A detour leads through the base posture, or with the tool drawn back along its z before and after.
Motions are the same in both directions.

Passed postures short of those that are measured let all joints arrive from one side. A reducer
loses motion when its joint turns round: backlash, and friction that winds it up. Which side the
loss lies on depends on the side that the joint came from, so it differs from pose to pose unless
every joint makes its last movement in the same direction at all of them; then it is a constant, and
part of the zero offset. [Watanabe2006]_, section 2.1, asks the touch-up to suppress "the effect of
lost motion in robot reducers including backlash": of all reducers, also of the first and the last
joint, whose offsets are not identified but whose loss would still scatter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import islice, pairwise, product

import numpy as np

from calib.robots import Robot
from calib.robots.move_times import ACCELERATION_S, move_times, moving_time_s
from calib.se3 import BoolArray, FloatArray
from posedesign.constraints import Checker, MotionChecker, nearest_postures

RETREATS_M = (0.1, 0.2, 0.4)
"""How far the tool is drawn back in a detour, the shortest that helps."""

Leg = tuple[FloatArray, FloatArray]
"""From a posture ``(n,)`` to a posture ``(n,)`` [rad]."""

AT_FIRST = 32
"""Motions from the nearest other poses that are checked where a way over other poses is looked for;
twice as many each time that there is none."""

COMES_M = 0.01
"""How far what slides goes along with an approach: the lost motion of a rack is tenths of a
millimetre."""

MOST_DIRECTIONS = 16
"""Combinations of directions whose motions are checked: postures that keep a distance with so short
a way between them that does not are rare, and every joint can be turned alone within as many."""


class KnownMotions:
    """Remembers what was found out of motions; each is checked once.

    ``passing``: what a posture that the arm only passes through must keep. ``base`` (n,): posture
    that detours may lead through [rad]. ``speeds`` (n,): of the joints [rad/s]: the quickest detour
    is taken.
    """

    def __init__(
        self,
        robot: Robot,
        motions: MotionChecker,
        passing: Checker,
        base: FloatArray,
        speeds: FloatArray,
    ) -> None:
        self._robot = robot
        self._motions = motions
        self._passing = passing
        self._base = base
        self._speeds = speeds
        self._reasons: dict[frozenset[bytes], str] = {}
        # the other ends of the motions of each posture: clear ones, blocked ones, and those of the
        # blocked ones that a detour is known for
        self._clear: dict[bytes, set[bytes]] = {}
        self._shut: dict[bytes, set[bytes]] = {}
        self._led_round: dict[bytes, set[bytes]] = {}
        self._detours: dict[frozenset[bytes], list[FloatArray] | None] = {}
        self._retreats: dict[bytes, list[FloatArray]] = {}

    def check(self, legs: Sequence[Leg]) -> bool:
        """Check the motions that are not yet known; whether there was one."""
        unknown = {_edge(*leg): leg for leg in legs if _edge(*leg) not in self._reasons}
        if unknown:
            starts, ends = (np.array(side) for side in zip(*unknown.values(), strict=True))
            self._reasons.update(zip(unknown, self._blocked(starts, ends), strict=True))
            for edge, (a, b) in unknown.items():
                _join(self._shut if self._reasons[edge] else self._clear, a, b)
        return bool(unknown)

    def reason(self, start: FloatArray, end: FloatArray) -> str:
        """What is known to be in the way between two postures."""
        return self._reasons.get(_edge(start, end), "")

    def blocked(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Motions ``(K, K)`` from each of ``(K, n)`` to each of ``(K, n)`` known to be blocked."""
        return _between(self._shut, starts, ends)

    def clear(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Motions ``(K, K)`` known to be clear, as :meth:`blocked`."""
        return _between(self._clear, starts, ends)

    def through(
        self, start: FloatArray, end: FloatArray, others: Sequence[FloatArray]
    ) -> list[FloatArray] | None:
        """Postures to pass from one to another; none for a clear way, None without any.

        A detour where there is one, else the quickest known way over other postures. Motions from
        those to the end are checked in batches, the quickest first, until there is a way.
        """
        if not self.reason(start, end):
            return []
        detour = self.detour(start, end)
        if detour is not None:
            return detour
        places = [q for q in others if not np.array_equal(q, end)]
        if not places:
            return None
        quickest = np.argsort(self._times(np.array(places), end), kind="stable").tolist()
        size, asked = AT_FIRST, 0
        while asked < len(places):
            self.check([(end, places[k]) for k in quickest[asked : asked + size]])
            asked, size = asked + size, 2 * size
            path = self._over_others([start, *places, end])
            if path is not None:
                return path
        return None

    def detour(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        """Postures to pass through from one to another, the quickest of those that are clear."""
        edge = _edge(start, end)
        if edge not in self._detours:
            self._detours[edge] = self._quickest_detour(start, end)
            if self._detours[edge] is not None:
                _join(self._led_round, start, end)
        path = self._detours[edge]
        if path is None:
            return None
        return path[1:-1] if np.array_equal(path[0], start) else path[-2:0:-1]

    def _quickest_detour(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        """The quickest clear path from one to another over the base, drawn back, or both."""
        first, last = self._drawn_back(start), self._drawn_back(end)
        self.check(
            [(a, b) for a, some in ((start, first), (end, last)) for b in (self._base, *some)]
        )
        options = [[self._base], *([q] for q in (*first, *last))]
        options += [[a, b] for a in first for b in last]
        options += [[a, self._base, b] for a in first for b in last]
        self.check(
            [(via[0], end) for via in options[1 : 1 + len(first)] if not self.reason(start, via[0])]
            + [(start, q) for q in last if not self.reason(q, end)]
        )
        # what lies between is of use only where both ends of it can be come to
        paths = [
            [start, *via, end]
            for via in options
            if not (self.reason(start, via[0]) or self.reason(via[-1], end))
        ]
        self.check([leg for path in paths for leg in pairwise(path[1:-1])])
        paths.sort(key=self._time)
        clear = (path for path in paths if not any(self.reason(*leg) for leg in pairwise(path)))
        return next(clear, None)

    def in_steps(self, path: Sequence[FloatArray]) -> list[FloatArray]:
        """The path with stops put in between, so that no joint travels too far at once."""
        stops = [path[0]]
        for a, b in pairwise(path):
            count = self._motions.steps(a, b)
            stops += [a + (b - a) * k / count for k in range(1, count)]
            stops.append(b)  # as it is: motions are known by the last bit of their ends
        return stops

    def _over_others(self, places: Sequence[FloatArray]) -> list[FloatArray] | None:
        """The quickest known way from the first to the last place over the others.

        Followed back from the last place (Dijkstra): where hardly anything leads to it, little is
        looked at.
        """
        ends = {places[0].tobytes(): 0, places[-1].tobytes(): len(places) - 1}
        rows = {q.tobytes(): row for row, q in enumerate(places)} | ends
        last = len(places) - 1
        best, onward, done = {last: 0.0}, {last: last}, set[int]()
        front = [(0.0, last)]
        while front:
            time, here = heappop(front)
            if here == 0:
                break
            if here in done:
                continue
            done.add(here)
            there = places[here].tobytes()
            clear = sorted(rows[q] for q in rows.keys() & self._clear.get(there, set()))
            hops = sorted(rows[q] for q in rows.keys() & self._led_round.get(there, set()))
            times = self._times(np.array([places[row] for row in clear]), places[here]).tolist()
            times += [
                self._time([places[k], *self._hop(places[k], places[here]), places[here]])
                for k in hops
            ]
            for row, hop in zip([*clear, *hops], times, strict=True):
                if time + hop < best.get(row, np.inf):
                    best[row], onward[row] = time + hop, here
                    heappush(front, (time + hop, row))
        if 0 not in best:
            return None
        path, here = list[FloatArray](), 0
        while here != last:
            following = onward[here]
            path += self._hop(places[here], places[following])
            if following != last:
                path.append(places[following])
            here = following
        return path

    def _hop(self, start: FloatArray, end: FloatArray) -> list[FloatArray]:
        """What leads from one place to another that a way is known to: nothing, or a detour."""
        return (self.detour(start, end) or []) if self.reason(start, end) else []

    def _blocked(self, start: FloatArray, end: FloatArray) -> list[str]:
        """What is in each of the motions ``(W, n)`` to ``(W, n)`` [rad], stops on them included."""
        reasons = list(self._motions.check(start, end, far=True).reasons)
        if np.isfinite(self._motions.largest_travel):
            for i in np.flatnonzero([not why for why in reasons]).tolist():
                stops = self.in_steps([start[i], end[i]])[1:-1]
                if stops:
                    verdicts = self._passing.check(np.array(stops))
                    worst = int(np.argmin(verdicts.slack))
                    reasons[i] = "" if verdicts.feasible.all() else verdicts.reason(worst)
        return reasons

    def _drawn_back(self, q: FloatArray) -> list[FloatArray]:
        """Postures near one with the tool drawn back along its z."""
        if q.tobytes() not in self._retreats:
            T = np.tile(self._robot.fk(q), (len(RETREATS_M), 1, 1))
            T[:, :3, 3] -= np.array(RETREATS_M)[:, None] * T[:, :3, 2]
            found = nearest_postures(self._passing, T, q)
            self._retreats[q.tobytes()] = list(found.q[found.feasible])
        return self._retreats[q.tobytes()]

    def _times(self, starts: FloatArray, end: FloatArray) -> FloatArray:
        """Times ``(K,)`` [s] of motions from postures ``(K, n)`` to one."""
        return move_times(starts.reshape(-1, len(end)) - end, self._speeds, ACCELERATION_S)

    def _time(self, path: Sequence[FloatArray]) -> float:
        return moving_time_s(np.array(path), self._speeds, ACCELERATION_S)


def _edge(a: FloatArray, b: FloatArray) -> frozenset[bytes]:
    return frozenset((a.tobytes(), b.tobytes()))


def _join(ends: dict[bytes, set[bytes]], a: FloatArray, b: FloatArray) -> None:
    """Add a motion to those of both of its ends."""
    ends.setdefault(a.tobytes(), set()).add(b.tobytes())
    ends.setdefault(b.tobytes(), set()).add(a.tobytes())


def _between(known: dict[bytes, set[bytes]], starts: FloatArray, ends: FloatArray) -> BoolArray:
    """Motions ``(K, K)`` from each of ``(K, n)`` to each of ``(K, n)`` that are among some."""
    enter = _rows(ends)
    found = np.zeros((len(starts), len(ends)), dtype=bool)
    for one, rows in _rows(starts).items():
        there = [row for other in enter.keys() & known.get(one, set()) for row in enter[other]]
        found[np.ix_(rows, there)] = True
    return found


def _rows(postures: FloatArray) -> dict[bytes, list[int]]:
    """Rows at which each posture of ``(K, n)`` is."""
    rows: dict[bytes, list[int]] = {}
    for i, q in enumerate(postures):
        rows.setdefault(q.tobytes(), []).append(i)
    return rows


@dataclass(frozen=True, eq=False)
class Approaches:
    """Where the arm stands before its last movement to each posture."""

    postures: FloatArray
    """(N, n): short of those that are measured, by the same joint angles for all [rad]."""
    direction: FloatArray  # (n,): of the last movement of each joint: 1 or -1
    lost: dict[int, str]  # postures, by index, that cannot be approached so, and why


def find_approaches(
    postures: FloatArray, angle_rad: float, passing: Checker, known: KnownMotions
) -> Approaches:
    """Stop short of postures ``(N, n)`` [rad] by an angle in every joint, by ``COMES_M`` in slides.

    All joints arrive from below where that does for all postures. Otherwise the directions, one a
    joint, are those that do for most postures, with the fewest joints that arrive from above.

    ``passing`` is what a posture that the arm only passes through must keep; the motions from there
    must be clear by what is ``known``.
    """
    best: Approaches | None = None
    sliding = passing.robot.sliding
    by = np.where(sliding, COMES_M, angle_rad)
    for direction, bound in islice(_directions(postures, by, passing), MOST_DIRECTIONS):
        if best is not None and bound <= len(postures) - len(best.lost):
            break
        short = postures - by * direction
        lost = _lost(postures, short, passing, known)
        if best is None or len(lost) < len(best.lost):
            best = Approaches(short, direction, lost)
        if not lost:
            break
    if best is None:  # no postures
        return Approaches(postures, np.ones(postures.shape[1]), {})
    return best


def _directions(
    postures: FloatArray, by: FloatArray, passing: Checker
) -> Iterator[tuple[FloatArray, int]]:
    """Directions ``(n,)`` by how many passed postures they allow, the most first, and how many."""
    count, n = postures.shape
    if not count:
        return
    if passing.check(postures - by).feasible.all():
        yield np.ones(n), count
    signs = np.array(list(product((1.0, -1.0), repeat=n)))  # shape (2 ** n, n)
    signs = signs[np.argsort((signs < 0).sum(axis=1), kind="stable")]
    short = postures[None] - by * signs[:, None]  # shape (2 ** n, N, n)
    good = passing.check(short.reshape(-1, n), every=False).feasible.reshape(-1, count).sum(axis=1)
    order = np.argsort(-good, kind="stable")
    for k in order:
        yield signs[k], int(good[k])


def _lost(
    postures: FloatArray, short: FloatArray, passing: Checker, known: KnownMotions
) -> dict[int, str]:
    """Postures that a passed posture or the way from it keeps from being approached, and why."""
    verdicts = passing.check(short)
    lost = {i: verdicts.reason(i) for i in np.flatnonzero(~verdicts.feasible).tolist()}
    rows = [i for i in range(len(postures)) if i not in lost]
    known.check([(short[i], postures[i]) for i in rows])
    lost |= {i: why for i in rows if (why := known.reason(short[i], postures[i]))}
    return {i: f"cannot be approached from one side: {why}" for i, why in sorted(lost.items())}
