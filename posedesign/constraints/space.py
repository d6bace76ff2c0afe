"""What the arm may run into: at postures, on joint motions, and where a tool backs off its target.

Between two poses that touch one point, the straight joint move takes the tool point past it on a
curve, which may lead into what the target sits on. So the arm goes out along the axis of the tool,
turns where there is room, and comes in along the axis. Bodies that meet at the target are left
unchecked at the measuring pose and on the last millimetres before it only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.errors import UnreachableError
from calib.geometry import Body, HalfSpace, Scene, Sphere
from calib.geometry.scene import CAP_M
from calib.geometry.ways import TOUCH_M
from calib.robots import NO_EXTERNAL_AXES, ExternalAxes, Robot
from calib.se3 import BoolArray, FloatArray, IntArray, frame_about, rotation_angle, transform
from posedesign.constraints.checker import ROUNDING, Checker, Constraint, Situation

POINT_M = 1e-6
"""Radius of the balls that stand for points."""

_SHOWN_M = 0.5e-3
"""Depths below this would be written as 0 mm."""

BEND = 0.05
"""Part of its length by which a joint move may leave the axis of the tool, and still be one along
it. Over 50 mm, 97 of 100 poses of arms of 0.9 to 2.7 m reach bend by less than 0.04. More bend long
retreats of small arms, and those next to a singularity, where joints run far."""

TURN_RAD = float(np.deg2rad(1.0))
"""Turn of the tool on such a move, at most: one that pivots about the target does not come in."""

_SAMPLES = np.linspace(0.0, 1.0, 9)[1:-1]
"""Parts of a move that is looked at for its bend: a smooth curve of some degrees in each joint."""


class Collision(Constraint):
    """A safety distance between tool, obstacles and arm; contact is never allowed."""

    name = "collision"
    hint_words = (
        "move what stands there, lower constraints.safety_distance_mm, "
        "or list what may touch in constraints.ignore"
    )
    unit = "mm"
    display = 1e3
    comfort = 0.05

    def __init__(self, scene: Scene, keep_m: float) -> None:
        self.scene = scene
        self.keep_m = max(keep_m, TOUCH_M)
        self._cap_m = max(CAP_M, keep_m + self.comfort)

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: the pair of bodies."""
        # how far what is kept is from being broken takes long, and is read by people alone
        cap_m = self._cap_m if arm.in_full else self.keep_m + TOUCH_M
        found = self.scene.clearance(arm.q, cap_m=cap_m, depths=arm.in_full, state=arm.state)
        return found.distance_m - self.keep_m, found.pair

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        return self.explain(margin + self.keep_m, which)

    def explain(self, distance_m: float, pair: int) -> str:
        """In words, how near two bodies come."""
        if distance_m >= self._cap_m:
            return f"nothing within {self._cap_m * 1e3:g} mm"
        one, other = self.scene.names(pair)
        if distance_m < TOUCH_M:
            if distance_m > -_SHOWN_M:  # or a mesh of which nobody asked how deep it is
                return f"{one} runs into {other}"
            return f"{one} and {other} run {-distance_m * 1e3:.0f} mm into each other"
        asked = f", {self.keep_m * 1e3:g} mm asked for" if self.keep_m > TOUCH_M else ""
        return f"{one} {distance_m * 1e3:.1f} mm from {other}{asked}"


class SelfCollision(Collision):
    """The links of the arm not running into each other, nor the tool into the wrist it is on.

    Their makers keep no distance.
    """

    name = "self-collision"
    hint_words = "list links that cannot really meet in constraints.ignore"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, 0.0)


class Workspace(Collision):
    """Tool, arm beyond its first joint, and tool point inside a box: its sides are half-spaces."""

    name = "workspace"
    hint_words = "widen constraints.workspace_lowest_mm and workspace_highest_mm"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, 0.0)
        self.keep_m = 0.0  # nothing stands there that could be touched

    def explain(self, distance_m: float, pair: int) -> str:
        """In words, how near arm or tool come to a side of the box."""
        body, side = self.scene.names(pair)
        if distance_m >= self._cap_m:
            return f"nothing within {self._cap_m * 1e3:g} mm of the sides of the workspace"
        if distance_m < 0.0:
            return f"{body} {-distance_m * 1e3:.0f} mm outside the workspace, beyond {side}"
        return f"{body} {distance_m * 1e3:.0f} mm inside {side} of the workspace"


def workspace_scene(
    robot: Robot,
    bodies: Sequence[Body],
    tool_m: FloatArray,
    lowest_m: FloatArray,
    highest_m: FloatArray,
) -> Scene:
    """What moves, against the six half-spaces that leave a box free.

    ``bodies``: of arm and tool. Those of the base and of the first link stay where they are, and
    are left out. Joints and tool point count too, so that an arm without bodies is checked as well.
    ``tool_m`` (3,): tool point in the tip frame [m]. ``lowest_m``, ``highest_m`` (3,): corners of
    the box in the base frame [m], behind a positioner in the root of the description.
    """
    point = Sphere(POINT_M)
    tip = robot.chain.T_link_tip
    floor = robot.floor
    joints = list(enumerate(robot.joint_names, start=1))[floor + 1 :]
    moving = [body for body in bodies if body.link >= floor + 2]
    moving += [Body(name, link, np.eye(4), point) for link, name in joints]
    T_link_tool = tip @ transform(np.eye(3), tool_m)
    moving += [Body("tool point", robot.n, T_link_tool, point)]
    sides = []
    for letter, along, *bounds in zip("xyz", np.eye(3), lowest_m, highest_m, strict=True):
        for bound, sign in zip(bounds, (1.0, -1.0), strict=True):
            inward = transform(frame_about(sign * along), bound * along)
            name = f"{letter} = {bound * 1e3:.0f} mm"
            sides.append(Body(name, floor, robot.T_floor_world @ inward, HalfSpace()))
    return Scene(robot.chain, arm=moving, obstacles=sides).others


@dataclass(frozen=True, eq=False)
class MotionVerdicts:
    """What is to be said of the motions from one posture to another.

    ``clear`` (W,). ``travel`` (W,): largest joint travel [rad]. ``part`` (W,): where on the way
    something is in the way, from 0 at its start to 1; NaN where nothing is. ``reasons``: empty
    where the way is clear.
    """

    clear: BoolArray
    travel: FloatArray
    part: FloatArray
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class MotionChecker:
    """Bounds on motions: distances that are kept all along, and how far a joint may travel."""

    collisions: tuple[Collision, ...]
    """Each with its bodies and the distance they keep; none: motions are not checked for them."""
    largest_travel: float  # of joints that turn [rad]; infinite for no bound
    external: ExternalAxes = NO_EXTERNAL_AXES  # what the first joints are

    @cached_property
    def _scenes(self) -> list[tuple[Scene, FloatArray, list[tuple[Collision, int]]]]:
        """Scenes of the same bodies in one: what its pairs keep, and whose they are, by row."""
        alike: dict[int, list[Collision]] = {}
        for collision in self.collisions:
            alike.setdefault(id(collision.scene.bodies), []).append(collision)
        found = []
        for some in alike.values():
            pairs = np.concatenate([each.scene.pairs for each in some])
            whose = [(each, pair) for each in some for pair in range(len(each.scene.pairs))]
            keep_m = np.array([each.keep_m for each, _ in whose])
            found.append((some[0].scene.with_pairs(pairs), keep_m, whose))
        return found

    def steps(self, start: FloatArray, end: FloatArray) -> int:
        """Number of moves that the way between two postures ``(n,)`` [rad] takes."""
        return int(self.steps_of(self._turns(start[None], end[None]).max()))

    def _turns(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """How far joints that turn travel ``(W, n)`` [rad]; none of those that slide."""
        moves = np.abs(end - start)
        moves[:, self.external.slides_of(moves.shape[1])] = 0.0
        return np.asarray(moves)

    def steps_of(self, travel: FloatArray) -> FloatArray:
        """Whole number of moves of motions by their largest joint travel ``(...)`` [rad]."""
        return np.asarray(np.maximum(1.0, np.ceil((travel - ROUNDING) / self.largest_travel)))

    def check(self, start: FloatArray, end: FloatArray, *, far: bool = False) -> MotionVerdicts:
        """Verdicts on motions from postures ``(W, n)`` to postures ``(W, n)`` [rad].

        With ``far``, joints may travel as far as they like: there will be stops on the way.
        """
        moves = self._turns(start, end)
        labels = self.external.labels(moves.shape[1])
        travel = moves.max(axis=1, initial=0.0)
        clear = (travel <= self.largest_travel + ROUNDING) | far
        reasons, part = [""] * len(start), np.full(len(start), np.nan)
        for i in np.flatnonzero(~clear).tolist():
            degrees = np.rad2deg([travel[i], self.largest_travel])
            reasons[i] = (
                f"{labels[int(np.argmax(moves[i]))]} travels {degrees[0]:.0f} deg, "
                f"{degrees[1]:g} deg allowed"
            )
        for scene, keep_m, whose in self._scenes:
            rows = np.flatnonzero(clear)
            ways = scene.ways(start[rows], end[rows], keep_m, cap_m=TOUCH_M)
            clear[rows] = ways.clear
            for i in np.flatnonzero(~ways.clear).tolist():
                collision, pair = whose[ways.pair[i]]
                said = collision.explain(float(ways.distance_m[i]), pair)
                reasons[rows[i]], part[rows[i]] = said, ways.part[i]
        return MotionVerdicts(clear, travel, part, tuple(reasons))


@dataclass(frozen=True, eq=False)
class Retreat:
    """Moves along the axis of a tool, to poses that touch and away from them."""

    robot: Robot
    tool_m: FloatArray  # (3,): tool point in the tip frame [m]
    axis: FloatArray  # (3,): unit vector in the tip frame along which the tool comes to the target
    length_m: float
    contact_m: float
    short_m: float
    """length_m, contact_m, short_m: how far the tool backs off, within how much of the pose bodies
    may touch, and how far before the pose a program stops."""
    passing: Checker  # what a posture that is backed off must keep: all distances
    others: MotionChecker
    """What is kept all along the move: all distances but those of bodies that meet at the
    target."""
    meeting: MotionChecker  # those not touching, until the last part of the move

    def back_off(self, q: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
        """Postures ``(N, n)`` [rad] with the tool backed off from others, and what is in the way.

        Of the same arm configuration, and with the same orientation of the tool. Reasons are empty
        where nothing is.
        """
        back, found = self._backed_off(q)
        where = f"{self.length_m * 1e3:g} mm back along the tool"
        reasons = [f"no posture {where}"] * len(q)
        rows = np.flatnonzero(found)
        straight = self.is_along(back[rows], q[rows])
        for i in rows[~straight].tolist():
            reasons[i] = f"{where}: the joint move there is not straight"
        rows = rows[straight]
        verdicts = self.passing.check(back[rows], every=False)
        for k in np.flatnonzero(~verdicts.feasible).tolist():
            reasons[rows[k]] = f"{where}: {verdicts.reason(k)}"
        rows = rows[verdicts.feasible]
        moves = self.check(back[rows], q[rows])
        for i, why in zip(rows.tolist(), moves.reasons, strict=True):
            reasons[i] = f"on the last {self.length_m * 1e3:g} mm along the tool: {why}" * bool(why)
        return back, tuple(reasons)

    def stop_short(self, q: FloatArray) -> FloatArray:
        """Postures ``(N, n)`` [rad] on the moves in to others, where a program stops.

        Raises UnreachableError: the tool cannot back off from one of them.
        """
        back, found = self._backed_off(q)
        if not found.all():
            row = int(np.argmin(found))
            raise UnreachableError(
                f"posture {row + 1} has none {self.length_m * 1e3:g} mm back along the tool: there "
                f"is no way in to stop {self.short_m * 1e3:g} mm short on",
                hint="set plan.stop_short_mm = 0, or change plan.retreat_mm",
                name="plan.stop_short_mm",
            )
        return back + (q - back) * self._part_before(back, q, self.short_m)[:, None]

    def _backed_off(self, q: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Postures ``(N, n)`` [rad] with the tool backed off, and which there are ``(N,)``."""
        T = self.robot.fk(q)
        T[:, :3, 3] -= self.length_m * T[:, :3, :3] @ self.axis
        from calib.vision.touch_up import follow

        return follow(self.robot, q, T)

    def is_along(self, away: FloatArray, q: FloatArray) -> BoolArray:
        """Joint moves ``(N,)`` from postures ``(N, n)`` that come in along the tool's axis."""
        T = self.robot.fk(q)
        between = away[:, None] + (q - away)[:, None] * np.append(0.0, _SAMPLES)[:, None]
        T_on = self.robot.fk(between.reshape(-1, self.robot.n)).reshape(*between.shape[:2], 4, 4)
        off = self._points(T_on) - self._points(T)[:, None]
        axis = (T[:, :3, :3] @ self.axis)[:, None]
        along = -(off * axis).sum(axis=-1)  # shape (N, 1 + samples)
        bend = np.linalg.norm(off + along[..., None] * axis, axis=-1).max(axis=1)
        turn = rotation_angle(np.swapaxes(T[:, None, :3, :3], -1, -2) @ T_on[..., :3, :3])
        return np.asarray((bend <= BEND * along[:, 0]) & (turn <= TURN_RAD).all(axis=1))

    def check(self, away: FloatArray, q: FloatArray) -> MotionVerdicts:
        """Verdicts on moves along the tool from postures ``(N, n)`` to those that touch [rad]."""
        found = self.others.check(away, q)
        contact = self._part_before(away, q, self.contact_m)
        met = self.meeting.check(away, away + (q - away) * contact[:, None])
        first = found.clear & ~met.clear
        reasons = np.where(first, met.reasons, found.reasons).tolist()
        part = np.where(first, met.part * contact, found.part)
        return MotionVerdicts(found.clear & met.clear, found.travel, part, tuple(reasons))

    def _part_before(self, away: FloatArray, q: FloatArray, far_m: float) -> FloatArray:
        """Parts of moves ``(N,)`` after which the tool point is within so far of their end."""
        end = self._points(self.robot.fk(q))
        left = np.ones(len(q))
        for _ in range(4):  # the move is all but even: each step gains two digits
            point = self._points(self.robot.fk(q + (away - q) * left[:, None]))
            far = np.linalg.norm(point - end, axis=-1)
            left = np.minimum(1.0, left * far_m / np.maximum(far, far_m / 1e3))
        return np.asarray(1.0 - left)

    def _points(self, T: FloatArray) -> FloatArray:
        return np.asarray(T[..., :3, :3] @ self.tool_m + T[..., :3, 3])


class BackingOff(Constraint):
    """The tool can come in along its axis, from where there is room to turn."""

    name = "retreat"
    hint_words = "change plan.retreat_mm or plan.contact_mm, or correct tool.axis"
    measured = False

    def __init__(self, retreat: Retreat) -> None:
        self._retreat = retreat

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Infinite or -1."""
        _, reasons = self._retreat.back_off(arm.q)
        blocked = np.array([bool(why) for why in reasons], dtype=bool)
        return np.where(blocked, -1.0, np.inf), np.zeros(len(blocked), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        _, reasons = self._retreat.back_off(arm.q[[i]])
        return reasons[0] or "room to back off along the tool"
