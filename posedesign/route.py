"""The order in which poses are visited, so that every move between them is short and clear.

Moves are straight in joint space. The order is the shortest found from the base posture; where
the way between two poses is not clear, another order is tried, then a detour: through the base
posture, or with the tool drawn back along its z before and after. Where a joint would travel too
far at once, stops are put in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray, IntArray
from posedesign.feasibility import Checker, nearest_postures
from posedesign.feasibility.ways import WayChecker

MOST_ORDERS = 60
"""Orders tried while ways turn out to be blocked; each try checks only ways not yet known."""

RETREATS_M = (0.1, 0.2, 0.4)
"""How far the tool is drawn back in a detour, the shortest that helps."""

_BLOCKED = 1e6
"""Cost of a blocked way: more than any order of clear ones."""

_NO_GAIN = 1e-9
"""Gains below are rounding of :data:`_BLOCKED`; without a bound 2-opt could turn in circles."""


@dataclass(frozen=True, eq=False)
class Stop:
    """A posture on the route.

    Attributes
    ----------
    posture : array (n,)
        [rad]
    pose : int or None
        Index of the pose that is measured there; None where the arm only passes through.
    """

    posture: FloatArray
    pose: int | None


@dataclass(frozen=True, eq=False)
class Route:
    """Postures in the order in which they are visited.

    Attributes
    ----------
    stops : tuple of Stop
    lost : dict
        Poses that no clear way leads to, by index, and why.
    """

    stops: tuple[Stop, ...]
    lost: dict[int, str]

    @classmethod
    def in_order(cls, postures: FloatArray) -> Route:
        """The route through postures ``(N, n)`` [rad] as they stand."""
        return cls(tuple(Stop(q, i) for i, q in enumerate(postures)), {})

    @property
    def order(self) -> IntArray:
        """Indices of the poses in the order in which they are measured."""
        return np.array([s.pose for s in self.stops if s.pose is not None], dtype=np.intp)

    @property
    def detours(self) -> int:
        """Postures that are only passed through."""
        return sum(stop.pose is None for stop in self.stops)


class Router:
    """Finds routes through postures of one cell.

    Parameters
    ----------
    robot : Robot
    ways : WayChecker
    passing : Checker
        What a posture that the arm only passes through must keep.
    start : array (n,)
        Posture that the arm comes from [rad].
    """

    def __init__(self, robot: Robot, ways: WayChecker, passing: Checker, start: FloatArray) -> None:
        self._robot = robot
        self._ways = ways
        self._passing = passing
        self._start = start
        # one joint as fast as another where the speeds are not known
        self._speed = np.where(np.isfinite(robot.speed), robot.speed, 1.0)

    def route(self, postures: FloatArray) -> Route:
        """Visit postures ``(N, n)`` [rad], from the start posture on."""
        lost: dict[int, str] = {}
        nodes = np.vstack([self._start, postures])
        known: dict[tuple[int, int], str] = {}
        while True:
            kept = [i for i in range(len(postures)) if i not in lost]
            order = self._clear_order(nodes, [0, *(i + 1 for i in kept)], known)
            stops: list[Stop] = []
            cut = None
            for a, b in pairwise(order):
                if known[_edge(a, b)]:
                    detour = self._detour(nodes[a], nodes[b])
                    if detour is None:
                        cut = b
                        lost[b - 1] = f"no clear way to it: {known[_edge(a, b)]}"
                        break
                    stops += [Stop(posture, None) for posture in detour]
                stops.append(Stop(nodes[b], b - 1))
            if cut is None:
                return Route(tuple(stops), lost)

    def _clear_order(
        self, nodes: FloatArray, rows: list[int], known: dict[tuple[int, int], str]
    ) -> list[int]:
        """The shortest order found that avoids blocked ways, where there is one."""
        points = nodes[rows] / self._speed
        cost = np.abs(points[:, None] - points[None]).max(axis=-1)
        place = {row: i for i, row in enumerate(rows)}
        for (i, j), why in known.items():
            if why and i in place and j in place:
                cost[place[i], place[j]] = cost[place[j], place[i]] = _BLOCKED
        for _ in range(MOST_ORDERS):
            order = [rows[i] for i in shortest_order(cost)]
            steps = [_edge(*step) for step in pairwise(order)]
            unknown = [step for step in steps if step not in known]
            if unknown:
                a, b = np.array(unknown).T
                verdicts = self._ways.check(nodes[a], nodes[b])
                known.update(zip(unknown, verdicts.reasons, strict=True))
            if not unknown or not any(known[step] for step in steps):
                break  # nothing new, or nothing blocked
            for i, j in unknown:
                if known[i, j]:
                    cost[place[i], place[j]] = cost[place[j], place[i]] = _BLOCKED
        return order

    def _detour(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        """Postures to pass through from one to another, the quickest of those that are clear."""
        first, last = self._drawn_back(start), self._drawn_back(end)
        options: list[list[FloatArray]] = [[self._start]]
        options += [[q] for q in (*first, *last)]
        options += [[a, b] for a in first for b in last]
        options += [[a, self._start, b] for a in first for b in last]
        options = [self._in_steps([start, *via, end])[1:-1] for via in ([], *options)]
        options.sort(key=lambda via: self._time([start, *via, end]))
        clear = self._all_clear([[start, *via, end] for via in options])
        return next((via for via, ok in zip(options, clear, strict=True) if ok), None)

    def _drawn_back(self, q: FloatArray) -> list[FloatArray]:
        """Postures near one with the tool drawn back along its z."""
        T = np.tile(self._robot.fk(q), (len(RETREATS_M), 1, 1))
        T[:, :3, 3] -= np.array(RETREATS_M)[:, None] * T[:, :3, 2]
        found = nearest_postures(self._passing, T, q)
        return list(found.q[found.feasible])

    def _in_steps(self, path: Sequence[FloatArray]) -> list[FloatArray]:
        """The path with stops put in between, so that no joint travels too far at once."""
        stops = [path[0]]
        for a, b in pairwise(path):
            count = self._ways.steps(a, b)
            stops += [a + (b - a) * k / count for k in range(1, count + 1)]
        return stops

    def _all_clear(self, paths: Sequence[Sequence[FloatArray]]) -> list[bool]:
        starts = np.array([q for path in paths for q in path[:-1]])
        ends = np.array([q for path in paths for q in path[1:]])
        clear = self._ways.check(starts, ends).clear
        splits = np.cumsum([len(path) - 1 for path in paths])[:-1]
        return [bool(part.all()) for part in np.split(clear, splits)]

    def _time(self, path: Sequence[FloatArray]) -> float:
        return float((np.abs(np.diff(path, axis=0)) / self._speed).max(axis=1).sum())


def shortest_order(cost: FloatArray) -> list[int]:
    """A short open path through all nodes from node 0: nearest neighbour, then 2-opt.

    Parameters
    ----------
    cost : array (N, N)
        Symmetric.
    """
    count = len(cost)
    order = [0]
    left = set(range(1, count))
    while left:
        here = order[-1]
        order.append(min(left, key=lambda j: (cost[here, j], j)))
        left.remove(order[-1])
    path = np.array(order, dtype=np.intp)
    i, j = np.triu_indices(count, k=1)
    i, j = i[i > 0], j[i > 0]  # the stretch i .. j is turned round; the start stays
    while len(i):
        before, after = path[i - 1], path[np.minimum(j + 1, count - 1)]
        last = j == count - 1
        gain = cost[before, path[i]] - cost[before, path[j]]
        gain += np.where(last, 0.0, cost[path[j], after] - cost[path[i], after])
        best = int(np.argmax(gain))
        if gain[best] <= _NO_GAIN:
            break
        path[i[best] : j[best] + 1] = path[i[best] : j[best] + 1][::-1]
    return [int(i) for i in path]


def _edge(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)
