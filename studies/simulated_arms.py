"""What studies 16 and 18 share: parts of arms that are simulated, and how far off a model is."""

from __future__ import annotations

import numpy as np

from calib.model import Setup
from calib.model.parameters import AXES, GravityLoad, LinkGeometry
from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.cell import Cell


def aligned_rms_m(said: FloatArray, true: FloatArray) -> float:
    """Return the root mean square distance [m] of points ``(V, 3)`` after the best rigid motion.

    By the rotation of Kabsch 1976, and the middles of both sets.
    """
    a, b = said - said.mean(axis=0), true - true.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    turn = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return float(np.sqrt(np.mean(np.sum((a @ turn.T - b) ** 2, axis=1))))


def across_axes(robot: Robot) -> list[str]:
    """Return the names of all link errors but rotations about the joints' own axes.

    Those rotations are zero offsets.
    """
    own = {
        f"link.{joint}.{AXES[3 + int(np.argmax(np.abs(axis)))]}"
        for joint, axis in zip(robot.joint_names, robot.chain.axes, strict=True)
    }
    return [name for name in LinkGeometry(robot).names if name not in own]


def largest_torque_nm(cell: Cell, count: int, rng: np.random.Generator) -> FloatArray:
    """Return the largest torque of gravity ``(n,)`` [Nm] of each joint, over postures drawn.

    At least a tenth of the largest of all joints. Arm and tool only.
    """
    robot = cell.robot
    q = rng.uniform(robot.lower, robot.upper, (count, robot.n))
    torque = GravityLoad(robot, cell.payload).joint_torque(
        np.ascontiguousarray(q.T), Setup.of(len(q))
    )
    found = np.abs(torque).max(axis=1)
    return np.asarray(np.maximum(found, 0.1 * found.max()))
