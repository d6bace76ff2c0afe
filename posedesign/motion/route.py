"""The order in which poses are visited, so that every move between them is short and clear.

Moves are straight in joint space. The order is the quickest found from the base posture through
all poses and back to it; where the way between two poses is not clear, another order is tried, then
a detour. Where a joint would travel too far at once, stops are put in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import combinations, permutations
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import UnreachableError
from calib.robots import Robot
from calib.robots.move_times import ACCELERATION_S, move_times, moving_time_s
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints import Checker, MotionChecker, Retreat
from posedesign.motion.known_motions import KnownMotions, Leg, find_approaches
from posedesign.motion.order import (
    MANY,
    legs_of,
    shortest_order,
)

if TYPE_CHECKING:
    from posedesign.cell import Cell

MOST_ORDERS = 60
"""Orders tried while motions turn out to be blocked; each try checks only motions not yet known."""

TRIED_BLINDLY = 3
"""Orders with blocked motions after which those between all places are checked at once: a cell is
so narrow then that most of them will be asked for, and together they take less time than a few at a
time."""

MOST_PLACES = 80
"""Places between which all motions are checked at once: 3160 of them."""

MOTION_SHARE = 1e-3
"""Of the mean time over the joints, added to that of the slowest: of the many orders that take as
long where one joint sets the time, that with least motion is taken. It makes the answer one, too:
without it a search of limited time returned several of them for 60 and 100 poses."""


SLIDE_M_S = 1.0
"""Speed of a slide that the description gives none of [m/s]: tracks of arms go 1 to 2 m/s."""

NEIGHBOURS = 16
"""Motions to the nearest places that are checked, of many places, where a motion is blocked."""


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
            if cut is None and fewer:  # the library had no turn yet
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
                order, fewer = self._clear_order(places, order, thorough=False), True
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
        """Where in an order a node can be put with clear motions before and after it."""
        to = [places.leg(other, node) for other in order]
        onward = [places.leg(node, other) for other in order]
        self._known.check([*to, *onward])
        reachable = [not self._known.reason(*leg) for leg in to]
        leads_on = [not self._known.reason(*leg) for leg in onward]
        for place in range(1, len(order) + 1):
            following = leads_on[place % len(order)] or (place == len(order) and not places.closed)
            if reachable[place - 1] and following:
                return place
        return None

    def _through(
        self, places: _Places, rows: Sequence[int], leg: tuple[int, int]
    ) -> list[FloatArray] | None:
        """Postures to pass from one node to another; see :meth:`KnownMotions.through`."""
        others = [places.leave[row] for row in rows]
        if places.enter is not places.leave:
            others += [places.enter[row] for row in rows if row != 0]
        return self._known.through(*places.leg(*leg), others)

    def _clear_order(self, places: _Places, rows: list[int], *, thorough: bool = True) -> list[int]:
        """The quickest order found that avoids blocked motions, where there is one.

        The library has its turn when a quick search has found out what is in the way.
        """
        leave, enter = places.leave[rows], places.enter[rows]
        cost = self._costs(leave, enter)
        cost[self._known.blocked(leave, enter)] = np.inf
        many = len(rows) > MANY
        turn, failed, order = False, 0, None  # the library's
        for _ in range(MOST_ORDERS):
            # of many places the library finds the first order, too
            order = shortest_order(
                cost,
                closed=places.closed,
                thorough=turn or (many and order is None),
                before=order if many else None,
            )
            steps = legs_of(order, closed=places.closed)
            legs = [places.leg(rows[i], rows[j]) for i, j in steps]
            asked = self._known.check(legs)
            blocked = any(self._known.reason(*leg) for leg in legs)
            failed += asked and blocked
            if failed == TRIED_BLINDLY and len(rows) <= MOST_PLACES:
                pairs = permutations(rows, 2) if enter is not leave else combinations(rows, 2)
                self._known.check([places.leg(*pair) for pair in pairs])
            if many and blocked:  # where one way is blocked, so may those be that are tried next
                stuck = {k for k, leg in zip(steps, legs, strict=True) if self._known.reason(*leg)}
                near = {k: np.argsort(cost[k])[:NEIGHBOURS] for pair in stuck for k in pair}
                tried = [(k, int(j)) for k, some in near.items() for j in some if j != k]
                self._known.check([places.leg(rows[i], rows[j]) for i, j in tried])
            if asked and blocked:
                cost[self._known.blocked(leave, enter)] = np.inf
            elif turn or not thorough:  # nothing new, or nothing in the way
                break
            else:
                turn = True
        return [rows[i] for i in order or ()]

    def _costs(self, leave: FloatArray, enter: FloatArray) -> FloatArray:
        """Times ``(K, K)`` [s] from leaving each place to being at each, all motions clear."""
        moves = np.abs(enter[None] - leave[:, None])
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
