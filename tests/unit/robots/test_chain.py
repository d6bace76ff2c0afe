"""Forward kinematics and Jacobian against Pinocchio's own, and which joints a robot is made of."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot, preset_names, se3
from calib.errors import InputError, JointLimitError, RobotModelError
from calib.robots import SerialChain


def by_pinocchio(model: pin.Model, q: np.ndarray, tip: str, base: str):
    """Pose and Jacobian (origin of the tip, axes of the base) by Pinocchio's algorithms."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    tip_id, base_id = model.getFrameId(tip), model.getFrameId(base)
    J = pin.getFrameJacobian(model, data, tip_id, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)
    R_base_world = data.oMf[base_id].rotation.T
    return (
        (data.oMf[base_id].inverse() * data.oMf[tip_id]).homogeneous,
        np.concatenate([R_base_world @ J[:3], R_base_world @ J[3:]]),
    )


def assert_same_kinematics(robot: Robot, model: pin.Model, q: np.ndarray) -> None:
    T, J = robot.fk(q), robot.jacobian(q)
    columns = [model.joints[model.getJointId(name)].idx_v for name in robot.joint_names]
    for i in range(len(q)):
        whole = pin.neutral(model)
        whole[columns] = q[i]
        T_pin, J_pin = by_pinocchio(model, whole, robot.tip_frame, robot.base_frame)
        np.testing.assert_allclose(T[i], T_pin, atol=1e-13)
        np.testing.assert_allclose(J[i], J_pin[:, columns], atol=1e-13)


@pytest.mark.parametrize("name", preset_names())
@pytest.mark.parametrize("base", [None, "base"])
def test_presets_move_as_in_pinocchio(name, base):
    if base is not None and not Robot.preset(name).model.existFrame(base):
        base = "panda_link1"  # a base of another name, on a link that moves
        assert name == "panda"
    robot = Robot.preset(name, base=base)
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (50, robot.n))
    assert_same_kinematics(robot, robot.model, q)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7, 9])
def test_random_arms_move_as_in_pinocchio(random_urdf, n):
    rng = np.random.default_rng(n)
    path = random_urdf(rng, n)
    robot, model = Robot.from_urdf(path), pin.buildModelFromUrdf(str(path))
    assert robot.joint_names == tuple(f"j{j + 1}" for j in range(n))
    assert (robot.base_frame, robot.tip_frame) == ("root", "tool0")
    assert_same_kinematics(robot, model, rng.uniform(-7, 7, (20, n)))
    np.testing.assert_allclose(robot.lower, model.lowerPositionLimit)
    np.testing.assert_allclose(robot.upper, model.upperPositionLimit)
    np.testing.assert_allclose(robot.joint_range, robot.upper - robot.lower)
    np.testing.assert_array_equal(robot.speed, np.arange(1, n + 1))
    np.testing.assert_allclose(np.linalg.norm(robot.chain.axes, axis=1), 1.0, atol=1e-14)


def test_base_and_tip_can_be_any_links_of_the_arm(random_urdf):
    rng = np.random.default_rng(5)
    path = random_urdf(rng, 6)
    model = pin.buildModelFromUrdf(str(path))
    robot = Robot.from_urdf(path, base="link2", tip="link5")
    assert robot.joint_names == ("j3", "j4", "j5")
    assert robot.notices == ("locked at zero, not between base and tip: j1, j2, j6",)
    assert_same_kinematics(robot, model, rng.uniform(-2, 2, (10, 3)))


def test_jacobian_is_the_derivative_of_the_forward_kinematics(random_urdf):
    rng = np.random.default_rng(8)
    robot = Robot.from_urdf(random_urdf(rng, 6))
    q, h = rng.uniform(-2, 2, (5, 6)), 1e-6
    J = robot.jacobian(q)
    for j in range(6):
        plus, minus = robot.fk(q + h * np.eye(6)[j]), robot.fk(q - h * np.eye(6)[j])
        spin = (
            (plus[:, :3, :3] - minus[:, :3, :3])
            / (2 * h)
            @ np.swapaxes(robot.fk(q)[:, :3, :3], -1, -2)
        )
        np.testing.assert_allclose(J[:, :3, j], (plus - minus)[:, :3, 3] / (2 * h), atol=1e-8)
        np.testing.assert_allclose(J[:, 3, j], spin[:, 2, 1], atol=1e-8)
        np.testing.assert_allclose(J[:, 4, j], spin[:, 0, 2], atol=1e-8)
        np.testing.assert_allclose(J[:, 5, j], spin[:, 1, 0], atol=1e-8)


def test_leading_dimensions_are_kept(reference_robot):
    q = np.random.default_rng(0).uniform(-1, 1, (2, 3, 6))
    assert reference_robot.fk(q).shape == (2, 3, 4, 4)
    assert reference_robot.jacobian(q).shape == (2, 3, 6, 6)
    np.testing.assert_array_equal(reference_robot.fk(q)[1, 2], reference_robot.fk(q[1, 2]))
    state = reference_robot.state(q)
    tip = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(
        state.point(tip), state.T_base_tip[..., :3, :3] @ tip + state.T_base_tip[..., :3, 3]
    )


@pytest.mark.parametrize("tip", ["turned", "along the last axis"])
@pytest.mark.parametrize("kind", ["straight", "almost straight", "askew"])
def test_frames_are_the_product_of_placements_and_turns(kind, tip):
    """Joint by joint with 4x4 matrices: axes along and against x, y and z, and askew."""
    rng = np.random.default_rng(1)
    R = se3.rotation_exp(rng.uniform(-3, 3, (7, 3)))
    R[2:5] = np.eye(3), np.eye(3)[[1, 2, 0]], np.diag([1, -1, -1])
    placements = se3.transform(R, rng.uniform(-1, 1, (7, 3)) * rng.integers(0, 2, (7, 3)))
    axes = rng.normal(size=(7, 3))
    if "straight" in kind:
        axes = np.vstack([np.eye(3), -np.eye(3), [[0, 0, 1]]])
        axes[::2, 1] += 2e-8 if kind == "almost straight" else 0.0
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    turned = se3.rotation_exp([0.3, 0.2, -1]) if tip == "turned" else se3.frame_about(axes[-1])
    mount = se3.transform(turned, [0.1, 0, 0.2])
    chain = SerialChain(placements, axes, mount)
    q = rng.uniform(-7, 7, (20, 7))
    state = chain.forward(q)
    for i in range(20):
        T = np.eye(4)
        for j in range(7):
            T = T @ placements[j] @ se3.transform(se3.rotation_exp(axes[j] * q[i, j]), np.zeros(3))
            np.testing.assert_allclose(state.rotations[i, j], T[:3, :3], atol=1e-14)
            np.testing.assert_allclose(state.origins[i, j], T[:3, 3], atol=1e-14)
            np.testing.assert_allclose(state.axes[i, j], T[:3, :3] @ axes[j], atol=1e-14)
        np.testing.assert_allclose(state.T_base_tip[i], T @ mount, atol=1e-14)
        # one posture goes by numbers, many by arrays: the same products in the same order
        alone = chain.forward(q[i])
        for name in ("rotations", "origins", "axes", "R_base_tip", "p_base_tip"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(state, name)[i])


def test_a_posture_gives_the_same_bits_in_any_batch(reference_robot):
    """Also across the blocks that batches are walked in."""
    q = np.random.default_rng(2).uniform(-6, 6, (2500, 6))
    whole = reference_robot.state(q)
    for part in (slice(0, 1), slice(1000, 1050), slice(1020, 1029), slice(2499, 2500)):
        alone = reference_robot.state(q[part])
        for name in ("rotations", "origins", "axes", "R_base_tip", "p_base_tip"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(whole, name)[part])
    assert reference_robot.state(np.empty((0, 6))).origins.shape == (0, 6, 3)


@pytest.mark.parametrize(
    ("posture", "message"),
    [
        (np.zeros(5), "has 6 joints, the posture has 5 values .*joint_1, .*joint_6"),
        (0.0, "has 6 joints, the posture has 0 values"),
        (np.zeros((6, 3)), "has 6 joints, the posture has 3 values"),
        ([0, 0, np.nan, 0, 0, 0], "the value of joint_3 is not a finite number"),
        ([[0.0] * 6, [0, 0, 0, 0, 0, np.inf]], "the value of joint_6 is not a finite number"),
    ],
)
def test_postures_are_checked(reference_robot, posture, message):
    for use in (reference_robot.fk, reference_robot.jacobian, reference_robot.check_limits):
        with pytest.raises(InputError, match=message):
            use(posture)


def test_the_first_joint_outside_its_limits_is_named(reference_robot):
    reference_robot.check_limits(reference_robot.lower)
    reference_robot.check_limits(reference_robot.upper)
    with pytest.raises(JointLimitError, match=r"^joint_5 131.2 deg is above 125.0 deg$") as caught:
        reference_robot.check_limits(np.deg2rad([0, 0, 0, 0, 131.2, 400]))
    assert caught.value.bound == pytest.approx((-125.0, 125.0))
    with pytest.raises(JointLimitError, match=r"joint_2 -61.0 deg is below -60.0 deg"):
        reference_robot.check_limits(np.deg2rad([0, -61, 0, 0, 0, 0]))


def test_a_robot_can_be_sent_to_a_worker_after_it_has_been_used(reference_robot):
    pose = reference_robot.fk(np.full(6, 0.3))
    before = reference_robot.inverse(pose)
    copy = pickle.loads(pickle.dumps(reference_robot))  # noqa: S301
    np.testing.assert_array_equal(copy.inverse(pose).postures, before.postures)


def test_unknown_frames_of_a_preset():
    with pytest.raises(RobotModelError, match=r"there is no link 'tool' \(did you mean tool0") as e:
        Robot.preset("r2000ic165f", tip="tool")
    assert e.value.name == "tool"
