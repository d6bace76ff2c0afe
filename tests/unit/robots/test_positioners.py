"""Arms beside positioners that carry the target: kinematics, inverse, loads, corrected files."""

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot
from calib.correction import corrected_robot, corrected_urdf
from calib.errors import InputError, RobotModelError
from calib.model import CalibrationModel, Setup
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    GravityLoad,
    JointCompliance,
    LinkGeometry,
    Payload,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.robots.one_posture import OnePosture
from calib.robots.robot import with_placements
from calib.se3 import rotation_exp, transform
from calib.vision.touch_up import follow
from posedesign.cell.cell import moved_as_base, usual_offset_joints
from tests.positioners import ONE_AXIS, TWO_AXES, beside_positioner

KINDS = {
    "two axes": ("r2000ic165f", TWO_AXES, False),
    "one axis": ("ur10e", ONE_AXIS, False),
    "and a rail": ("ur10e", TWO_AXES, True),
}


@pytest.fixture(scope="module", params=KINDS)
def robot(request, tmp_path_factory) -> Robot:
    preset, joints, rail = KINDS[request.param]
    path = tmp_path_factory.mktemp("positioners") / "robot.urdf"
    path.write_text(beside_positioner(preset, joints, rail=rail))
    return Robot.from_urdf(path, tip=Robot.preset(preset).tip_frame, base="plate")


def described(robot: Robot) -> str:
    """The text that a robot was read from."""
    rail = "rail" in robot.joint_names
    of = next(k for k in KINDS.values() if len(k[1]) == robot.floor and k[2] == rail)
    return beside_positioner(*of[:2], rail=rail)


def postures(robot: Robot, count: int = 12) -> np.ndarray:
    return np.random.default_rng(5).uniform(robot.lower, robot.upper, (count, robot.n))


def by_pinocchio(robot: Robot, q: np.ndarray) -> tuple[pin.Data, np.ndarray]:
    """Its data at a posture, all frames placed, and the whole tree's configuration."""
    model, data = robot.model, robot.model.createData()
    whole = pin.neutral(model)
    for name, value in zip(robot.joint_names, q, strict=True):
        whole[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, whole)
    return data, whole


def test_kinematics_are_those_of_both_branches_of_the_tree(robot):
    plate, tip = (robot.model.getFrameId(name) for name in ("plate", robot.tip_frame))
    for q in postures(robot):
        data, _ = by_pinocchio(robot, q)
        T = data.oMf[plate].inverse()
        np.testing.assert_allclose(robot.fk(q), (T * data.oMf[tip]).homogeneous, atol=1e-12)
        world = robot.T_base_floor(q) @ robot.T_floor_world
        np.testing.assert_allclose(world, T.homogeneous, atol=1e-12)
        np.testing.assert_allclose(OnePosture(robot).tip(q), robot.fk(q), atol=1e-12)


def test_jacobians_are_differences(robot):
    q, step = postures(robot, 5), 1e-6
    J = robot.jacobian(q)
    for j in range(robot.n):
        by = step * np.eye(robot.n)[j]
        ahead, behind = robot.fk(q + by), robot.fk(q - by)
        moved = (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(J[:, :3, j], moved[:, :3, 3], atol=1e-8)
        turned = moved[:, :3, :3] @ np.swapaxes(robot.fk(q)[:, :3, :3], -1, -2)
        found = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(J[:, 3:, j], found, atol=1e-8)


def test_every_pose_is_taken_and_from_several_angles_of_the_table(robot):
    q = postures(robot, 4)
    T = robot.fk(q)
    near = (robot.lower + robot.upper) / 2.0
    solved = robot.inverse(T, near=near)
    off = np.abs(robot.fk(solved.postures) - T[solved.pose]).max(axis=(1, 2))
    assert off.max() < 1e-8
    good = solved.postures[solved.inside]
    assert ((good >= robot.lower - 1e-8) & (good <= robot.upper + 1e-8)).all()
    assert len(np.unique(solved.pose[solved.inside])) == 4
    assert len(np.unique(good[:, : robot.floor].round(6), axis=0)) > 5
    found, there = robot.inverse(T[:1], near=q[0]).nearest()
    assert there.all()
    np.testing.assert_allclose(found[0], q[0], atol=1e-7)


def test_labels_count_from_the_foot_and_values_are_degrees(robot):
    labels = dict(zip(robot.joint_names, robot.joint_labels, strict=True))
    numbers = ["rail", "tilt", "turn"]
    there = [name for name in numbers if name in labels]
    assert [labels[name] for name in there] == [f"E{k}" for k in range(1, len(there) + 1)]
    units = dict(zip(robot.joint_names, robot.joint_units, strict=True))
    assert {units[name] for name in there} == ({"mm", "deg"} if "rail" in labels else {"deg"})
    q = postures(robot, 2)
    np.testing.assert_allclose(robot.shown(q)[:, 0], np.rad2deg(q[:, 0]))


@pytest.mark.parametrize("payload", [None, Payload(12.0, np.array([0.03, -0.02, 0.2]))])
def test_gravity_is_that_of_the_world(robot, payload):
    """Against the whole tree, whose root is level, by Pinocchio."""
    q = postures(robot, 8)
    load = GravityLoad(robot, payload)
    torque = load.joint_torque(np.ascontiguousarray(q.T), Setup.of(len(q))).T
    model = robot.model.copy()
    frame = model.frames[model.getFrameId(robot.tip_frame)]
    if payload is not None:
        own = pin.Inertia(payload.mass_kg, payload.com_m, np.zeros((3, 3)))
        model.appendBodyToJoint(frame.parentJoint, own, frame.placement)
    columns = [model.joints[model.getJointId(n)].idx_v for n in robot.joint_names]
    level = model.gravity.linear[2] / -9.80665  # Pinocchio's own constant is 9.81
    k = robot.n_external
    one = OnePosture(robot, *(() if payload is None else (payload.mass_kg, payload.com_m)))
    for i, posture in enumerate(q):
        _, whole = by_pinocchio(robot, posture)
        expected = -pin.computeGeneralizedGravity(model, model.createData(), whole)[columns]
        np.testing.assert_allclose(torque[i, k:] * level, expected[k:], rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(one.gravity_torque(posture)[k:], torque[i, k:], atol=1e-7)
    assert not torque[:, :k].any()
    assert np.ptp(torque[:, k + 1]) > 1.0


TOOL_M = np.array([0.05, 0.02, 0.2])
TARGETS_M = np.array([[0.1, 0.05, 0.15], [-0.12, 0.2, 0.25]])


def model_of(robot: Robot, joints: tuple[str, ...], targets_m: np.ndarray) -> CalibrationModel:
    blocks = [
        ZeroOffsets(robot, joints),
        ToolPoint(TOOL_M, "xyz"),
        TargetPoints(targets_m, ["T1", "T2"]),
    ]
    return CalibrationModel(robot, blocks, TouchUp(np.full(3, 1e-5)))


def touches_of(robot: Robot) -> tuple[np.ndarray, Setup]:
    """Postures that touch two targets, and which of them."""
    rng, q, which = np.random.default_rng(1), [], []
    for k in range(10):
        R = rotation_exp(rng.uniform(-0.9, 0.9, (4, 3))) @ np.diag([1.0, -1.0, -1.0])
        tips = transform(R, TARGETS_M[k % 2] - R @ TOOL_M)
        near = rng.uniform(robot.lower, robot.upper)
        found, there = robot.inverse(tips, near=near).nearest()
        q += [*found[there]]
        which += [k % 2] * int(there.sum())
    assert len(q) > 15
    return np.array(q), Setup.of(len(q), target=np.array(which))


def rank_of(
    robot: Robot, joints: tuple[str, ...], touches: tuple[np.ndarray, Setup]
) -> tuple[int, int]:
    """Rank and number of parameters of zero offsets, tool and two targets that are touched."""
    model, (q, setup) = model_of(robot, joints, TARGETS_M), touches
    J = model.jacobian(q, setup=setup).reshape(-1, model.p)
    return int(np.linalg.matrix_rank(J / np.linalg.norm(J, axis=0), tol=1e-9)), model.p


def test_zeros_that_targets_take_up_are_left_out_and_no_others(robot):
    absorbed = moved_as_base(robot)
    assert absorbed == ("turn",)
    usual = usual_offset_joints(robot)
    assert "turn" not in usual
    assert usual[-1] == robot.joint_names[-2]
    touches = touches_of(robot)
    rank, count = rank_of(robot, usual, touches)
    assert rank == count
    assert robot.arm_joints[0] in usual
    assert ("tilt" in usual) == (robot.floor == 2)
    if "rail" in robot.joint_names:  # behind a table its zero is told, and may be listed
        rank, count = rank_of(robot, (*usual, "rail"), touches)
        assert rank == count
    rank, count = rank_of(robot, ("turn", *usual), touches)
    assert rank == count - 1


def test_a_table_that_turns_about_the_arm_s_own_axis_does_not_tell_its_zero(tmp_path):
    text = beside_positioner("ur10e", ONE_AXIS)
    text = text.replace('xyz="0.9 0.1 0.7" rpy="0.02 -0.03 0.01"', 'xyz="0 0 0.2" rpy="0 0 0"')
    text = text.replace('xyz="0.1 0.05 0" rpy="0 0 0.1"', 'xyz="0 0 0" rpy="0 0 0"')
    text = text.replace('xyz="0 0 0.2" rpy="0 0.03 0.2"', 'xyz="0 0 0.2" rpy="0 0 0.2"')
    text = text.replace('xyz="0 0.01 0.05"', 'xyz="0.7 0 0.05"')  # of the plate
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    robot = Robot.from_urdf(path, tip="tool0", base="plate")
    assert moved_as_base(robot) == ("turn", "shoulder_pan_joint")
    rank, count = rank_of(robot, usual_offset_joints(robot), touches_of(robot))
    assert rank == count


def test_the_corrected_file_is_the_corrected_chain(robot, tmp_path):
    """With zero offsets of all joints, and links displaced: read anew it is the same robot."""
    preset = next(
        v
        for v in KINDS.values()
        if len(v[1]) == robot.floor and v[2] == ("rail" in robot.joint_names)
    )
    source = tmp_path / "robot.urdf"
    source.write_text(beside_positioner(*preset[:2], rail=preset[2]))
    links = LinkGeometry(robot)
    assert not any(name.startswith("link.turn.") for name in links.names)
    blocks = [ZeroOffsets(robot, robot.joint_names), links]
    model = CalibrationModel(
        robot,
        [*blocks, TargetPoints([[0.1, 0.0, 0.2]]), ToolPoint([0, 0, 0.1], "xyz")],
        TouchUp(np.full(3, 1e-5)),
    )
    rng = np.random.default_rng(2)
    x = model.nominal + 2e-3 * rng.standard_normal(model.p)
    found = corrected_robot(model, x)
    q = postures(robot, 6)
    np.testing.assert_allclose(found.robot.fk(q), model.view(q, x).T_base_tip, atol=1e-12)
    path = tmp_path / "corrected.urdf"
    path.write_bytes(corrected_urdf(found, source))
    again = Robot.from_urdf(path, tip=robot.tip_frame, base="plate")
    np.testing.assert_allclose(again.fk(q), found.robot.fk(q), atol=1e-12)
    for one, other in (
        (again.gravity, found.robot.gravity),
        (again.T_floor_world, found.robot.T_floor_world),
    ):
        np.testing.assert_allclose(one, other, atol=1e-12)
    for one, other in zip(again.bodies, found.robot.bodies, strict=True):
        np.testing.assert_allclose(one.T_link_body, other.T_link_body, atol=1e-12)


def test_the_joint_that_moves_the_base_keeps_its_place_in_it(robot):
    placed = robot.chain.placements.copy()
    placed[0, 0, 3] += 1e-3
    with pytest.raises(RobotModelError, match="turn would sit elsewhere in plate, which it moves"):
        with_placements(robot, placed)
    with pytest.raises(InputError, match="'turn' is a positioner's, and what it carries is not"):
        JointCompliance(robot, ["turn"])


def test_the_table_stays_where_the_arm_follows_a_tool(robot):
    q = postures(robot)
    T = robot.fk(q)
    T[:, :3, 3] += [0.01, -0.02, 0.015]
    found, there = follow(robot, q, T)
    assert there.mean() > 0.4
    k = robot.n_external
    np.testing.assert_array_equal(found[:, :k], q[:, :k])
    np.testing.assert_allclose(robot.fk(found[there]), T[there], atol=1e-8)


def test_what_is_no_positioner_is_refused(tmp_path):
    path = tmp_path / "robot.urdf"
    many = [(f"t{k}", "0 0 1", "-3", "3", "0.3 0 0.1", "0.1 0 0") for k in range(4)]
    path.write_text(beside_positioner("ur10e", tuple(many)))
    with pytest.raises(RobotModelError, match="4 joints carry the base, more than 3: t3, t2, t1"):
        Robot.from_urdf(path, tip="tool0", base="plate")
    held = Robot.from_urdf(path, tip="tool0", base="plate", lock=["t0", "t1"])
    assert held.joint_names[:2] == ("t3", "t2")
    path.write_text(
        beside_positioner("ur10e").replace(
            'name="tilt" type="revolute"', 'name="tilt" type="prismatic"'
        )
    )
    with pytest.raises(RobotModelError, match="joint tilt slides, and carries the base"):
        Robot.from_urdf(path, tip="tool0", base="plate")
    with pytest.raises(RobotModelError, match="world does not hang on plate"):
        Robot.from_urdf(path, tip="world", base="plate")


def test_a_positioner_that_is_held_is_none(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(beside_positioner("ur10e"))
    moving = Robot.from_urdf(path, tip="tool0", base="plate")
    held = Robot.from_urdf(path, tip="tool0", base="plate", held_rad={"tilt": 0.4, "turn": -1.1})
    assert (held.n, held.n_external) == (6, 0)
    q = np.concatenate([[-1.1, 0.4], np.full(6, 0.3)])
    np.testing.assert_allclose(moving.fk(q), held.fk(q[2:]), atol=1e-12)
    load = [
        GravityLoad(r).joint_torque(x[:, None], Setup.of(1))
        for r, x in ((moving, q), (held, q[2:]))
    ]
    np.testing.assert_allclose(load[0][2:], load[1], atol=1e-9)


@pytest.mark.parametrize("preset", ["r2000ic165f", "irb120"])
def test_a_plate_that_faces_the_arm_turns_no_sign_of_it(preset, tmp_path):
    """Makers count joints from where the arm stands, and not from the plate."""
    path = tmp_path / "robot.urdf"
    text = beside_positioner(preset).replace('"base"', '"elsewhere"')  # the controller's world
    path.write_text(text.replace('rpy="0 0 0.3"', 'rpy="0 0 3.0"'))
    tip = Robot.preset(preset).tip_frame
    robot = Robot.from_urdf(path, tip=tip, base="plate")
    assert not robot.model.existFrame("base")
    maker = Robot.preset(preset).controller.maker
    seen, alone = robot.controlled_by(maker).controller, Robot.preset(preset).controller
    q = postures(robot, 5)
    np.testing.assert_allclose(seen.pendant(q)[:, 2:], alone.pendant(q[:, 2:]), atol=1e-9)
    np.testing.assert_allclose(seen.pendant(q)[:, :2], np.rad2deg(q[:, :2]))
