"""Arms in any posture: inverse kinematics, nearness, invariances."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calib import CalibrationModel, Robot, preset_names, se3
from calib.identification import covariance_of
from calib.model.measurements import TouchUp, ViewLine
from calib.model.parameters import TargetPoints, ToolPoint, ZeroOffsets
from calib.robots import InverseSolutions
from calib.robots.bounds import nearest_turns

ROBOTS = [Robot.preset(name) for name in preset_names()]
SIX = [robot for robot in ROBOTS if robot.n == 6]
SEVEN = [robot for robot in ROBOTS if robot.n == 7]
share = st.floats(0, 1)
TURN = 2 * np.pi


def postures(n: int) -> st.SearchStrategy[np.ndarray]:
    """Shares of the joints' ranges; hypothesis likes simple ones, singular postures and limits."""
    return st.tuples(*[share] * n).map(np.array)


def allowed(robot: Robot, q: np.ndarray) -> bool:
    return all(limit.margin(q) >= 0 for limit in robot.coupled_limits)


def smallest_singular_value(robot: Robot, q: np.ndarray) -> float:
    return float(np.linalg.svd(robot.jacobian(q), compute_uv=False)[-1])


def name_of(robot: Robot) -> str:
    return preset_names()[ROBOTS.index(robot)]


def assert_answers_hold(robot: Robot, poses: np.ndarray, answers: InverseSolutions) -> None:
    """Each takes its pose, and what is said to be inside the limits is."""
    np.testing.assert_allclose(robot.fk(answers.postures), poses[answers.pose], atol=1e-9)
    inside = answers.postures[answers.inside]
    assert (inside >= robot.lower - 1e-9).all()
    assert (inside <= robot.upper + 1e-9).all()
    for limit in robot.coupled_limits:
        assert (limit.margin(inside) >= -1e-9).all()
    np.testing.assert_array_equal(answers.gap_m[answers.pose], 0.0)


@pytest.mark.parametrize("robot", SIX, ids=name_of)
@settings(max_examples=10, deadline=None)
@given(part=postures(6))
def test_inverse_kinematics_finds_every_posture_again(robot, part):
    """Of singular postures, the pose is taken; which of their neighbours is given is open."""
    q = robot.lower + part * robot.joint_range
    assume(allowed(robot, q))
    pose = robot.fk(q)
    answers = robot.inverse(pose, near=q)
    assert_answers_hold(robot, pose[None], answers)
    best, found = answers.nearest()
    if smallest_singular_value(robot, q) > 1e-3:
        # how far a posture moves for a rounding of the pose: the worse, the nearer a singularity
        assert found[0]
        assert np.abs(best[0] - q).max() < 1e-6
        every = robot.inverse(pose, every_turn=True)
        assert np.abs(every.of(0) - q).max(axis=1).min() < 1e-6
    else:
        assert len(answers.postures) > 0


@pytest.mark.parametrize("robot", SIX, ids=name_of)
@settings(max_examples=4, deadline=None)
@given(part=postures(6), margin=st.sampled_from([0.0, 0.1]))
def test_every_turn_is_all_there_are(robot, part, margin):
    pose = robot.fk(robot.lower + part * robot.joint_range)
    one = robot.inverse(pose, margin=margin)
    every = robot.inverse(pose, margin=margin, every_turn=True)
    assert_answers_hold(robot, pose[None], every)
    wanted = []
    for branch in one.postures:
        turned = branch[:, None] + TURN * np.arange(-5, 6)
        fits = turned >= robot.lower[:, None] + margin - 1e-9
        fits &= turned <= robot.upper[:, None] - margin + 1e-9
        for choice in itertools.product(*[turned[j][fits[j]] for j in range(6)]):
            if all(lim.margin(np.array(choice)) >= margin - 1e-9 for lim in robot.coupled_limits):
                wanted.append(choice)
    found = every.of(0)
    assert len(found) == len(wanted)
    if wanted:
        order = [np.lexsort(np.round(np.array(rows), 6).T) for rows in (found, wanted)]
        np.testing.assert_allclose(found[order[0]], np.array(wanted)[order[1]], atol=1e-9)
        assert len(np.unique(np.round(found, 6), axis=0)) == len(found)


@pytest.mark.parametrize("robot", SEVEN, ids=name_of)
@settings(max_examples=4, deadline=None)
@given(part=postures(7))
def test_a_redundant_arm_finds_the_posture_it_is_near_to(robot, part):
    q = robot.lower + part * robot.joint_range
    assume(allowed(robot, q))
    pose = robot.fk(q)
    answers = robot.inverse(pose, near=q)
    assert_answers_hold(robot, pose[None], answers)
    best, found = answers.nearest()
    assert found[0]
    np.testing.assert_allclose(best[0], q, atol=1e-6)


@pytest.mark.parametrize("robot", ROBOTS, ids=preset_names())
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_order_of_the_poses_is_that_of_the_answers(robot, seed):
    rng = np.random.default_rng(seed)
    poses = robot.fk(rng.uniform(robot.lower, robot.upper, (9, robot.n)))
    poses[4, :3, 3] += 9.0  # out of reach in between
    order = rng.permutation(9)
    before, after = robot.inverse(poses), robot.inverse(poses[order])
    np.testing.assert_allclose(after.gap_m, before.gap_m[order], atol=1e-12)
    for i, pose in enumerate(order):
        np.testing.assert_allclose(after.of(i), before.of(int(pose)), atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    q=st.floats(-20, 20), near=st.floats(-7, 7), lower=st.floats(-7, 0), width=st.floats(0.1, 13)
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
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10_000), turn=st.floats(-3, 3))
def test_turning_the_whole_cell_about_the_first_axis_changes_no_certainty(measurement, seed, turn):
    robot = Robot.preset("r2000ic165f")
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
