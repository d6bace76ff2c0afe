"""What else gives way under gravity: bearings across their joint, and lost motion about it."""

import numpy as np
import pinocchio as pin
import pytest

from calib import CalibrationModel, Robot, se3
from calib.errors import InputError
from calib.model import Setup
from calib.model.measurements import Pose
from calib.model.parameters import (
    BearingCompliance,
    JointCompliance,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    Payload,
    TargetPoints,
    ToolPoint,
    gravity_torque,
)
from calib.robots.model_chain import STANDARD_GRAVITY

PAYLOADS = (Payload(30.0, np.array([0.1, -0.05, 0.2])), Payload(5.0, np.array([0.0, 0.3, 0.1])))
TYPICAL = {"m": 2e-3, "rad": 5e-3, "rad/Nm": 1e-5, "rad/rad": 1e-3}


def model_of(robot: Robot, blocks: list[ParameterBlock]) -> CalibrationModel:
    frames = [ToolPoint([0.1, -0.05, 0.2], ""), TargetPoints([0.3, 0.2, 0.1], free=False)]
    return CalibrationModel(robot, [*blocks, *frames], Pose(1e-4))


def across(axis: np.ndarray) -> list[np.ndarray]:
    """Two unit vectors across an axis: one next to the frame axis that is farthest from it."""
    farthest, next_one, _ = np.argsort(np.abs(axis))
    x = np.eye(3)[farthest] - axis * axis[farthest]
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    pair = {farthest: x, next_one: y * np.sign(y[next_one])}
    return [pair[k] for k in sorted(pair)]


def tilted(model: pin.Model, joint: int, vector: np.ndarray) -> pin.Model:
    """The model with the frame of a joint (from 1) turned by a rotation vector in its own axes."""
    other = pin.Model(model)
    placement = other.jointPlacements[joint]
    turned = placement.rotation @ se3.rotation_exp(vector)
    other.jointPlacements[joint] = pin.SE3(turned, placement.translation)
    return other


def energy(model: pin.Model, q: np.ndarray) -> float:
    model.gravity.linear = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    return float(pin.computePotentialEnergy(model, model.createData(), q))


@pytest.fixture(params=["preset", "random"])
def arm(request, random_urdf) -> Robot:
    """An arm with axes along its frames, and one with axes and frames of any direction."""
    if request.param == "preset":
        return Robot.preset("ur5e")
    return Robot.from_urdf(random_urdf(np.random.default_rng(3), 5))


def test_a_bearing_tilts_by_its_compliance_times_the_work_of_gravity(arm):
    """The torque about an axis is what the potential energy loses with a turn about it."""
    compliance, step = 2e-6, 1e-5
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (4, arm.n))
    block = BearingCompliance(arm, arm.joint_names)
    model = model_of(arm, [block])
    tip = arm.model.getFrameId(arm.tip_frame)
    largest = 0.0
    for k in range(block.size):
        joint, which = divmod(k, 2)
        axis = across(arm.chain.axes[joint])[which]
        x = np.zeros(block.size)
        x[k] = compliance
        found = model.view(q, x).T_base_tip
        for posture, T in zip(q, found, strict=True):
            up, down = (
                energy(tilted(arm.model, joint + 1, s * step * axis), posture) for s in (1, -1)
            )
            torque = (down - up) / (2 * step)
            largest = max(largest, abs(torque))
            bent = tilted(arm.model, joint + 1, compliance * torque * axis)
            data = bent.createData()
            pin.framesForwardKinematics(bent, data, posture)
            np.testing.assert_allclose(T, data.oMf[tip].homogeneous, atol=1e-10)
    assert largest > 5.0


def test_bearing_and_reducer_share_the_whole_torque(arm):
    """The parts across and along the axis are those of one vector, payload included."""
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (6, arm.n))
    block = BearingCompliance(arm, arm.joint_names, PAYLOADS[0])
    sideways = block.torques(q.T.copy(), Setup.of(6)).T.reshape(6, arm.n, 2)
    along = gravity_torque(arm, q, PAYLOADS[0])
    squared = np.sum(sideways**2, axis=-1) + along**2
    state = arm.chain.forward(q)
    point = se3.apply(state.T_base_tip, PAYLOADS[0].com_m)
    moment, weight = PAYLOADS[0].mass_kg * point, PAYLOADS[0].mass_kg
    for j in reversed(range(arm.n)):
        com = state.origins[:, j] + (state.rotations[:, j] @ arm.link_com[j])
        moment, weight = moment + arm.link_mass[j] * com, weight + arm.link_mass[j]
        torque = np.cross(moment - weight * state.origins[:, j], arm.gravity)
        np.testing.assert_allclose(squared[:, j], np.sum(torque**2, axis=1), rtol=1e-9)


def test_all_that_displaces_a_frame_adds_up(arm):
    """Link geometry and bearing make one rotation vector, whichever block comes first."""
    rng = np.random.default_rng(2)
    q = rng.uniform(-2.0, 2.0, (3, arm.n))
    geometry, bearing = LinkGeometry(arm), BearingCompliance(arm, arm.joint_names)
    values = [rng.normal(size=b.size) * [TYPICAL[u] for u in b.units] for b in (geometry, bearing)]
    one = model_of(arm, [geometry, bearing]).predict(q, np.concatenate(values))
    other = model_of(arm, [bearing, geometry]).predict(q, np.concatenate(values[::-1]))
    np.testing.assert_allclose(one, other, atol=1e-14)
    # the same as the geometry with the tilt of each posture written into it
    torque = bearing.torques(q.T.copy(), Setup.of(3))
    for posture in range(3):
        six = values[0].reshape(arm.n, 6).copy()
        for k in range(bearing.size):
            tilt = values[1][k] * torque[k, posture]
            six[k // 2, 3:] += tilt * across(arm.chain.axes[k // 2])[k % 2]
        alone = model_of(arm, [geometry]).predict(q[posture : posture + 1], six.ravel())
        np.testing.assert_allclose(one[posture], alone[0], atol=1e-13)


def test_bearings_are_named_by_the_axes_across():
    robot = Robot.preset("r2000ic165f")
    along = [int(np.argmax(np.abs(axis))) for axis in robot.chain.axes]
    block = BearingCompliance(robot, robot.joint_names, prior=1e-7)
    expected = [
        f"bearing.{joint}.{letter}"
        for joint, k in zip(robot.joint_names, along, strict=True)
        for letter in "xyz".replace("xyz"[k], "")
    ]
    assert list(block.names) == expected
    assert set(block.units) == {"rad/Nm"}
    np.testing.assert_array_equal(block.prior, 1e-7)
    np.testing.assert_array_equal(block.nominal, 0.0)


def test_lost_motion_leans_to_the_side_that_gravity_pushes():
    robot = Robot.preset("ur5e")
    joint = robot.joint_names[1]
    block = LostMotion(robot, [joint], 10.0, prior_rad=1e-3)
    q = np.zeros((3, robot.n))
    q[:, 1] = [0.0, -np.pi, -np.pi / 2]  # stretched to the one side, to the other, and up
    torque = gravity_torque(robot, q)[:, 1]
    assert (np.abs(torque[:2]) > 50.0).all()
    assert torque[0] * torque[1] < 0
    shown = model_of(robot, [block]).view(q, [2e-4]).joint_errors
    np.testing.assert_allclose(shown[:2, 1], 2e-4 * np.sign(torque[:2]), rtol=1e-3)
    np.testing.assert_allclose(shown[:, 1], 2e-4 * np.tanh(torque / 10.0), rtol=1e-12)
    np.testing.assert_array_equal(np.delete(shown, 1, axis=1), 0.0)
    assert block.names == (f"lost_motion.{joint}",)
    assert block.units == ("rad",)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda r: BearingCompliance(r, ["elbow"]), "has no joint 'elbow'"),
        (lambda r: BearingCompliance(r, ["wrist_1_joint"], prior=0.0), "a prior of 0 cannot"),
        (lambda r: LostMotion(r, ["elbow"], 1.0), "has no joint 'elbow'"),
        (lambda r: LostMotion(r, r.joint_names, [1.0, 2.0]), "2 torques for the lost motion of 6"),
        (lambda r: LostMotion(r, r.joint_names, 0.0), "must be a number above zero"),
        (lambda r: LostMotion(r, r.joint_names, np.nan), "must be a number above zero"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(InputError, match=message):
        make(Robot.preset("ur5e"))


@pytest.mark.parametrize(
    "kind", [BearingCompliance, JointCompliance, lambda r, j: LostMotion(r, j, 1.0)]
)
def test_a_payload_that_nobody_knows_is_refused(kind):
    robot = Robot.preset("ur5e")
    model = model_of(robot, [kind(robot, robot.joint_names)])
    with pytest.raises(InputError, match="has payload 2, 1 are known"):
        model.predict(np.zeros((1, robot.n)), setup=Setup.of(1, payload=1))
