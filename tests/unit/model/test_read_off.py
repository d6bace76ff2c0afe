"""What instruments show: predictions against plain matrices, rotations on the manifold."""

import numpy as np
import pytest

from calib import CalibrationModel, se3
from calib.model import Setup, simulate
from calib.model.measurements import CameraPose, Distance, Point, Pose
from calib.model.measurements.kinds import Contact
from calib.model.parameters import (
    LengthOffsets,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import inverse, rotation_exp, rotation_log, transform

T_TOOL = transform(rotation_exp([0.1, 0.6, -0.2]), [0.2, -0.05, 0.35])
T_TARGET = transform(rotation_exp([0.4, -0.3, 2.7]), [1.7, -0.6, 0.4])
REFLECTORS = np.array([[0.1, 0.2, 0.3], [-0.2, 0.1, 0.25]])
SIX = [1e-5, 2e-5, 3e-5, 1e-4, 2e-4, 3e-4]


@pytest.fixture(scope="module")
def arm(reference_robot):
    """Postures, parameters of a displaced set-up, and the frames that these mean."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (8, 6))
    offsets = rng.uniform(-0.02, 0.02, 6)
    moved = rng.uniform(-0.3, 0.3, (2, 6))
    T_tip_tool, T_base_target = (
        transform(T[:3, :3] @ rotation_exp(six[3:]), T[:3, 3] + six[:3])
        for T, six in zip((T_TOOL, T_TARGET), moved, strict=True)
    )
    x = np.concatenate(
        [offsets, T_tip_tool[:3, 3], moved[0, 3:], T_base_target[:3, 3], moved[1, 3:]]
    )
    T_base_tool = reference_robot.fk(q + offsets) @ T_tip_tool
    return q, x, T_base_tool, T_base_target


def model_of(robot, kind) -> CalibrationModel:
    blocks = [ZeroOffsets(robot, robot.joint_names), ToolFrame(T_TOOL), TargetFrame(T_TARGET)]
    return CalibrationModel(robot, blocks, kind)


def test_a_point_is_read_in_the_frame_of_the_instrument(reference_robot, arm):
    q, x, T_base_tool, T_base_target = arm
    read = model_of(reference_robot, Point(1e-5)).predict(q, x)
    expected = se3.apply(inverse(T_base_target), T_base_tool[:, :3, 3])
    np.testing.assert_allclose(read, expected, atol=1e-14)


@pytest.mark.parametrize("kind", [Pose, CameraPose])
def test_an_instrument_sees_the_tool_and_a_camera_on_the_tool_the_target(
    reference_robot, arm, kind
):
    q, x, T_base_tool, T_base_target = arm
    read = model_of(reference_robot, kind(SIX)).predict(q, x)
    expected = inverse(T_base_target) @ T_base_tool
    expected = expected if kind is Pose else inverse(expected)
    np.testing.assert_allclose(read[:, :3], expected[:, :3, 3], atol=1e-14)
    np.testing.assert_allclose(rotation_exp(read[:, 3:]), expected[:, :3, :3], atol=1e-14)


def test_a_distance_is_that_of_the_points_and_what_the_wire_shows_more(reference_robot):
    rng = np.random.default_rng(1)
    q = rng.uniform(-1, 1, (6, 6))
    anchors = np.array([[2.0, 0.1, 0.0], [1.0, -1.5, 0.3]])
    blocks = [
        ToolPoints(REFLECTORS, ["P", "Q"]),
        TargetPoints(anchors, ["near", "far"]),
        LengthOffsets(["far"]),
    ]
    model = CalibrationModel(reference_robot, blocks, Distance(1e-5))
    tool, target = np.array([0, 1, 1, 0, 0, 1]), np.array([0, 0, 1, 1, 1, 0])
    x = model.nominal.copy()
    x[-1] = 0.25
    read = model.predict(q, x, Setup.of(6, tool=tool, target=target))
    points = se3.apply(reference_robot.fk(q), REFLECTORS[tool])
    expected = np.linalg.norm(points - anchors[target], axis=1) + 0.25 * (target == 1)
    np.testing.assert_allclose(read[:, 0], expected, atol=1e-14)


def test_each_reflector_sits_in_its_own_place(reference_robot):
    q = np.random.default_rng(2).uniform(-1, 1, (2, 5, 6))
    blocks = [ToolPoints(REFLECTORS, ["P", "Q"], free="zx"), TargetFrame(T_TARGET)]
    model = CalibrationModel(reference_robot, blocks, Point(1e-5))
    assert model.names[:4] == ("tool.P.z", "tool.P.x", "tool.Q.z", "tool.Q.x")
    tool = np.array([1, 0, 0, 1, 1])
    places = REFLECTORS.copy()
    places[1] += [0.02, 0.0, 0.01]
    x = model.nominal.copy()
    x[2:4] += [0.01, 0.02]
    read = model.predict(q, x, Setup.of(5, tool=tool))
    expected = se3.apply(inverse(T_TARGET), se3.apply(reference_robot.fk(q), places[tool]))
    np.testing.assert_allclose(read, expected, atol=1e-14)


@pytest.mark.parametrize("kind", [Pose, CameraPose])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, np.pi - 1e-3, np.pi - 1e-9, np.pi])
def test_rotations_are_compared_on_the_manifold(kind, angle):
    """Also of readings near 180 deg, whose vector may turn round."""
    rng = np.random.default_rng(3)
    axis = rng.standard_normal((3, 50))
    axis /= np.linalg.norm(axis, axis=0)
    read = np.concatenate([rng.standard_normal((3, 50)), angle * axis])
    off = rng.uniform(-0.02, 0.02, (6, 50))
    shown = kind(SIX).disturb(read, off)
    np.testing.assert_allclose(
        rotation_exp(shown[3:].T), rotation_exp(off[3:].T) @ rotation_exp(read[3:].T), atol=1e-14
    )
    np.testing.assert_allclose(kind(SIX).difference(shown, read), off, atol=1e-13)
    # the other vector of the same half turn is the same reading
    around = np.concatenate([read[:3], (angle - 2 * np.pi) * axis])
    np.testing.assert_allclose(kind(SIX).difference(shown, around), off, atol=1e-13)


@pytest.mark.parametrize("kind", [Pose, CameraPose])
def test_poses_near_half_a_turn_are_identified(reference_robot, kind):
    """The tool is turned by 180 deg against the instrument, to a hair and by noise beyond it."""
    rng = np.random.default_rng(4)
    q = np.array([0.3, 0.2, -0.4, 0.5, -0.8, 0.2]) + rng.uniform(-1e-4, 1e-4, (12, 6))
    T_base_tool = reference_robot.fk(q[0])
    flip = transform(rotation_exp([np.pi, 0.0, 0.0]), [0.3, 0.2, 0.1])
    target = T_base_tool @ flip
    blocks = [
        ZeroOffsets(reference_robot, reference_robot.joint_names[1:4]),
        ToolFrame(np.eye(4), free=()),
        TargetFrame(target, free=()),
    ]
    model = CalibrationModel(reference_robot, blocks, kind([1e-5] * 3 + [1e-4] * 3))
    data = simulate(model, model.nominal, q, rng, trials=200)
    angles = np.linalg.norm(data.observed[..., 3:], axis=-1)
    assert angles.min() > np.pi - 2e-3
    rows = model.linearise(data.postures, observed=data.observed).white_rows
    assert np.abs(rows).max() < 6
    assert np.mean(rows**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / rows.size))


def test_turns_of_a_pose_are_about_the_axes_of_the_instrument():
    """Noise of the rotation does not turn with the tool."""
    read = np.concatenate([np.zeros(3), [0.5, -0.8, 1.1]])[:, None]
    off = np.array([0, 0, 0, 0, 0, 0.01])[:, None]
    turned = rotation_exp(Pose(SIX).disturb(read, off)[3:].T)[0] @ rotation_exp(read[3:].T)[0].T
    np.testing.assert_allclose(rotation_log(turned), [0, 0, 0.01], atol=1e-15)


@pytest.mark.parametrize("kind", [Point, Pose, CameraPose, Distance])
def test_what_is_read_off_moves_no_arm(kind, reference_robot):
    model = model_of(reference_robot, kind(1e-5))
    q = np.random.default_rng(5).uniform(-1, 1, (3, 6))
    view = model.view(q)
    np.testing.assert_array_equal(model.gap(view.error, view), 0.0)
    assert not isinstance(model.measurement, Contact)


@pytest.mark.parametrize("kind", [Pose, CameraPose])
def test_readings_that_cannot_be_written_to(kind, reference_robot):
    """Of a single measurement, spread over trials: scipy's rotations refuse such an array."""
    model = model_of(reference_robot, kind(1e-4))
    q = np.zeros((1, 6))
    read = np.broadcast_to(model.predict(q)[0], (1, 6))
    assert not read.flags.writeable
    assert np.abs(model.linearise(q, observed=read).rows).max() < 1e-9
