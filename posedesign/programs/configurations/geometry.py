"""Where the wrist of a six-axis arm is: the geometry that the words of all makers share.

Everything is taken from the axes at the posture (``robot.state``), nothing from tables of
dimensions, so that it holds for calibrated arms and for those that are not in the presets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.robots import ChainState, Controller, Robot
from calib.se3 import BoolArray, FloatArray

_ONE_POINT_M = 2e-3
"""Distance of axes 4 and 6 from the wrist centre up to which they meet: frames of calibrated arms
are off by some tenths of a millimetre, wrists that are offset by design by 20 mm and more."""

_PARALLEL = 1e-3
"""Sine of the angle between axes 4 and 5 below which they have no one nearest point."""


@dataclass(frozen=True, eq=False)
class ArmPositions:
    """Arm positions at N postures."""

    pendant_deg: FloatArray
    """(N, 6): joint values with the maker's signs, as the pendant shows them [deg]."""
    front_m: FloatArray
    """(N,): how far the wrist centre is in front of axis 1 [m], seen by the arm: along the
    horizontal direction that is x of the controller's world when joint 1 is at zero, and turns with
    it. Negative behind axis 1."""
    line_m: FloatArray
    """(N,): how far the wrist centre is in front of the line from axis 2 to axis 3 [m], seen by the
    arm: positive where a forearm that points to the front is with the upper arm straight up. Zero
    where the arm is stretched or folded."""

    @property
    def behind_axis_1(self) -> BoolArray:
        """Whether the wrist centre is behind axis 1, ``(N,)``."""
        return self.front_m < 0

    @property
    def behind_line(self) -> BoolArray:
        """Whether the wrist centre is behind the line from axis 2 to axis 3, ``(N,)``.

        With the wrist in front of axis 1 the elbow is then below the line from axis 2 to the wrist.
        """
        return self.line_m < 0


def arm_positions(robot: Robot, postures: FloatArray, maker: str) -> ArmPositions:
    """Arm positions at postures ``(N, 6)`` [rad, signs of the description].

    Raises InputError: the robot does not have this maker's controller, its last three axes do not
    meet, or the postures are not of this robot.
    """
    controller = _controller_of(robot, maker)
    postures = np.atleast_2d(robot.check_posture(postures))
    state = robot.state(postures)
    wrist = wrist_centre(state)
    # positive joint 2 tips the upper arm to the front with every maker: its axis points to the left
    left = state.axes[:, 1] * np.sign(controller.pendant_from_joints[1, 1])
    up = state.axes[:, 0] * np.sign(state.axes[:, 0] @ controller.T_base_world[:3, 2])[:, None]
    front = np.cross(left, up)
    upper_arm = state.origins[:, 2] - state.origins[:, 1]
    upper_arm -= left * _dot(upper_arm, left)[:, None]
    ahead = np.cross(left, upper_arm) / np.linalg.norm(upper_arm, axis=-1)[:, None]
    return ArmPositions(
        pendant_deg=controller.pendant(postures),
        front_m=_dot(wrist - state.origins[:, 0], front),
        line_m=_dot(wrist - state.origins[:, 2], ahead),
    )


def wrist_centre(state: ChainState) -> FloatArray:
    """Where axes 4, 5 and 6 meet, ``(N, 3)`` [m] in the base frame.

    The point of axis 5 nearest to axis 4, which is defined in every posture; axis 6 may lie on
    axis 4.

    Raises InputError: the three axes do not meet.
    """
    a4, a5, a6 = (state.axes[:, j] for j in (3, 4, 5))
    p4, p5, p6 = (state.origins[:, j] for j in (3, 4, 5))
    cosine = _dot(a4, a5)
    sine_squared = 1.0 - cosine**2
    if (sine_squared < _PARALLEL**2).any():
        raise _no_wrist_centre("axes 4 and 5 are parallel")
    apart = p4 - p5
    along = (_dot(apart, a5) - _dot(apart, a4) * cosine) / sine_squared
    centre = p5 + along[:, None] * a5
    miss = max(
        float(np.linalg.norm(np.cross(centre - p, a), axis=-1).max(initial=0.0))
        for p, a in ((p4, a4), (p6, a6))
    )
    if miss > _ONE_POINT_M:
        raise _no_wrist_centre(f"its axes 4, 5 and 6 miss one point by {1e3 * miss:.1f} mm")
    return np.asarray(centre)


def _no_wrist_centre(why: str) -> InputError:
    return InputError(
        f"the arm has no wrist centre: {why}",
        hint="its poses cannot be told apart by words: write the program with joint values",
        name="robot",
    )


def _controller_of(robot: Robot, maker: str) -> Controller:
    controller = robot.controller
    if controller is None or controller.maker != maker:
        found = f"a controller of {controller.maker}" if controller else "no controller"
        raise InputError(
            f"{robot.name} has {found}, these are words of {maker}",
            hint=f"use robot.controlled_by({maker!r}) if that is what it has",
            name=maker,
        )
    return controller


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))
