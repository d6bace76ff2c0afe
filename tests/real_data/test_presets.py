"""Presets against the public URDFs of the same arms: one can stand in for the other."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot

pytestmark = pytest.mark.real_data

URDFS = {
    "irb120": "irb120_3_58",
    "irb6700_200_260": "irb6700_200_260",
    "kr6r900sixx": "kr6r900sixx",
    "lrmate200id": "lrmate200id",
    "m20ia": "m20ia",
    "mh5": "mh5",
    "panda": "panda",
    "r2000ic165f": "r2000ic165f",
    "tx2_60": "tx2_60",
    "ur10e": "ur10e",
    "ur5e": "ur5e",
}
"""File of each preset's arm."""

ROUNDING = {"irb120": 5e-6, "m20ia": 1e-6, "mh5": 1e-4}
"""Where the file rounds limits [rad] and speeds [rad/s] of whole degrees; the others are exact.
MH5's are given with four decimals, and 184.6 deg with a digit too little."""

LEFT_OUT = {
    "irb6700_200_260": {"cylinder", "piston"},  # the balancer, which follows J2
    "panda": {f"panda_link{i}_sc" for i in range(8)},  # for the maker's own collision check
}
"""Links that presets do without."""

WITH_MASSES = ("irb120", "ur10e", "ur5e")

Pair = tuple[str, Robot, Robot, Path]


@pytest.fixture(scope="module", params=URDFS)
def pair(request, data_folder) -> Pair:
    """Name, the preset with the URDF's own tip, the robot of the URDF, and its file."""
    path = data_folder / "urdf" / f"{URDFS[request.param]}.urdf"
    if not path.exists():
        pytest.skip(f"{path} does not exist")
    robot = Robot.from_urdf(path)
    return request.param, Robot.preset(request.param, tip=robot.tip_frame), robot, path


def test_forward_kinematics(pair):
    _, preset, robot, _ = pair
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (1000, robot.n))
    np.testing.assert_allclose(preset.fk(q), robot.fk(q), atol=1e-9)
    np.testing.assert_allclose(preset.jacobian(q), robot.jacobian(q), atol=1e-9)


def test_names_limits_and_speeds(pair):
    name, preset, robot, _ = pair
    assert preset.joint_names == robot.joint_names
    assert preset.base_frame == robot.base_frame
    tolerance = ROUNDING.get(name, 1e-9)
    np.testing.assert_allclose(preset.lower, robot.lower, atol=tolerance, rtol=0)
    np.testing.assert_allclose(preset.upper, robot.upper, atol=tolerance, rtol=0)
    np.testing.assert_allclose(preset.speed, robot.speed, atol=tolerance, rtol=0)


def test_every_link_of_the_file_is_there(pair):
    name, preset, robot, path = pair
    links, here = (
        {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
        for model in (robot.model, preset.model)
    )
    assert links - here == LEFT_OUT.get(name, set())
    q = np.random.default_rng(3).uniform(robot.lower, robot.upper, (10, robot.n))
    for link in {"base", "flange", "tool0"} & links:  # fixed frames, beside the tip
        if link == "base":
            ours = Robot.preset(name, tip=robot.tip_frame, base=link)
            theirs = Robot.from_urdf(path, base=link)
        else:
            ours, theirs = Robot.preset(name, tip=link), Robot.from_urdf(path, tip=link)
        np.testing.assert_allclose(ours.fk(q), theirs.fk(q), atol=1e-9, err_msg=link)


def test_masses(pair):
    name, preset, robot, _ = pair
    if name in WITH_MASSES:
        np.testing.assert_allclose(preset.link_mass, robot.link_mass, atol=1e-12)
        np.testing.assert_allclose(preset.link_com, robot.link_com, atol=1e-12)
    else:  # those of the R-2000iC are assumed, those of the Panda were identified by others
        assert not robot.link_mass.any()
        assert preset.link_mass.any() == (name in {"r2000ic165f", "panda"})


def test_the_tool_frame_of_ours_points_out_of_the_face(data_folder):
    """MH5 has no tool0 in its file: ours sits where its last link is, z along that one's x."""
    path = data_folder / "urdf" / "mh5.urdf"
    if not path.exists():
        pytest.skip(f"{path} does not exist")
    preset, robot = Robot.preset("mh5"), Robot.from_urdf(path)
    assert (preset.tip_frame, robot.tip_frame) == ("tool0", "link_t")
    q = np.random.default_rng(4).uniform(robot.lower, robot.upper, (10, 6))
    ours, theirs = preset.fk(q), robot.fk(q)
    np.testing.assert_allclose(ours[:, :3, 3], theirs[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(ours[:, :3, 2], theirs[:, :3, 0], atol=1e-12)
