"""A route: where the arm stops, why, and how long the round takes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from calib.se3 import FloatArray, IntArray


class Passing(StrEnum):
    """Why the arm passes through a posture at which nothing is measured."""

    DETOUR = "detour"
    APPROACH = "approach"
    RETREAT = "retreat"
    RETURN = "return to base"


@dataclass(frozen=True, eq=False)
class Stop:
    """A posture on the route.

    ``posture`` (n,): [rad]. ``pose``: index of the pose that is measured there; None where the arm
    only passes through. ``passing``: why, where it does.
    """

    posture: FloatArray
    pose: int | None
    passing: Passing = Passing.DETOUR


@dataclass(frozen=True, eq=False)
class Route:
    """Postures in the order in which they are visited.

    ``lost``: poses that no clear way leads to, by index, and why. ``moving_s``: predicted time of
    all moves, from the base posture on [s]; NaN where no speed is known. ``dwell_s``: how long the
    arm stands at each pose that is measured [s].
    """

    stops: tuple[Stop, ...]
    lost: dict[int, str]
    moving_s: float = float("nan")
    dwell_s: float = 0.0

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
        return self.dwell_s * len(self.order)

    @property
    def cycle_time_s(self) -> float:
        """Predicted time of the whole round [s]: :func:`~posedesign.motion.order.cycle_time_s`."""
        return self.moving_s + self.standing_s

    @property
    def timing(self) -> str:
        """The predicted time in one line."""
        if np.isnan(self.moving_s):
            return "cycle time not known: the robot's description gives no joint speeds"
        return (
            f"predicted cycle time {self.cycle_time_s:.0f} s: {self.moving_s:.0f} s moving, "
            f"{self.standing_s:.0f} s standing at {len(self.order)} pose(s)"
        )


@dataclass(frozen=True)
class RouteOptions:
    """How poses are visited.

    ``return_to_base``: whether the round ends where it starts. ``approach_rad``: last movement of
    every joint to each pose, in the same direction at all of them; 0: as it comes. ``dwell_s``: how
    long the arm stands at each pose. ``speed_share``: speed of the moves as a part of the joints'
    own.
    """

    return_to_base: bool = True
    approach_rad: float = 0.0
    dwell_s: float = 0.0
    speed_share: float = 1.0
