"""Whether poses that were made elsewhere, or by hand, belong to a cell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError, JointLimitError
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.planning.tables import PoseList

ON_TARGET_M = 1e-3
"""Distance of the tool point from the target at which a pose is still one for touching it: far
above the rounding of a program, far below what would change an index."""

NEAR_TARGET_M = 0.05
"""Distance from which touch-up may start: a servo that is farther off does not see the target."""


def outside_limits(cell: Cell, names: Sequence[str], postures: FloatArray) -> list[str]:
    """Name and broken limit of each posture ``(N, n)`` [rad] that the robot cannot take."""
    said = []
    for name, q in zip(names, postures, strict=True):
        try:
            cell.robot.check_limits(q)
        except JointLimitError as error:
            said.append(f"{name}: {error.message}")
    return said


def off_target(cell: Cell, names: Sequence[str], postures: FloatArray, far_m: float) -> list[str]:
    """Name and distance [mm] of each posture ``(N, n)`` [rad] off the target by more than that."""
    points = cell.robot.state(postures).point(cell.tool_m)
    distance = np.linalg.norm(points - cell.target_m, axis=-1)
    return [
        f"{name}: the tool point is {far * 1e3:.4g} mm from the target"
        for name, far in zip(names, distance, strict=True)
        if far > far_m
    ]


def refuse_unfit(cell: Cell, poses: PoseList) -> None:
    """Refuse poses that the robot is to be sent to and that do not belong to this cell.

    Raises
    ------
    InputError
        A pose outside the joint limits, or with the tool point far from the target.
    """
    outside = outside_limits(cell, poses.names, poses.postures)
    _refuse(outside, "are these poses of this robot, in URDF signs? FANUC pendants show J3 less J2")
    measured = poses.measured
    far = off_target(cell, measured.names, measured.postures, NEAR_TARGET_M)
    _refuse(far, "are these poses of this cell, its tool and its target, in URDF signs?")


def refuse_hand_eye(cell: Cell, what: str) -> None:
    """Refuse to do with a cell of hand-eye calibration what needs a robot to be identified.

    Raises
    ------
    InputError
    """
    if cell.is_hand_eye:
        raise InputError(
            f"{what} needs a robot that is identified; this cell calibrates a camera",
            hint='set measurement.kind = "touch-up"',
            name="measurement.kind",
            value=cell.config.measurement.kind,
        )


def _refuse(poses: Sequence[str], hint: str) -> None:
    if poses:
        more = f", and {len(poses) - 1} more" if len(poses) > 1 else ""
        raise InputError(f"pose {poses[0]}{more}", hint=hint, name="poses")
