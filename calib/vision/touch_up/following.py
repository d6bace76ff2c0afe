"""The controller's part: from a shift of the tip to joint values, on the nominal robot."""

from __future__ import annotations

import numpy as np

from calib.robots import Robot
from calib.robots.inverse import CLOSURE_TOLERANCE, pose_error
from calib.robots.inverse.iterative import close_in
from calib.se3 import BoolArray, FloatArray, transform

_ITERATIONS = 12
"""Newton steps of a shift by centimetres: three or four, more only where there is no posture."""


def follow(robot: Robot, q: FloatArray, T_wanted: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Postures next to ``(S, n)`` [rad] that bring the nominal tip to poses ``(S, 4, 4)``.

    As a controller runs a short straight move: the arm does not change its configuration.

    Returns
    -------
    q : array (S, n)
        [rad]
    found : array (S,) of bool
        False where the joint limits or a singularity are in the way.
    """
    out = close_in(robot.chain, q, T_wanted, robot.lower, robot.upper, _ITERATIONS)
    error = np.abs(pose_error(robot.chain, out, T_wanted)).max(axis=-1)
    found = error < CLOSURE_TOLERANCE
    for limit in robot.coupled_limits:
        found &= limit.room(out) >= 0.0
    return out, np.asarray(found)


def shifted(T_base_tip: FloatArray, shift_m: FloatArray) -> FloatArray:
    """Poses ``(..., 4, 4)`` of a tip moved by ``(..., 3)`` [m] in its own axes."""
    return T_base_tip @ transform(np.eye(3), shift_m)
