"""Six-axis arms other than the spherical wrist on exact right angles: parallel axes, rounding."""

from dataclasses import replace

import numpy as np
import pytest

from calib import Robot, se3
from calib.robots import SerialChain
from calib.robots.inverse.closed_form import ClosedForm
from calib.robots.inverse.ideal import idealised
from tests.arms import apart, arm_from, missed

CLOSURE = 1e-9

UR5E = [  # xyz [m], rpy [rad]: three parallel axes, none of the wrist's meet in one point
    ((0, 0, 0.1625), (0, 0, 0)),
    ((0, 0, 0), (np.pi / 2, 0, 0)),
    ((-0.425, 0, 0), (0, 0, 0)),
    ((-0.3922, 0, 0.1333), (0, 0, 0)),
    ((0, -0.0997, 0), (np.pi / 2, 0, 0)),
    ((0, 0.0996, 0), (-np.pi / 2, 0, 0)),
]

GP180 = [  # as its maker's description rounds right angles
    ((0, 0, 0.650), (0, 0, 0)),
    ((0.325, 0, 0), (0, -1.571, -1.571)),
    ((1.150, 0, 0), (3.142, 0, 0)),
    ((0.300, -1.225, 0), (-1.571, 0, 0)),
    ((0, 0, 0), (1.571, 0, 0)),
    ((0, -0.225, 0), (-1.571, 0, 0)),
]


@pytest.fixture(scope="module")
def ur5e() -> Robot:
    return arm_from([(xyz, np.degrees(rpy), "0 0 1", 360.0) for xyz, rpy in UR5E])


@pytest.fixture(scope="module")
def rounded() -> Robot:
    return arm_from([(xyz, np.degrees(rpy), "0 0 1", 172.0) for xyz, rpy in GP180])


@pytest.fixture(scope="module")
def calibrated() -> Robot:
    """The reference arm with every frame off by some tenths of a millimetre and milliradian."""
    robot, rng = Robot.preset("r2000ic165f"), np.random.default_rng(0)
    off = se3.transform(se3.rotation_exp(rng.normal(0, 2e-4, (6, 3))), rng.normal(0, 2e-4, (6, 3)))
    chain = replace(robot.chain, placements=robot.chain.placements @ off)
    return replace(robot, chain=chain)


@pytest.mark.parametrize("bend", [1e-9, 3e-8, 3e-7, 3e-6, 1e-5, 1e-3])
@pytest.mark.parametrize("middle", [0.0, np.pi])
def test_three_parallel_axes_lose_nothing_near_a_straight_wrist(ur5e, bend, middle):
    """EAIK loses the digits of joint 6 below 3e-6, and up to a twentieth of the poses."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-3, 3, (150, 6))
    q[:, 4] = middle + bend * rng.choice([-1, 1], 150)
    off = missed(ur5e, q)
    # the nearer the line, the farther a posture moves for the rounding of its pose, 1e-15, and a
    # hundred times farther where the elbow is almost stretched, too
    assert (off < 1e-6 + 2e-13 / bend).all()


@pytest.mark.parametrize("bend", [0.0, 1e-13, 1e-11])
def test_on_the_line_the_roll_of_the_reference_is_kept(ur5e, bend):
    rng = np.random.default_rng(1)
    q = rng.uniform(-3, 3, (12, 6))
    q[:, 4] = bend
    for posture in q:
        best, found = ur5e.inverse(ur5e.fk(posture), near=posture).nearest()
        assert found[0]
        np.testing.assert_allclose(best[0], posture, atol=1e-6)
    # from elsewhere no pose is lost either
    answers = ur5e.inverse(ur5e.fk(q), near=np.full(6, 0.7))
    assert set(answers.pose.tolist()) == set(range(12))


def test_on_the_line_joint_6_turns_where_the_arm_is_too_short(ur5e):
    """A stretched arm reaches such a pose with some turns of joint 6 only."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-3, 3, (500, 6))
    q[:, 2] = rng.choice([0.0, 1e-9, 0.01, 0.2], 500)
    q[:, 4] = rng.choice([0.0, np.pi], 500)
    poses = ur5e.fk(q)
    answers = ur5e.inverse(poses)
    assert answers.nearest()[1].all()
    np.testing.assert_allclose(ur5e.fk(answers.postures), poses[answers.pose], atol=CLOSURE)


def test_each_branch_of_three_parallel_axes_is_given_once(ur5e):
    rng = np.random.default_rng(2)
    q = rng.uniform(-3, 3, (80, 6))
    q[::2, 4] = 1e-7
    answers = ur5e.inverse(ur5e.fk(q))
    for i in range(80):
        own = answers.postures[answers.pose == i]
        assert 1 <= len(own) <= 8
        between = apart(own[:, None], own[None])
        assert between[~np.eye(len(own), dtype=bool)].min(initial=1.0) > 1e-6


@pytest.mark.parametrize("name", ["rounded", "calibrated"])
def test_inexact_arms_are_solved_through_their_ideal(request, name):
    robot = request.getfixturevalue(name)
    assert isinstance(robot._inverse, ClosedForm)
    q = np.random.default_rng(3).uniform(robot.lower, robot.upper, (200, 6))
    off = missed(robot, q)
    smallest = np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1]
    # two branches that are about to merge may both be closed in on from one side
    assert (off[smallest > 0.01] < 1e-6).all()
    assert (off < 1e-6).mean() > 0.995
    far = robot.inverse(se3.transform(np.eye(3), [4.0, 0.0, 1.0]))
    assert len(far.postures) == 0
    assert 0.5 < far.gap_m[0] < 2.5


def test_the_ideal_of_an_exact_arm_is_the_arm(reference_robot):
    ideal = idealised(reference_robot.chain, 0.02, 5e-3)
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(
        ideal.forward(q).T_base_tip, reference_robot.fk(q), rtol=0, atol=1e-14
    )


def test_only_what_is_slight_is_idealised():
    frames = se3.transform(
        se3.rotation_exp([[0.3, 0.2, 0.1], [9e-4, 0, 0], [np.pi / 2 + 9e-4, 0, 0], [0.3, 0, 0]]),
        [[0.1, 0.2, 0.3], [0.4, 0.0, 0.1], [9e-4, 0.2, 0.0], [8e-3, 0.0, 0.0]],
    )
    chain = SerialChain(frames, np.tile([0.0, 0.0, 1.0], (4, 1)), np.eye(4))
    ideal = idealised(chain, 2e-3, 1e-3)
    axes, points = ideal.forward(np.zeros(4)).axes, ideal.forward(np.zeros(4)).origins
    np.testing.assert_array_equal(axes[:2], np.tile(chain.forward(np.zeros(4)).axes[0], (2, 1)))
    assert abs(axes[1] @ axes[2]) < 1e-16
    assert axes[2] @ axes[3] == pytest.approx(np.cos(0.3), abs=1e-12)

    def gap(j):
        normal = np.cross(axes[j], axes[j + 1])
        return abs((points[j + 1] - points[j]) @ normal) / np.linalg.norm(normal)

    assert gap(1) < 1e-15
    assert gap(2) == pytest.approx(8e-3, abs=1e-12)


def test_frames_far_along_their_axes_do_not_change_the_ideal():
    """A controller's numbers: axes that are parallel but for 5e-4 rad meet 800 m away."""
    frames = se3.transform(
        se3.rotation_exp([[0, 0, 0], [np.pi / 2, 0, 0], [0, 5e-4, 0], [0, -3e-4, 0]]),
        [[0, 0, 0.1], [0, 0, 0], [0.4, 0, 0], [0.4, 0, 0]],
    )
    axes = np.tile([0.0, 0.0, 1.0], (4, 1))
    near, frames_far = SerialChain(frames, axes, np.eye(4)), frames.copy()
    for j, along in ((2, 800.0), (3, -500.0)):
        frames_far[j] = frames_far[j] @ se3.transform(np.eye(3), [0, 0, along])
        if j + 1 < 4:
            back = se3.transform(np.eye(3), [0, 0, -along])
            frames_far[j + 1] = back @ frames_far[j + 1]
    far = SerialChain(frames_far, axes, se3.transform(np.eye(3), [0, 0, 500.0]))
    q = np.random.default_rng(0).uniform(-3, 3, (20, 4))
    np.testing.assert_allclose(
        idealised(far, 0.02, 5e-3).forward(q).T_base_tip,
        idealised(near, 0.02, 5e-3).forward(q).T_base_tip,
        rtol=0,
        atol=1e-9,
    )
