"""Joint values as a controller's pendant shows them, from those of the URDF and back.

FANUC's J3 is the angle of the forearm to the horizontal, the URDF's joint_3 the one to the upper
arm; with joint_2 about +y and joint_3 about -y

    J3 = q3 - q2        q3 = J3 + J2

and the other joints agree. Source: ros-industrial/fanuc, fanuc_driver/src/fanuc_utils.cpp, where
``J23_factor`` is 1 for all arms but the M-430iA. A zero offset of J2 therefore moves q2 *and* q3
when the pendant's J3 is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import InputError

FloatArray = NDArray[np.float64]

FANUC_JOINTS = 6
"""Joints of the arms whose coupling of J2 and J3 is known."""


def pendant_from_urdf(posture_rad: ArrayLike) -> FloatArray:
    """Joint values on a FANUC pendant ``(..., 6)`` [deg] of URDF postures ``(..., 6)`` [rad].

    Raises
    ------
    InputError
        The arm has another number of joints than 6.
    """
    pendant = np.degrees(_check_joints(posture_rad))
    pendant[..., 2] -= pendant[..., 1]
    return pendant


def urdf_from_pendant(pendant_deg: ArrayLike) -> FloatArray:
    """URDF postures ``(..., 6)`` [rad] of joint values on a FANUC pendant ``(..., 6)`` [deg].

    Raises
    ------
    InputError
        The arm has another number of joints than 6.
    """
    posture = _check_joints(pendant_deg)
    posture[..., 2] += posture[..., 1]
    return np.radians(posture)


def _check_joints(values: ArrayLike) -> FloatArray:
    """Copy the values, after checking that they belong to an arm of six joints."""
    array = np.array(values, dtype=float)
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
