"""What an answer of inverse kinematics says: every turn, singular, limits, why there is none."""

import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot, se3
from calib.robots import CoupledLimit
from calib.robots.bounds import every_turn
from calib.robots.inverse import NEAR_SINGULAR

TURN = 2 * np.pi
DOWN = np.diag([1.0, -1.0, -1.0])


def turns_inside(q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> list[tuple[float, ...]]:
    """Every combination of turns, by trying all of them."""
    choices = []
    for j in range(len(q)):
        turned = q[j] + TURN * np.arange(-5, 6)
        choices.append(turned[(turned >= lower[j] - 1e-9) & (turned <= upper[j] + 1e-9)])
    return list(itertools.product(*choices))


def test_every_turn_of_a_wide_joint():
    lower, upper = np.deg2rad([-360.0, -185.0]), np.deg2rad([360.0, 185.0])

    def turned(*q_deg):
        q, source = every_turn(np.deg2rad([q_deg]), lower, upper)
        assert (source == 0).all()
        return np.rad2deg(q).round(9).tolist()

    assert turned(10.0, 20.0) == [[-350.0, 20.0], [10.0, 20.0]]
    assert turned(0.0, 0.0) == [[-360.0, 0.0], [0.0, 0.0], [360.0, 0.0]]
    assert turned(370.0, 178.0) == [[-350, -182], [-350, 178], [10, -182], [10, 178]]
    assert every_turn(np.deg2rad([[0.0, 20.0]]), lower, np.deg2rad([1.0, 10.0]))[0].shape == (0, 2)


@pytest.mark.parametrize("margin", [0.0, np.deg2rad(30.0)])
def test_every_turn_is_every_branch_in_all_its_turns(reference_robot, margin):
    robot = reference_robot
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (60, 6))
    poses = robot.fk(q)
    one, every = (
        robot.inverse(poses, margin=margin),
        robot.inverse(poses, margin=margin, every_turn=True),
    )
    lower, upper = robot.lower + margin, robot.upper - margin
    for i in range(60):
        wanted = [t for b in one.of(i) for t in turns_inside(b, lower, upper)]
        found = every.of(i)
        assert len(found) == len(wanted)
        for posture in wanted:
            assert np.abs(found - posture).max(axis=1).min() < 1e-12
        for a, b in itertools.combinations(found, 2):
            assert np.abs(a - b).max() > 1e-6
    if margin == 0.0:
        for i in range(60):  # the posture itself, in its own turn
            assert np.abs(every.of(i) - q[i]).max(axis=1).min() < 1e-7
        assert len(every.postures) > 2 * len(one.postures)
    # a branch outside the limits is told as it is without every turn
    np.testing.assert_array_equal(every.postures[~every.inside], one.postures[~one.inside])
    np.testing.assert_array_equal(every.pose[~every.inside], one.pose[~one.inside])
    assert (np.diff(every.pose) >= 0).all()


def test_answers_take_their_poses_by_pinocchios_reckoning(reference_robot):
    """No least-squares compromise is passed off as an answer: far, near and inside the reach."""
    robot = reference_robot
    model, data = robot.model, robot.model.createData()
    tip, base = (model.getFrameId(f) for f in (robot.tip_frame, robot.base_frame))
    rng = np.random.default_rng(1)
    R = se3.rotation_exp(rng.uniform(-2, 2, (300, 3)))
    poses = se3.transform(R, rng.uniform([-3, -3, -1], [3, 3, 3.5], (300, 3)))
    answers = robot.inverse(poses)
    reached = np.zeros(300, dtype=bool)
    for q, pose in zip(answers.postures, answers.pose, strict=True):
        pin.framesForwardKinematics(model, data, q)
        T = (data.oMf[base].inverse() * data.oMf[tip]).homogeneous
        assert np.linalg.norm(T[:3, 3] - poses[pose, :3, 3]) < 1e-9
        assert se3.rotation_angle(T[:3, :3].T @ poses[pose, :3, :3]) < 1e-9
        reached[pose] = True
    assert 30 < reached.sum() < 270
    np.testing.assert_array_equal(answers.gap_m == 0, reached)
    assert (answers.gap_m[~reached] > 0).all()


@pytest.mark.parametrize(
    ("q_deg", "singular"),
    [
        ([10, 15, -25, 30, -50, 20], False),
        ([10, 15, -25, 30, 0.5, 20], True),  # wrist straight
        ([10, 15, -25, 30, 10, 20], False),
        ([10, 15, 80.03, 30, -50, 20], True),  # elbow stretched: 90 - atan(225 / 1280)
        ([10, 15, -60, 30, -50, 20], False),
    ],
)
def test_singular_postures_are_flagged(reference_robot, q_deg, singular):
    q = np.deg2rad(q_deg)
    answers = reference_robot.inverse(reference_robot.fk(q), near=q)
    row = np.abs(answers.postures - q).max(axis=1).argmin()
    np.testing.assert_allclose(answers.postures[row], q, atol=1e-6)
    assert answers.singular.shape == answers.inside.shape
    assert answers.singular[row] == singular


def test_the_shoulder_singularity_is_flagged(reference_robot):
    """Wrist centre above axis 1: joint 1 turns the tip about that centre, as the wrist can."""
    robot = reference_robot
    R = se3.rotation_exp([0.3, -0.4, 0.2])

    def any_flag(off_m):
        wrist = np.array([off_m, 0.0, 2.4])
        tip = robot.state(np.zeros(6))
        hand = tip.R_base_tip.T @ (tip.p_base_tip - tip.origins[4])
        answers = robot.inverse(se3.transform(R, wrist + R @ hand))
        assert len(answers.postures) > 0
        return answers.singular

    assert any_flag(0.0005).all()
    assert not any_flag(0.9).all()


def test_the_flag_is_the_smallest_singular_value_over_the_reach(reference_robot):
    robot = reference_robot
    reach = 1.075 + 0.225 + 1.280 + 0.215  # from joint 2 to the faceplate
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (200, 6))
    answers = robot.inverse(robot.fk(q))
    J = robot.jacobian(answers.postures) / np.repeat([reach, 1.0], 3)[:, None]
    smallest = np.linalg.svd(J, compute_uv=False)[:, -1]
    clear = np.abs(smallest - NEAR_SINGULAR) > 1e-6
    np.testing.assert_array_equal(answers.singular[clear], (smallest < NEAR_SINGULAR)[clear])
    assert 0.01 < answers.singular.mean() < 0.5


def with_coupled(robot: Robot, coefficients, lower_deg: float, upper_deg: float) -> Robot:
    limit = CoupledLimit(
        "J2 with J3", np.array(coefficients, float), *np.deg2rad([lower_deg, upper_deg])
    )
    return replace(robot, coupled_limits=(limit,))


def test_coupled_limits_are_limits(reference_robot):
    robot = with_coupled(reference_robot, [0, 1, 1, 0, 0, 0], -40.0, 60.0)
    q = np.random.default_rng(3).uniform(robot.lower, robot.upper, (80, 6))
    free, bound = reference_robot.inverse(robot.fk(q)), robot.inverse(robot.fk(q))
    np.testing.assert_array_equal(free.postures, bound.postures)
    total = np.rad2deg(bound.postures[:, 1] + bound.postures[:, 2])
    np.testing.assert_array_equal(bound.inside, free.inside & (total >= -40) & (total <= 60))
    assert bound.inside.sum() < free.inside.sum()
    # the margin is kept from them, too
    narrow = robot.inverse(robot.fk(q), margin=np.deg2rad(5.0))
    total = np.rad2deg(narrow.postures[narrow.inside][:, 1:3].sum(axis=1))
    assert total.min() >= -35
    assert total.max() <= 55


def test_another_turn_can_keep_a_coupled_limit(reference_robot):
    """Nearest to the reference J4 - J6 is too much; a full turn away it is not."""
    robot = with_coupled(reference_robot, [0, 0, 0, 1, 0, -1], -100.0, 100.0)
    q = np.deg2rad([0, 15, -25, 170, -50, -170])
    answers = robot.inverse(robot.fk(q), near=q)
    best, found = answers.nearest()
    assert found[0]
    kept = []
    for branch in reference_robot.inverse(robot.fk(q)).of(0):
        turned = np.array(turns_inside(branch, robot.lower, robot.upper))
        kept.extend(turned[np.abs(turned[:, 3] - turned[:, 5]) <= np.deg2rad(100)])
    distance = np.linalg.norm(np.array(kept) - q, axis=1)
    assert np.linalg.norm(best[0] - q) == pytest.approx(distance.min(), abs=1e-9)
    # the branch of q itself is given in the turn next to that of q
    same = np.abs(answers.postures[:, :3] - q[:3]).max(axis=1) < 1e-6
    same &= np.abs(answers.postures[:, 4] - q[4]) < 1e-6
    changed = np.rad2deg(answers.postures[same & answers.inside] - q)[0]
    assert sorted(np.abs(changed).round(6).tolist()) == [0, 0, 0, 0, 0, 360]
    every = robot.inverse(robot.fk(q), near=q, every_turn=True)
    assert every.inside.sum() == len(kept)


def test_the_reason_for_no_posture(reference_robot):
    robot = reference_robot
    q = np.deg2rad([0, 15, -25, 0, -50, 0])
    poses = np.stack([robot.fk(q), se3.transform(DOWN, [4.0, 0.0, 1.0])])
    answers = robot.inverse(poses)
    assert answers.reason(0) is None
    far = answers.reason(1)
    assert far is not None
    assert far.gap_m == answers.gap_m[1] > 1.0
    assert (far.joint, far.coupled) == (None, None)
    assert np.isnan(far.excess)
    # joint 5 may no longer bend: 50 deg either way is 40 deg too far, whatever the other branches
    stiff = replace(
        robot,
        lower=np.where(np.arange(6) == 4, np.deg2rad(-10), robot.lower),
        upper=np.where(np.arange(6) == 4, np.deg2rad(10), robot.upper),
    )
    limits = stiff.inverse(poses[0]).reason(0)
    assert limits is not None
    assert limits.gap_m == 0.0
    assert limits.joint == 4
    assert np.rad2deg(limits.excess) == pytest.approx(40.0, abs=1e-6)
    tied = with_coupled(robot, [0, 1, 1, 0, 0, 0], -5.0, 5.0)
    coupled = tied.inverse(poses[0]).reason(0)
    assert coupled is not None
    assert (coupled.joint, coupled.coupled) == (None, "J2 with J3")
    assert np.rad2deg(coupled.excess) == pytest.approx(5.0, abs=1e-6)  # -10 is 5 beyond -5
