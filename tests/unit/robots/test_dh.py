"""Denavit-Hartenberg tables: the arm that they describe is the arm that they were made of."""

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot
from calib.errors import InputError, RobotModelError
from calib.model.measurements import TouchUp
from calib.model.parameters import LinkGeometry, TargetPoints, ToolPoint, ZeroOffsets
from calib.robots import preset_names
from calib.robots.dh import PARALLEL_RAD, dh_table
from calib.robots.robot import with_placements

CASES = [
    ("standard", 0.0),
    ("modified", 0.0),
    ("standard", PARALLEL_RAD),
    ("modified", PARALLEL_RAD),
]


def identified(robot: Robot, seed: int = 0) -> Robot:
    """The arm with errors of a milliradian and a millimetre in every joint frame."""
    blocks = [
        ZeroOffsets(robot, robot.joint_names),
        LinkGeometry(robot),
        ToolPoint([0.0, 0.0, 0.1]),
        TargetPoints([[1.0, 0.0, 0.5]]),
    ]
    model = CalibrationModel(robot, blocks, TouchUp(1e-5))
    change = 2e-3 * np.random.default_rng(seed).uniform(-1, 1, model.p)
    return corrected_robot(model, model.nominal + change).robot


@pytest.mark.parametrize(("form", "parallel"), CASES)
@pytest.mark.parametrize("name", preset_names())
def test_forward_kinematics_is_that_of_the_arm(name, form, parallel):
    robot = identified(Robot.preset(name))
    table = dh_table(robot, form, parallel)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (200, robot.n))
    np.testing.assert_allclose(table.fk(q), robot.fk(q), atol=1e-9)
    np.testing.assert_allclose(table.fk(q[0]), robot.fk(q[0]), atol=1e-9)


@pytest.mark.parametrize("name", ["r2000ic165f", "irb120", "ur5e", "panda"])
def test_of_parallel_axes_hayati_has_lengths_of_the_arm_and_denavit_none(name):
    robot = identified(Robot.preset(name))
    plain, hayati = dh_table(robot), dh_table(robot, parallel_rad=PARALLEL_RAD)
    assert np.abs(hayati.d).max() < 1.5
    rows = np.flatnonzero(hayati.beta)
    assert (hayati.d[rows] == 0.0).all()
    assert np.abs(hayati.beta).max() < 5e-3
    assert len(rows) == {"panda": 0, "ur5e": 2}.get(name, 1)
    if len(rows):
        assert np.abs(plain.d).max() > 3.0
    np.testing.assert_array_equal(plain.beta, 0.0)


def test_that_of_a_ur5e_is_the_makers():
    """Universal Robots, "DH parameters for calculations of kinematics and dynamics"."""
    table = dh_table(Robot.preset("ur5e"), parallel_rad=PARALLEL_RAD)
    np.testing.assert_allclose(table.a, [0, -0.425, -0.3922, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(table.d, [0.1625, 0, 0, 0.1333, 0.0997, 0.0996], atol=1e-9)
    half = np.pi / 2
    np.testing.assert_allclose(table.alpha, [half, 0, 0, half, -half, 0], atol=1e-9)
    np.testing.assert_allclose(table.theta, 0.0, atol=1e-9)
    np.testing.assert_allclose(table.T_base_0, np.diag([-1, -1, 1, 1]), atol=1e-9)
    np.testing.assert_allclose(table.T_n_tip, np.eye(4), atol=1e-9)


def test_that_of_a_panda_is_the_makers_in_craigs_form():
    """Franka, "Robot and interface specifications": Craig's convention, flange 0.107 m on."""
    table = dh_table(Robot.preset("panda"), "modified")
    np.testing.assert_allclose(table.a, [0, 0, 0, 0.0825, -0.0825, 0, 0.088], atol=1e-9)
    np.testing.assert_allclose(table.d[:6], [0.333, 0, 0.316, 0, 0.384, 0], atol=1e-9)
    half = np.pi / 2
    np.testing.assert_allclose(table.alpha, [0, -half, half, half, -half, half, half], atol=1e-9)


def test_nearly_parallel_axes_are_refused_where_hayati_is_not_asked_for():
    robot = Robot.preset("ur5e")
    placements = robot.chain.placements.copy()
    turn = np.eye(4)
    turn[1:3, 1:3] = [[np.cos(1e-8), -np.sin(1e-8)], [np.sin(1e-8), np.cos(1e-8)]]
    placements[2] = placements[2] @ turn
    other = with_placements(robot, placements)
    with pytest.raises(RobotModelError, match="shoulder_lift_joint and elbow_joint are parallel"):
        dh_table(other)
    q = np.random.default_rng(1).uniform(-3, 3, (50, 6))
    table = dh_table(other, parallel_rad=PARALLEL_RAD)
    np.testing.assert_allclose(table.fk(q), other.fk(q), atol=1e-12)


def test_an_unknown_form_is_refused():
    with pytest.raises(InputError, match="unknown form 'craig'"):
        dh_table(Robot.preset("ur5e"), "craig")
