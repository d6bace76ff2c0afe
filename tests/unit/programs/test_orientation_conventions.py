"""Every maker's orientation against RoboDK's library, which is written and used by others.

Rotations are compared, never angles: these are not unique at +-90 deg of the middle one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.se3 import transform
from posedesign.programs.notation import ABC, MOVING_XYZ, QUATERNION, VECTOR, WPR

robomath = pytest.importorskip("robodk.robomath", reason="robodk is RoboDK's own library")

Numbers = np.ndarray[Any, np.dtype[np.float64]]

# Each controller's numbers here, and RoboDK's functions from and to them.
MAKERS = {
    "fanuc": (WPR, "Fanuc_2_Pose", "Pose_2_Fanuc"),
    "yaskawa": (WPR, "Motoman_2_Pose", "Pose_2_Motoman"),
    "kuka": (ABC, "KUKA_2_Pose", "Pose_2_KUKA"),
    "staubli": (MOVING_XYZ, "Staubli_2_Pose", "Pose_2_Staubli"),
    "ur": (VECTOR, "UR_2_Pose", "Pose_2_UR"),
    "abb": (QUATERNION, "quaternion_2_pose", "Pose_2_ABB"),
}


def theirs(name: str, numbers: Numbers) -> Numbers:
    """RoboDK's pose ``(4, 4)`` of numbers as the controller has them."""
    place = [] if name == "quaternion_2_pose" else [100.0, -200.0, 300.0]
    return np.array(getattr(robomath, name)([*place, *numbers.tolist()]).rows)


def numbers_of(name: str, T: Numbers, count: int) -> Numbers:
    """RoboDK's numbers of the orientation of a pose."""
    return np.array(getattr(robomath, name)(robomath.Mat(T.tolist())))[-count:]


def rotations() -> Numbers:
    """Random ones, and those that are special to some convention."""
    axes = Rotation.from_euler(
        "zyx", np.mgrid[-180:181:90, -90:91:90, -180:181:90].reshape(3, -1).T, degrees=True
    )
    near = Rotation.from_euler("zyx", [[10, 89.9999, 20], [10, -89.9999, 20]], degrees=True)
    many = Rotation.random(300, random_state=7)
    return np.concatenate([r.as_matrix() for r in (many, axes, near)])


@pytest.mark.parametrize("maker", MAKERS)
def test_numbers_that_we_write_mean_the_same_rotation_to_robodk(maker: str) -> None:
    turn, pose_of, _ = MAKERS[maker]
    wanted = rotations()
    found = np.array([theirs(pose_of, numbers)[:3, :3] for numbers in turn.numbers(wanted)])
    np.testing.assert_allclose(found, wanted, atol=2e-14, rtol=0)


@pytest.mark.parametrize("maker", MAKERS)
def test_numbers_that_robodk_writes_mean_the_same_rotation_to_us(maker: str) -> None:
    turn, _, numbers_name = MAKERS[maker]
    # theirs lose digits near 0 and 180 deg, and at +-90 deg of the middle angle
    wanted = Rotation.random(300, random_state=8).as_matrix()
    poses = [transform(R, np.zeros(3)) for R in wanted]
    numbers = np.array([numbers_of(numbers_name, T, turn.count) for T in poses])
    most = 1e-7 if maker == "ur" else 1e-9
    np.testing.assert_allclose([turn.read(row) for row in numbers], wanted, atol=most, rtol=0)
    if turn.in_deg:
        np.testing.assert_allclose(turn.numbers(wanted), numbers, atol=1e-7, rtol=0)
