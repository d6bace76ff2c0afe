"""Inverse kinematics: every branch, the right full turn, the limits, how far is too far."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from calib import Robot, preset_names, se3
from calib.errors import InputError
from calib.robots.bounds import nearest_turns
from calib.robots.inverse.closed_form import ClosedForm
from calib.robots.inverse.redundant import RedundantArm
from calib.robots.inverse.solutions import DampedIteration
from tests.arms import apart

CLOSURE = 1e-9
TURN = 2 * np.pi
DOWN = np.diag([1.0, -1.0, -1.0])


SIX_AXES = [name for name in preset_names() if Robot.preset(name).n == 6]


@pytest.fixture(scope="module", params=SIX_AXES)
def robot(request) -> Robot:
    return Robot.preset(request.param)


def inside_all(robot: Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Random postures inside the limits, the coupled ones included."""
    q = rng.uniform(robot.lower, robot.upper, (20 * count, robot.n))
    for limit in robot.coupled_limits:
        q = q[limit.margin(q) >= 0]
    return q[:count]


def spherical(robot: Robot) -> bool:
    """Whether the last three axes meet in a point, which joints 1 to 3 alone place."""
    state = robot.state(np.full(6, 0.4))
    a, o = state.axes[3:], state.origins[3:]
    pairs = [(0, 1), (1, 2), (0, 2)]
    return max(abs((o[j] - o[i]) @ np.cross(a[i], a[j])) for i, j in pairs) < 1e-9


def test_answers_close_lie_inside_and_hold_the_posture_asked_for(robot):
    q = inside_all(robot, np.random.default_rng(0), 40)
    poses = robot.fk(q)
    answers = robot.inverse(poses)
    np.testing.assert_allclose(robot.fk(answers.postures), poses[answers.pose], atol=CLOSURE)
    np.testing.assert_array_equal(answers.gap_m, 0.0)
    assert (np.diff(answers.pose) >= 0).all()
    inside = answers.postures[answers.inside]
    assert (inside >= robot.lower - CLOSURE).all()
    assert (inside <= robot.upper + CLOSURE).all()
    for i in range(len(q)):
        assert apart(answers.of(i), q[i]).min() < 1e-7
        branches = answers.postures[answers.pose == i]
        assert len(branches) <= 8
        between = apart(branches[:, None], branches[None])
        assert between[~np.eye(len(branches), dtype=bool)].min() > 1e-6  # each branch once


def test_outside_means_that_no_full_turn_helps(robot):
    q = inside_all(robot, np.random.default_rng(1), 20)
    answers = robot.inverse(robot.fk(q))
    narrow = (robot.joint_range < TURN).any() or robot.coupled_limits
    assert answers.inside.all() == (not narrow)
    for posture in answers.postures[~answers.inside]:
        turned = posture[:, None] + TURN * np.arange(-3, 4)
        fits = (turned >= robot.lower[:, None]) & (turned <= robot.upper[:, None])
        for choice in itertools.product(*[turned[j][fits[j]] for j in range(6)]):
            assert any(limit.margin(np.array(choice)) < 0 for limit in robot.coupled_limits)


def test_nearest_is_the_nearest_of_all_branches_and_all_turns(robot):
    rng = np.random.default_rng(2)
    for _ in range(4):
        reference, made = inside_all(robot, rng, 2)
        answers = robot.inverse(robot.fk(made), near=reference)
        best, found = answers.nearest()
        assert found.tolist() == [True]
        shortest = np.inf
        for branch in answers.postures:
            choices = []
            for j in range(6):
                turned = branch[j] + TURN * np.arange(-4, 5)
                keep = (turned >= robot.lower[j] - 1e-9) & (turned <= robot.upper[j] + 1e-9)
                choices.append(turned[keep])
            for posture in map(np.array, itertools.product(*choices)):
                if all(limit.margin(posture) >= -1e-9 for limit in robot.coupled_limits):
                    shortest = min(shortest, np.linalg.norm(posture - reference))
        assert np.linalg.norm(best[0] - reference) == pytest.approx(shortest, abs=1e-9)


@pytest.mark.parametrize("bend", [0.0, 1e-11, 1e-7, 1e-6, 1e-4])
def test_a_straight_wrist_loses_no_pose_whatever_its_roll(robot, bend):
    """EAIK alone returns q4 = q6 = 0 there, which takes another pose."""
    rng = np.random.default_rng(3)
    count = 4
    q = inside_all(robot, rng, count)
    q[:, 4] = bend * rng.choice([-1, 1], count)
    poses = robot.fk(q)
    for i in range(count):
        answers = robot.inverse(poses[i], near=q[i])
        np.testing.assert_allclose(
            robot.fk(answers.postures), poses[[i] * len(answers.postures)], atol=CLOSURE
        )
        best, found = answers.nearest()
        assert found[0]
        if spherical(robot):
            # joints 1 to 3 are those asked for; on the line itself any split of the roll is right
            np.testing.assert_allclose(best[0, :3], q[i, :3], atol=1e-6)
        if bend == 0.0 or bend > 1e-7:
            np.testing.assert_allclose(best[0], q[i], atol=1e-5)


def test_the_roll_of_a_straight_wrist_is_shared_from_the_reference(reference_robot):
    q = np.deg2rad([10, 15, -25, 30, 0, 20])
    near = np.deg2rad([10, 15, -25, 0, 0, 0])
    best, _ = reference_robot.inverse(reference_robot.fk(q), near=near).nearest()
    np.testing.assert_allclose(np.rad2deg(best[0]), [10, 15, -25, 25, 0, 25], atol=1e-6)


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_postures_at_the_very_limits_are_found(robot, end):
    robot = replace(robot, coupled_limits=())  # they may exclude the corner
    q = getattr(robot, end)
    best, found = robot.inverse(robot.fk(q), near=q).nearest()
    assert found[0]
    # a UR arm has whole turns for limits, and is singular there
    if np.linalg.svd(robot.jacobian(q), compute_uv=False)[-1] > 1e-6:
        np.testing.assert_allclose(best[0], q, atol=1e-9)


def test_full_turns():
    lower, upper = np.deg2rad([-360.0, -185.0]), np.deg2rad([360.0, 185.0])

    def turned(q, near):
        picked, inside = nearest_turns(
            np.deg2rad([q]), lower, upper, np.deg2rad(np.asarray(near, dtype=float))
        )
        return np.rad2deg(picked[0]).round(9).tolist(), bool(inside[0])

    assert turned([10.0, 0.0], [0, 0]) == ([10.0, 0.0], True)
    assert turned([10.0, 0.0], [340, 0]) == ([10.0, 0.0], True)  # 370 would be nearer
    assert turned([-10.0, 0.0], [340, 0]) == ([350.0, 0.0], True)
    assert turned([170.0, 0.0], [-300, 0]) == ([-190.0, 0.0], True)
    assert turned([0.0, 178.0], [0, -180]) == ([0.0, -182.0], True)
    assert turned([700.0, 365.0], [0, 0]) == ([-20.0, 5.0], True)
    lower, upper = np.deg2rad([-20.0, -185.0]), np.deg2rad([30.0, 185.0])
    # the turn that breaks the limit least, not the one nearest to the reference
    assert turned([300.0, 0.0], [300, 0]) == ([-60.0, 0.0], False)
    assert turned([100.0, 0.0], [500, 0]) == ([100.0, 0.0], False)


def test_a_margin_can_leave_another_turn_or_none(reference_robot):
    """Narrower limits on the same arm: the turn changes first, then the posture is gone."""
    q = np.deg2rad([0, 15, -25, 0, -50, 350])
    pose = reference_robot.fk(q)

    def nearest(margin_deg: float):
        margin = np.deg2rad([0, 0, 0, 0, 0, margin_deg])
        robot = replace(
            reference_robot,
            lower=reference_robot.lower + margin,
            upper=reference_robot.upper - margin,
        )
        answers = robot.inverse(pose, near=q)
        keep = apart(answers.postures[:, :5], q[:5]) < 1e-6
        return np.rad2deg(answers.postures[keep][0, 5]), answers.inside[keep][0]

    assert nearest(0.0) == (pytest.approx(350), True)
    assert nearest(11.0) == (pytest.approx(-10), True)
    assert nearest(351.0) == (pytest.approx(-10), False)


REACHES = [
    ("r2000ic165f", [0.312, 0, 0.670], 1.075 + np.hypot(0.225, 1.280), 0.215),
    ("r2000ia165f_fig7", [0.0, 0, 0.479], 1.075 + 1.300, 0.260),
]


@pytest.mark.parametrize(("name", "shoulder", "reach", "hand"), REACHES)
@pytest.mark.parametrize("place", [[3.5, 0, 0.9], [4.0, 0.0, 2.5], [3.0, 1.5, 2.0], [-3, 1, 0.5]])
def test_what_is_too_far_says_by_how_much(name, shoulder, reach, hand, place):
    robot = Robot.preset(name)
    answers = robot.inverse(se3.transform(DOWN, place))
    assert len(answers.postures) == 0
    np.testing.assert_array_equal(answers.nearest()[0], np.full((1, 6), np.nan))
    assert answers.nearest()[1].tolist() == [False]
    # the wrist centre stands above the tip; the shoulder turns with joint 1
    wrist = np.add(place, [0, 0, hand])
    flat = np.array([np.hypot(wrist[0], wrist[1]), 0, wrist[2]])
    expected = np.linalg.norm(flat - shoulder) - reach
    assert answers.gap_m[0] == pytest.approx(expected, abs=1e-4)
    # and the same by search over joints 1 to 3

    def miss(q):
        at = robot.state(np.append(q, [0, 0, 0])).origins[4]
        return np.linalg.norm(at - wrist)

    rng = np.random.default_rng(0)
    starts = [[np.arctan2(wrist[1], wrist[0]), *rng.uniform(-1.5, 1.5, 2)] for _ in range(4)]
    searched = min(minimize(miss, s, method="Nelder-Mead").fun for s in starts)
    assert answers.gap_m[0] == pytest.approx(searched, abs=1e-3)


def test_many_poses_at_once_are_the_same_poses_one_by_one(reference_robot):
    q = np.random.default_rng(5).uniform(reference_robot.lower, reference_robot.upper, (12, 6))
    poses = reference_robot.fk(q)
    poses[4, :3, 3] += 9.0  # out of reach in between
    together = reference_robot.inverse(poses, near=q[0])
    for i, pose in enumerate(poses):
        alone = reference_robot.inverse(pose, near=q[0])
        np.testing.assert_array_equal(alone.postures, together.postures[together.pose == i])
        np.testing.assert_array_equal(alone.of(0), together.of(i))
    assert len(together.of(4)) == 0
    assert together.gap_m[4] > 5.0
    assert together.nearest()[1].tolist() == [i != 4 for i in range(12)]
    assert len(reference_robot.inverse(np.empty((0, 4, 4))).postures) == 0


@pytest.mark.parametrize(
    ("pose", "near", "message"),
    [
        (np.full((4, 4), np.nan), None, r"T_base_tip\[0, 0\] is not a finite number"),
        (np.eye(3), None, r"T_base_tip has shape \(3, 3\)"),
        (np.diag([1.0, 1, -1, 1]), None, "left-handed"),
        (np.eye(4), np.zeros(5), "has 6 joints, the posture has 5 values"),
        (np.eye(4), np.zeros((2, 6)), r"near has shape \(2, 6\), not \(6,\)"),
    ],
)
def test_what_is_no_pose_or_no_reference_is_refused(reference_robot, pose, near, message):
    with pytest.raises(InputError, match=message):
        reference_robot.inverse(pose, near=near)


def test_each_arm_has_its_solver(random_urdf, seven_axis_robot):
    assert isinstance(Robot.preset("r2000ic165f")._inverse, ClosedForm)
    assert isinstance(seven_axis_robot._inverse, RedundantArm)
    for n in (5, 6, 7, 8):
        robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), n))
        assert isinstance(robot._inverse, DampedIteration)


def test_iteration_closes_on_a_six_axis_arm_without_closed_form(random_urdf):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 6))
    q = np.random.default_rng(7).uniform(robot.lower, robot.upper, (10, 6))
    poses = robot.fk(q)
    answers = robot.inverse(poses)
    np.testing.assert_allclose(robot.fk(answers.postures), poses[answers.pose], atol=CLOSURE)
    assert set(answers.pose.tolist()) == set(range(len(q)))
    np.testing.assert_array_equal(answers.gap_m, 0.0)
    assert answers.inside.all()
    assert (answers.postures >= robot.lower).all()
    assert (answers.postures <= robot.upper).all()


def test_iteration_stays_where_the_reference_already_takes_the_pose(random_urdf):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 8))
    q = (robot.lower + robot.upper) / 2 + 0.1
    best, found = robot.inverse(robot.fk(q), near=q).nearest()
    assert found[0]
    np.testing.assert_allclose(best[0], q, atol=1e-9)


def test_iteration_gives_each_posture_once_and_the_same_at_every_call(random_urdf):
    """With six joints there are but a few postures, and several starts fall to the same one."""
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 6))
    pose = robot.fk((robot.lower + robot.upper) / 2 + 0.1)
    answers = robot.inverse(pose)
    assert len(answers.postures) > 0
    for a, b in itertools.combinations(answers.postures, 2):
        assert np.abs(a - b).max() > 1e-3
    np.testing.assert_array_equal(robot.inverse(pose).postures, answers.postures)


def test_iteration_says_how_far_what_is_too_far_is(random_urdf):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 6))
    steps = [robot.chain.placements[:, :3, 3], robot.chain.T_link_tip[None, :3, 3]]
    reach = np.linalg.norm(np.concatenate(steps), axis=1).sum()
    answers = robot.inverse(se3.transform(DOWN, [9.0, 0.0, 0.5]))
    assert len(answers.postures) == 0
    assert np.hypot(9.0, 0.5) - reach < answers.gap_m[0] < np.hypot(9.0, 0.5) + reach


def test_iteration_with_a_margin_that_leaves_no_room(random_urdf):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 6))
    middle = (robot.lower + robot.upper) / 2
    margin = float((robot.upper - robot.lower).max())
    answers = robot.inverse(robot.fk(middle), near=middle, margin=margin)
    assert len(answers.postures)
    assert not answers.inside.any()
    assert answers.reason(0).excess > 0.0


def test_iteration_on_many_poses_at_once(random_urdf, monkeypatch):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 6))
    poses = robot.fk(np.random.default_rng(0).uniform(-1, 1, (7, 6)))
    together = robot.inverse(poses)
    monkeypatch.setattr("calib.robots.inverse.solutions.DampedIteration.poses_at_once", 3)
    parts = robot.inverse(poses)
    np.testing.assert_array_equal(parts.pose, together.pose)
    np.testing.assert_allclose(parts.postures, together.postures, atol=1e-9)
    np.testing.assert_allclose(parts.gap_m, together.gap_m, atol=1e-9)


@pytest.mark.parametrize("margin", [np.nan, np.inf])
def test_what_is_no_margin_is_refused(reference_robot, margin):
    with pytest.raises(InputError, match=r"^the margin to the limits is"):
        reference_robot.inverse(np.eye(4), margin=margin)


def test_limits_of_many_turns_do_not_fill_the_memory(reference_robot):
    robot = replace(reference_robot, lower=np.full(6, -600.0), upper=np.full(6, 600.0))
    pose = robot.fk(np.full(6, 0.3))
    assert robot.inverse(pose).nearest()[1].all()
    with pytest.raises(InputError, match="in every turn of their joints"):
        robot.inverse(pose, every_turn=True)


def test_limits_are_checked_of_one_posture(reference_robot):
    with pytest.raises(InputError, match=r"^posture has shape \(2, 6\), not \(6,\)"):
        reference_robot.check_limits(np.zeros((2, 6)))
