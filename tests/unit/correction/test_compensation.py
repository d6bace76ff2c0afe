"""Commands that bring the real arm where the nominal one was meant to go."""

from dataclasses import replace

import numpy as np
import pytest

from calib import CalibrationModel, Robot, se3
from calib.correction import compensate, corrected_robot
from calib.correction.compensation import CLOSED
from calib.errors import InputError
from calib.model import Setup
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    BearingCompliance,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LinkGeometry,
    LostMotion,
    Payload,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.robots import preset_names

SIZES = {"rad": 3e-3, "m": 2e-3, "rad/Nm": 1e-6, "rad/rad": 1e-3}
LOADS = (Payload(50.0, [0.0, 0.0, 0.1]), Payload(165.0, [0.1, 0.0, 0.2]))

STRETCHED = np.pi / 2 - np.arctan2(225.0, 1280.0)
"""Joint 3 of the reference robot with its wrist in line with joints 2 and 3."""


def whole_model(robot: Robot) -> CalibrationModel:
    """Every error that a block can describe, motor shafts included."""
    joints = robot.joint_names
    blocks = [
        ZeroOffsets(robot, joints),
        LinkGeometry(robot),
        JointCompliance(robot, joints, LOADS),
        BearingCompliance(robot, joints[1:3], LOADS),
        JointHarmonics(robot, joints[:3], [1.0, 2.0]),
        JointScale(robot, joints[:2]),
        LostMotion(robot, joints[1:3], 50.0, LOADS),
        ToolPoint([0.02, -0.05, 0.2]),
        TargetPoints([[1.0, 0.0, 0.5]]),
    ]
    return CalibrationModel(robot, blocks, TouchUp(1e-5))


def random_values(model: CalibrationModel, rng: np.random.Generator) -> np.ndarray:
    size = np.array([SIZES[unit] for unit in model.units])
    return model.nominal + size * rng.uniform(-1, 1, model.p)


def clear_postures(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Postures 5 deg inside all limits and away from singularities."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        q = rng.uniform(robot.lower + 0.09, robot.upper - 0.09)
        far = robot.chain.smallest_singular_values(robot.state(q[None]))[0] > 0.06
        if far and all(limit.margin(q) > 0.09 for limit in robot.coupled_limits):
            found.append(q)
    return np.array(found)


def tool_poses(model: CalibrationModel, q: np.ndarray, x=None, setup=None) -> np.ndarray:
    view = model.view(q, x, setup)
    return se3.transform(view.T_base_tip[:, :3, :3], view.tool_points)


@pytest.mark.parametrize("name", preset_names())
def test_the_real_tool_goes_where_the_nominal_one_would(name):
    robot = Robot.preset(name)
    model = whole_model(robot)
    rng = np.random.default_rng(len(name))
    q = clear_postures(robot, 40)
    x = random_values(model, rng)
    found = compensate(model, x, postures=q)
    off = tool_poses(model, found.postures, x) - tool_poses(model, q)
    assert np.abs(tool_poses(model, q, x) - tool_poses(model, q)).max() > 1e-3
    assert np.abs(off).max() < CLOSED
    assert set(found.status) <= {"reached"}
    assert found.reasons == ("",) * 40
    assert found.ok.all()
    assert found.error_m.max() < CLOSED
    assert found.error_rad.max() < CLOSED
    np.testing.assert_allclose(found.T_base_tip, robot.fk(found.postures), atol=0)
    np.testing.assert_array_equal(found.nominal, q)


def test_tip_alone_and_payloads(reference_robot):
    model = whole_model(reference_robot)
    x = random_values(model, np.random.default_rng(7))
    q = clear_postures(reference_robot, 40)
    loads = Setup.of(40, payload=np.arange(40) % 2)
    found = compensate(model, x, postures=q, setup=loads, point="tip")
    real = model.view(found.postures, x, loads).T_base_tip
    np.testing.assert_allclose(real, reference_robot.fk(q), atol=CLOSED)
    other = compensate(model, x, postures=q, point="tip")
    apart = np.abs(other.postures - found.postures).max(axis=1)
    assert (apart[1::2] > 1e-6).all()
    assert apart[::2].max() < 1e-12


def test_poses_are_taken_in_the_configuration_next_to_a_posture(reference_robot):
    model = whole_model(reference_robot)
    x = random_values(model, np.random.default_rng(8))
    near = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
    q = near + np.random.default_rng(0).uniform(-0.2, 0.2, (30, 6))
    wanted = tool_poses(model, q)
    found = compensate(model, x, poses=wanted, near=near)
    assert found.ok.all()
    np.testing.assert_allclose(found.nominal, q, atol=1e-9)
    assert np.abs(found.change).max() < 0.2
    np.testing.assert_allclose(tool_poses(model, found.postures, x), wanted, atol=CLOSED)
    # from postures of another configuration, it is kept
    flipped = q + np.array([0, 0, 0, np.pi, 0, np.pi])
    flipped[:, 4] *= -1
    other = compensate(model, x, poses=wanted, postures=flipped)
    assert other.ok.all()
    assert np.abs(other.change).max() < 0.2
    np.testing.assert_allclose(tool_poses(model, other.postures, x), wanted, atol=CLOSED)


def test_without_errors_nothing_changes(reference_robot):
    model = whole_model(reference_robot)
    q = clear_postures(reference_robot, 20)
    found = compensate(model, model.nominal, postures=q)
    np.testing.assert_array_equal(found.postures, q)
    np.testing.assert_array_equal(found.change, 0.0)


def test_chain_and_command_agree(reference_robot):
    """Of what a chain can hold, the corrected robot's own inverse kinematics is the command."""
    tool, target = ToolPoint([0.0, 0.0, 0.2], ""), TargetPoints([[1.0, 0.0, 0.5]], free=False)
    blocks = [LinkGeometry(reference_robot), ZeroOffsets(reference_robot, ["joint_2", "joint_3"])]
    model = CalibrationModel(reference_robot, [*blocks, tool, target], TouchUp(1e-5))
    x = random_values(model, np.random.default_rng(2))
    q = clear_postures(reference_robot, 10)
    found = compensate(model, x, postures=q)
    corrected = corrected_robot(model, x).robot
    for wanted, command in zip(reference_robot.fk(q), found.postures, strict=True):
        answers = corrected.inverse(wanted[None], near=command)
        assert np.abs(answers.of(0) - command).max(axis=1).min() < 1e-7


def test_cartesian_points_of_the_controllers_tool(reference_robot):
    model = whole_model(reference_robot)
    x = random_values(model, np.random.default_rng(3))
    found = compensate(model, x, postures=clear_postures(reference_robot, 5))
    T_tip_tool = se3.transform(se3.rotation_exp([0.1, 0.2, 0.3]), [0.0, 0.1, 0.2])
    points = found.T_base_point(T_tip_tool)
    # the controller solves the point with the nominal arm, and ends at the command
    back = points @ se3.inverse(T_tip_tool)
    for pose, command in zip(back, found.postures, strict=True):
        answers = reference_robot.inverse(pose[None], near=command)
        assert np.abs(answers.of(0) - command).max(axis=1).min() < 1e-8


def test_a_command_beyond_a_limit_says_which(reference_robot):
    model = CalibrationModel(
        reference_robot,
        [
            ZeroOffsets(reference_robot, ["joint_2"]),
            ToolPoint([0.0, 0.0, 0.2], ""),
            TargetPoints([[1.0, 0.0, 0.5]], free=False),
        ],
        TouchUp(1e-5),
    )
    q = np.deg2rad([[0.0, 76.0, -25.0, 0.0, -50.0, 0.0], [0.0, 15.0, -25.0, 0.0, -50.0, 0.0]])
    found = compensate(model, np.deg2rad([-0.5]), postures=q)
    assert found.status == ("outside limits", "reached")
    assert found.reasons == ("joint_2 76.5 deg is above 76.0 deg", "")
    np.testing.assert_array_equal(found.ok, [False, True])
    assert found.error_m[0] < CLOSED


def test_a_coupled_limit_counts(reference_robot):
    robot = replace(reference_robot, coupled_limits=Robot.preset("r2000ic165f").coupled_limits)
    model = whole_model(robot)
    values = model.nominal.copy()
    values[2] = -0.01
    q = np.deg2rad([[0.0, 50.0, -81.9, 0.0, -50.0, 0.0]])
    assert compensate(model, model.nominal, postures=q).ok.all()
    values[2] = 0.01
    found = compensate(model, values, postures=q)
    assert found.status == ("outside limits",)
    assert found.reasons[0].startswith("J3 to the horizontal -132.")


def test_poses_out_of_reach_are_told_apart(reference_robot):
    model = whole_model(reference_robot)
    x = random_values(model, np.random.default_rng(4))
    near = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
    good = tool_poses(model, near[None])[0]
    far, low = good.copy(), good.copy()
    far[0, 3] += 5.0
    stretched = np.array([0.0, np.deg2rad(85.0), STRETCHED, 0.0, -0.9, 0.0])
    low = tool_poses(model, stretched[None])[0]
    found = compensate(model, x, poses=[far, good, low], near=near)
    assert found.status == ("no posture", "reached", "no posture")
    assert found.reasons[0].startswith("the nominal robot does not reach it")
    assert found.reasons[2] == "the nominal robot would have joint_2 9.00 deg outside its limits"
    assert np.isnan(found.postures[0]).all()
    assert np.isnan(found.T_base_tip[0]).all()
    assert np.isnan(found.error_m[0])
    # from a posture of its own: what remains is told
    found = compensate(model, x, poses=[far, good], postures=[near, near])
    assert found.status == ("not reached", "reached")
    assert "remain" in found.reasons[0]
    assert found.error_m[0] > 1.0


def test_the_end_of_the_reach_is_not_reached_by_a_shorter_arm(reference_robot):
    freed = LinkGeometry(reference_robot, ["link.joint_5.x"])
    tool, target = ToolPoint([0.0, 0.0, 0.2], ""), TargetPoints([[1.0, 0.0, 0.5]], free=False)
    model = CalibrationModel(reference_robot, [freed, tool, target], TouchUp(1e-5))
    stretched = np.array([[0.0, 0.5, STRETCHED, 0.0, -0.9, 0.0]])
    origins = reference_robot.state(stretched).origins[0]
    reach = np.linalg.norm(origins[4] - origins[1])
    assert reach > 2.3
    found = compensate(model, [-1e-3], postures=stretched)
    assert found.status == ("not reached",)
    assert 1e-4 < found.error_m[0] < 2e-3


def test_seven_joints_stay_near_their_posture(seven_axis_robot):
    model = whole_model(seven_axis_robot)
    x = random_values(model, np.random.default_rng(5))
    q = clear_postures(seven_axis_robot, 30)
    found = compensate(model, x, postures=q)
    assert found.ok.all()
    assert np.abs(found.change).max() < 0.3
    np.testing.assert_allclose(
        tool_poses(model, found.postures, x), tool_poses(model, q), atol=CLOSED
    )


def test_no_poses_are_no_trouble(reference_robot):
    model = whole_model(reference_robot)
    found = compensate(model, model.nominal, postures=np.empty((0, 6)))
    assert found.status == ()
    assert found.ok.shape == (0,)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give poses, or postures"),
        ({"postures": np.zeros(6)}, "list of postures"),
        ({"postures": np.zeros((2, 5))}, "5 values"),
        ({"postures": np.full((2, 6), np.nan)}, "finite"),
        ({"poses": np.eye(4)}, "list of poses"),
        ({"poses": np.zeros((2, 4, 4))}, "last row"),
        ({"poses": np.eye(4)[None], "postures": np.zeros((2, 6))}, "1 poses for 2 postures"),
        ({"postures": np.zeros((2, 6)), "point": "camera"}, "unknown point 'camera'"),
    ],
)
def test_what_cannot_be_compensated_is_refused(reference_robot, options, words):
    model = whole_model(reference_robot)
    with pytest.raises(InputError, match=words):
        compensate(model, model.nominal, **options)
