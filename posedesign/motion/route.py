"""The order in which poses are visited, so that every move between them is short and clear.

Moves are straight in joint space. The order is the quickest found from the base posture through
all poses and back to it; where the way between two poses is not clear, another order is tried, then
a detour. Where a joint would travel too far at once, stops are put in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import UnreachableError
from calib.robots import Robot
from calib.robots.move_times import ACCELERATION_S, move_times, moving_time_s
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints import Checker, MotionChecker, Retreat
from posedesign.motion.known_motions import KnownMotions, Leg, find_approaches
from posedesign.motion.order import OrderSearch, legs_of

if TYPE_CHECKING:
    from posedesign.cell import Cell

MOST_ORDERS = 20
"""Orders tried while motions turn out to be blocked; each try checks only motions not yet known."""

MOST_SEARCHES = 2
"""Thorough searches for an order: another one follows where motions of the order of the one before
turned out to be blocked, and the order was repaired."""

NEIGHBOURS = 16
"""Motions to the nearest places that are checked at once where a motion is blocked: where one way
is blocked, so may be those that are tried next. The first time, of all places: checks take a tenth
of the time by hundreds."""

DOUBT = 1.2
"""What the time of a motion that was not looked at counts for, once others are blocked, over that
of one that is known to be clear: without it each repair goes by motions that are blocked again."""

MOST_DOUBLED = 10
"""How often the number of those is doubled for a place whose motions turn out to be blocked."""

MOTION_SHARE = 1e-3
"""Of the mean time over the joints, added to that of the slowest: of the many orders that take as
long where one joint sets the time, that with least motion is taken. It makes the answer one, too:
without it a search of limited time returned several of them for 60 and 100 poses."""


SLIDE_M_S = 1.0
"""Speed of a slide that the description gives none of [m/s]: tracks of arms go 1 to 2 m/s."""


class Passing(StrEnum):
    """Why the arm passes through a posture at which nothing is measured."""

    DETOUR = "detour"
    APPROACH = "approach"
    RETREAT = "retreat"
    RETURN = "return to base"


@dataclass(frozen=True, eq=False)
class Stop:
    """A posture on the route."""

    posture: FloatArray  # (n,) [rad]
    pose: int | None
    """Index of the pose that is measured there; None where the arm only passes through."""
    passing: Passing = Passing.DETOUR  # why, where it does


@dataclass(frozen=True, eq=False)
class Route:
    """Postures in the order in which they are visited."""

    stops: tuple[Stop, ...]
    lost: dict[int, str]  # poses that no clear way leads to, by index, and why
    moving_s: float = float("nan")
    """Predicted time of all moves, from the base posture on [s]; NaN where no speed is known."""
    dwell_s: float | FloatArray = 0.0
    """How long the arm stands at each pose that is measured [s]; one number, or one for each
    (N,)."""

    @property
    def order(self) -> IntArray:
        """Indices of the poses in the order in which they are measured."""
        return np.array([s.pose for s in self.stops if s.pose is not None], dtype=np.intp)

    @property
    def detours(self) -> int:
        """Postures that are passed through because a way is blocked or too long."""
        return sum(stop.pose is None and stop.passing is Passing.DETOUR for stop in self.stops)

    @property
    def standing_s(self) -> float:
        """Time at the poses that are measured [s]."""
        if isinstance(self.dwell_s, float):
            return self.dwell_s * len(self.order)
        return float(self.dwell_s[self.order].sum())

    @property
    def cycle_time_s(self) -> float:
        """Predicted time of the whole tour [s]."""
        return self.moving_s + self.standing_s

    @property
    def timing(self) -> str:
        if np.isnan(self.moving_s):
            return "cycle time not known: the robot's description gives no joint speeds"
        return (
            f"predicted cycle time {self.cycle_time_s:.0f} s: {self.moving_s:.0f} s moving, "
            f"{self.standing_s:.0f} s standing at {len(self.order)} pose(s)"
        )


@dataclass(frozen=True)
class RouteOptions:
    """How poses are visited."""

    return_to_base: bool = True  # whether the round ends where it starts
    approach_rad: float = 0.0
    """Last movement of every joint to each pose, in the same direction at all of them; 0: as it
    comes."""
    dwell_s: float = 0.0  # how long the arm stands at each pose
    speed_share: float = 1.0  # speed of the moves as a part of the joints' own


class Router:
    """Finds routes through postures of one cell, and remembers what it has found out of motions.

    ``passing``: what a posture that the arm only passes through must keep. ``start`` (n,): posture
    that the arm comes from [rad]. ``retreat``: how the tool comes to each pose along its axis.
    """

    def __init__(
        self,
        robot: Robot,
        motions: MotionChecker,
        passing: Checker,
        start: FloatArray,
        options: RouteOptions | None = None,
        retreat: Retreat | None = None,
    ) -> None:
        self._motions = motions
        self._passing = passing
        self._start = start
        self._retreat = retreat
        self._led_to: set[bytes] = set()  # postures that a route has led to
        self.options = options or RouteOptions()
        # joints whose speed is not known are taken to be as fast as the others that turn
        known, sliding = np.isfinite(robot.speed), robot.sliding
        self._timed = bool(known.any())
        like = robot.speed[known & ~sliding]
        usual = np.where(sliding, SLIDE_M_S, np.median(like) if len(like) else 1.0)
        self._speeds = self.options.speed_share * np.where(known, robot.speed, usual)
        home = start if retreat is None else retreat.back_off(start[None])[0][0]
        self._known = KnownMotions(robot, motions, passing, home, self._speeds)

    @classmethod
    def of_cell(cls, cell: Cell) -> Router:
        """The router of a cell, with what its ``[plan]`` asks for and its program's speed."""
        section = cell.config.plan
        same_side = section.approach == "same-side"
        options = RouteOptions(
            return_to_base=section.return_to_base,
            approach_rad=float(np.deg2rad(section.approach_deg)) if same_side else 0.0,
            dwell_s=section.dwell_s,
            speed_share=cell.config.program.speed_percent / 100.0,
        )
        return cls(cell.robot, cell.ways, cell.passing, cell.base_posture, options, cell.retreat)

    def route(self, postures: FloatArray, loads: IntArray | None = None) -> Route:
        """Visit postures ``(N, n)`` [rad], from the start posture on.

        ``loads`` (N,): index of what the flange carries at each. There is a tour for each of them,
        one after another, and the load is changed at the start posture.
        """
        if loads is None or len(np.unique(loads)) <= 1:
            return self._tour(postures, closed=self.options.return_to_base)
        stops: list[Stop] = []
        lost: dict[int, str] = {}
        moving_s = 0.0
        for load in np.unique(loads):
            rows = np.flatnonzero(loads == load)
            tour = self._tour(postures[rows], closed=True)
            stops += [
                stop if stop.pose is None else replace(stop, pose=int(rows[stop.pose]))
                for stop in tour.stops
            ]
            lost |= {int(rows[i]): why for i, why in tour.lost.items()}
            moving_s += tour.moving_s
        return Route(tuple(stops), lost, moving_s, self.options.dwell_s)

    def _tour(self, postures: FloatArray, *, closed: bool) -> Route:
        places, lost = self._places(postures, closed=closed)
        rows = [0, *(i + 1 for i in range(len(postures)) if i not in lost)]
        moved: set[int] = set()
        order, fewer = self._clear_order(places, rows), False
        while True:
            cut = self._first_cut(places, order)
            if cut is None and fewer:
                order, fewer = self._clear_order(places, order), False
                continue
            if cut is None:
                break
            node = order.pop(cut)
            place = None if node in moved else self._place_for(places, order, node)
            if place is not None:
                order.insert(place, node)
                moved.add(node)  # once: what is moved to and fro would never end
            elif self._through(places, [*order, node], (order[cut - 1], node)) is not None:
                order.insert(cut, node)
                moved.add(node)
            else:
                why = self._known.reason(*places.leg(order[cut - 1], node))
                lost[node - 1] = f"no clear way to it: {why}"
                moved.clear()  # those after it are come to from another place now
                fewer = True
        self._led_to.update(postures[row - 1].tobytes() for row in order if row)
        stops = tuple(self._stops(places, order))
        path = np.array([self._start, *(stop.posture for stop in stops)])
        moving = moving_time_s(path, self._speeds, ACCELERATION_S) if self._timed else np.nan
        return Route(stops, lost, moving, self.options.dwell_s)

    def between(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        """Postures to pass from one ``(n,)`` to another [rad]; None where no clear way is found."""
        self._known.check([(start, end)])
        through = self._known.through(start, end, [])
        return None if through is None else self._known.in_steps([start, *through, end])[1:-1]

    def reached(self, postures: FloatArray) -> BoolArray:
        """Postures ``(N, n)`` [rad] that a clear way leads to.

        Straight from the base posture and back; or on a route that was found before.
        """
        places, lost = self._places(postures, closed=self.options.return_to_base)
        found = np.array([i not in lost for i in range(len(postures))], dtype=bool)
        rows = (np.flatnonzero(found) + 1).tolist()
        legs = {i: (places.leg(0, i), places.leg(i, 0)) for i in rows}
        self._known.check([leg for both in legs.values() for leg in both])
        for i, both in legs.items():
            found[i - 1] = not any(self._known.reason(*leg) for leg in both)
        before = np.array([q.tobytes() in self._led_to for q in postures], dtype=bool)
        return np.asarray(found | before)

    def stuck(self, postures: FloatArray) -> dict[int, str]:
        """Postures ``(N, n)`` [rad] that no way is soon found to, by index, and what is in it.

        Neither from the base posture, nor from the nearest of the others that are reached.
        """
        reached = self.reached(postures)
        places, lost = self._places(postures, closed=self.options.return_to_base)
        near = [0, *(np.flatnonzero(reached) + 1).tolist()]
        rest = [i + 1 for i in np.flatnonzero(~reached).tolist() if i not in lost]
        while near and rest:
            times = self._times(places.leave[near][:, None], places.enter[rest][None])
            quickest = np.argsort(times, axis=0, kind="stable")[:NEIGHBOURS].T.tolist()
            legs = {
                node: [(places.leg(near[k], node), places.leg(node, near[k])) for k in some]
                for node, some in zip(rest, quickest, strict=True)
            }
            self._known.check([leg for some in legs.values() for both in some for leg in both])
            near = [
                node
                for node, some in legs.items()
                if any(not any(map(self._known.reason, *zip(*both, strict=True))) for both in some)
            ]
            rest = [node for node in rest if node not in near]
            self._led_to.update(postures[node - 1].tobytes() for node in near)
        shut = {node - 1: self._known.reason(*places.leg(0, node)) for node in rest}
        return lost | {i: f"no clear way to it: {why}" for i, why in shut.items()}

    def _places(self, postures: FloatArray, *, closed: bool) -> tuple[_Places, dict[int, str]]:
        """The base posture and the poses, and which of these have no approach."""
        at = np.vstack([self._start, postures])
        if self._retreat is not None:
            back, reasons = self._retreat.back_off(at)
            if reasons[0]:
                raise UnreachableError(
                    f"the tool cannot back off from the base posture: {reasons[0]}",
                    hint="move the base posture, or change plan.retreat_mm",
                    name="base_pose",
                )
            return _Places(at, back, back, closed), {
                i: f"cannot be come to along the tool: {why}"
                for i, why in enumerate(reasons[1:])
                if why
            }
        if not self.options.approach_rad:
            return _Places(at, at, at, closed), {}
        found = find_approaches(postures, self.options.approach_rad, self._passing, self._known)
        return _Places(at, at, np.vstack([self._start, found.postures]), closed), dict(found.lost)

    def _stops(self, places: _Places, order: list[int]) -> list[Stop]:
        """The stops of an order of places; with a retreat the round begins and ends backed off."""
        backs_off = places.leave is not places.at
        before = Passing.RETREAT if backs_off else Passing.APPROACH
        stops = [Stop(places.leave[0], None, Passing.RETREAT)] * backs_off
        for a, b in legs_of(order, closed=places.closed):
            between = self._through(places, order, (a, b)) or []
            start, end = places.leg(a, b)
            path = self._known.in_steps([start, *between, end])
            stops += [Stop(q, None) for q in path[1:-1]]
            if b == 0:
                stops.append(Stop(end, None, Passing.RETURN))
                continue
            if places.enter is not places.at:
                stops.append(Stop(end, None, before))
            stops.append(Stop(places.at[b], b - 1))
            if backs_off:
                stops.append(Stop(places.leave[b], None, Passing.RETREAT))
        return stops

    def _first_cut(self, places: _Places, order: list[int]) -> int | None:
        """Place in the order of the first node that no way leads to from the one before.

        There is always a way back to the base posture: if no other, that which led here.
        """
        legs = legs_of(order, closed=places.closed)
        self._known.check([places.leg(*leg) for leg in legs])
        for place, leg in enumerate(legs[: len(order) - 1], start=1):
            if self._through(places, order, leg) is None:
                return place
        return None

    def _place_for(self, places: _Places, order: list[int], node: int) -> int | None:
        """Where in an order a node costs least with clear motions before and after it.

        The motions are checked in batches, those to the cheapest places first.
        """
        before, after = order, [*order[1:], *order[:1]]
        leave, enter = places.leave, places.enter
        extra = self._times(leave[before], enter[node])
        onward = self._times(leave[node], enter[after])
        onward -= self._times(leave[before], enter[after])
        if not places.closed:
            onward[-1] = 0.0
        options: list[int] = np.argsort(extra + onward, kind="stable").tolist()
        for first in range(0, len(options), NEIGHBOURS):
            legs = {
                k: [places.leg(before[k], node)]
                + [places.leg(node, after[k])] * (places.closed or k + 1 < len(order))
                for k in options[first : first + NEIGHBOURS]
            }
            self._known.check([leg for both in legs.values() for leg in both])
            for k, both in legs.items():
                if not any(self._known.reason(*leg) for leg in both):
                    return k + 1
        return None

    def _through(
        self, places: _Places, rows: Sequence[int], leg: tuple[int, int]
    ) -> list[FloatArray] | None:
        """Postures to pass from one node to another; see :meth:`KnownMotions.through`."""
        if not self._known.reason(*places.leg(*leg)):
            return []
        others = [places.leave[row] for row in rows]
        if places.enter is not places.leave:
            others += [places.enter[row] for row in rows if row != 0]
        return self._known.through(*places.leg(*leg), others)

    def _clear_order(self, places: _Places, rows: list[int]) -> list[int]:
        """A quick order of some places that avoids blocked motions, where there is one."""
        leave, enter = places.leave[rows], places.enter[rows]
        times = self._times(leave[:, None], enter[None])
        shut = self._known.blocked(leave, enter)
        times[shut] = np.inf
        known = shut | self._known.clear(leave, enter) | np.eye(len(rows), dtype=bool)
        among = _Among(places, rows, times, known)
        self._repair(among)
        for _ in range(MOST_SEARCHES):
            among.search.search()
            if not self._repair(among):
                break
        return [rows[i] for i in among.search.order]

    def _repair(self, among: _Among) -> bool:
        """Check the motions of an order, and repair it where they are blocked; whether it was.

        With each blocked motion those from its ends to the nearest places are checked, twice as
        many each time that a motion of a place is blocked; the first time, those from all places.
        """
        repaired = False
        for _ in range(MOST_ORDERS):
            looked_at = self._look_at(among.legs, among)
            blocked = [leg for leg in looked_at if np.isinf(among.times[leg])]
            repaired |= bool(blocked)
            if (
                among.asked.any() and looked_at
            ):  # those that are clear are no longer doubted, either
                ends = sorted({k for leg in blocked for k in leg})
                looked_at += self._look_at(among.nearest_unknown(ends), among)
                among.take(looked_at)
            elif blocked:
                self._look_at(among.nearest_unknown(list(range(len(among.rows)))), among)
                among.doubt()
            else:
                break
        return repaired

    def _look_at(self, legs: list[tuple[int, int]], among: _Among) -> list[tuple[int, int]]:
        """Check motions that are not known; returns them, those back with them."""
        legs = [leg for leg in legs if not among.known[leg]]
        self._known.check([among.leg(*leg) for leg in legs])
        blocked = [leg for leg in legs if self._known.reason(*among.leg(*leg))]
        if among.same_back:
            legs += [leg[::-1] for leg in legs]
            blocked += [leg[::-1] for leg in blocked]
        for leg in legs:
            among.known[leg] = True
        for leg in blocked:
            among.times[leg] = np.inf
        return legs

    def _times(self, leave: FloatArray, enter: FloatArray) -> FloatArray:
        """Times ``(...)`` [s] from leaving places to being at others, all motions clear."""
        moves = np.abs(enter - leave)
        count = self._motions.steps_of(moves.max(axis=-1))
        times = count * move_times(moves / count[..., None], self._speeds, ACCELERATION_S)
        return np.asarray(times + MOTION_SHARE * (moves / self._speeds).mean(axis=-1))


@dataclass(frozen=True, eq=False)
class _Places:
    """The base posture, which is place 0, and the poses."""

    at: FloatArray  # (1 + N, n): postures that the arm is brought to [rad]
    leave: FloatArray
    enter: FloatArray
    """leave, enter (1 + N, n): postures from which the arm goes on, and to which it comes first
    [rad]: the same array where motions are the same in both directions, and as ``at`` where nothing
    lies in between."""
    closed: bool  # whether the arm goes back to place 0 in the end

    def leg(self, start: int, end: int) -> Leg:
        return self.leave[start], self.enter[end]


class _Among:
    """Motions among the places of one order, and the search for it.

    ``rows`` (K,): the places, by their number in the search. ``times`` (K, K): of the motions [s],
    infinite for those known to be blocked. ``known`` (K, K): motions that were looked at.
    """

    def __init__(
        self, places: _Places, rows: list[int], times: FloatArray, known: BoolArray
    ) -> None:
        self.places, self.rows, self.times, self.known = places, rows, times, known
        self.same_back = places.enter is places.leave  # motions are the same in both directions
        self.search = OrderSearch(times, closed=places.closed)
        self.asked = np.zeros(len(rows), dtype=np.intp)
        """(K,): how often the quickest motions of each place were asked for."""

    @property
    def legs(self) -> list[tuple[int, int]]:
        """The motions of the order that was found."""
        return legs_of(self.search.order, closed=self.places.closed)

    def leg(self, start: int, end: int) -> Leg:
        return self.places.leg(self.rows[start], self.rows[end])

    def doubt(self) -> None:
        """Search anew, for an order that goes by motions known to be clear where there are some."""
        times = np.where(self.known, self.times, DOUBT * self.times)
        self.search = OrderSearch(times, closed=self.places.closed)

    def take(self, legs: list[tuple[int, int]]) -> None:
        """Tell the search what was found out of motions."""
        self.search.change(legs, np.array([self.times[leg] for leg in legs]))

    def nearest_unknown(self, some: list[int]) -> list[tuple[int, int]]:
        """From each of some places, the quickest motions that were not looked at."""
        times = np.where(self.known[some], np.inf, self.times[some])
        nearest = np.argsort(times, axis=1, kind="stable")
        counts = NEIGHBOURS << np.minimum(self.asked[some], MOST_DOUBLED)
        self.asked[some] += 1
        return [
            (k, j)
            for k, ends, count in zip(some, nearest.tolist(), counts.tolist(), strict=True)
            for j in ends[:count]
            if not self.known[k, j]
        ]
