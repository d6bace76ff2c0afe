"""URDF files of every kind: what is read otherwise is said, what is broken is named."""

import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot
from calib.errors import RobotModelError
from calib.robots.description import urdf
from calib.se3 import rotation_from_quaternion
from tests.arms import missed

LIMIT = '<limit lower="-1" upper="1.5" velocity="2" effort="1"/>'


def link(name: str, inside: str = "") -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(
    name, parent, child, kind="revolute", *, axis='<axis xyz="0 0 1"/>', limit=LIMIT, more=""
):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.3" rpy="0 0.2 0"/>{axis}{limit}{more}</joint>'
    )


def inertial(mass: str = '<mass value="3"/>', origin: str = "") -> str:
    return (
        f"<inertial>{origin}{mass}"
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    )


ABC = link("a") + link("b") + link("c")
J1, J2 = joint("j1", "a", "b"), joint("j2", "b", "c")


@pytest.fixture
def read(tmp_path, capfd):
    """Read the inside of a <robot>, or a whole file, and see that nothing is printed."""

    def call(text: str | bytes, **frames: str) -> Robot:
        path = tmp_path / "arm.urdf"
        if isinstance(text, str) and not text.startswith("<?"):
            text = f'<robot name="arm">{text}</robot>'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        try:
            return Robot.from_urdf(path, **frames)
        finally:
            assert capfd.readouterr() == ("", "")

    return call


def test_plain(read):
    robot = read(ABC + J1 + J2)
    assert robot.joint_names == ("j1", "j2")
    assert robot.notices == ("tip taken to be c, the last link of the longest chain",)
    np.testing.assert_array_equal(robot.lower, [-1, -1])
    np.testing.assert_array_equal(robot.upper, [1.5, 1.5])
    np.testing.assert_array_equal(robot.link_mass, [0, 0])
    assert np.isinf(robot.stiffness).all()


@pytest.mark.parametrize("tip", ["flange", "tool0"])
def test_usual_tips_are_taken_without_a_word(read, tip):
    frames = link("flange") + joint("mount", "c", "flange", "fixed")
    if tip == "tool0":
        frames += link("tool0") + joint("face", "flange", "tool0", "fixed")
    robot = read(ABC + J1 + J2 + frames)
    assert robot.tip_frame == tip
    assert robot.notices == ()


def test_missing_speed_is_said_and_unknown(read):
    robot = read(ABC + J1 + joint("j2", "b", "c", limit='<limit lower="-1" upper="1"/>'), tip="c")
    assert robot.notices == ("no speed given for j2",)
    np.testing.assert_array_equal(robot.speed, [2.0, np.nan])


def test_continuous_joints_turn_once_each_way(read):
    wheel = read(ABC + J1 + joint("j2", "b", "c", "continuous", limit=""), tip="c")
    assert wheel.notices[0] == "continuous joint j2 is read as one of +-360 deg"
    np.testing.assert_allclose(wheel.upper, [1.5, 2 * np.pi])
    np.testing.assert_allclose(wheel.lower, [-1, -2 * np.pi])
    plain = read(ABC + J1 + J2, tip="c")
    q = np.random.default_rng(0).uniform(-6, 6, (20, 2))
    np.testing.assert_allclose(wheel.fk(q), plain.fk(q), atol=1e-14)


def test_passive_joints_are_locked_at_zero_and_said(read):
    side = link("rod") + joint("piston", "b", "rod")
    robot = read(ABC + side + J1 + J2, tip="c")
    assert robot.joint_names == ("j1", "j2")
    assert robot.notices == ("locked at zero, not between base and tip: piston",)
    np.testing.assert_allclose(
        robot.fk([0.3, 0.4]), read(ABC + J1 + J2, tip="c").fk([0.3, 0.4]), atol=1e-15
    )


def test_the_axis_needs_no_unit_length(read):
    q = [0.3, 0.4]
    expected = read(ABC + J1 + joint("j2", "b", "c", axis='<axis xyz="0.6 0 -0.8"/>')).fk(q)
    long = read(ABC + J1 + joint("j2", "b", "c", axis='<axis xyz="30 0 -40"/>')).fk(q)
    np.testing.assert_allclose(long, expected, atol=1e-15)


def test_masses_of_fixed_and_locked_links_count_for_the_joint_that_carries_them(read):
    arm = link("a") + link("b", inertial()) + link("c", inertial(origin='<origin xyz="0.1 0 0"/>'))
    extra = link("box", inertial('<mass value="5"/>')) + joint("weld", "c", "box", "fixed")
    flap = link("flap", inertial('<mass value="7"/>')) + joint("hinge", "b", "flap")
    robot = read(arm + extra + flap + J1 + J2, tip="c")
    np.testing.assert_allclose(robot.link_mass, [3 + 7, 3 + 5])
    box = (3 * np.array([0.1, 0, 0]) + 5 * np.array([0.1, 0, 0.3])) / 8
    np.testing.assert_allclose(robot.link_com[1], box, atol=1e-15)


def test_a_robot_without_name_is_named_after_its_file(read):
    body = f"<robot>{ABC}{J1}{J2}</robot>"
    assert read(f'<?xml version="1.0"?>{body}').name == "arm"


def test_visual_geometry_is_not_read(read):
    mesh = '<visual><geometry><mesh filename="package://none/none.dae"/></geometry></visual>'
    robot = read(link("a", mesh) + link("b") + link("c") + J1 + J2, tip="c")
    assert (robot.notices, robot.bodies) == ((), ())


def test_what_is_not_kinematics_is_passed_over(read):
    around = (
        '<transmission name="t"><joint name="j1"/></transmission>'
        '<gazebo reference="b"><plugin filename="x"/></gazebo>'
        '<material name="m"><color rgba="x"/></material>' + "<g>" * 3000 + "</g>" * 3000
    )
    more = (
        '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="0.5" k_velocity="x"/>'
        '<dynamics friction="x"/><calibration rising="x"/>'
    )
    robot = read(ABC + around + joint("j1", "a", "b", more=more) + J2, tip="c")
    np.testing.assert_array_equal(robot.upper, [1.5, 1.5])
    assert robot.notices == ()


def test_elements_may_have_a_name_space(read):
    robot = read(f'<?xml version="1.0"?><robot name="r" xmlns="http://x.org">{ABC}{J1}{J2}</robot>')
    assert robot.joint_names == ("j1", "j2")


def test_line_breaks_in_the_name_of_the_robot_do_not_break_lines(read):
    robot = read(f'<?xml version="1.0"?><robot name="a&#10;b">{ABC}{J1}{J2}</robot>')
    assert robot.name == "a b"


def test_the_speed_of_a_continuous_joint_is_kept(read):
    wheel = read(ABC + J1 + joint("j2", "b", "c", "continuous"), tip="c")
    np.testing.assert_array_equal(wheel.speed, [2.0, 2.0])


def test_a_model_without_a_root_link_needs_one():
    """The first frame of a model need not be its root."""
    model = pin.buildSampleModelManipulator()
    with pytest.raises(RobotModelError, match="has no link that its first joint hangs on"):
        Robot.from_model(model)
    root = pin.Frame("root", 0, 0, pin.SE3.Identity(), pin.FrameType.BODY)
    model.addFrame(root)
    robot = Robot.from_model(model)
    assert robot.base_frame == "root"
    assert robot.n == model.njoints - 1


def test_a_model_that_pinocchio_refuses(read, monkeypatch):
    def refuse(_):
        raise ValueError("no\nway")

    monkeypatch.setattr(urdf.pin, "buildModelFromXML", refuse)
    with pytest.raises(RobotModelError, match="Pinocchio cannot build a model of it: no "):
        read(ABC + J1 + J2)


BROKEN = {
    "entity": (
        '<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY x "lol"><!ENTITY y "&x;&x;&x;">]>'
        '<robot name="&y;"/>',
        "document types and entities are not accepted",
        "arm.urdf",
    ),
    "doctype": (
        '<?xml version="1.0"?><!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot name="r"/>',
        "document types and entities are not accepted",
        "arm.urdf",
    ),
    "no XML": ("<?no", "is not well-formed XML", "arm.urdf"),
    "binary": (bytes(range(256)), "is not well-formed XML", "arm.urdf"),
    "empty": (b"", "is not well-formed XML: no element found", "arm.urdf"),
    "encoding": (
        b'<?xml version="1.0" encoding="klingon"?><robot/>',
        "is not well-formed XML: unknown encoding: klingon",
        "arm.urdf",
    ),
    "multi-byte": (
        b'<?xml version="1.0" encoding="shift_jis"?><robot/>',
        "is not well-formed XML: multi-byte encodings",
        "arm.urdf",
    ),
    "root": ('<?xml version="1.0"?><sdf/>', "outermost element is <sdf>, not <robot>", "arm.urdf"),
    "xacro": (
        '<?xml version="1.0"?><robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:include filename="x"/></robot>',
        r"xacro cannot be expanded: cannot be read: .* No such file or directory: '.*/x'",
        "arm.urdf",
    ),
    "xacro value": (
        ABC + J1 + J2.replace("0.1 0 0.3", "${length} 0 0"),
        "joint 'j2' has origin xyz='\\${length} 0 0', not three finite numbers",
        "j2",
    ),
    "no links": ("", "has no links", "arm.urdf"),
    "many links": (
        ABC + J1 + J2 + "".join(link(f"l{i}") for i in range(998)),
        "has 1001 links, more than 1000",
        "arm.urdf",
    ),
    "far": (
        ABC + J1 + J2.replace("0.1 0 0.3", "0 0 200000"),
        r"joint 'j2' has origin xyz='0 0 200000', beyond 100000 m",
        "j2",
    ),
    "millimetres": (
        ABC + J1 + J2 + link("d") + joint("j3", "c", "d").replace("0.1 0 0.3", "425 0 0"),
        "arm: reaches 501 m from its second joint to d",
        "d",
    ),
    "no turns": (
        ABC + J1 + joint("j2", "b", "c", limit='<limit lower="-1e16" upper="1e16"/>'),
        "joint 'j2' has limits -1e\\+16 to 1e\\+16, more than a hundred turns",
        "j2",
    ),
    "limits in degrees": (
        ABC + J1 + joint("j2", "b", "c", limit='<limit lower="-90" upper="170" velocity="2"/>'),
        r"j2: limits -90 to 170 rad are -5157 to 9740 deg, more than 4 turns \(were they typed in "
        r"degrees\? a URDF has radians: -1.571 to 2.967;",
        "j2",
    ),
    "unnamed link": (ABC + J1 + J2 + "<link/>", "link '' has no name in one line", ""),
    "a name of two lines": (
        ABC + J1 + joint("j&#10;2", "b", "c"),
        r"joint 'j\\n2' has no name in one line",
        "j\n2",
    ),
    "a long value": (
        ABC + J1 + J2.replace("0.1 0 0.3", "1 " * 500),
        r"joint 'j2' has origin xyz='(1 )+1\.\.\.', not three",
        "j2",
    ),
    "heavy": (
        link("a") + link("b", inertial('<mass value="1e300"/>')) + link("c") + J1 + J2,
        "link 'b' has inertial mass value='1e300'",
        "b",
    ),
    "no limit": (ABC + J1 + joint("j2", "b", "c", limit=""), "joint 'j2' has no <limit>", "j2"),
    "reversed limits": (
        ABC + J1 + joint("j2", "b", "c", limit='<limit lower="1" upper="-2" velocity="1"/>'),
        "joint 'j2' has its limits reversed: lower 1 is above upper -2",
        "j2",
    ),
    "NaN limit": (
        ABC + J1 + joint("j2", "b", "c", limit='<limit lower="nan" upper="2" velocity="1"/>'),
        "joint 'j2' has limit lower='nan', not a finite number",
        "j2",
    ),
    "infinite limit": (
        ABC + J1 + joint("j2", "b", "c", limit='<limit lower="-1" upper="inf" velocity="1"/>'),
        "joint 'j2' has limit upper='inf', not a finite number",
        "j2",
    ),
    "comma": (
        ABC + J1 + joint("j2", "b", "c", limit='<limit lower="-1,5" upper="2" velocity="1"/>'),
        "joint 'j2' has limit lower='-1,5'",
        "j2",
    ),
    "zero axis": (
        ABC + J1 + joint("j2", "b", "c", axis='<axis xyz="0 0 0"/>'),
        "joint 'j2' has an axis of length zero",
        "j2",
    ),
    "axis without direction": (
        ABC + J1 + joint("j2", "b", "c", axis="<axis/>"),
        "joint 'j2' has an axis of length zero",
        "j2",
    ),
    "short axis": (
        ABC + J1 + joint("j2", "b", "c", axis='<axis xyz="0 1"/>'),
        "joint 'j2' has axis xyz='0 1', not three finite numbers",
        "j2",
    ),
    "unnamed joint": (ABC + J1 + joint("", "b", "c"), "joint '' has no name in one line", ""),
    "type": (
        ABC + J1 + joint("j2", "b", "c", "revolut"),
        r"joint 'j2' has the unknown type 'revolut' \(did you mean revolute",
        "j2",
    ),
    "no parent": (
        ABC + J1 + J2.replace('<parent link="b"/>', ""),
        "joint 'j2' has no <parent link=...>",
        "j2",
    ),
    "unknown link": (ABC + J1 + joint("j2", "b", "d"), "joint 'j2' names a missing link 'd'", "d"),
    "two parents": (
        ABC + link("d") + J1 + J2 + joint("j3", "d", "c"),
        "link 'c' has two parents",
        "c",
    ),
    "two roots": (ABC + J1, r"has 2 root links \(a, c\), not one", "arm.urdf"),
    "ring": (
        ABC + link("d") + J1 + joint("j2", "c", "d") + joint("j3", "d", "c"),
        "link 'c' hangs on itself",
        "c",
    ),
    "all in a ring": (ABC + J1 + J2 + joint("j3", "c", "a"), "has 0 root links", "arm.urdf"),
    "link twice": (ABC + link("b") + J1 + J2, "link 'b' is defined twice", "b"),
    "joint twice": (ABC + J1 + joint("j1", "b", "c"), "joint 'j1' is defined twice", "j1"),
    "mass": (
        link("a") + link("b", inertial('<mass value="x"/>')) + link("c") + J1 + J2,
        "link 'b' has inertial mass value='x'",
        "b",
    ),
    "negative mass": (
        link("a") + link("b", inertial('<mass value="-3"/>')) + link("c") + J1 + J2,
        "link 'b' has inertial mass value='-3'",
        "b",
    ),
    "no mass": (
        link("a") + link("b", inertial("")) + link("c") + J1 + J2,
        "link 'b' has inertial mass value=None",
        "b",
    ),
    "centre of mass": (
        link("a") + link("b", inertial(origin='<origin xyz="1 2"/>')) + link("c") + J1 + J2,
        "link 'b' has inertial origin xyz='1 2'",
        "b",
    ),
    "floating": (
        ABC + J1 + joint("j2", "b", "c", "floating"),
        "joint j2 is neither revolute nor prismatic",
        "j2",
    ),
    "mimic": (
        ABC + J1 + joint("j2", "b", "c", more='<mimic joint="far" multiplier="2"/>'),
        r"joint 'j2' follows another joint \(mimic\)",
        "j2",
    ),
    "no moving joint": (
        link("a") + link("b") + joint("weld", "a", "b", "fixed"),
        "there is no moving joint between a and b",
        "b",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_broken_is_named(read, case):
    text, message, name = BROKEN[case]
    with pytest.raises(RobotModelError, match=message) as caught:
        read(text)
    assert Path(caught.value.name).name == name
    assert caught.value.hint


def test_a_mimic_joint_off_the_arm_does_not_matter(read):
    finger = link("f") + joint("grip", "c", "f", more='<mimic joint="j1"/>')
    assert read(ABC + finger + J1 + J2, tip="c").joint_names == ("j1", "j2")


@pytest.mark.parametrize(
    ("frames", "message", "name"),
    [
        ({"tip": "toool"}, r"there is no link 'toool' \(did you mean tool\?\)", "toool"),
        ({"base": "xyz"}, r"there is no link 'xyz' \(known: a, b, tool\)", "xyz"),
        ({"base": "tool", "tip": "b"}, "b does not hang on tool", "tool"),
        ({"base": "b", "tip": "b"}, "there is no moving joint between b and b", "b"),
        # a joint has a frame too, but is no link
        ({"tip": "j1"}, "there is no link 'j1'", "j1"),
    ],
)
def test_base_and_tip_must_be_links_of_one_arm(read, frames, message, name):
    body = link("a") + link("b") + link("tool") + J1 + joint("j2", "b", "tool")
    with pytest.raises(RobotModelError, match=message) as caught:
        read(body, **frames)
    assert caught.value.name == name


@pytest.mark.parametrize("name", ["none.urdf", ".", "zero\0byte"])
def test_a_file_that_cannot_be_read(tmp_path, name):
    with pytest.raises(RobotModelError, match="cannot be read: ") as caught:
        Robot.from_urdf(os.path.join(tmp_path, name))
    assert "preset" in caught.value.hint


def test_a_file_without_end_is_not_read_to_it(monkeypatch, tmp_path):
    monkeypatch.setattr(urdf, "LARGEST_URDF_BYTES", 1000)
    with pytest.raises(RobotModelError, match="more than 1000 bytes is too large"):
        Robot.from_urdf("/dev/zero")
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{ABC}{J1}{J2}{" " * 1000}</robot>')
    with pytest.raises(RobotModelError, match="too large for a description"):
        Robot.from_urdf(path)


QUARTER = 'quat_xyzw="0.1 -0.3 0.5 0.7"'  # of no unit length


def as_version_1_1(inside: str) -> str:
    return f'<?xml version="1.0"?><robot name="arm" version="1.1">{inside}</robot>'


def test_origins_may_turn_by_quaternions(read):
    """As Pinocchio reads the same file, masses and shapes as well."""
    box = f'<collision><origin xyz="0 0 1" {QUARTER}/><geometry><sphere radius="1"/></geometry>'
    inside = inertial(origin=f'<origin xyz="1 2 3" {QUARTER}/>') + box + "</collision>"
    inside = inside.replace('ixx="1"', 'ixx="2"')
    turned = (J1 + J2).replace('rpy="0 0.2 0"', QUARTER)
    text = as_version_1_1(link("a") + link("b", inside) + link("c") + turned)
    robot, model = read(text), pin.buildModelFromXML(text)
    for one, other in zip(robot.model.jointPlacements, model.jointPlacements, strict=True):
        np.testing.assert_allclose(one.homogeneous, other.homogeneous, rtol=0, atol=1e-12)
    one, other = robot.model.inertias[1], model.inertias[1]
    np.testing.assert_allclose(one.inertia, other.inertia, rtol=0, atol=1e-12)
    R = rotation_from_quaternion([0.7, 0.1, -0.3, 0.5])
    np.testing.assert_allclose(robot.bodies[0].T_link_body[:3, :3], R, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("version", "origin", "why"),
    [
        ("", QUARTER, "URDF 1.0 does not have"),
        ('version="1.0"', QUARTER, "URDF 1.0 does not have"),
        ('version="1.2"', f'{QUARTER} rpy="0 0 0"', "and rpy='0 0 0'"),
        ('version="1.2"', 'quat_xyzw="0 0 0 0"', "not four finite numbers that are a rotation"),
        ('version="1.2"', 'quat_xyzw="0 0 1"', "not four finite numbers that are a rotation"),
        ('version="1.2"', 'quat_xyzw="0 0 nan 1"', "not four finite numbers"),
    ],
)
def test_quaternions_that_mean_nothing_are_refused(read, version, origin, why):
    joints = J1 + J2.replace('rpy="0 0.2 0"', origin)
    with pytest.raises(RobotModelError, match=f"an origin of <joint> 'j2' has quat_xyzw=.*{why}"):
        read(f'<?xml version="1.0"?><robot name="arm" {version}>{ABC}{joints}</robot>')


@pytest.mark.parametrize("along", [574.0, 4000.0, 20_000.0])
def test_frames_of_a_factory_calibration_are_far_along_their_axes(read, along):
    """Axes 2 to 4 of a UR5 are parallel but for some 0.1 mrad: its tables place frames far away."""

    def row(k, xyz, rpy):
        return (
            joint(f"q{k}", f"l{k - 1}", f"l{k}").replace("0.1 0 0.3", xyz).replace("0 0.2 0", rpy)
        )

    tilt = 0.08 / along
    rows = (
        row(1, "0 0 0", "0 0 0"),
        row(2, "0 0 0.089", "1.5708 0 0"),
        row(3, f"-0.425 0 {along}", f"{tilt} 0 0.1"),
        row(4, f"-0.392 0 {-along}", f"{-tilt} 0 -0.2"),
        row(5, "0 0 0.109", "1.5708 0 0"),
        row(6, "0 0 0.095", "-1.5708 0 0"),
    )
    text = "".join(link(f"l{k}") for k in range(7)) + "".join(rows)
    robot = read(text)
    assert robot.chain.reach_m < 2.0
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (50, 6))
    assert missed(robot, q).max() < 1e-6
