"""Constraints on the joints: their limits, limits that they have together, singularities."""

from __future__ import annotations

import numpy as np

from calib.errors import limit_reason
from calib.robots import Robot
from calib.se3 import FloatArray, IntArray
from posedesign.constraints.constraint import ROUNDING, Constraint, Situation

_DEG = float(np.rad2deg(1.0))


class JointLimits(Constraint):
    """Every joint inside its limits, less a margin: an uncalibrated joint is not where it says."""

    name = "joint limits"
    unit = "deg"
    display = _DEG
    comfort = np.deg2rad(10.0)

    def __init__(self, robot: Robot, margin: float) -> None:
        self._lower, self._upper = robot.lower, robot.upper
        self._margin = margin

    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: the joint."""
        room = np.minimum(arm.q - self._lower, self._upper - arm.q) - self._margin
        which = np.argmin(room, axis=1)
        return room[np.arange(len(room)), which], which

    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        value, low, high = arm.q[i, which], self._lower[which], self._upper[which]
        return _limit_says(f"J{which + 1}", value, low, high, self._margin)

    def remedy(self, room: float) -> str:
        return _margin_remedy(room, self._margin)


class CoupledLimits(Constraint):
    """Limits that joints have together, less a margin."""

    name = "coupled limits"
    unit = "deg"
    display = _DEG
    comfort = np.deg2rad(10.0)

    def __init__(self, robot: Robot, margin: float) -> None:
        self._limits = robot.coupled_limits
        self._margin = margin

    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: the limit."""
        room = np.stack([limit.margin(arm.q) for limit in self._limits], axis=1) - self._margin
        which = np.argmin(room, axis=1)
        return room[np.arange(len(room)), which], which

    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        limit = self._limits[which]
        value = float(arm.q[i] @ limit.coefficients)
        return _limit_says(limit.name, value, limit.lower, limit.upper, self._margin)

    def remedy(self, room: float) -> str:
        return _margin_remedy(room, self._margin)


def _limit_says(name: str, value: float, lower: float, upper: float, margin: float) -> str:
    """How a value lies between limits that a margin is kept from [rad]."""
    kept = 0.0 if not lower - ROUNDING <= value <= upper + ROUNDING else margin
    value_deg, low_deg, high_deg = np.rad2deg([value, lower + kept, upper - kept]).tolist()
    ending = f" ({np.rad2deg(kept):g} deg inside the limit)" if kept else ""
    if min(value - lower, upper - value) - kept < -ROUNDING:
        return limit_reason(name, value_deg, low_deg, high_deg) + ending
    side, bound_deg = ("upper", high_deg) if 2 * value > lower + upper else ("lower", low_deg)
    return f"{name} {value_deg:.1f} deg, {side} bound {bound_deg:.1f} deg{ending}"


def _margin_remedy(room: float, margin: float) -> str:
    """A margin is worth lowering only where the limit itself is kept."""
    return "lower plan.limit_margin_deg" if 0.0 <= room + margin < margin else ""


class Singularity(Constraint):
    """The smallest singular value of the tip's Jacobian, its lengths divided by the arm's reach."""

    name = "singularity"
    unit = ""
    display = 1.0
    comfort = 0.05

    def __init__(self, smallest: float) -> None:
        self._smallest = smallest

    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        value = arm.chain.smallest_singular_values(arm.state)
        return value - self._smallest, np.zeros(len(value), dtype=np.intp)

    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        return f"smallest singular value {room + self._smallest:.3f}, bound {self._smallest:g}"

    def remedy(self, room: float) -> str:
        return "lower constraints.smallest_singular_value"
