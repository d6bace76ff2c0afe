"""A robot of which nothing is known but where its flange was: its postures are poses.

Hand-eye calibration needs no more. Six numbers are a posture: the place of the flange [m] and its
rotation vector [rad] in the base frame. Parameters of joints and links mean nothing here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.robots.chain import Displacement, SerialChain, Walk
from calib.robots.robot import Robot
from calib.se3 import FloatArray, check_transforms, rotation_exp, rotation_log

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True, eq=False)
class _PoseChain(SerialChain):
    def walk(self, q: FloatArray, displaced: Mapping[int, Displacement] | None = None) -> Walk:
        """The pose itself; joint axes are not there, and stand as noughts."""
        count = q.shape[1]
        tip = rotation_exp(q[3:].T).transpose(2, 1, 0)
        nothing = np.zeros((6, 3, 3, count))
        return Walk(nothing, nothing[:, 0], np.ascontiguousarray(tip), q[:3].copy(), {})


def flange_robot() -> Robot:
    """The robot whose postures are poses of its flange: see :func:`posture_of_pose`."""
    chain = _PoseChain(np.tile(np.eye(4), (6, 1, 1)), np.tile([0.0, 0.0, 1.0], (6, 1)), np.eye(4))
    wide = np.full(6, np.inf)
    return Robot(
        name="flange poses",
        chain=chain,
        joint_names=NAMES,
        lower=-wide,
        upper=wide,
        speed=np.full(6, np.nan),
        link_mass=np.zeros(6),
        link_com=np.zeros((6, 3)),
        gravity=np.array([0.0, 0.0, -9.81]),
        stiffness=wide,
        base_frame="base",
        tip_frame="flange",
    )


def posture_of_pose(T_base_flange: FloatArray) -> FloatArray:
    """Postures ``(..., 6)`` of :func:`flange_robot` at poses ``(..., 4, 4)`` [m]."""
    T = check_transforms(T_base_flange, "T_base_flange")
    return np.concatenate([T[..., :3, 3], rotation_log(T[..., :3, :3])], axis=-1)
