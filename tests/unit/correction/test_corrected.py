"""The identified robot as a chain, and as a URDF."""

import pickle
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot, corrected_urdf
from calib.errors import InputError, RobotModelError
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    BearingCompliance,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    Part,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
    gravity_torque,
)
from calib.robots import Controller, preset_names
from calib.robots.robot import with_placements
from calib.robots.urdf_anew import rpy_of
from calib.se3 import rotation_exp, rotation_from_wpr

TARGET = TargetPoints([[1.0, 0.0, 0.5]])
SIGMA_M = 1e-5


def model_of(robot: Robot, *blocks: ParameterBlock) -> CalibrationModel:
    tool = ToolPoint([0.01, 0.02, 0.1])
    return CalibrationModel(robot, [*blocks, tool, TARGET], TouchUp(SIGMA_M))


def geometry_of(robot: Robot) -> CalibrationModel:
    return model_of(robot, LinkGeometry(robot), ZeroOffsets(robot, robot.joint_names))


def random_values(model: CalibrationModel, rng: np.random.Generator) -> np.ndarray:
    """Parameters off by 3 mm and half a degree."""
    size = np.array([3e-3 if unit == "m" else 1e-2 for unit in model.units])
    return model.nominal + size * rng.uniform(-1, 1, model.p)


def postures_of(robot: Robot, count: int = 50, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, robot.n))


def assert_stands_as(robot: Robot, model: CalibrationModel, x: np.ndarray) -> None:
    """Robot and model have their tips at the same poses."""
    q = postures_of(model.robot)
    np.testing.assert_allclose(robot.fk(q), model.view(q, x).T_base_tip, atol=1e-12)


@pytest.mark.parametrize("name", preset_names())
def test_chain_is_the_model(name):
    model = geometry_of(Robot.preset(name))
    x = random_values(model, np.random.default_rng(0))
    found = corrected_robot(model, x)
    q = postures_of(model.robot)
    assert np.abs(found.robot.fk(q) - model.robot.fk(q)).max() > 1e-3
    assert_stands_as(found.robot, model, x)
    assert found.left_out == ()
    assert found.moved == model.robot.joint_names


@pytest.mark.parametrize(("n", "slides"), [(1, 0), (3, 0), (6, 0), (7, 0), (8, 2)])
def test_chain_is_the_model_of_random_arms(random_urdf, n, slides):
    rng = np.random.default_rng(n)
    model = geometry_of(Robot.from_urdf(random_urdf(rng, n, slides)))
    x = random_values(model, rng)
    q = postures_of(model.robot)
    corrected = corrected_robot(model, x).robot
    np.testing.assert_allclose(corrected.fk(q), model.view(q, x).T_base_tip, atol=1e-12)
    # the model behind it holds the same
    from calib.robots.model_chain import chain_of, frame_id, joints_between

    base, tip = (frame_id(corrected.model, f) for f in (corrected.base_frame, corrected.tip_frame))
    chain = chain_of(corrected.model, joints_between(corrected.model, base, tip), base, tip)
    np.testing.assert_allclose(chain.placements, corrected.chain.placements, atol=1e-14)


def test_a_part_of_a_block_and_values_held_are_in_the_chain(reference_robot):
    part = Part(LinkGeometry(reference_robot), ["link.joint_3.x", "link.joint_4.rz"])
    model = model_of(reference_robot, part, ZeroOffsets(reference_robot, ["joint_2"]))
    x = model.nominal + np.array([1e-3, 2e-3, 3e-3, 0, 0, 0, 0, 0, 0])
    found = corrected_robot(model, x)
    assert_stands_as(found.robot, model, x)
    assert found.moved == ("joint_2", "joint_3", "joint_4")


def test_what_no_chain_can_hold_is_named(reference_robot):
    robot, joints = reference_robot, ["joint_2", "joint_3"]
    blocks = {
        "compliance of joints": JointCompliance(robot, joints),
        "compliance of bearings": BearingCompliance(robot, joints),
        "harmonics of transmissions": JointHarmonics(robot, joints),
        "scale of joint values": JointScale(robot, joints),
        "lost motion": LostMotion(robot, joints, 100.0),
    }
    model = model_of(robot, ZeroOffsets(robot, joints), *blocks.values())
    x = model.nominal + 1e-6
    found = corrected_robot(model, x)
    assert len(found.left_out) == len(blocks)
    for said, (words, block) in zip(found.left_out, blocks.items(), strict=True):
        assert said == f"{words} ({', '.join(block.names)})"
    # the chain is what is left without them
    bare = model_of(robot, ZeroOffsets(robot, joints))
    values = np.concatenate([x[:2], x[-6:]])
    q = postures_of(robot)
    np.testing.assert_allclose(found.robot.fk(q), bare.view(q, values).T_base_tip, atol=1e-12)


def test_what_is_identified_as_nothing_is_not_named(reference_robot):
    model = model_of(reference_robot, JointCompliance(reference_robot, ["joint_2"]))
    assert corrected_robot(model, model.nominal).left_out == ()
    assert corrected_robot(model, model.nominal).moved == ()


class Unheard(ParameterBlock):
    """A block whose author has not thought of chains."""

    names, units, prior = ("unheard",), ("rad",), np.array([np.inf])

    @property
    def nominal(self):
        return np.zeros(1)

    def displace(self, values, errors, q, setup):
        errors.joints = errors.joints + values * np.sin(q)

    def move(self, values, view, out):
        raise NotImplementedError


def test_a_block_that_says_nothing_is_not_taken_for_a_chain(reference_robot):
    model = model_of(reference_robot, Unheard())
    found = corrected_robot(model, model.nominal + 1e-3)
    assert found.left_out == ("errors that change from posture to posture (unheard)",)
    assert found.moved == ()


def test_corrected_robot_does_what_robots_do():
    robot = Robot.preset("r2000ic165f")
    model = geometry_of(robot)
    corrected = corrected_robot(model, random_values(model, np.random.default_rng(3))).robot
    q = postures_of(corrected, 20)
    q[:, 4] = np.copysign(np.maximum(np.abs(q[:, 4]), 0.2), q[:, 4])
    q = q[[not any(limit.margin(row) < 0 for limit in robot.coupled_limits) for row in q]]
    answers = corrected.inverse(corrected.fk(q))
    assert set(answers.pose[answers.inside]) == set(range(len(q)))
    closed = corrected.fk(answers.postures) - corrected.fk(q)[answers.pose]
    assert np.abs(closed).max() < 1e-9
    for i, row in enumerate(q):  # each posture is among its answers, full turns aside
        apart = np.remainder(answers.of(i) - row + np.pi, 2 * np.pi) - np.pi
        assert np.abs(apart).max(axis=1).min() < 1e-6
    for key in ("lower", "upper", "speed", "link_mass", "link_com", "gravity", "stiffness"):
        np.testing.assert_array_equal(getattr(corrected, key), getattr(robot, key))
    assert corrected.joint_names == robot.joint_names
    assert corrected.coupled_limits == robot.coupled_limits
    assert isinstance(corrected.controller, Controller)
    torque, before = gravity_torque(corrected, q), gravity_torque(robot, q)
    assert 0 < np.abs(torque - before).max() < 0.02 * np.abs(before).max()
    again = pickle.loads(pickle.dumps(corrected))  # noqa: S301
    np.testing.assert_array_equal(again.fk(q), corrected.fk(q))
    # the robot it was made from is as it was
    np.testing.assert_array_equal(robot.fk(q), Robot.preset("r2000ic165f").fk(q))


@pytest.mark.parametrize("bad", [np.zeros(3), np.full(6, np.nan), np.zeros((2, 6))])
def test_values_that_are_not_one_set_are_refused(reference_robot, bad):
    with pytest.raises(InputError, match=r"values|finite"):
        corrected_robot(model_of(reference_robot), bad)


def test_placements_of_another_number_of_joints_are_refused(reference_robot):
    with pytest.raises(InputError, match="6 joints"):
        with_placements(reference_robot, np.eye(4)[None])


# URDF -------------------------------------------------------------------------------------------


def assert_reads_back(folder: Path, model: CalibrationModel, x: np.ndarray, *source: Path) -> Robot:
    """The URDF of the corrected robot, from a file or not, is that robot; and what was read."""
    content = corrected_urdf(corrected_robot(model, x), *source)
    again = read_back(content, folder, model.robot)
    assert_stands_as(again, model, x)
    return again


def read_back(content: bytes, folder: Path, robot: Robot, **options) -> Robot:
    path = folder / "corrected.urdf"
    path.write_bytes(content)
    return Robot.from_urdf(path, tip=robot.tip_frame, base=robot.base_frame, **options)


@pytest.mark.parametrize("name", preset_names())
def test_urdf_of_a_preset_reads_back(name, tmp_path):
    robot = Robot.preset(name)
    model = geometry_of(robot)
    x = random_values(model, np.random.default_rng(5))
    corrected = corrected_robot(model, x)
    again = read_back(corrected_urdf(corrected), tmp_path, robot)
    assert_stands_as(again, model, x)
    for key in ("lower", "upper", "speed", "link_mass"):
        np.testing.assert_array_equal(getattr(again, key), getattr(robot, key))
    q = postures_of(robot)
    torque = gravity_torque(corrected.robot, q)
    np.testing.assert_allclose(gravity_torque(again, q), torque, atol=1e-9)
    assert again.joint_names == robot.joint_names
    assert again.name == robot.name


@pytest.mark.parametrize("name", preset_names())
def test_the_controller_of_a_corrected_urdf_is_known(name, tmp_path):
    robot = Robot.preset(name)
    model = model_of(robot, ZeroOffsets(robot, robot.joint_names))
    x = model.nominal.copy()
    x[: robot.n] = np.deg2rad(0.3) * (-1.0) ** np.arange(robot.n)
    x[1:3] = np.deg2rad(0.5)
    again = read_back(corrected_urdf(corrected_robot(model, x)), tmp_path, robot)
    shown = again.controlled_by(robot.controller.maker).controller
    np.testing.assert_array_equal(shown.pendant_from_joints, robot.controller.pendant_from_joints)


def test_urdf_of_a_part_of_a_preset_reads_back(tmp_path):
    robot = Robot.preset("r2000ic165f", tip="link_4", base="link_1")
    model = geometry_of(robot)
    x = random_values(model, np.random.default_rng(6))
    assert_reads_back(tmp_path, model, x)


@pytest.mark.parametrize("n", [1, 4, 6, 7])
def test_urdf_of_a_file_reads_back(random_urdf, tmp_path, n):
    rng = np.random.default_rng(n)
    source = random_urdf(rng, n)
    before = source.read_bytes()
    model = geometry_of(Robot.from_urdf(source))
    x = random_values(model, rng)
    again = assert_reads_back(tmp_path, model, x, source)
    np.testing.assert_array_equal(again.link_com, model.robot.link_com)
    assert source.read_bytes() == before


FILE = """<?xml version='1.0' encoding='ISO-8859-1'?>
<!-- Grüße; <joint name="a1"><origin xyz="9 9 9"/></joint> -->
<robot name="small">
  <gazebo><joint name="a1"><origin xyz="8 8 8"/></joint></gazebo>
  <link name="l0"><visual><origin xyz="1 2 3"/><geometry><mesh filename="m.stl"/></geometry>
  </visual></link>
  <joint   type='revolute'  name = 'a1' >
    <parent link="l0"/><child link="l1"/>
    <calibration rising="0.0"/><!-- <origin xyz="7 7 7"/> -->
    <origin  note="a > b 'xyz=1'"   rpy='0.1 0 0'
       />
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="3" effort="0"/>
  </joint>
  <link name="l1"/>
  <joint name="a2" type="revolute"><parent link="l1"/><child link="l2"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="0"/></joint>
  <link name="l2"/>
  <joint name="a3" type="revolute"><parent link="l2"/><child link="l3"/>
    <origin xyz="0 0 0.5" rpy="0 0 0"></origin>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="0"/></joint>
  <link name="l3"/>
  <joint name="m" type="fixed"><parent link="l3"/><child link="tool0"/><origin xyz="0 0 1"/></joint>
  <link name="tool0"/>
</robot>
""".encode("latin-1")


@pytest.fixture
def source(tmp_path) -> Path:
    path = tmp_path / "in.urdf"
    path.write_bytes(FILE)
    return path


def test_only_origins_of_moved_joints_change_in_a_file(tmp_path, source):
    robot = Robot.from_urdf(source)
    model = model_of(robot, ZeroOffsets(robot, ["a1", "a2"]))
    x = model.nominal.copy()
    x[:2] = 0.01, -0.02
    content = corrected_urdf(corrected_robot(model, x), source)
    again = read_back(content, tmp_path, robot)
    assert_stands_as(again, model, x)
    lines, new = FILE.splitlines(), content.splitlines()
    head = new.pop(2)
    assert head.startswith(b"<!-- Joint origins as identified")
    assert head.endswith(b"-->")
    changed = [i for i, (a, b) in enumerate(zip(lines, new, strict=True)) if a != b]
    assert changed == [9, 14]
    assert b"note=\"a > b 'xyz=1'\"" in new[9]
    added = new[14].replace(b"<parent", b"\n<parent").splitlines()
    assert added[0].startswith(b'  <joint name="a2" type="revolute"><origin xyz=')
    assert lines[14].endswith(added[1])


def test_a_quaternion_gives_way_to_roll_pitch_and_yaw(tmp_path):
    source = tmp_path / "in.urdf"
    text = FILE.replace(b"rpy='0.1 0 0'", b"quat_xyzw='0.1 0 0 0.9'")
    source.write_bytes(text.replace(b'name="small"', b'name="small" version="1.1"'))
    robot = Robot.from_urdf(source)
    model = model_of(robot, ZeroOffsets(robot, ["a1"]))
    x = model.nominal.copy()
    x[0] = 0.01
    content = corrected_urdf(corrected_robot(model, x), source)
    assert b"quat_xyzw" not in content
    assert_stands_as(read_back(content, tmp_path, robot), model, x)


def test_a_name_space_is_kept(tmp_path):
    text = FILE.decode("latin-1").replace("<?xml version='1.0' encoding='ISO-8859-1'?>", "")
    for tag in ("robot", "joint", "link", "parent", "child", "axis", "limit", "origin"):
        text = text.replace(f"<{tag}", f"<u:{tag}").replace(f"</{tag}", f"</u:{tag}")
    text = text.replace("<u:robot", '<u:robot xmlns:u="urdf"')
    for tag in ("gazebo", "visual", "geometry", "mesh", "calibration"):
        text = text.replace(f"<{tag}", f"<u:{tag}").replace(f"</{tag}", f"</u:{tag}")
    source = tmp_path / "in.urdf"
    source.write_text(text, encoding="utf-8-sig")
    robot = Robot.from_urdf(source)
    model = geometry_of(robot)
    x = random_values(model, np.random.default_rng(0))
    assert_reads_back(tmp_path, model, x, source)


def test_a_hostile_name_cannot_leave_the_comment(tmp_path):
    name = "a1 --&gt;&lt;joint name='x'/&gt;&lt;!-- --"
    source = tmp_path / "in.urdf"
    source.write_bytes(FILE.replace(b"'a1'", f'"{name}"'.encode()))
    robot = Robot.from_urdf(source)
    model = model_of(robot, JointHarmonics(robot, robot.joint_names))
    corrected = corrected_robot(model, model.nominal + 1e-3)
    for content in (corrected_urdf(corrected, source), corrected_urdf(corrected)):
        comment = content[content.index(b"<!-- Joint") + 4 :].split(b">", 1)[0]
        assert b"harmonic.a1" in comment or b"--" not in comment[:-2]
        joints = [joint.get("name") for joint in fromstring(content).findall("joint")]  # noqa: S314
        assert len(joints) == 4


def test_a_file_without_the_joint_is_refused(tmp_path, source, reference_robot):
    model = model_of(reference_robot, ZeroOffsets(reference_robot, ["joint_2"]))
    with pytest.raises(RobotModelError, match="joint_2"):
        corrected_urdf(corrected_robot(model, model.nominal + 0.01), source)
    with pytest.raises(RobotModelError, match="cannot be read"):
        corrected_urdf(corrected_robot(model, model.nominal), tmp_path / "none.urdf")


def test_an_encoding_without_ascii_is_refused(tmp_path):
    source = tmp_path / "in.urdf"
    text = FILE.decode("latin-1").replace("ISO-8859-1", "UTF-16")
    source.write_bytes(text.encode("utf-16"))
    robot = Robot.from_urdf(source)
    model = geometry_of(robot)
    with pytest.raises(RobotModelError, match="encoding"):
        corrected_urdf(corrected_robot(model, model.nominal + 1e-3), source)


@given(
    st.tuples(*[st.floats(-np.pi, np.pi)] * 3),
    st.sampled_from([0.0, 1e-16, 1e-12, 1e-10, 1e-9, 1e-7, 1e-3]),
    st.booleans(),
)
def test_roll_pitch_yaw_give_back_the_rotation(wpr, off, gimbal):
    angles = (wpr[0], np.pi / 2 - off if gimbal else wpr[1], wpr[2])
    R = rotation_from_wpr(angles) @ rotation_exp([off, -off, off])
    np.testing.assert_allclose(rotation_from_wpr(rpy_of(R)), R, atol=1e-14)


def test_a_nominal_robot_writes_a_file_of_itself(tmp_path, reference_robot):
    model = model_of(replace(reference_robot))
    source = corrected_urdf(corrected_robot(model, model.nominal))
    again = read_back(source, tmp_path, reference_robot)
    q = postures_of(again)
    np.testing.assert_allclose(again.fk(q), reference_robot.fk(q), atol=1e-13)


def test_a_xacro_is_written_as_the_urdf_that_it_expands_to(tmp_path):
    pytest.importorskip("xacro", reason="needs xacro (posedesign[xacro])")
    text = FILE.decode("latin-1").replace("ISO-8859-1", "utf-8")
    text = text.replace('xyz="0 0 1"', 'xyz="${h} 0 1"')
    text = text.replace(
        '<robot name="small">',
        '<robot name="small" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:property name="h" value="${0.5 / 2}"/>',
    )
    source = tmp_path / "small.urdf.xacro"
    source.write_text(text, encoding="utf-8")
    robot = Robot.from_urdf(source)
    assert robot.chain.T_link_tip[0, 3] == 0.25
    model = geometry_of(robot)
    x = random_values(model, np.random.default_rng(0))
    content = corrected_urdf(corrected_robot(model, x), source)
    assert b"xacro:property" not in content
    again = read_back(content, tmp_path, robot)
    assert_stands_as(again, model, x)
