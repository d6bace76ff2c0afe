"""Joints beside the arm, joints held still by name, and what cannot be moved."""

import numpy as np
import pytest

from calib import Robot
from calib.errors import RobotModelError

LIMIT = '<limit lower="-1" upper="1.5" velocity="2" effort="1"/>'


def joint(name, parent, child, kind="revolute", *, limit=LIMIT, more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.3" rpy="0 0.2 0"/><axis xyz="0 0 1"/>{limit}{more}</joint>'
    )


def links(*names: str) -> str:
    return "".join(f'<link name="{name}"/>' for name in names)


ARM = links("a", "b", "c") + joint("j1", "a", "b") + joint("j2", "b", "c")


@pytest.fixture
def read(tmp_path, capfd):
    """Read the inside of a <robot>, and see that nothing is printed."""

    def call(text: str, tip: str | None = "c", **named: object) -> Robot:
        path = tmp_path / "arm.urdf"
        path.write_text(f'<robot name="arm">{text}</robot>')
        try:
            return Robot.from_urdf(path, tip, **named)
        finally:
            assert capfd.readouterr() == ("", "")

    return call


UNUSABLE = {
    "no limits": joint("x", "{}", "{}", limit=""),
    "limits that are no numbers": joint("x", "{}", "{}", limit='<limit lower="?" upper="1"/>'),
    "limits reversed": joint("x", "{}", "{}", limit='<limit lower="2" upper="1"/>'),
    "no range": joint("x", "{}", "{}", limit='<limit lower="0" upper="0"/>'),
    "prismatic": joint("x", "{}", "{}", "prismatic"),
    "prismatic without limits": joint("x", "{}", "{}", "prismatic", limit=""),
    "mimic": joint("x", "{}", "{}", more='<mimic joint="j1"/>'),
    "continuous mimic": joint("x", "{}", "{}", "continuous", more='<mimic joint="j1"/>'),
    "floating": joint("x", "{}", "{}", "floating", limit=""),
    "planar": joint("x", "{}", "{}", "planar", limit=""),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_beside_the_arm_it_is_locked_and_said(read, case):
    robot = read(ARM + links("f") + UNUSABLE[case].format("b", "f"))
    assert robot.notices == ("locked at zero, not between base and tip: x",)
    np.testing.assert_allclose(robot.fk([0.3, 0.4]), read(ARM).fk([0.3, 0.4]), atol=1e-15)


@pytest.mark.parametrize("case", UNUSABLE)
def test_below_the_base_it_is_locked_and_said(read, case):
    robot = read(ARM + links("world") + UNUSABLE[case].format("world", "a"), base="a")
    assert robot.notices == ("locked at zero, not between base and tip: x",)
    np.testing.assert_allclose(robot.fk([0.3, 0.4]), read(ARM).fk([0.3, 0.4]), atol=1e-15)
    np.testing.assert_array_equal(robot.upper, [1.5, 1.5])


@pytest.mark.parametrize(
    "case", sorted(UNUSABLE.keys() - {"prismatic", "mimic", "continuous mimic"})
)
def test_on_the_arm_it_is_refused_by_name_unless_it_is_locked(read, case):
    text = ARM + links("d") + UNUSABLE[case].format("c", "d")
    with pytest.raises(RobotModelError, match=r"joint '?x'? ") as caught:
        read(text, "d")
    assert caught.value.name == "x"
    assert caught.value.hint.endswith("with lock")
    robot = read(text, "d", lock=["x"])
    assert robot.joint_names == ("j1", "j2")
    assert robot.notices == ("locked at zero, as asked: x",)


def test_a_rail_is_locked_at_zero(read):
    rail = links("world") + joint("rail", "world", "a", "prismatic")
    fixed = links("world") + joint("rail", "world", "a", "fixed")
    robot = read(rail + ARM, lock=("rail",))
    expected = read(fixed + ARM, base="world")
    np.testing.assert_allclose(robot.fk([0.3, -0.4]), expected.fk([0.3, -0.4]), atol=1e-15)


def test_a_revolute_joint_of_the_arm_is_locked_like_a_fixed_one(read):
    robot = read(ARM + links("d") + joint("j3", "c", "d"), "d", lock="j2")
    rigid = links("a", "b", "c", "d") + joint("j1", "a", "b") + joint("j2", "b", "c", "fixed")
    expected = read(rigid + joint("j3", "c", "d"), "d")
    assert robot.joint_names == expected.joint_names == ("j1", "j3")
    np.testing.assert_allclose(robot.fk([0.3, -0.4]), expected.fk([0.3, -0.4]), atol=1e-15)


def test_names_asked_for_and_others_are_told_apart(read):
    more = links("f", "g") + joint("y", "b", "f") + joint("z", "b", "g")
    robot = read(ARM + more, lock=["z", "j1"])
    assert robot.notices == (
        "locked at zero, not between base and tip: y",
        "locked at zero, as asked: j1, z",
    )


def test_locking_a_fixed_joint_changes_nothing(read):
    text = ARM + links("tool0") + joint("mount", "c", "tool0", "fixed")
    assert read(text, None, lock=["mount"]).notices == ()


@pytest.mark.parametrize(
    ("lock", "message", "name"),
    [
        (["j11"], r"there is no joint 'j11' to lock \(did you mean j1\?\)", "j11"),
        (["j1", "c"], r"there is no joint 'c' to lock \(known: j1, j2\)", "c"),
        (["j1", "j2"], "there is no moving joint between a and c", "c"),
    ],
)
def test_names_that_cannot_be_locked(read, lock, message, name):
    with pytest.raises(RobotModelError, match=message) as caught:
        read(ARM, lock=lock)
    assert caught.value.name == name


def test_continuous_joints_are_only_told_of_where_they_move(read):
    text = ARM + links("w") + joint("wheel", "b", "w", "continuous")
    assert read(text).notices == ("locked at zero, not between base and tip: wheel",)


TWO_ARMS = links("torso", "l0", "l1", "l2", "r0", "r1", "r2") + "".join(
    joint(f"{side}_mount", "torso", f"{side}0", "fixed")
    + joint(f"{side}j1", f"{side}0", f"{side}1")
    + joint(f"{side}j2", f"{side}1", f"{side}2")
    for side in "lr"
)


def test_one_of_two_arms(read):
    left, right = (read(TWO_ARMS, f"{side}2", base=f"{side}0") for side in "lr")
    assert (left.joint_names, right.joint_names) == (("lj1", "lj2"), ("rj1", "rj2"))
    assert left.notices == ("locked at zero, not between base and tip: rj1, rj2",)
    np.testing.assert_allclose(left.fk([0.1, 0.2]), right.fk([0.1, 0.2]), atol=1e-15)
    carried = read(TWO_ARMS, "r2", base="l1")  # by a positioner of one joint
    assert (carried.joint_names, carried.floor) == (("lj1", "rj1", "rj2"), 1)
    with pytest.raises(RobotModelError, match="l1 does not hang on l2, nor on what carries it"):
        read(TWO_ARMS, "l1", base="l2")
