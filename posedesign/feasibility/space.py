"""Constraints on the space around the arm: what it may run into, and the box it must stay in."""

from __future__ import annotations

import numpy as np

from calib.geometry.scene import CAP_M, Scene
from calib.se3 import FloatArray, IntArray
from posedesign.feasibility.constraint import Constraint
from posedesign.feasibility.situation import Situation

_SIDES = ("below x", "below y", "below z", "above x", "above y", "above z")


class Collision(Constraint):
    """A safety distance between tool, obstacles and arm."""

    name = "collision"
    unit = "mm"
    display = 1e3
    comfort = 0.05
    key = "constraints.safety_distance_mm"

    def __init__(self, scene: Scene, keep_m: float) -> None:
        self.scene = scene
        self.keep_m = keep_m

    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """See :meth:`Constraint.room`; which: the pair of bodies."""
        found = self.scene.clearance(arm.q, state=arm.state)
        return found.distance_m - self.keep_m, found.pair

    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        """See :meth:`Constraint.says`."""
        return distance_reason(self.scene, room + self.keep_m, which, self.keep_m)


class SelfCollision(Collision):
    """The links of the arm not running into each other: their makers keep no distance."""

    name = "self-collision"
    key = "constraints.ignore"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, 0.0)


class Workspace(Constraint):
    """The tool and the arm beyond its first joint inside a box."""

    name = "workspace"
    unit = "mm"
    display = 1e3
    comfort = 0.05
    key = "constraints.workspace_lowest_mm, workspace_highest_mm"

    def __init__(self, scene: Scene, lowest_m: FloatArray, highest_m: FloatArray) -> None:
        self._scene = scene
        self._lowest_m, self._highest_m = lowest_m, highest_m

    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """See :meth:`Constraint.room`; which: the side of the box."""
        lowest, highest = self._scene.extent(arm.q, state=arm.state)
        room = np.concatenate([lowest - self._lowest_m, self._highest_m - highest], axis=1)
        which = np.argmin(room, axis=1)
        return room[np.arange(len(room)), which], which

    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        """See :meth:`Constraint.says`."""
        bound = np.concatenate([self._lowest_m, self._highest_m])[which]
        side = _SIDES[which]
        if room < 0:
            return (
                f"arm or tool {-room * 1e3:.0f} mm {side} = {bound * 1e3:.0f} mm of the workspace"
            )
        axis = side[-1]
        return f"arm and tool {room * 1e3:.0f} mm inside {axis} = {bound * 1e3:.0f} mm"


def distance_reason(scene: Scene, distance_m: float, pair: int, keep_m: float) -> str:
    """In words, how near two bodies come."""
    if distance_m >= CAP_M:
        return f"nothing within {CAP_M * 1e3:g} mm"
    one, other = scene.names(pair)
    if distance_m <= 0.0:
        return f"{one} and {other} run {-distance_m * 1e3:.0f} mm into each other"
    asked = f", {keep_m * 1e3:g} mm asked for" if keep_m else ""
    return f"{one} {distance_m * 1e3:.1f} mm from {other}{asked}"
