"""Constraints on the space around the arm: what it may run into, and the box it must stay in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.geometry import Body, HalfSpace, Scene, Sphere
from calib.geometry.scene import CAP_M
from calib.geometry.ways import TOUCH_M
from calib.robots import Robot
from calib.se3 import FloatArray, IntArray, transform
from posedesign.constraints.constraint import Constraint, Situation

POINT_M = 1e-6
"""Radius of the balls that stand for points."""

_SHOWN_M = 0.5e-3
"""Depths below this would be written as 0 mm."""


class Collision(Constraint):
    """A safety distance between tool, obstacles and arm; contact is never allowed."""

    name = "collision"
    unit = "mm"
    display = 1e3
    comfort = 0.05

    def __init__(self, scene: Scene, keep_m: float) -> None:
        self.scene = scene
        self.keep_m = max(keep_m, TOUCH_M)
        self._cap_m = max(CAP_M, keep_m + self.comfort)

    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: the pair of bodies."""
        found = self.scene.clearance(arm.q, cap_m=self._cap_m, depths=arm.depths, state=arm.state)
        return found.distance_m - self.keep_m, found.pair

    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        return self.explain(room + self.keep_m, which)

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

    def remedy(self, room: float) -> str:
        return (
            "move what stands there, lower constraints.safety_distance_mm, "
            "or list what may touch in constraints.ignore"
        )


class SelfCollision(Collision):
    """The links of the arm not running into each other, nor the tool into the wrist it is on.

    Their makers keep no distance.
    """

    name = "self-collision"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, 0.0)

    def remedy(self, room: float) -> str:
        return "list links that cannot really meet in constraints.ignore"


class Workspace(Collision):
    """Tool, arm beyond its first joint, and tool point inside a box: its sides are half-spaces."""

    name = "workspace"

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

    def remedy(self, room: float) -> str:
        return "widen constraints.workspace_lowest_mm and workspace_highest_mm"


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
    the box in the base frame [m].
    """
    point = Sphere(POINT_M)
    tip = robot.chain.T_link_tip
    moving = [body for body in bodies if body.link >= 2]
    moving += [
        Body(name, j + 1, np.eye(4), point) for j, name in enumerate(robot.joint_names) if j >= 1
    ]
    T_link_tool = tip @ transform(np.eye(3), tool_m)
    moving += [Body("tool point", robot.n, T_link_tool, point)]
    sides = []
    for axis, letter in enumerate("xyz"):
        for bound, sign in ((lowest_m[axis], 1.0), (highest_m[axis], -1.0)):
            place = transform(_z_along(axis, sign), bound * np.eye(3)[axis])
            sides.append(Body(f"{letter} = {bound * 1e3:.0f} mm", 0, place, HalfSpace()))
    scene = Scene(robot.chain, arm=moving, obstacles=sides)
    return scene.others


def _z_along(axis: int, sign: float) -> FloatArray:
    """A rotation (3, 3) whose z points along an axis of the base, or against it."""
    z = sign * np.eye(3)[axis]
    x = np.eye(3)[(axis + 1) % 3]
    return np.column_stack([x, np.cross(z, x), z])
