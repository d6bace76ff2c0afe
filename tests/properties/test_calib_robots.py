"""Arms in any posture: inverse kinematics, nearness, invariances."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import CalibrationModel, Robot, preset_names, se3
from calib.identification import covariance_of
from calib.measurement import TouchUp, ViewLine
from calib.parameters import TargetPoints, ToolPoint, ZeroOffsets
from calib.robots.inverse import nearest_turns

ROBOTS = [Robot.preset(name) for name in preset_names()]
share = st.floats(0, 1)
postures = st.tuples(*[share] * 6).map(np.array)


@pytest.mark.parametrize("robot", ROBOTS, ids=preset_names())
@settings(max_examples=60, deadline=None)
@given(part=postures)
def test_inverse_kinematics_finds_every_posture_again(robot, part):
    """Simple fractions of the range, too: hypothesis likes straight wrists and limits."""
    q = robot.lower + part * robot.joint_range
    pose = robot.fk(q)
    answers = robot.inverse(pose, near=q)
    for posture in answers.postures:
        np.testing.assert_allclose(robot.fk(posture), pose, atol=1e-9)
    best, found = answers.nearest()
    assert found[0]
    assert (best[0] >= robot.lower - 1e-9).all()
    assert (best[0] <= robot.upper + 1e-9).all()
    wrist = robot.state(q).axes
    if np.linalg.norm(np.cross(wrist[3], wrist[5])) > 1e-3:
        # how far a posture moves for a rounding of the pose: the worse, the nearer a singularity
        worst = np.linalg.svd(robot.jacobian(q), compute_uv=False)[-1]
        assert np.abs(best[0] - q).max() < 1e-6 or worst < 1e-3


@settings(max_examples=100, deadline=None)
@given(
    q=st.floats(-20, 20),
    near=st.floats(-7, 7),
    lower=st.floats(-7, 0),
    width=st.floats(0.1, 13),
)
def test_the_full_turn_is_the_best_of_all(q, near, lower, width):
    q = float(np.remainder(q + np.pi, 2 * np.pi) - np.pi)  # as solvers give it
    upper = lower + width
    picked, inside = nearest_turns(
        np.array([[q]]), np.array([lower]), np.array([upper]), np.array([near])
    )
    turned = q + 2 * np.pi * np.arange(-3, 4)
    fits = turned[(turned >= lower - 1e-9) & (turned <= upper + 1e-9)]
    assert inside[0] == (len(fits) > 0)
    if len(fits):
        assert abs(picked[0, 0] - near) <= np.abs(fits - near).min() + 1e-9
    else:
        excess = np.maximum(lower - turned, turned - upper).min()
        assert max(lower - picked[0, 0], picked[0, 0] - upper) <= excess + 1e-9


@pytest.mark.parametrize("measurement", [TouchUp([1e-5, 2e-5, 6e-5]), ViewLine([1e-5, 2e-5])])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), turn=st.floats(-3, 3))
def test_turning_the_whole_cell_about_the_first_axis_changes_no_certainty(measurement, seed, turn):
    robot = ROBOTS[-1]
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, (20, 6))
    free = "xyz" if measurement.rows == 3 else "xy"
    blocks = [ZeroOffsets(robot, robot.joint_names[1:5]), ToolPoint([0.2, -0.1, 0.3], free)]
    place = np.array([1.9, 0.1, 0.5])
    here = CalibrationModel(robot, [*blocks, TargetPoints(place)], measurement)
    R = se3.rotation_exp([0, 0, turn])
    there = CalibrationModel(robot, [*blocks, TargetPoints(R @ place)], measurement)
    turned = q + turn * np.eye(6)[0]
    a, b = covariance_of(here, q), covariance_of(there, turned)
    np.testing.assert_allclose(np.diag(b)[:-3], np.diag(a)[:-3], rtol=1e-6)
    np.testing.assert_allclose(b[-3:, -3:], R @ a[-3:, -3:] @ R.T, rtol=1e-5, atol=1e-9 * a.max())
    # the order of the postures changes nothing either
    order = rng.permutation(20)
    np.testing.assert_allclose(covariance_of(here, q[order]), a, rtol=1e-6, atol=1e-9 * a.max())
