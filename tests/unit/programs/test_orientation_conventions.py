"""Every maker's orientation against RoboDK's library, which is written and used by others.

Rotations are compared, never angles: these are not unique at +-90 deg of the middle one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.se3 import (
    moving_xyz_from_rotation,
    quaternion_from_rotation,
    rotation_exp,
    rotation_from_moving_xyz,
    rotation_from_quaternion,
    rotation_from_wpr,
    rotation_log,
    transform,
    wpr_from_rotation,
)

robomath = pytest.importorskip("robodk.robomath", reason="robodk is RoboDK's own library")

Numbers = np.ndarray[Any, np.dtype[np.float64]]

DEG = np.pi / 180.0


def _wpr(numbers: Numbers) -> Numbers:
    return rotation_from_wpr(numbers * DEG)


def _wpr_of(rotations: Numbers) -> Numbers:
    return wpr_from_rotation(rotations) / DEG


# How each controller's three or four numbers become a rotation here and there, and back.
MAKERS: dict[str, tuple[Callable[..., Numbers], Callable[..., Numbers], str, str]] = {
    "fanuc": (_wpr, _wpr_of, "Fanuc_2_Pose", "Pose_2_Fanuc"),
    "yaskawa": (_wpr, _wpr_of, "Motoman_2_Pose", "Pose_2_Motoman"),
    "kuka": (
        lambda abc: _wpr(abc[..., ::-1]),
        lambda R: _wpr_of(R)[..., ::-1],
        "KUKA_2_Pose",
        "Pose_2_KUKA",
    ),
    "staubli": (
        lambda r: rotation_from_moving_xyz(r * DEG),
        lambda R: moving_xyz_from_rotation(R) / DEG,
        "Staubli_2_Pose",
        "Pose_2_Staubli",
    ),
    "ur": (rotation_exp, rotation_log, "UR_2_Pose", "Pose_2_UR"),
    "abb": (rotation_from_quaternion, quaternion_from_rotation, "quaternion_2_pose", "Pose_2_ABB"),
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
    _, ours_of, pose_of, _ = MAKERS[maker]
    wanted = rotations()
    found = np.array([theirs(pose_of, numbers)[:3, :3] for numbers in ours_of(wanted)])
    np.testing.assert_allclose(found, wanted, atol=2e-14, rtol=0)


@pytest.mark.parametrize("maker", MAKERS)
def test_numbers_that_robodk_writes_mean_the_same_rotation_to_us(maker: str) -> None:
    ours, _, _, numbers_name = MAKERS[maker]
    # theirs lose digits near 0 and 180 deg, and at +-90 deg of the middle angle
    wanted = Rotation.random(300, random_state=8).as_matrix()
    count = 4 if maker == "abb" else 3
    numbers = np.array([numbers_of(numbers_name, transform(R, np.zeros(3)), count) for R in wanted])
    np.testing.assert_allclose(ours(numbers), wanted, atol=1e-7 if maker == "ur" else 1e-9, rtol=0)


@pytest.mark.parametrize("maker", ["fanuc", "yaskawa", "kuka", "staubli"])
def test_angles_are_those_of_robodk_away_from_the_degenerate_ones(maker: str) -> None:
    ours, ours_of, pose_of, numbers_name = MAKERS[maker]
    angles = np.random.default_rng(9).uniform([-179, -89, -179], [179, 89, 179], (300, 3))
    poses = np.array([theirs(pose_of, a) for a in angles])
    np.testing.assert_allclose(ours(angles), poses[:, :3, :3], atol=2e-15, rtol=0)
    np.testing.assert_allclose(ours_of(poses[:, :3, :3]), angles, atol=1e-11, rtol=0)
    back = np.array([numbers_of(numbers_name, T, 3) for T in poses])
    np.testing.assert_allclose(back, angles, atol=1e-9, rtol=0)


def test_kuka_and_fanuc_have_the_same_angles_in_the_other_order() -> None:
    abc = np.array([30.0, 20.0, 10.0])
    np.testing.assert_allclose(theirs("KUKA_2_Pose", abc), theirs("Fanuc_2_Pose", abc[::-1]))
    assert not np.allclose(theirs("Staubli_2_Pose", abc), theirs("Fanuc_2_Pose", abc), atol=0.1)


def test_moving_angles_are_degenerate_at_a_right_angle_and_the_rotation_still_right() -> None:
    for sign in (-1.0, 1.0):
        R = rotation_from_moving_xyz(np.array([0.3, sign * np.pi / 2, 0.5]))
        angles = moving_xyz_from_rotation(R)
        assert angles[2] == 0.0
        np.testing.assert_allclose(rotation_from_moving_xyz(angles), R, atol=2e-15)
    half = moving_xyz_from_rotation(np.diag([1.0, -1.0, -1.0]))
    np.testing.assert_allclose(half, [np.pi, 0, 0], atol=1e-15)
