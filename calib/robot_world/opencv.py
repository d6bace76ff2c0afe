"""The same equation as OpenCV names it.

``cv2.calibrateRobotWorldHandEye`` calls A the transform from world to camera, B from base to
gripper, X from base to world and Z from gripper to camera: A X = Z B read from the other side. With
our names its world is the target and its gripper the flange.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError, one_line
from calib.robot_world.results import RobotWorldResult
from calib.se3 import FloatArray


def pairs_from_opencv(
    world2cam: ArrayLike, base2gripper: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """A = T_base_flange and B = T_target_camera from what OpenCV's function takes.

    Parameters
    ----------
    world2cam : array_like (N, 4, 4)
        T_camera_target [m]: its arguments ``R_world2cam`` and ``t_world2cam``.
    base2gripper : array_like (N, 4, 4)
        T_flange_base [m]: its arguments ``R_base2gripper`` and ``t_base2gripper``.

    Returns
    -------
    A, B : ndarray (N, 4, 4)
        What :func:`calib.robot_world.solve` takes.

    Raises
    ------
    InputError
        A matrix is not a rigid transform.
    """
    T_camera_target = se3.check_transforms(world2cam, "world2cam")
    T_flange_base = se3.check_transforms(base2gripper, "base2gripper")
    return se3.inverse(T_flange_base), se3.inverse(T_camera_target)


def result_to_opencv(result: RobotWorldResult) -> tuple[FloatArray, FloatArray]:
    """``base2world`` = T_target_base and ``gripper2cam`` = T_camera_flange ``(4, 4)`` [m].

    Raises
    ------
    InputError
        Something else than a result.
    """
    if not isinstance(result, RobotWorldResult):
        raise InputError(f"{one_line(result)} is no result of solve", name="result")
    return se3.inverse(result.Z), se3.inverse(result.X)
