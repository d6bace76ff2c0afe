"""Arms on a rail or a gantry: kinematics, inverse, loads and the controller's view."""

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot
from calib.errors import InputError, JointLimitError, RobotModelError
from calib.model.parameters import GravityLoad, JointHarmonics
from calib.robots.dh import dh_table
from calib.robots.one_posture import OnePosture
from calib.robots.urdf_anew import urdf_of
from calib.vision.touch_up import follow
from tests.rails import GANTRY, RAIL, on_slides
from tests.unit.robots.test_chain import assert_same_kinematics

KINDS = {"rail": ("r2000ic165f", (RAIL,)), "gantry": ("ur10e", GANTRY), "panda": ("panda", (RAIL,))}


@pytest.fixture(scope="module", params=KINDS)
def robot(request, tmp_path_factory) -> Robot:
    path = tmp_path_factory.mktemp("rails") / "robot.urdf"
    path.write_text(on_slides(*KINDS[request.param]))
    return Robot.from_urdf(path)


def postures(robot: Robot, count: int = 40) -> np.ndarray:
    return np.random.default_rng(5).uniform(robot.lower, robot.upper, (count, robot.n))


def test_kinematics_are_pinocchio_s(robot):
    assert_same_kinematics(robot, robot.model, postures(robot))
    one = postures(robot)[:1]
    np.testing.assert_array_equal(robot.fk(one)[0], robot.fk(postures(robot))[0])
    np.testing.assert_allclose(OnePosture(robot).tip(one[0]), robot.fk(one)[0], atol=1e-12)


def test_every_answer_of_the_inverse_takes_the_pose(robot):
    q = postures(robot, 2)
    T = robot.fk(q)
    solved = robot.inverse(T, near=q[0])
    off = np.abs(robot.fk(solved.postures) - T[solved.pose]).max(axis=(1, 2))
    assert off.max() < 1e-8
    good = solved.postures[solved.inside]
    assert ((good >= robot.lower - 1e-8) & (good <= robot.upper + 1e-8)).all()
    assert len(np.unique(solved.pose[solved.inside])) == 2
    # the reference itself is found at its own pose
    nearest, found = solved.nearest()
    assert found.all()
    np.testing.assert_allclose(nearest[0], q[0], atol=1e-7)
    # other stations of the slides are used
    assert len(np.unique(good[:, : robot.n_external].round(6), axis=0)) > 3


def test_a_pose_that_only_a_station_far_off_reaches_is_reached(robot):
    q = postures(robot, 1)[0]
    q[: robot.n_external] = robot.upper[: robot.n_external]
    near = q.copy()
    near[: robot.n_external] = robot.lower[: robot.n_external]
    assert robot.inverse(robot.fk(q)[None], near=near).inside.any()


def test_values_are_shown_in_millimetres_and_degrees(robot):
    q = postures(robot, 3)
    k = robot.n_external
    np.testing.assert_allclose(robot.shown(q)[:, :k], 1e3 * q[:, :k])
    np.testing.assert_allclose(robot.shown(q)[:, k:], np.rad2deg(q[:, k:]))
    np.testing.assert_allclose(robot.of_shown(robot.shown(q)), q)
    assert robot.joint_labels[: k + 1] == (*[f"E{j + 1}" for j in range(k)], "J1")
    assert robot.joint_units == ("mm",) * k + ("deg",) * (robot.n - k)
    beyond = q[0].copy()
    beyond[0] = robot.upper[0] + 0.25
    with pytest.raises(JointLimitError, match=r"mm is above .*00\.\d mm"):
        robot.check_limits(beyond)


def test_what_turns_feels_the_gravity_that_pinocchio_says(robot):
    from calib.model import Setup

    q = postures(robot)
    torque = GravityLoad(robot).joint_torque(np.ascontiguousarray(q.T), Setup.of(len(q))).T
    data = robot.model.createData()
    columns = [robot.model.joints[robot.model.getJointId(n)].idx_v for n in robot.joint_names]
    expected = np.empty_like(q)
    for i, posture in enumerate(q):
        whole = pin.neutral(robot.model)
        whole[columns] = posture
        expected[i] = -pin.computeGeneralizedGravity(robot.model, data, whole)[columns]
    k = robot.n_external
    level = robot.model.gravity.linear[2] / -9.80665  # Pinocchio's own constant is 9.81
    np.testing.assert_allclose(torque[:, k:] * level, expected[:, k:], rtol=1e-9, atol=1e-7)
    assert not torque[:, :k].any()


def test_written_anew_it_is_the_same_robot(robot, tmp_path):
    path = tmp_path / "anew.urdf"
    path.write_bytes(urdf_of(robot, ""))
    again = Robot.from_urdf(path, tip=robot.tip_frame)
    np.testing.assert_allclose(again.fk(postures(robot)), robot.fk(postures(robot)), atol=1e-12)
    assert again.n_external == robot.n_external
    np.testing.assert_allclose(again.upper, robot.upper)


def test_what_only_turning_joints_have_is_refused_of_slides(robot):
    with pytest.raises(InputError, match=f"'{robot.joint_names[0]}' slides, and has no such error"):
        JointHarmonics(robot, robot.joint_names)
    with pytest.raises(RobotModelError, match="is an external axis, and the table"):
        dh_table(robot)


def test_the_controller_sees_the_arm_as_without_the_rail(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(on_slides("r2000ic165f"))
    railed, alone = Robot.from_urdf(path).controlled_by("fanuc"), Robot.preset("r2000ic165f")
    q = postures(alone)
    with_rail = np.column_stack([np.linspace(-1.5, 2.5, len(q)), q])
    assert alone.controller is not None
    assert railed.controller is not None
    shown = railed.controller.pendant(with_rail)
    np.testing.assert_allclose(shown[:, 0], 1e3 * with_rail[:, 0])
    np.testing.assert_allclose(shown[:, 1:], alone.controller.pendant(q), atol=1e-9)
    np.testing.assert_allclose(railed.controller.posture(shown), with_rail, atol=1e-12)


def test_slides_carry_an_arm_of_four_joints_and_more(tmp_path):
    """Those before fewer joints are the arm's own: a Cartesian robot, a SCARA on its column."""
    path = tmp_path / "robot.urdf"
    path.write_text(on_slides("r2000ic165f"))
    alone = Robot.from_urdf(path, tip="rail_carriage")
    assert (alone.n_external, alone.joint_labels, alone.joint_units) == (0, ("J1",), ("mm",))
    short, long = (Robot.from_urdf(path, tip=f"link_{k}") for k in (3, 4))
    assert (short.n_external, short.sliding.tolist()) == (0, [True, False, False, False])
    assert (long.n_external, long.sliding.tolist()) == (1, [True] + 4 * [False])
    held = Robot.from_urdf(path, held_m={"rail": 0.7})
    assert (held.n, held.n_external) == (6, 0)
    moving = Robot.from_urdf(path)
    np.testing.assert_allclose(
        moving.fk(np.concatenate([[0.7], np.full(6, 0.3)])), held.fk(np.full(6, 0.3)), atol=1e-12
    )


def test_limits_in_millimetres_are_refused(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(on_slides("r2000ic165f", [("lift", "0 0 1", "0", "500")]))
    with pytest.raises(RobotModelError, match="'lift' slides from 0 to 500 m") as refused:
        Robot.from_urdf(path)
    assert "in metres" in refused.value.hint


def test_slides_stay_where_the_arm_follows_a_tool(robot):
    q = postures(robot)
    T = robot.fk(q)
    T[:, :3, 3] += [0.01, -0.02, 0.015]
    found, there = follow(robot, q, T)
    assert there.mean() > 0.5
    np.testing.assert_array_equal(found[:, : robot.n_external], q[:, : robot.n_external])
    np.testing.assert_allclose(robot.fk(found[there]), T[there], atol=1e-8)
    np.testing.assert_allclose(follow(robot, q[:1], T[:1])[0], found[:1], atol=1e-12)
