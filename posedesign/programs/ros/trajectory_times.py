"""When the arm is at each point of a trajectory, from the speeds of its joints."""

from __future__ import annotations

import math

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.motion.order import ACCELERATION_S, move_times
from posedesign.programs.arm import Arm

UNKNOWN_SPEED = 1.0
"""Speed of the joints of an arm whose description gives none [rad/s]: below that of the slowest
joints of common arms, 1.3 to 2 rad/s for 200 kg payload."""

CUBIC_PEAK = 1.5
"""Greatest speed over mean speed of a cubic from rest to rest: the joint trajectory controller
joins points with positions and velocities by cubics."""

SHORTEST_MS = 100
"""Of a move [ms]: points must not have the same time, also where the arm is there already."""

MOST_SECONDS = 2**31 - 1
"""Largest value of the field sec of a Duration."""


def joint_speeds(arm: Arm, percent: float) -> FloatArray:
    """Speeds ``(n,)`` [rad/s] at so many percent of the description's.

    Joints without one are as fast as the median of the others; without any it is
    :data:`UNKNOWN_SPEED`.
    """
    speeds = np.full(arm.n, np.nan) if arm.robot is None else arm.robot.speed
    known = np.isfinite(speeds)
    usual = float(np.median(speeds[known])) if known.any() else UNKNOWN_SPEED
    return np.asarray(np.where(known, speeds, usual) * percent / 100.0)


def point_times_ms(
    path: FloatArray, arm: Arm, percent: float, settle_s: float
) -> tuple[list[int], int]:
    """Durations of the moves to each of ``(S, n)`` postures [ms], and of standing [ms].

    A move takes the time of :func:`posedesign.motion.order.move_times`, and never so little that a
    cubic would be faster than the joint speeds. The first one begins wherever the arm is: it takes
    the time from the farthest that the joint limits allow, or from a half turn away.

    Raises
    ------
    InputError
        The whole takes longer than a Duration can say.
    """
    speeds = joint_speeds(arm, percent)
    moves = np.vstack([_farthest(path[0], arm), np.abs(np.diff(path, axis=0))])
    times = np.maximum(
        move_times(moves, speeds, ACCELERATION_S), CUBIC_PEAK * (moves / speeds).max(axis=1)
    )
    moving = [max(SHORTEST_MS, math.ceil(1e3 * t)) for t in times.tolist()]
    standing = math.ceil(1e3 * settle_s)
    if sum(moving) + standing * len(path) > 1000 * MOST_SECONDS:
        raise InputError(
            f"the trajectory would take longer than {MOST_SECONDS} s",
            hint="settle for a shorter time, or move faster",
            name="settle_s",
            value=settle_s,
        )
    return moving, standing


def _farthest(posture: FloatArray, arm: Arm) -> FloatArray:
    """Greatest distance ``(n,)`` [rad] that each joint can be away from a posture."""
    if arm.robot is None:
        return np.full(arm.n, np.pi)
    return np.maximum(np.abs(arm.robot.upper - posture), np.abs(posture - arm.robot.lower))
