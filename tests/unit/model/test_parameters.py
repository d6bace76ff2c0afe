"""Blocks of parameters: gravity torque against Pinocchio, what each block refuses."""

import numpy as np
import pinocchio as pin
import pytest

from calib import CalibrationModel, Robot, identify
from calib.errors import InputError
from calib.model import Setup, simulate
from calib.model.measurements import Measurements, Point, Pose, TouchUp
from calib.model.parameters import (
    BearingCompliance,
    JointCompliance,
    Payload,
    TargetFrame,
    TargetPoints,
    ToolBody,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
    gravity_torque,
)
from calib.robots.model_chain import STANDARD_GRAVITY
from calib.se3 import rotation_exp, transform

PAYLOAD = Payload(165.0, np.array([0.1, -0.05, 0.2]))


def torque_by_pinocchio(model: pin.Model, q: np.ndarray) -> np.ndarray:
    model.gravity.linear = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    data = model.createData()
    return -np.array([pin.computeGeneralizedGravity(model, data, row).copy() for row in q])


def with_payload(model: pin.Model, tip: str, payload: Payload) -> pin.Model:
    loaded = pin.Model(model)
    frame = loaded.frames[loaded.getFrameId(tip)]
    inertia = pin.Inertia(payload.mass_kg, payload.com_m, np.zeros((3, 3)))
    loaded.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    return loaded


@pytest.mark.parametrize("payload", [None, PAYLOAD], ids=["alone", "loaded"])
def test_gravity_torque_of_a_preset(reference_robot, payload):
    q = np.random.default_rng(0).uniform(reference_robot.lower, reference_robot.upper, (50, 6))
    model = pin.Model(reference_robot.model)
    if payload is not None:
        model = with_payload(model, "tool0", payload)
    expected = torque_by_pinocchio(model, q)
    assert np.abs(expected).max() > 1000.0
    np.testing.assert_allclose(gravity_torque(reference_robot, q, payload), expected, atol=1e-9)


@pytest.mark.parametrize("n", [1, 4, 7])
@pytest.mark.parametrize("loaded", [False, True])
def test_gravity_torque_of_random_arms(random_urdf, n, loaded):
    rng = np.random.default_rng(n)
    path = random_urdf(rng, n)
    robot, model = Robot.from_urdf(path), pin.buildModelFromUrdf(str(path))
    if loaded:
        model = with_payload(model, "tool0", PAYLOAD)
    q = rng.uniform(-3, 3, (20, n))
    torque = gravity_torque(robot, q, PAYLOAD if loaded else None)
    np.testing.assert_allclose(torque, torque_by_pinocchio(model, q), atol=1e-10)


def test_gravity_pulls_an_outstretched_arm_down(reference_robot):
    """Joint 2 turns the arm forward and down in its positive sense."""
    torque = gravity_torque(reference_robot, np.deg2rad([[0, 60, 0, 0, 0, 0]]))
    assert torque[0, 1] > 0
    assert torque[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_a_compliant_joint_gives_way_by_compliance_times_torque(reference_robot):
    block = JointCompliance(reference_robot, ["joint_3"], PAYLOAD)
    model = CalibrationModel(
        reference_robot, [block, ToolPoint([0, 0, 0], ""), TargetPoints([0, 0, 0])], TouchUp(1e-5)
    )
    q = np.deg2rad([[10, 20, -30, 40, -50, 60]])
    given = 1e-6
    shown = q.copy()
    shown[:, 2] += given * gravity_torque(reference_robot, q, PAYLOAD)[:, 2]
    at = model.predict(q, [given, 0, 0, 0])
    np.testing.assert_allclose(at[0], reference_robot.fk(shown)[0, :3, 3], atol=1e-13)


@pytest.mark.parametrize("block", [JointCompliance, BearingCompliance])
def test_what_is_kept_of_postures_is_of_these_and_of_their_payloads(reference_robot, block):
    """A fit asks for the torques at its postures again and again: others give others."""
    joints, payloads = reference_robot.joint_names[1:3], [Payload(0.0, np.zeros(3)), PAYLOAD]
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 5))
    kept = block(reference_robot, joints, payloads)

    def torques(one, setup):
        return one.torques(q, setup) if hasattr(one, "torques") else one.functions(q, setup)

    for setup in (Setup.of(5), Setup.of(5, payload=1), Setup.of(5, payload=[0, 1, 1, 0, 0])):
        q[1] += 0.1  # in place
        expected = torques(block(reference_robot, joints, payloads), setup)
        for _ in range(2):
            np.testing.assert_array_equal(torques(kept, setup), expected)
    with pytest.raises(InputError, match="has payload 3, 2 are known"):
        torques(kept, Setup.of(5, payload=2))


def test_zero_offsets_are_added_to_the_joint_they_name(reference_robot):
    block = ZeroOffsets(reference_robot, ["joint_5", "joint_2"])
    assert block.names == ("zero_offset.joint_5", "zero_offset.joint_2")
    model = CalibrationModel(
        reference_robot, [block, ToolPoint([0, 0, 0], ""), TargetPoints([0, 0, 0])], TouchUp(1e-5)
    )
    q = np.deg2rad([[10, 20, -30, 40, -50, 60]])
    turned = np.add(q, [0, 0.02, 0, 0, 0.05, 0])
    at = model.predict(q, [0.05, 0.02, 0, 0, 0])
    np.testing.assert_allclose(at[0], reference_robot.fk(turned)[0, :3, 3], atol=1e-14)


def test_tool_point_frees_only_the_axes_asked_for():
    tool = ToolPoint([1, 2, 3], "zx")
    assert tool.names == ("tool.z", "tool.x")
    np.testing.assert_array_equal(tool.nominal, [3, 1])
    np.testing.assert_array_equal(tool.position_m, [1, 2, 3])
    assert ToolPoint([1, 2, 3], "").names == ()


def test_targets_are_named_by_their_labels():
    targets = TargetPoints([[1, 2, 3], [4, 5, 6]], ["left", "right"])
    assert targets.names == (
        *("target.left.x", "target.left.y", "target.left.z"),
        *("target.right.x", "target.right.y", "target.right.z"),
    )
    np.testing.assert_array_equal(targets.nominal, [1, 2, 3, 4, 5, 6])
    assert TargetPoints([1, 2, 3]).names == ("target.T1.x", "target.T1.y", "target.T1.z")


def test_what_places_the_set_up_is_a_nuisance(make_model, reference_robot):
    model = make_model(extra=(JointCompliance(reference_robot, ["joint_2"]),))
    assert model.nuisance.tolist() == [False] * 5 + [True] * 6
    assert model.units == ("rad",) * 4 + ("rad/Nm",) + ("m",) * 6
    np.testing.assert_array_equal(model.nominal[:5], 0.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda r: ZeroOffsets(r, ["joint_7"]), r"has no joint 'joint_7' \(did you mean joint_"),
        (lambda r: JointCompliance(r, ["wrist"]), r"has no joint 'wrist' \(known: joint_1, "),
        (lambda r: ZeroOffsets(r, ["joint_2", "joint_2"]), "joint 'joint_2' is listed twice"),
        (lambda r: ToolPoint([0, 0]), "each tool point needs three finite numbers"),
        (lambda r: ToolPoint([0, 0, np.nan]), "each tool point needs three finite numbers"),
        (lambda r: ToolPoint([0, 0, 0], "xw"), "free axes of the tool 'x w'"),
        (lambda r: ToolPoint([0, 0, 0], "xx"), "free axes of the tool 'x x'"),
        (lambda r: TargetPoints([0, 0]), "each target needs three finite numbers"),
        (lambda r: TargetPoints([[0, 0, 0]] * 2), "each target needs three finite numbers"),
        (lambda r: TargetPoints([0, np.inf, 0]), "each target needs three finite numbers"),
        (lambda r: TargetPoints([[0, 0, 0]] * 2, ["a", "a"]), "two targets have the same name"),
    ],
)
def test_refusals(reference_robot, make, message):
    with pytest.raises(InputError, match=message):
        make(reference_robot)


def test_gravity_pulls_down_whatever_frame_is_the_base(tmp_path):
    """An arm on a wall: its base frame is tilted against the root of the description."""
    (tmp_path / "wall.urdf").write_text(
        """<robot name="wall"><link name="world"/><link name="base"/>
        <link name="arm"><inertial><mass value="5"/><origin xyz="1 0 0"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="mount" type="fixed"><parent link="world"/><child link="base"/>
        <origin rpy="1.5707963267948966 0 0"/></joint>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="0"/></joint></robot>"""
    )
    torques = [
        gravity_torque(Robot.from_urdf(tmp_path / "wall.urdf", tip="arm", base=base), np.zeros(1))
        for base in ("world", "base")
    ]
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-9)
    assert abs(torques[0][0]) == pytest.approx(5 * STANDARD_GRAVITY, rel=1e-9)


ROBOT = Robot.preset("ur5e")
PLACES = np.array([[0.1, 0.0, 0.0], [0.0, 0.12, 0.02], [-0.05, -0.06, 0.03]])
LABELS = ("P", "Q", "R")
T_BODY = transform(rotation_exp(np.array([0.4, -1.0, 0.7])), [0.02, 0.05, 0.1])
T_TARGET = transform(rotation_exp(np.array([0.1, 0.2, 2.0])), [0.8, -0.3, 0.2])
X = np.array([0.01, -0.02, 0.03, 0.3, -0.2, 0.1])


def test_distances_stay_and_the_pose_is_that_of_a_frame():
    q = np.random.default_rng(0).uniform(-2, 2, (3, ROBOT.n))
    setup = Setup.of(3, tool=[0, 1, 2])
    body = CalibrationModel(
        ROBOT, [ToolBody(PLACES, LABELS, T_BODY), TargetFrame(T_TARGET, free=())], Point(1e-4)
    )
    frame = CalibrationModel(ROBOT, [ToolFrame(T_BODY), TargetFrame(T_TARGET, free=())], Pose(1e-4))
    x = body.nominal + X
    assert frame.nominal == pytest.approx(body.nominal)
    view = frame.view(q, x)
    turned = np.moveaxis(view.tool, -1, 0).swapaxes(1, 2)  # R_base_body of each posture
    expected = view.tool_points + np.einsum("nij,nj->ni", turned, PLACES)
    np.testing.assert_allclose(body.view(q, x, setup).tool_points, expected, atol=1e-12)


@pytest.mark.parametrize("kind", [Point(1e-5), Pose(1e-5)])
def test_it_is_found_from_readings(kind):
    """Also where a pose is read: the start is then that of the nominal body."""
    rng = np.random.default_rng(2)
    count = 20
    q = np.repeat(rng.uniform(-2, 2, (count, ROBOT.n)), 3, axis=0)
    setup = Setup.of(3 * count, tool=np.tile([0, 1, 2], count))
    blocks = [
        ZeroOffsets(ROBOT, ROBOT.joint_names[1:5]),
        ToolBody(PLACES, LABELS, T_BODY),
        TargetFrame(T_TARGET),
    ]
    truth = CalibrationModel(ROBOT, blocks, kind)
    x = truth.nominal + rng.normal(0.0, 0.01, truth.p)
    read = simulate(truth, x, q, None, setup=setup)
    data = Measurements(q, setup, truth.targets, truth.tools, read.observed)
    result = identify(truth, data)
    np.testing.assert_allclose(result.values, x, atol=1e-9)
    assert result.names[4:10] == tuple(f"tool.body.{a}" for a in ("x", "y", "z", "rx", "ry", "rz"))


def test_what_is_refused():
    with pytest.raises(InputError, match="each point of the body needs three finite numbers"):
        ToolBody(PLACES[:, :2], LABELS)
    with pytest.raises(InputError, match="two tools have the same name"):
        ToolBody(PLACES, ("P", "Q", "P"))
    with pytest.raises(InputError, match="a prior of -1 cannot be used"):
        ToolBody(PLACES, LABELS, prior_m=-1.0)
