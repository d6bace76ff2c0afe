"""The frame of a joint may be described anywhere along its axis: the arm stays the same arm."""

from xml.etree import ElementTree

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot, corrected_urdf
from calib.model.measurements import TouchUp
from calib.model.parameters import LinkGeometry, TargetPoints, ToolPoint
from calib.se3 import transform

URDF = "ur_like.urdf"
LINKS = (  # origin, roll of each joint of an arm as UR builds them, all axes z
    ("0 0 0.16", 0.0),
    ("0 0 0", np.pi / 2),
    ("-0.42 0 0", 0.0),
    ("-0.39 0 0.13", 0.0),
    ("0 -0.1 0", np.pi / 2),
    ("0 0.1 0", -np.pi / 2),
)


def write_arm(folder, slid_m=(0.0, 0.0, 0.0)):
    """The arm with the frames of joints 2, 3 and 4 slid along their three parallel axes."""
    root = ElementTree.Element("robot", name="arm")
    ElementTree.SubElement(root, "link", name="base_link")
    along = (0.0, *slid_m, 0.0, 0.0, 0.0)
    before = "base_link"
    for j, (xyz, roll) in enumerate(LINKS):
        name = "tool0" if j == 5 else f"l{j + 1}"
        T = transform(np.eye(3), [0.0, 0.0, -along[j - 1] if j else 0.0])
        c, s = np.cos(roll), np.sin(roll)
        T = T @ transform([[1, 0, 0], [0, c, -s], [0, s, c]], np.array(xyz.split(), dtype=float))
        T = T @ transform(np.eye(3), [0.0, 0.0, along[j]])
        joint = ElementTree.SubElement(root, "joint", name=f"j{j + 1}", type="revolute")
        place = " ".join(map(repr, T[:3, 3].tolist()))
        ElementTree.SubElement(joint, "origin", xyz=place, rpy=f"{roll!r} 0 0")
        ElementTree.SubElement(joint, "parent", link=before)
        ElementTree.SubElement(joint, "child", link=name)
        ElementTree.SubElement(joint, "axis", xyz="0 0 1")
        ElementTree.SubElement(joint, "limit", lower="-3", upper="3", velocity="3", effort="1")
        link = ElementTree.SubElement(root, "link", name=name)
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=f"0.02 0 {0.03 - along[j]!r}")
        ElementTree.SubElement(inertial, "mass", value="2")
        six = {"ixx": "1", "iyy": "1", "izz": "1", "ixy": "0", "ixz": "0", "iyz": "0"}
        ElementTree.SubElement(inertial, "inertia", six)
        collision = ElementTree.SubElement(link, "collision")
        ElementTree.SubElement(collision, "origin", xyz=f"0.1 0 {-along[j]!r}")
        shape = ElementTree.SubElement(collision, "geometry")
        ElementTree.SubElement(shape, "sphere", radius="0.03")
        before = name
    path = folder / URDF
    ElementTree.ElementTree(root).write(path)
    return path


SLID = [(0.4, 0.4, 0.4), (0.0, 570.0, 60.0), (-300.0, 80.0, 2.0)]


@pytest.mark.parametrize("slid_m", SLID)
def test_frames_slid_along_parallel_axes_change_no_size(tmp_path, slid_m):
    near = Robot.from_urdf(write_arm(tmp_path))
    far = Robot.from_urdf(write_arm(tmp_path, slid_m))
    assert far.chain.reach_m == pytest.approx(near.chain.reach_m, abs=1e-9)
    q = np.random.default_rng(0).uniform(-3, 3, (500, 6))
    farthest = np.linalg.norm(near.fk(q)[:, :3, 3] - [0, 0, 0.16], axis=1).max()
    assert 0.9 * farthest < near.chain.reach_m < 1.3 * farthest


def test_the_reach_of_presets_is_the_sum_of_their_links():
    for name, reach_m in (("r2000ic165f", 2.795), ("irb120", 0.714), ("ur5e", 1.0165)):
        assert Robot.preset(name).chain.reach_m == pytest.approx(reach_m)


@pytest.mark.parametrize("slid_m", SLID[1:])
def test_frames_far_outside_the_arm_are_taken_at_the_arm(tmp_path, slid_m):
    near = Robot.from_urdf(write_arm(tmp_path))
    far = Robot.from_urdf(write_arm(tmp_path, slid_m))
    assert any("outside the arm" in said for said in far.notices)
    assert not any("outside the arm" in said for said in near.notices)
    assert np.abs(far.chain.placements[:, :3, 3]).max() < 2.5
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(far.fk(q), near.fk(q), atol=1e-9)
    for robot in (near, far):
        state = robot.state(q)
        R, p = state.rotations, state.origins
        com = (R @ robot.link_com[..., None])[..., 0] + p
        solids = [
            (R[:, b.link - 1] @ b.T_link_body[:3, 3]) + p[:, b.link - 1] for b in robot.bodies
        ]
        if robot is near:
            expected = com, solids
        else:
            np.testing.assert_allclose(com, expected[0], atol=1e-9)
            np.testing.assert_allclose(solids, expected[1], atol=1e-9)


def test_the_corrected_file_of_an_arm_with_frames_far_outside_is_the_corrected_arm(tmp_path):
    path = write_arm(tmp_path, (0.0, 570.0, 60.0))
    robot = Robot.from_urdf(path)
    names = ["link.j3.x", "link.j3.ry", "link.j4.rx", "link.j5.y"]
    tool, target = ToolPoint([0.0, 0.0, 0.1], free=""), TargetPoints([[0.5, 0.0, 0.3]])
    model = CalibrationModel(robot, [LinkGeometry(robot, names), tool, target], TouchUp(1e-5))
    off = dict(zip(names, (1e-3, 2e-3, -1e-3, 5e-4), strict=True))
    corrected = corrected_robot(model, [off.get(name, 0.0) for name in model.names])
    written = tmp_path / "corrected.urdf"
    written.write_bytes(corrected_urdf(corrected, path))
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(Robot.from_urdf(written).fk(q), corrected.robot.fk(q), atol=1e-9)
    assert np.abs(corrected.robot.fk(q) - robot.fk(q)).max() > 1e-4
