"""Joints that follow others: parallelograms, lifts of two stages, wherever the leaders are."""

import numpy as np
import pinocchio as pin
import pytest

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot
from calib.errors import RobotModelError
from calib.geometry.enclosure import motion_radii
from calib.model.measurements import TouchUp
from calib.model.parameters import LinkGeometry, Payload, TargetPoints, ToolPoint, ZeroOffsets
from calib.model.parameters.gravity import gravity_torque
from calib.robots.arm_shapes import with_capsules
from calib.robots.dh import dh_table
from calib.robots.inverse.closed_form import ClosedForm
from calib.robots.one_posture import OnePosture
from calib.robots.shapes import Body, Sphere
from calib.se3 import inverse, rotation_exp, transform

Joint = tuple[str, str, str, str, float, float, tuple[str, float, float] | None]
"""Name, type, origin, axis, limits, and the joint that it follows with factor and offset."""

# of a palletiser with parallelograms: forearm and wrist keep their angle to the floor
PALLETISER: list[Joint] = [
    ("j1", "revolute", "0 0 0.74", "0 0 1", -2.8, 2.8, None),
    ("j2", "revolute", "0.26 0 0", "0 1 0", -0.7, 1.4, None),
    ("j2_back", "revolute", "0 0 0.945", "0 1 0", -3.0, 3.0, ("j2", -1.0, 0.0)),
    ("j3", "revolute", "0 0 0", "0 1 0", -0.3, 2.0, None),
    ("j3_level", "revolute", "1.025 0 0", "0 1 0", -1.5, 3.0, ("j3", -1.0, 0.0)),
    ("j4", "revolute", "0.22 0 -0.2", "0 0 1", -5.0, 5.0, None),
]

# a lift of two stages by one drive, the follower first, under an elbow
LIFT: list[Joint] = [
    ("stage", "prismatic", "0 0 0.4", "0 0 1", -1.0, 1.0, ("lift", 0.5, 0.01)),
    ("lift", "prismatic", "0 0.1 0.1", "0 0 1", 0.0, 0.3, None),
    ("a1", "revolute", "0 0 0.2", "0 0 1", -2.0, 2.0, None),
    ("a2", "revolute", "0.3 0 0.1", "0 1 0", -1.0, 1.0, None),
]

# one that follows a follower, far from its leader
CHAINED: list[Joint] = [
    ("b1", "revolute", "0 0 0.3", "0 0 1", -2.0, 2.0, None),
    ("b2", "revolute", "0.1 0 0.2", "0 1 0", -1.0, 1.0, None),
    ("b3", "revolute", "0 0.1 0.3", "1 0 0", -3.0, 3.0, ("b1", 2.0, 0.2)),
    ("b4", "prismatic", "0.2 0 0", "0.6 0 0.8", -3.0, 3.0, ("b3", 0.05, -0.1)),
    ("b5", "revolute", "0 0 0.1", "0 1 0", -1.5, 1.5, None),
]

ARMS = {"palletiser": PALLETISER, "lift": LIFT, "chained": CHAINED}


def urdf(joints: list[Joint], name: str = "geared") -> str:
    parts = [f'<robot name="{name}"><link name="l0"/>']
    for k, (joint, kind, xyz, axis, low, high, led) in enumerate(joints, start=1):
        follows = (
            f'<mimic joint="{led[0]}" multiplier="{led[1]}" offset="{led[2]}"/>' if led else ""
        )
        parts.append(
            f'<link name="l{k}"/><joint name="{joint}" type="{kind}"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            f'<limit lower="{low}" upper="{high}" velocity="1" effort="1"/>{follows}</joint>'
        )
    parts.append(
        f'<link name="tool0"/><joint name="mount" type="fixed"><parent link="l{len(joints)}"/>'
        '<child link="tool0"/><origin xyz="0.02 0.01 -0.05" rpy="3.0 0.1 0.2"/></joint></robot>'
    )
    return "\n".join(parts)


@pytest.fixture(params=ARMS)
def arm(request, tmp_path) -> tuple[Robot, list[Joint]]:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(ARMS[request.param]))
    return Robot.from_urdf(path), ARMS[request.param]


def drawn(robot: Robot, count: int) -> np.ndarray:
    rng = np.random.default_rng(2)
    return rng.uniform(robot.lower, robot.upper, (count, robot.n))


def by_hand(joints: list[Joint], names: tuple[str, ...], q: np.ndarray) -> np.ndarray:
    """The tip (4, 4), joint by joint."""
    led = {joint[0]: joint[6] for joint in joints}

    def value(name: str) -> float:
        follows = led[name]
        if follows is None:
            return float(q[names.index(name)])
        return follows[1] * value(follows[0]) + follows[2]

    T = np.eye(4)
    for name, kind, xyz, axis, *_ in joints:
        along = np.array([float(v) for v in axis.split()]) * value(name)
        turns = kind == "revolute"
        R = rotation_exp(along) if turns else np.eye(3)
        T = T @ transform(np.eye(3), [float(v) for v in xyz.split()])
        T = T @ transform(R, np.zeros(3) if turns else along)
    mount = pin.SE3(pin.rpy.rpyToMatrix(3.0, 0.1, 0.2), np.array([0.02, 0.01, -0.05]))
    return np.asarray(T @ mount.homogeneous)


def test_poses_are_those_of_all_joints_one_by_one(arm):
    robot, joints = arm
    leading = tuple(joint[0] for joint in joints if joint[6] is None)
    assert robot.joint_names == leading
    assert robot.chain_joints == tuple(joint[0] for joint in joints)
    q = drawn(robot, 40)
    expected = np.array([by_hand(joints, leading, row) for row in q])
    np.testing.assert_allclose(robot.fk(q), expected, atol=1e-13)
    np.testing.assert_allclose(robot.fk(q[0]), expected[0], atol=1e-13)
    np.testing.assert_allclose(OnePosture(robot).tip(q[0]), expected[0], atol=1e-13)


def test_poses_are_pinocchio_s_with_mimic(tmp_path):
    """Its reader takes joints that follow one before them, and whose names come after it."""
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(PALLETISER))
    robot, model = Robot.from_urdf(path), pin.buildModelFromUrdf(str(path), mimic=True)
    data = model.createData()
    for q in drawn(robot, 30):
        whole = pin.neutral(model)
        for name, value in zip(robot.joint_names, q, strict=True):
            whole[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, whole)
        T = data.oMf[model.getFrameId("tool0")].homogeneous
        np.testing.assert_allclose(robot.fk(q), T, atol=1e-13)


def test_jacobians_are_those_of_differences(arm):
    robot, _ = arm
    q, step = drawn(robot, 6), 1e-6
    J, J_at = robot.jacobian(q), robot.state(q).jacobian(np.tile([0.3, -0.2, 0.5], (6, 1)))
    T = robot.fk(q)
    for j in range(robot.n):
        ahead, behind = q.copy(), q.copy()
        ahead[:, j] += step
        behind[:, j] -= step
        dT = (robot.fk(ahead) - robot.fk(behind)) / (2.0 * step)
        w = dT[:, :3, :3] @ np.swapaxes(T[:, :3, :3], -1, -2)
        turn = np.stack([w[:, 2, 1], w[:, 0, 2], w[:, 1, 0]], axis=1)
        np.testing.assert_allclose(J[:, :3, j], dT[:, :3, 3], atol=1e-8)
        np.testing.assert_allclose(J[:, 3:, j], turn, atol=1e-8)
        lever = np.array([0.3, -0.2, 0.5]) - T[:, :3, 3]
        np.testing.assert_allclose(J_at[:, :3, j], dT[:, :3, 3] + np.cross(turn, lever), atol=1e-8)


def test_parameters_move_as_differences_say(arm):
    robot, _ = arm
    tool = np.array([0.03, 0.0, 0.05])
    target = robot.state(drawn(robot, 1)[0]).point(tool)
    blocks = [
        ZeroOffsets(robot, robot.joint_names),
        LinkGeometry(robot),
        ToolPoint(tool),
        TargetPoints([target]),
    ]
    model = CalibrationModel(robot, blocks, TouchUp([1e-4] * 3))
    q, x = drawn(robot, 5), model.nominal + np.random.default_rng(6).normal(0.0, 1e-2, model.p)
    J, step = model.jacobian(q, x), 1e-6
    for k in range(model.p):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += step
        behind[k] -= step
        differences = (model.predict(q, ahead) - model.predict(q, behind)) / (2.0 * step)
        np.testing.assert_allclose(J[..., k], differences, atol=1e-7)


def test_a_corrected_description_has_the_offsets_of_those_that_follow_too(arm):
    """Of zero offsets alone: shown is ``q``, the joints are at ``q + offset``."""
    robot, _ = arm
    model = CalibrationModel(
        robot,
        [
            ZeroOffsets(robot, robot.joint_names),
            ToolPoint(np.zeros(3)),
            TargetPoints([np.zeros(3)]),
        ],
        TouchUp([1e-4] * 3),
    )
    x = model.nominal
    offsets = 0.01 * np.arange(1.0, robot.n + 1.0)
    x[: robot.n] = offsets
    q, found = drawn(robot, 10), corrected_robot(model, x)
    np.testing.assert_allclose(found.robot.fk(q), robot.fk(q + offsets), atol=1e-12)
    off = inverse(robot.joint_origins) @ found.robot.joint_origins
    np.testing.assert_allclose(found.corrections, off, atol=1e-12)
    assert set(found.moved) == set(robot.chain_joints)


def test_limits_keep_those_of_joints_that_follow(tmp_path):
    path = tmp_path / "arm.urdf"
    narrow = [list(joint) for joint in PALLETISER]
    narrow[2][4:6] = -1.0, 0.5  # j2_back = -j2
    path.write_text(urdf([tuple(joint) for joint in narrow]))
    robot = Robot.from_urdf(path)
    assert (robot.lower[1], robot.upper[1]) == pytest.approx((-0.5, 1.0))
    narrow[2][4:6] = 5.0, 6.0
    path.write_text(urdf([tuple(joint) for joint in narrow]))
    with pytest.raises(RobotModelError, match="joint j2 has no range: the joints that follow it"):
        Robot.from_urdf(path)


def test_one_that_follows_what_is_not_on_the_arm_is_refused_by_name(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(PALLETISER))
    with pytest.raises(RobotModelError, match="joint 'j2_back' follows another joint"):
        Robot.from_urdf(path, base="l2")
    held = Robot.from_urdf(path, lock=["j2_back", "j3_level"])
    assert held.joint_names == ("j1", "j2", "j3", "j4")


def test_what_is_not_right_for_them_is_refused_or_left_out(arm):
    robot, _ = arm
    with pytest.raises(RobotModelError, match="joints that slide, or follow others"):
        dh_table(robot)
    with pytest.raises(RobotModelError, match="no capsules run from joint to joint there"):
        with_capsules(robot, [0.05])
    assert not isinstance(robot._inverse, ClosedForm)


def test_weight_carried_turns_joints_by_the_power_that_it_takes(arm):
    """Torque of gravity by differences of the height of the payload."""
    robot, _ = arm
    q, step, load = drawn(robot, 4), 1e-6, Payload(7.0, np.array([0.02, 0.0, 0.1]))
    torque = gravity_torque(robot, q, load)

    def height(posture: np.ndarray) -> np.ndarray:
        return robot.state(posture).point(load.com_m)[:, 2]

    for j in np.flatnonzero(~robot.sliding):
        ahead, behind = q.copy(), q.copy()
        ahead[:, j] += step
        behind[:, j] -= step
        power = -7.0 * 9.80665 * (height(ahead) - height(behind)) / (2.0 * step)
        np.testing.assert_allclose(torque[:, j], power, atol=1e-6)


def test_joint_motion_is_bounded(arm):
    robot, _ = arm
    bodies = [
        Body(f"b{k}", k, transform(np.eye(3), [0.02, -0.03, 0.05]), Sphere(0.02))
        for k in range(robot.n + 1)
    ]
    pairs = np.array([[a, b] for a in range(robot.n + 1) for b in range(a + 1, robot.n + 1)])
    radii, q, step = motion_radii(robot.chain, bodies, pairs), drawn(robot, 100), 1e-6

    def centres(posture: np.ndarray) -> np.ndarray:
        state = robot.state(posture)
        p = state.rotations @ np.array([0.02, -0.03, 0.05]) + state.origins
        first = np.tile([0.02, -0.03, 0.05], (len(posture), 1, 1))
        return np.concatenate([first, p], axis=1)

    for j in range(robot.n):
        moved = q.copy()
        moved[:, j] += step
        apart = [
            np.linalg.norm(at[:, pairs[:, 0]] - at[:, pairs[:, 1]], axis=-1)
            for at in (centres(q), centres(moved))
        ]
        fastest = np.abs(apart[1] - apart[0]).max(axis=0) / step
        assert (fastest <= radii[:, j] + 1e-6).all()
