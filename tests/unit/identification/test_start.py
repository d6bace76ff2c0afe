"""First guesses: a set-up that is nowhere near its nominal place is found exactly."""

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.errors import NotIdentifiableError
from calib.model import Setup, simulate, touch
from calib.model.measurements import CameraPose, Distance, PlaneContact, Point, Pose, TouchUp
from calib.model.parameters import (
    LengthOffsets,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import rotation_exp, transform

EXACT = 1e-9
SIX = [2e-5] * 3 + [1e-4] * 3
JOINTS = ["joint_2", "joint_3", "joint_4", "joint_5"]
OFFSETS = np.deg2rad([0.2, -0.3, 0.15, -0.25])


@pytest.fixture(params=range(3))
def rng(request) -> np.random.Generator:
    return np.random.default_rng(request.param)


def anywhere(rng: np.random.Generator) -> np.ndarray:
    """A pose turned by up to half a turn, some metres away."""
    axis = rng.standard_normal(3)
    turn = rng.uniform(0.5, np.pi) * axis / np.linalg.norm(axis)
    return transform(rotation_exp(turn), rng.uniform(-4, 4, 3))


def on_tip(rng: np.random.Generator) -> np.ndarray:
    T = anywhere(rng)
    T[:3, 3] = rng.uniform(-0.4, 0.4, 3)
    return T


def found_from(robot, kind, at_home, real, q, setup=None):
    """Identify readings of one set-up from the nominal frames of another; values and truth.

    The rotation vector of a frame starts at its nominal one, so frames are compared as poses.
    """
    offsets = ZeroOffsets(robot, JOINTS)
    truth = CalibrationModel(robot, [offsets, *real], kind)
    x = truth.nominal.copy()
    x[: len(OFFSETS)] = OFFSETS
    data = simulate(truth, x, q, setup=setup)
    model = CalibrationModel(robot, [offsets, *at_home], kind)
    result = identify(model, data)
    np.testing.assert_allclose(result.values[: len(OFFSETS)], OFFSETS, atol=EXACT)
    for block, other, part in zip(
        model.parameters[1:], truth.parameters[1:], model.slices[1:], strict=True
    ):
        if isinstance(block, LengthOffsets):
            continue
        np.testing.assert_allclose(
            block.poses(result.values[part]), other.poses(other.nominal), atol=EXACT
        )
    return result


def postures(rng: np.random.Generator, count: int = 24) -> np.ndarray:
    return np.add([0, 0.2, -0.3, 0, -0.6, 0], rng.uniform(-1, 1, (count, 6)))


@pytest.mark.parametrize("kind", [Pose, CameraPose])
@pytest.mark.parametrize("free", ["both", "target", "tool"])
def test_poses_of_an_instrument_that_stands_anywhere(reference_robot, rng, kind, free):
    T_tool, T_target = on_tip(rng), anywhere(rng)
    home = {
        "both": [ToolFrame(np.eye(4)), TargetFrame(np.eye(4))],
        "target": [ToolFrame(T_tool, free=()), TargetFrame(np.eye(4))],
        "tool": [ToolFrame(np.eye(4)), TargetFrame(T_target, free=())],
    }[free]
    real = [ToolFrame(T_tool, free=()), TargetFrame(T_target, free=())]
    found_from(reference_robot, kind(SIX), home, real, postures(rng))


def test_a_reflector_seen_by_a_tracker_that_stands_anywhere(reference_robot, rng):
    T_target = anywhere(rng)
    found_from(
        reference_robot,
        Point(2e-5),
        [ToolPoint([0, 0, 0]), TargetFrame(np.eye(4))],
        [ToolPoint([0.2, -0.05, 0.35], ""), TargetFrame(T_target, free=())],
        postures(rng),
    )


def test_three_reflectors_in_turn(reference_robot, rng):
    places, T_target = rng.uniform(-0.3, 0.4, (3, 3)), anywhere(rng)
    names = ["A", "B", "C"]
    found_from(
        reference_robot,
        Point(2e-5),
        [ToolPoints(np.zeros((3, 3)), names), TargetFrame(np.eye(4))],
        [ToolPoints(places, names, ""), TargetFrame(T_target, free=())],
        postures(rng),
        Setup.of(24, tool=np.arange(24) % 3),
    )


def test_a_wire_to_an_anchor_that_nobody_has_measured(reference_robot, rng):
    anchor = np.array([1.2, -1.5, 0.4]) + rng.uniform(-0.5, 0.5, 3)
    found_from(
        reference_robot,
        Distance(2e-5),
        [ToolPoint([0.2, -0.05, 0.35], ""), TargetPoints([0, 0, 0], ["A"])],
        [ToolPoint([0.2, -0.05, 0.35], ""), TargetPoints(anchor, ["A"], free=False)],
        postures(rng, 30),
    )


def test_a_wire_whose_zero_is_not_known_either(reference_robot, rng):
    anchors = np.add([[1.2, -1.5, 0.4], [1.5, 1.3, -0.2]], rng.uniform(-0.3, 0.3, (2, 3)))
    robot, names = reference_robot, ["A", "B"]
    tool = ToolPoint([0.2, -0.05, 0.35], "")
    setup = Setup.of(40, target=np.arange(40) % 2)
    model = CalibrationModel(
        robot,
        [
            ZeroOffsets(robot, JOINTS),
            tool,
            TargetPoints(np.zeros((2, 3)), names),
            LengthOffsets(names),
        ],
        Distance(2e-5),
    )
    x = model.nominal.copy()
    x[:4], x[4:10], x[10:] = OFFSETS, anchors.ravel(), [0.012, -0.007]
    data = simulate(model, x, postures(rng, 40), setup=setup)
    np.testing.assert_allclose(identify(model, data).values, x, atol=EXACT)


def test_touch_ups_of_points_that_are_metres_off(reference_robot, touching, target_m):
    offsets = ZeroOffsets(reference_robot, JOINTS)
    truth = CalibrationModel(
        reference_robot,
        [offsets, ToolPoint([0.2, -0.05, 0.35]), TargetPoints(target_m)],
        TouchUp(1e-5),
    )
    x = truth.nominal.copy()
    x[:4] = OFFSETS
    data = simulate(truth, x, touching(20))
    lost = CalibrationModel(
        reference_robot,
        [offsets, ToolPoint([-0.5, 0.5, 0]), TargetPoints([-3, 2, 4])],
        TouchUp(1e-5),
    )
    np.testing.assert_allclose(identify(lost, data).values, x, atol=EXACT)


def test_poses_and_contacts_together(reference_robot, rng):
    """The frames come from the poses; the plane is touched with the tool that they give."""
    robot = reference_robot
    T_tool, T_target = on_tip(rng), anywhere(rng)
    touched = np.arange(30) >= 20
    setup = Setup.of(30, kind=touched.astype(int), target=touched.astype(int))
    plane = [robot.fk(postures(rng, 1))[0, :3, 3], [0.05, 0.02, 1.0]]

    def model(tool: ToolFrame, target: TargetFrame, surface: TargetPlane) -> CalibrationModel:
        blocks = [ZeroOffsets(robot, JOINTS), tool, target, surface]
        return CalibrationModel(robot, blocks, [Pose(SIX), PlaneContact(2e-5)])

    real = model(
        ToolFrame(T_tool, free=()), TargetFrame(T_target, free=()), TargetPlane(*plane, free=False)
    )
    q = postures(rng, 30)
    q[touched] = touch(real, q[touched], OFFSETS, setup[touched], hold_orientation=False)[0]
    data = simulate(real, OFFSETS, q, setup=setup)
    tilted = [np.add(plane[0], [0.0, 0.0, 0.03]), [0.02, -0.03, 1.0]]
    lost = model(ToolFrame(np.eye(4)), TargetFrame(np.eye(4)), TargetPlane(*tilted))
    result = identify(lost, data)
    np.testing.assert_allclose(result.values[:4], OFFSETS, atol=EXACT)
    np.testing.assert_allclose(
        lost.parameters[1].poses(result.values[lost.slices[1]])[0], T_tool, atol=EXACT
    )
    found = lost.parameters[3].poses(result.values[lost.slices[3]])[0]
    normal = np.array(plane[1]) / np.linalg.norm(plane[1])
    np.testing.assert_allclose(found[:3, 2], normal, atol=EXACT)
    assert (plane[0] - found[:3, 3]) @ normal == pytest.approx(0.0, abs=EXACT)


@pytest.mark.parametrize("kind", [Pose(SIX), Point(2e-5)])
def test_noise_does_not_lead_the_guess_astray(reference_robot, rng, kind):
    T_target = anywhere(rng)
    tool = [0.2, -0.05, 0.35]
    free = ["x", "y", "z", "rx", "ry", "rz"] if kind.turns else ["x", "y", "z"]
    T_tool = transform(np.eye(3), tool)
    truth = CalibrationModel(
        reference_robot,
        [ZeroOffsets(reference_robot, JOINTS), ToolFrame(T_tool, free=free), TargetFrame(T_target)],
        kind,
    )
    x = truth.nominal.copy()
    x[:4] = OFFSETS
    data = simulate(truth, x, postures(rng), rng)
    lost = truth.with_parameters(
        [truth.parameters[0], ToolFrame(np.eye(4), free=free), TargetFrame(np.eye(4))]
    )
    result, near = identify(lost, data), identify(truth, data)
    np.testing.assert_array_less(np.abs(result.values - near.values)[:4], 1e-4 * near.sigma[:4])
    assert result.chi2 == pytest.approx(near.chi2, rel=1e-6)


def test_poses_that_turn_about_one_axis_only_are_refused_by_name(reference_robot):
    """No closed form can place both frames then, and the error says what is hidden."""
    q = np.tile([0.1, 0.2, -0.4, 0.5, -0.8, 0.2], (12, 1))
    q[:, 5] += np.linspace(-1, 1, 12)
    model = CalibrationModel(
        reference_robot, [ToolFrame(np.eye(4)), TargetFrame(np.eye(4))], Pose(SIX)
    )
    x = model.nominal + 0.01
    with pytest.raises(NotIdentifiableError) as caught:
        identify(model, simulate(model, x, q))
    assert set(caught.value.parameters) <= set(model.names)
    # a prior places them all the same
    blocks = [ToolFrame(np.eye(4), prior_m=0.05, prior_rad=0.05), TargetFrame(np.eye(4))]
    result = identify(model.with_parameters(blocks), simulate(model, x, q))
    assert set(result.held_by_prior) >= {"tool.rz"}
