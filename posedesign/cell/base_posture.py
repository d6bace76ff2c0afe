"""A base posture to start from, for an arm that nobody has taught yet."""

from __future__ import annotations

from itertools import product

import numpy as np

from calib.errors import UnreachableError
from calib.robots import Robot
from calib.se3 import FloatArray, rotation_from_wpr, wpr_from_rotation
from posedesign.cell.orientations import touching_poses, wpr_rotations
from posedesign.constraints import Checker, nearest_postures

_TRIAL_VARIATION = np.deg2rad([30.0, 30.0, 30.0])
"""Of the 27 poses that a base posture is judged by."""

_ROLLS = (0.0, np.pi)
_FRACTIONS = (0.45, 0.55, 0.65, 0.75)
_HEIGHTS = (-0.1, 0.1, 0.25, 0.4)
"""Where the tool point is tried: in front of the arm, as parts of its reach."""

_TRIED_PER_PLACE = 2
"""Postures of each place, the roomiest first, for which the trial poses are solved."""


def suggest_tool(robot: Robot) -> FloatArray:
    """A tool point ``(3,)`` [m] of the size that suits the arm, off the axis of its last joint.

    On the axis, turning the last joint would not move it, and would tell nothing.
    """
    size = robot.chain.reach_m
    return np.round(np.array([0.05 * size, 0.0, 0.1 * size]), 2)


def suggest_base_posture(robot: Robot, tool_m: FloatArray) -> FloatArray:
    """A posture with the tool pointing down in front of the arm, and room to turn it.

    Parameters
    ----------
    robot : Robot
    tool_m : array (3,)
        Tool point in the tip frame [m].

    Returns
    -------
    array (n,)
        [rad], rounded to whole degrees: of all places tried, the one where most of the poses
        varied by 30 deg can be taken, then the one farthest from its joint limits.

    Raises
    ------
    UnreachableError
        The arm cannot point its tool down anywhere in front of it.
    """
    size, height = robot.chain.reach_m, float(robot.state(np.zeros(robot.n)).origins[1, 2])
    front = _front(robot)
    best: tuple[tuple[float, ...], FloatArray] | None = None
    for roll, part, up in product(_ROLLS, _FRACTIONS, _HEIGHTS):
        down = rotation_from_wpr([np.pi, 0.0, roll])
        target = part * size * front + [0.0, 0.0, height + up * size]
        pose = touching_poses(down[None], tool_m, target)
        found = np.deg2rad(np.round(np.rad2deg(robot.inverse(pose).of(0))))
        for q in sorted(found, key=lambda q: -_room(robot, q))[:_TRIED_PER_PLACE]:
            score = _score(robot, tool_m, q)
            if best is None or score > best[0]:
                best = score, q
    if best is None:
        raise UnreachableError(
            f"{robot.name}: the tool cannot point down in front of the arm",
            hint="give a base posture of your own in [base_pose]",
            name="base_pose",
        )
    return best[1]


def _score(robot: Robot, tool_m: FloatArray, q: FloatArray) -> tuple[float, ...]:
    """Poses of the trial grid that can be taken, then room, then nearness to the zero posture."""
    state = robot.state(q)
    rotations = wpr_rotations(wpr_from_rotation(state.R_base_tip), _TRIAL_VARIATION)
    poses = touching_poses(rotations, tool_m, state.point(tool_m))
    found = nearest_postures(Checker(robot), poses, q).feasible.sum()
    return float(found), round(_room(robot, q), 2), -float(np.abs(q).sum())


def _room(robot: Robot, q: FloatArray) -> float:
    """How far a posture is from its limits and from a singularity, about 0 to 0.5."""
    limits = (np.minimum(q - robot.lower, robot.upper - q) / robot.joint_range).min()
    dexterity = robot.chain.smallest_singular_values(robot.state(q))
    return float(min(limits, dexterity))


def _front(robot: Robot) -> FloatArray:
    """Horizontal unit vector to where the arm reaches with its first joint in mid-range."""
    q = (robot.lower + robot.upper) / 2.0
    q[1:] = np.clip(0.0, robot.lower[1:], robot.upper[1:])
    forward = robot.state(q).p_base_tip * [1.0, 1.0, 0.0]
    length = np.linalg.norm(forward)
    return forward / length if length > 0.05 * robot.chain.reach_m else np.array([1.0, 0.0, 0.0])
