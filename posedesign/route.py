"""The order in which poses are visited, so that every move between them is short and clear.

Moves are straight in joint space. The order is the shortest found from the base posture; where
the way between two poses is not clear, another order is tried, then a detour: through the base
posture, or with the tool drawn back along its z before and after. Where a joint would travel too
far at once, stops are put in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

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

    @property
    def order(self) -> IntArray:
        """Indices of the poses in the order in which they are measured."""
        return np.array([s.pose for s in self.stops if s.pose is not None], dtype=np.intp)

    @property
    def detours(self) -> int:
        """Postures that are only passed through."""
        return sum(stop.pose is None for stop in self.stops)


class Router:
    """Finds routes through postures of one cell, and remembers what it has found out of ways.

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
        # joints whose speed is not known are taken to be as fast as the others
        known = np.isfinite(robot.speed)
        usual = np.median(robot.speed[known]) if known.any() else 1.0
        self._speed = np.where(known, robot.speed, usual)
        self._reasons: dict[frozenset[bytes], str] = {}
        self._detours: dict[frozenset[bytes], list[FloatArray] | None] = {}
        self._retreats: dict[bytes, list[FloatArray]] = {}

    def route(self, postures: FloatArray) -> Route:
        """Visit postures ``(N, n)`` [rad], from the start posture on."""
        nodes = np.vstack([self._start, postures])
        lost: dict[int, str] = {}
        moved: set[int] = set()
        order = self._clear_order(nodes, list(range(len(nodes))))
        while (cut := self._first_cut(nodes, order)) is not None:
            node = order.pop(cut)
            place = None if node in moved else self._place_for(nodes, order, node)
            if place is not None:
                order.insert(place, node)
                moved.add(node)  # once: what is moved to and fro would never end
            elif self._through(nodes, [*order, node], order[cut - 1], node) is not None:
                order.insert(cut, node)
                moved.add(node)
            else:
                why = self._reason(nodes[order[cut - 1]], nodes[node])
                lost[node - 1] = f"no clear way to it: {why}"
                order = self._clear_order(nodes, order)
        return Route(tuple(self._stops(nodes, order)), lost)

    def _stops(self, nodes: FloatArray, order: list[int]) -> list[Stop]:
        stops = []
        for a, b in pairwise(order):
            between = self._through(nodes, order, a, b) or []
            path = self._in_steps([nodes[a], *between, nodes[b]])
            stops += [Stop(q, None) for q in path[1:-1]]
            stops.append(Stop(nodes[b], b - 1))
        return stops

    def _first_cut(self, nodes: FloatArray, order: list[int]) -> int | None:
        """Place in the order of the first node that no way leads to from the one before."""
        self._check(nodes, list(pairwise(order)))
        for place, (a, b) in enumerate(pairwise(order), start=1):
            if self._through(nodes, order, a, b) is None:
                return place
        return None

    def _place_for(self, nodes: FloatArray, order: list[int], node: int) -> int | None:
        """Where in an order a node can be put with clear ways before and after it."""
        self._check(nodes, [(node, other) for other in order])
        near = [not self._reason(nodes[node], nodes[other]) for other in order]
        for place in range(1, len(order) + 1):
            if near[place - 1] and (place == len(order) or near[place]):
                return place
        return None

    def _through(
        self, nodes: FloatArray, rows: list[int], start: int, end: int
    ) -> list[FloatArray] | None:
        """Postures to pass from one node to another; none for a clear way, None without any.

        A detour where there is one, else over other nodes, the quickest way that is known.
        """
        if not self._reason(nodes[start], nodes[end]):
            return []
        detour = self._detour(nodes[start], nodes[end])
        if detour is not None:
            return detour
        self._check(nodes, [(end, row) for row in rows if row != end])
        reached: dict[int, tuple[float, list[FloatArray]]] = {start: (0.0, [])}
        front = [start]
        while front:
            here = front.pop(0)
            for row in rows:
                hop = self._known_hop(nodes[here], nodes[row])
                if row == here or hop is None:
                    continue
                time = reached[here][0] + self._time([nodes[here], *hop, nodes[row]])
                if time < reached.get(row, (np.inf,))[0]:
                    passed = [nodes[here]] if here != start else []
                    reached[row] = time, [*reached[here][1], *passed, *hop]
                    front.append(row)
        return reached[end][1] if end in reached else None

    def _known_hop(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        """What is known to lead from one node to another: a clear way, or a detour."""
        edge = _edge(start, end)
        if edge not in self._reasons:
            return None
        if not self._reasons[edge]:
            return []
        return self._detour(start, end) if edge in self._detours else None

    def _clear_order(self, nodes: FloatArray, rows: list[int]) -> list[int]:
        """The shortest order found that avoids blocked ways, where there is one."""
        points = nodes[rows] / self._speed
        cost = np.abs(points[:, None] - points[None]).max(axis=-1)
        place = {row: i for i, row in enumerate(rows)}

        def block(a: int, b: int) -> None:
            cost[place[a], place[b]] = cost[place[b], place[a]] = _BLOCKED

        for a, b in combinations(rows, 2):
            if self._reasons.get(_edge(nodes[a], nodes[b])):
                block(a, b)
        for _ in range(MOST_ORDERS):
            order = [rows[i] for i in shortest_order(cost)]
            steps = list(pairwise(order))
            asked = self._check(nodes, steps)
            blocked = [(a, b) for a, b in steps if self._reason(nodes[a], nodes[b])]
            if not asked or not blocked:
                break  # nothing new, or nothing in the way
            for a, b in blocked:
                block(a, b)
        return order

    def _check(self, nodes: FloatArray, steps: Sequence[tuple[int, int]]) -> bool:
        """Check the ways that are not yet known; whether there was one."""
        unknown = [s for s in steps if _edge(nodes[s[0]], nodes[s[1]]) not in self._reasons]
        if unknown:
            a, b = np.array(unknown).T
            reasons = self._blocked(nodes[a], nodes[b])
            edges = (_edge(nodes[i], nodes[j]) for i, j in unknown)
            self._reasons.update(zip(edges, reasons, strict=True))
        return bool(unknown)

    def _blocked(self, start: FloatArray, end: FloatArray) -> list[str]:
        """What is in each of the ways ``(W, n)`` to ``(W, n)`` [rad], stops on them included."""
        reasons = list(self._ways.check(start, end, far=True).reasons)
        if np.isfinite(self._ways.largest_travel):
            for i in np.flatnonzero([not why for why in reasons]).tolist():
                stops = self._in_steps([start[i], end[i]])[1:-1]
                if stops:
                    verdicts = self._passing.check(np.array(stops))
                    worst = int(np.argmin(verdicts.slack))
                    reasons[i] = "" if verdicts.feasible.all() else verdicts.says(worst)
        return reasons

    def _reason(self, start: FloatArray, end: FloatArray) -> str:
        """What is known to be in the way between two postures."""
        return self._reasons.get(_edge(start, end), "")

    def _detour(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        """Postures to pass through from one to another, the quickest of those that are clear."""
        edge = _edge(start, end)
        if edge not in self._detours:
            first, last = self._drawn_back(start), self._drawn_back(end)
            options: list[list[FloatArray]] = [[], [self._start]]
            options += [[q] for q in (*first, *last)]
            options += [[a, b] for a in first for b in last]
            options += [[a, self._start, b] for a in first for b in last]
            paths = [[start, *via, end] for via in options[1:]]
            paths.sort(key=self._time)
            clear = self._all_clear(paths)
            self._detours[edge] = next((p for p, ok in zip(paths, clear, strict=True) if ok), None)
        path = self._detours[edge]
        if path is None:
            return None
        return path[1:-1] if np.array_equal(path[0], start) else path[-2:0:-1]

    def _drawn_back(self, q: FloatArray) -> list[FloatArray]:
        """Postures near one with the tool drawn back along its z."""
        if q.tobytes() not in self._retreats:
            T = np.tile(self._robot.fk(q), (len(RETREATS_M), 1, 1))
            T[:, :3, 3] -= np.array(RETREATS_M)[:, None] * T[:, :3, 2]
            found = nearest_postures(self._passing, T, q)
            self._retreats[q.tobytes()] = list(found.q[found.feasible])
        return self._retreats[q.tobytes()]

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
        clear = np.array([not why for why in self._blocked(starts, ends)])
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


def _edge(a: FloatArray, b: FloatArray) -> frozenset[bytes]:
    return frozenset((a.tobytes(), b.tobytes()))
