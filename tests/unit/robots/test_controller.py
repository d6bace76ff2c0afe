"""What the pendant shows: joints both ways, world frames, and descriptions that do not fit."""

from dataclasses import replace

import numpy as np
import pytest

from calib import se3
from calib.errors import InputError, RobotModelError
from calib.robots import POSITIVE_AXES, Robot, SerialChain, preset_names
from calib.robots.controller import Coupling, controller_of
from tests.arms import DESCRIPTIONS, robot_of


@pytest.mark.parametrize("name", preset_names())
def test_pendant_and_posture_are_inverse(name):
    robot = Robot.preset(name)
    controller = robot.controller
    assert controller is not None
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (50, robot.n))
    np.testing.assert_allclose(controller.posture(controller.pendant(q)), q, atol=1e-14)
    T = robot.fk(q)
    np.testing.assert_allclose(controller.in_base(controller.in_world(T)), T, atol=1e-14)


def test_fanuc_j3_is_the_angle_to_the_horizontal():
    """Moving J2 on the pendant leaves the forearm's direction as it is."""
    robot = Robot.preset("r2000ic165f")
    assert robot.controller is not None
    shown = np.array([10.0, -5.0, -20.0, 0.0, -45.0, 30.0])
    moved = np.array([10.0, 20.0, -20.0, 0.0, -45.0, 30.0])
    R = robot.fk(robot.controller.posture(np.array([shown, moved])))[:, :3, :3]
    np.testing.assert_allclose(R[0], R[1], atol=1e-12)
    forearm = robot.state(robot.controller.posture(shown)).axes[3]
    # axis 4 points back along the forearm: J3 = -20 deg points it down by 20 deg
    assert np.rad2deg(np.arcsin(-forearm[2])) == pytest.approx(-20.0, abs=1e-9)


def test_fanuc_world_lies_on_j1_at_the_height_of_j2():
    """Pendant J (0, 0, 0, 0, -90, 0): X 1592, Z 1085, W 180, from a real controller."""
    robot = Robot.preset("r2000ic165f")
    assert robot.controller is not None
    q = robot.controller.posture([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
    T = robot.controller.in_world(robot.fk(q))
    np.testing.assert_allclose(1e3 * T[:3, 3], [1592.0, 0.0, 1085.0], atol=1e-9)
    # W 180, P 0, R 0
    np.testing.assert_allclose(T[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-12)


def test_the_world_is_computed_where_the_description_has_none():
    robot = Robot.preset("r2000ic165f")
    assert robot.controller is not None
    found = controller_of("fanuc", robot.chain, None)
    np.testing.assert_allclose(found.T_base_world, robot.controller.T_base_world, atol=1e-12)


def turned_joint(chain: SerialChain, joint: int) -> SerialChain:
    """The same arm with a joint that counts the other way."""
    axes = chain.axes.copy()
    axes[joint] *= -1.0
    return replace(chain, axes=axes)


@pytest.mark.parametrize("joint", range(6))
def test_signs_are_read_off_the_axes(joint):
    robot = Robot.preset("r2000ic165f")
    assert robot.controller is not None
    q = np.deg2rad([10.0, 20.0, -30.0, 40.0, -50.0, 60.0])
    other = q.copy()
    other[joint] *= -1.0
    found = controller_of("fanuc", turned_joint(robot.chain, joint), None)
    np.testing.assert_allclose(found.pendant(other), robot.controller.pendant(q), atol=1e-12)


def test_kuka_signs():
    """A1, A4 and A6 count about axes that point down, and back along the arm."""
    robot = Robot.preset("kr6r900sixx")
    assert robot.controller is not None
    turned = robot.fk(robot.controller.posture([30.0, -90.0, 90.0, 0.0, 0.0, 0.0]))
    # A1 = 30 turns the arm clockwise, seen from above: to negative y
    assert np.rad2deg(np.arctan2(turned[1, 3], turned[0, 3])) == pytest.approx(-30.0, abs=1e-9)


def test_kawasaki_signs():
    """JT1 counts clockwise seen from above, and JT2 lays the arm to the front, along y."""
    robot = robot_of("kawasaki")
    assert robot.controller is not None
    T = robot.fk(robot.controller.posture([[30.0, 90.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 6]))
    front = (0.355 + 0.0925 + 0.2825 + 0.078) * np.array([np.sin(np.pi / 6), np.cos(np.pi / 6)])
    np.testing.assert_allclose(T[0, :3, 3], [*front, 0.36], atol=1e-9)
    np.testing.assert_allclose(T[1, :3, 3], [0.0, 0.0, 1.168], atol=1e-9)


@pytest.mark.parametrize("maker", DESCRIPTIONS)
def test_descriptions_of_the_makers_have_the_signs_of_their_controllers(maker):
    controller = robot_of(maker).controller
    assert controller is not None
    assert not controller.differs


def test_universal_robots_count_positions_in_a_turned_base():
    robot = Robot.preset("ur5e")
    assert robot.controller is not None
    T = se3.transform(np.eye(3), [-0.8172, -0.2329, 0.0628])
    np.testing.assert_allclose(
        robot.controller.in_base(T)[:3, 3], [0.8172, 0.2329, 0.0628], atol=1e-12
    )


def test_unknown_maker_is_named():
    robot = Robot.preset("r2000ic165f")
    with pytest.raises(RobotModelError, match="no controller 'fanu'") as caught:
        robot.controlled_by("fanu")
    assert "fanuc" in caught.value.hint


@pytest.mark.parametrize("maker", sorted(set(POSITIVE_AXES) - {"fanuc", "yaskawa", "franka"}))
def test_a_description_with_other_axes_is_refused(maker):
    """The wrist of a FANUC at zero lies along x: a maker whose zero differs is not guessed at."""
    chain = Robot.preset("r2000ic165f").chain
    if maker in ("abb", "kuka"):  # the same axes, but for signs: they are read off
        assert controller_of(maker, chain, None).maker == maker
        return
    with pytest.raises(RobotModelError, match="at zero does not turn about the axis"):
        controller_of(maker, chain, None)


def test_wrong_number_of_joints():
    robot = Robot.preset("r2000ic165f")
    with pytest.raises(RobotModelError, match="an arm of franka has 7 joints, this one 6"):
        robot.controlled_by("franka")
    assert robot.controller is not None
    with pytest.raises(InputError, match="5 joint values, the arm 6"):
        robot.controller.posture(np.zeros(5))


def test_a_parallel_linkage_holds_the_forearm_as_joint_2_moves():
    """IRB 4400 and its kind: J3 is shown against the horizontal."""
    robot = Robot.preset("irb120").controlled_by("abb", [Coupling("joint_3", "joint_2", 1.0)])
    shown = np.array([10.0, -5.0, 20.0, 0.0, 45.0, 30.0])
    moved = shown + np.array([0.0, 25.0, 0.0, 0.0, 0.0, 0.0])
    q = robot.controller.posture([shown, moved])
    np.testing.assert_allclose(np.rad2deg(q[:, 2]), [20.0 + 5.0, 20.0 - 20.0])
    axes = robot.state(q).axes[:, 3]
    np.testing.assert_allclose(axes[0], axes[1], atol=1e-12)
    np.testing.assert_allclose(robot.controller.pendant(q), [shown, moved], atol=1e-12)
    assert robot.controller.differs


def test_a_coupling_takes_the_place_of_the_maker_s_own():
    robot = Robot.preset("r2000ic165f")
    none = robot.controlled_by("fanuc", [Coupling("joint_3", "joint_2", 0.0)])
    np.testing.assert_array_equal(none.controller.pendant_from_joints, np.eye(6))
    half = robot.controlled_by("fanuc", [Coupling("joint_3", "joint_2", -0.5)])
    assert half.controller.pendant_from_joints[2, 1] == -0.5


def test_couplings_are_in_the_signs_of_the_controller(tmp_path):
    """A KUKA whose description turns axis 2 the other way shows the same."""
    robot = Robot.preset("kr6r900sixx")
    axes = robot.chain.axes.copy()
    axes[1] *= -1.0
    other = replace(robot, chain=replace(robot.chain, axes=axes))
    names = robot.joint_names
    couplings = [Coupling(names[2], names[1], 1.0)]
    q = np.random.default_rng(0).uniform(-1, 1, 6)
    turned = q * [1.0, -1.0, 1.0, 1.0, 1.0, 1.0]
    shown = [r.controlled_by("kuka", couplings).controller for r in (robot, other)]
    np.testing.assert_allclose(shown[0].pendant(q), shown[1].pendant(turned), atol=1e-12)
    own = robot.controller.pendant(q)
    own[2] += own[1]
    np.testing.assert_allclose(shown[0].pendant(q), own, atol=1e-12)


@pytest.mark.parametrize(
    ("couplings", "message"),
    [
        ([("joint_3", "joint2", 1.0)], r"no joint 'joint2' to couple \(did you mean joint_2"),
        ([("joint_3", "joint_3", 1.0)], "joint_3 cannot be coupled with 1 of joint_3"),
        ([("joint_3", "joint_2", np.nan)], "cannot be coupled with nan"),
        ([("joint_3", "joint_2", 1.0), ("joint_2", "joint_3", 1.0)], "does not tell where"),
    ],
)
def test_couplings_that_cannot_be(couplings, message):
    with pytest.raises(RobotModelError, match=message):
        Robot.preset("irb120").controlled_by("abb", [Coupling(*c) for c in couplings])
