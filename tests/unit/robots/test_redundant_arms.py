"""Arms of seven joints: every branch along the sweep, and the nearest of the self-motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from calib import Robot, se3
from calib.robots import CoupledLimit
from calib.robots.inverse.redundant import SWEEP_STEP_RAD, RedundantArm
from tests.arms import arm_from

CLOSURE = 1e-9
DOWN = np.diag([1.0, -1.0, -1.0])

IIWA = [  # xyz [m], axis, limits [deg]: three axes in the shoulder and three in the wrist meet
    ((0, 0, 0.16), "0 0 1", 170),
    ((0, 0, 0.2), "0 1 0", 120),
    ((0, 0, 0), "0 0 1", 170),
    ((0, 0, 0.42), "0 -1 0", 120),
    ((0, 0, 0), "0 0 1", 170),
    ((0, 0, 0.4), "0 1 0", 120),
    ((0, 0, 0), "0 0 1", 175),
]


def iiwa(rpy_deg: tuple[float, float, float]) -> Robot:
    """An arm in the manner of a KUKA iiwa, all joints but the first turned a little."""
    turns = [(0, 0, 0)] + 6 * [rpy_deg]
    joints = [(xyz, rpy, *of) for (xyz, *of), rpy in zip(IIWA, turns, strict=True)]
    return arm_from(joints, flange_m=0.126)


@pytest.fixture(scope="module", params=["franka", "iiwa", "rounded iiwa"])
def robot(request, seven_axis_robot) -> Robot:
    if request.param == "franka":
        return seven_axis_robot
    return iiwa((0.017, -0.011, 0.023) if "rounded" in request.param else (0, 0, 0))


def postures_of(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, 7))


def test_the_swept_joint_takes_part_in_the_self_motion(robot):
    """Joint 4 of such arms, the elbow, has a closed form when held, but it never moves."""
    solver = robot._inverse
    assert isinstance(solver, RedundantArm)
    assert solver.swept in (2, 4, 6)


def test_every_answer_closes_and_each_is_given_once(robot):
    q = postures_of(robot, 8)
    poses = robot.fk(q)
    answers = robot.inverse(poses)
    np.testing.assert_allclose(robot.fk(answers.postures), poses[answers.pose], atol=CLOSURE)
    assert set(answers.pose[answers.inside].tolist()) == set(range(8))
    np.testing.assert_array_equal(answers.gap_m, 0.0)
    assert (np.diff(answers.pose) >= 0).all()
    inside = answers.postures[answers.inside]
    assert (inside >= robot.lower - 1e-9).all()
    assert (inside <= robot.upper + 1e-9).all()
    for i in range(8):
        own = answers.of(i)
        apart = np.abs(own[:, None] - own[None]).max(axis=-1)
        assert apart[~np.eye(len(own), dtype=bool)].min() > 1e-7


def test_the_posture_that_made_the_pose_comes_back(robot):
    for q in postures_of(robot, 4, seed=1):
        best, found = robot.inverse(robot.fk(q), near=q).nearest()
        assert found[0]
        np.testing.assert_allclose(best[0], q, atol=1e-6)


def test_postures_on_the_limits_come_back(robot):
    rng = np.random.default_rng(2)
    for q in postures_of(robot, 5, seed=2):
        q[rng.permutation(7)[:3]] = np.where(rng.random() < 0.5, robot.lower, robot.upper)[:3]
        q = np.clip(q, robot.lower, robot.upper)
        best, found = robot.inverse(robot.fk(q), near=q).nearest()
        assert found[0]
        np.testing.assert_allclose(best[0], q, atol=1e-6)


def test_the_sweep_passes_close_to_every_posture(robot):
    """Each posture inside has a cut of its own self-motion beside it, whatever the reference."""
    q = postures_of(robot, 20, seed=3)
    answers = robot.inverse(robot.fk(q))
    swept = robot._inverse.swept
    null = np.linalg.svd(robot.jacobian(q))[2][:, -1]
    close = 0
    for i in range(20):
        away = np.abs(answers.of(i) - q[i]).max(axis=1).min()
        # so far moves the joint that moves most, where the swept one moves a step
        close += away < 2.0 * SWEEP_STEP_RAD * np.abs(null[i]).max() / abs(null[i, swept])
    assert close >= 18  # a fold or a limit can lie within the step


def nearest_by_search(robot: Robot, pose: np.ndarray, near: np.ndarray, starts: np.ndarray):
    """Distance from the reference by a general optimiser, from many starts."""

    def miss(q):
        state = robot.state(q)
        return np.concatenate(
            [state.p_base_tip - pose[:3, 3], (state.R_base_tip - pose[:3, :3]).ravel()]
        )

    best = np.inf
    for q in starts:
        result = minimize(
            lambda q: np.sum((q - near) ** 2),
            q,
            jac=lambda q: 2 * (q - near),
            method="SLSQP",
            bounds=list(zip(robot.lower, robot.upper, strict=True)),
            constraints={"type": "eq", "fun": lambda q: miss(q)[[0, 1, 2, 4, 5, 8]]},
            options={"maxiter": 200, "ftol": 1e-12},
        )
        if np.abs(miss(result.x)).max() < 1e-6:
            best = min(best, np.sqrt(result.fun))
    return best


@pytest.mark.slow
def test_the_nearest_is_the_nearest_of_the_self_motion(robot):
    near = (robot.lower + robot.upper) / 2 + 0.2
    for i, q in enumerate(postures_of(robot, 2, seed=4)):
        answers = robot.inverse(robot.fk(q), near=near)
        best, found = answers.nearest()
        assert found[0]
        cuts = answers.of(0)
        rng = np.random.default_rng(i)
        starts = np.vstack([q, cuts[rng.permutation(len(cuts))[:6]]])
        searched = nearest_by_search(robot, robot.fk(q), near, starts)
        assert np.linalg.norm(best[0] - near) <= searched + 1e-5


def test_at_rest_the_nearest_is_pulled_only_across_the_self_motion(robot):
    near = (robot.lower + robot.upper) / 2
    poses = robot.fk(near + 0.3 * np.random.default_rng(5).uniform(-1, 1, (10, 7)))
    best, found = robot.inverse(poses, near=near).nearest()
    assert found.all()
    free = ((best > robot.lower + 1e-6) & (best < robot.upper - 1e-6)).all(axis=1)
    assert free.sum() >= 6
    null = np.linalg.svd(robot.jacobian(best))[2][:, -1]
    along = np.sum(null * (near - best), axis=1)
    np.testing.assert_allclose(along[free], 0.0, atol=1e-6)


@pytest.mark.slow
def test_poses_do_not_disturb_each_other(robot, monkeypatch):
    monkeypatch.setattr(RedundantArm, "poses_at_once", 8)
    poses = robot.fk(postures_of(robot, 11, seed=6))
    poses[3, :3, 3] += 9.0
    near = (robot.lower + robot.upper) / 2
    together = robot.inverse(poses, near=near)
    for i in (0, 3, 7, 10):
        alone = robot.inverse(poses[i], near=near)
        np.testing.assert_allclose(alone.of(0), together.of(i), atol=1e-9)
    assert len(together.of(3)) == 0
    assert together.gap_m[3] > 7
    np.testing.assert_array_equal(robot.inverse(poses, near=near).postures, together.postures)
    assert robot.inverse(np.empty((0, 4, 4))).postures.shape == (0, 7)


@pytest.mark.parametrize(
    ("place", "gap_m"), [([0.9, 0.0, 0.3], 0.09596), ([0.0, 0.0, 1.6], 0.65743)]
)
def test_too_far_says_by_how_much(seven_axis_robot, place, gap_m):
    """The tip pointing down. The gaps were found by minimising the distance without limits, the
    orientation held by a penalty, from twelve random starts."""
    answers = seven_axis_robot.inverse(se3.transform(DOWN, place))
    assert len(answers.postures) == 0
    assert answers.gap_m[0] == pytest.approx(gap_m, abs=5e-4)


def test_limits_in_the_way_are_told_from_reach(seven_axis_robot):
    q = np.array([0.1, 0.4, -0.2, -1.8, 0.3, 1.9, 0.5])
    tight = np.full(7, 0.02)
    robot = replace(
        seven_axis_robot, lower=seven_axis_robot.lower, upper=seven_axis_robot.lower + tight
    )
    answers = robot.inverse(seven_axis_robot.fk(q))
    assert not answers.inside.any()
    reason = answers.reason(0)
    assert reason is not None
    if len(answers.postures):
        assert reason.gap_m == 0.0
        assert reason.excess > 0


def test_coupled_limits_hold_for_redundant_arms(seven_axis_robot):
    limit = CoupledLimit("J2 with J4", np.array([0, 1.0, 0, 1.0, 0, 0, 0]), -1.5, 0.0)
    robot = replace(seven_axis_robot, coupled_limits=(limit,))
    q = np.array([0.1, 0.4, -0.2, -1.8, 0.3, 1.9, 0.5])
    answers = robot.inverse(robot.fk(q), margin=0.01)
    assert answers.inside.any()
    assert (limit.margin(answers.postures[answers.inside]) >= 0.01 - 1e-9).all()
    free = seven_axis_robot.inverse(robot.fk(q), margin=0.01)
    assert answers.inside.sum() < free.inside.sum()


def test_a_short_piece_of_self_motion_is_found_from_far_away(seven_axis_robot):
    """Joint 5 stays within a step of the sweep there, near the middle of its limits."""
    robot = seven_axis_robot
    q = np.deg2rad([150.89, -88.851, 88.953, -69.48, 0.421, 23.198, 131.083])
    for near in np.random.default_rng(3).uniform(robot.lower, robot.upper, (3, 7)):
        assert robot.inverse(robot.fk(q), near=near).nearest()[1].all()


def test_a_margin_that_leaves_no_room_is_told_as_one_of_limits(seven_axis_robot):
    """Not as a pose out of reach."""
    robot = seven_axis_robot
    answers = robot.inverse(robot.fk(postures_of(robot, 5)), margin=3.5)
    assert not answers.inside.any()
    for i in range(5):
        reason = answers.reason(i)
        assert reason.gap_m == 0.0
        assert reason.excess > 0.0
