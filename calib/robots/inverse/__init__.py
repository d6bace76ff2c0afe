"""Inverse kinematics: poses in, for each pose every posture that takes it."""

from calib.robots.bounds import first_per_group
from calib.robots.inverse.solutions import (
    CLOSURE_TOLERANCE,
    NEAR_SINGULAR,
    InverseKinematics,
    InverseSolutions,
    pose_error,
    twist_to,
)

__all__ = [
    "CLOSURE_TOLERANCE",
    "NEAR_SINGULAR",
    "InverseKinematics",
    "InverseSolutions",
    "first_per_group",
    "pose_error",
    "twist_to",
]
