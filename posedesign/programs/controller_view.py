"""Joint values as a FANUC pendant shows them, for postures in the signs of ROS-Industrial's URDFs.

A program or a pose list knows no robot. What holds for any description is
:class:`calib.robots.Controller`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import InputError
from calib.robots import Controller

FloatArray = NDArray[np.float64]

FANUC_JOINTS = 6
"""Joints of the arms whose coupling of J2 and J3 is known."""

_MATRIX = np.eye(FANUC_JOINTS)
_MATRIX[2, 1] = -1.0  # J3 is the angle to the horizontal: q3 - q2

ROS_INDUSTRIAL_FANUC = Controller("fanuc", _MATRIX, np.eye(4))


def pendant_from_urdf(posture_rad: ArrayLike) -> FloatArray:
    """Joint values on a FANUC pendant ``(..., 6)`` [deg] of URDF postures ``(..., 6)`` [rad].

    Raises
    ------
    InputError
        The arm has another number of joints than 6.
    """
    return ROS_INDUSTRIAL_FANUC.pendant(_check_joints(posture_rad))


def urdf_from_pendant(pendant_deg: ArrayLike) -> FloatArray:
    """URDF postures ``(..., 6)`` [rad] of joint values on a FANUC pendant ``(..., 6)`` [deg].

    Raises
    ------
    InputError
        The arm has another number of joints than 6.
    """
    return ROS_INDUSTRIAL_FANUC.posture(_check_joints(pendant_deg))


def _check_joints(values: ArrayLike) -> FloatArray:
    """The values as an array, after checking that they belong to an arm of six joints."""
    array = np.asarray(values, dtype=float)
    n = array.shape[-1] if array.ndim else 0
    if n != FANUC_JOINTS:
        raise InputError(
            f"the posture has {n} joint values, a FANUC arm has {FANUC_JOINTS}",
            hint="only arms of six joints can be written for this controller",
            name="posture",
            value=n,
            bound=FANUC_JOINTS,
        )
    return array
