"""Six-axis arms with an offset wrist: every posture of a pose, against independent searches."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from calib import Robot, se3
from calib.robots.inverse import offset_wrist
from calib.robots.inverse.offset_wrist import OffsetWrist
from calib.robots.inverse.solutions import close_in, pose_error
from tests.arms import Joint, apart, arm_from, missed

LIMIT = 180.0

ARMS: dict[str, list[Joint]] = {
    # FANUC CRX-10iA/L: fanuc_driver, crx_description
    "crx10ial": [
        ((0, 0, 0.245), (0, 0, 0), "0 0 1", LIMIT),
        ((0, 0, 0), (0, 0, 0), "0 1 0", LIMIT),
        ((0, 0, 0.71), (0, 0, 0), "0 -1 0", LIMIT),
        ((0, 0, 0), (0, 0, 0), "-1 0 0", LIMIT),
        ((0.54, -0.15, 0), (0, 0, 0), "0 -1 0", LIMIT),
        ((0.16, 0, 0), (0, 0, 0), "-1 0 0", LIMIT),
    ],
    # Yaskawa HC10DT: ROS-Industrial motoman, motoman_hc10_support
    "hc10dt": [
        ((0, 0, 0.275), (0, 0, 0), "0 0 1", LIMIT),
        ((0, 0, 0), (0, 0, 0), "0 1 0", LIMIT),
        ((0, 0, 0.7), (0, 0, 0), "0 -1 0", LIMIT),
        ((0, 0, -0.5), (0, 0, 0), "0 0 1", LIMIT),
        ((0, 0.162, 0), (0, 0, 0), "0 -1 0", LIMIT),
        ((0, 0, 0), (0, 0, 0), "0 0 1", LIMIT),
    ],
    # ABB CRB 15000-5/0.95: ROS-Industrial abb, abb_crb15000_support. Axis 6 misses axis 5
    "crb15000": [
        ((0, 0, 0.265), (0, 0, 0), "0 0 1", LIMIT),
        ((0, 0, 0), (0, 0, 0), "0 1 0", LIMIT),
        ((0, 0, 0.444), (0, 0, 0), "0 1 0", LIMIT),
        ((0, 0, 0.11), (0, 0, 0), "1 0 0", LIMIT),
        ((0.47, 0, 0), (0, 0, 0), "0 1 0", LIMIT),
        ((0.101, 0, 0.08), (0, 0, 0), "1 0 0", LIMIT),
    ],
    # made up: offsets of the shoulder, oblique axes, axis 6 misses axis 5
    "oblique": [
        ((0, 0, 0.245), (0, 0, 0), "0 0 1", LIMIT),
        ((0.1, 0.05, 0), (10, 0, 0), "0 1 0", LIMIT),
        ((0, 0, 0.71), (0, 0, 0), "0 -1 0", LIMIT),
        ((0, 0.03, 0.05), (5, 20, 30), "-1 0 0", LIMIT),
        ((0.54, 0, 0), (0, 0, 30), "0 -1 0", LIMIT),
        ((0.16, 0, 0.08), (20, 25, 30), "-1 0 0", LIMIT),
    ],
}


@pytest.fixture(scope="module", params=ARMS)
def robot(request) -> Robot:
    return replace(arm_from(ARMS[request.param]), name=request.param)


def found_by_search(robot: Robot, pose: np.ndarray, starts: int, seed: int) -> list[np.ndarray]:
    """Postures that random starts close in on, each once."""
    free = np.full(6, np.inf)
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (starts, 6))
    q = close_in(robot.chain, q, np.tile(pose, (starts, 1, 1)), -free, free, 60)
    q = q[np.abs(pose_error(robot.chain, q, pose)).max(axis=1) < 1e-9]
    once = []
    while len(q):
        once.append(q[0])
        q = q[apart(q, q[0]) > 1e-4]
    return once


def test_no_posture_is_lost_and_each_is_given_once(robot):
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (150, 6))
    assert isinstance(robot._inverse, OffsetWrist)
    assert missed(robot, q).max() < 1e-7
    answers = robot.inverse(robot.fk(q))
    np.testing.assert_array_equal(answers.gap_m, 0.0)
    assert answers.inside.all()
    counts = np.bincount(answers.pose, minlength=len(q))
    assert (counts % 2 == 0).all()  # real postures come and go in pairs
    assert counts.max() <= 16
    for i in range(len(q)):
        own = answers.postures[answers.pose == i]
        between = apart(own[:, None], own[None])
        assert between[~np.eye(len(own), dtype=bool)].min() > 1e-6


def check_against_search(robot: Robot, poses: int, starts: int) -> None:
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (poses, 6))
    for i, pose in enumerate(robot.fk(q)):
        answers = robot.inverse(pose).postures
        searched = found_by_search(robot, pose, starts, i)
        assert len(searched) >= 2
        assert len(answers) >= len(searched)
        for posture in searched:
            assert apart(answers, posture).min() < 1e-6


def test_all_that_a_search_finds_is_found(robot):
    check_against_search(robot, poses=2, starts=300)


@pytest.mark.slow
@pytest.mark.parametrize("poses", [4, pytest.param(20, marks=pytest.mark.full)])
def test_all_that_a_long_search_finds_is_found(robot, poses):
    check_against_search(robot, poses, starts=8_000)


def lost_by_search(robot: Robot, postures: np.ndarray, starts: int) -> list[np.ndarray]:
    """Postures that a search finds for the poses of given ones, and that are no answers.

    Not where all of a line of postures takes the pose within rounding.
    """
    lost = []
    for i, (posture, pose) in enumerate(zip(postures, robot.fk(postures), strict=True)):
        known = np.array([posture, *found_by_search(robot, pose, starts, i)])
        answers = robot.inverse(pose).postures
        apart_by = apart(answers[:, None], known).min(axis=0)
        smallest = robot.chain.smallest_singular_values(robot.chain.forward(known))
        lost += list(known[(apart_by > 1e-3) & (smallest > 3e-6)])
    return lost


@pytest.mark.parametrize("size", [3e-4, 1e-3])
def test_no_branch_is_lost_near_the_zero_posture(robot, size):
    """There axes 1 and 4 of an arm like the HC10 are almost one line, and branches almost merge."""
    q = np.random.default_rng(3).uniform(-size, size, (25, 6))
    assert not lost_by_search(robot, q, starts=200)


@pytest.mark.slow
@pytest.mark.parametrize("poses", [10, pytest.param(40, marks=pytest.mark.full)])
def test_no_branch_is_lost_near_singular_postures(robot, poses):
    rng = np.random.default_rng(4)
    off = rng.uniform(-1.0, 1.0, (3, poses, 6)) * 10.0 ** rng.uniform(-4.0, -1.5, (3, poses, 1))
    quarters = rng.integers(-2, 3, (2, poses, 6)) * (np.pi / 2.0)
    quarters[1, :, rng.integers(0, 6, 3)] += rng.uniform(-np.pi, np.pi, (3, poses))
    q = np.concatenate([off[0], quarters[0] + off[1], quarters[1] + off[2]])
    assert not lost_by_search(robot, q, starts=2_000)


@pytest.mark.parametrize("joint", [1, 2, 3, 4])
def test_almost_singular_postures_are_found(robot, joint):
    """Straight wrists and arms: two branches meet, and the polynomial has a double zero."""
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (140, 6))
    q[:, joint] = np.repeat([0.0, 1e-9, 1e-6, 1e-3], 35)
    if robot.name == "oblique":
        q[:, joint] += -np.pi / 2 if joint == 2 else 0.3
    off = missed(robot, q)
    assert np.quantile(off, 0.99) < 1e-6
    assert off.max() < 1e-4


@pytest.mark.parametrize("fold", [0.0, np.pi])
def test_the_end_of_the_reach_is_reached(robot, fold):
    """The elbow stretched or folded: both its branches meet."""
    solver = robot._inverse
    flat = [np.arctan2(v[1], v[0]) for v in (solver._upper, solver._fore)]
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (120, 6))
    beyond = np.repeat([0.0, 1e-8, 1e-4], 40)
    way = solver._axes[2][2]  # of axis 3, along or against axis 2
    q[:, 2] = way * (flat[0] - flat[1]) + fold + beyond
    # the pose, rounded to 1e-16, leaves 1e-8 of the stretched elbow open
    assert np.quantile(missed(robot, q), 0.99) < 1e-5


def test_joint_1_is_found_where_the_wrist_is_above_the_base(robot):
    """There any angle of joint 1 takes the wrist's point to its place, and its axes decide."""
    if robot.name == "oblique":
        pytest.skip("its wrist passes the first axis")
    at = {"crx10ial": [0.54, 0, 0], "hc10dt": [0, 0, -0.5], "crb15000": [0.47, 0, 0.11]}[robot.name]
    q = np.random.default_rng(4).uniform(-np.pi, np.pi, (120, 6))
    q[:, :2] = 0.0
    elbow = robot.state(q)
    x, _, z = (elbow.rotations[:, 2] @ at + elbow.origins[:, 2] - elbow.origins[:, 1]).T
    q[:, 0] = np.random.default_rng(5).uniform(-np.pi, np.pi, 120)
    q[:, 1] = np.repeat([0.0, 1e-8, 1e-4], 40) - np.arctan2(x, z)
    off = missed(robot, q)
    smallest = np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1]
    assert off[smallest > 1e-3].max() < 1e-5
    assert np.isfinite(off).all()


def test_a_calibrated_arm_is_solved_through_its_ideal(robot):
    rng = np.random.default_rng(0)
    off = se3.transform(se3.rotation_exp(rng.normal(0, 2e-4, (6, 3))), rng.normal(0, 2e-4, (6, 3)))
    off[0] = np.eye(4)
    placements = robot.chain.placements @ off
    robot = replace(robot, chain=replace(robot.chain, placements=placements))
    assert isinstance(robot._inverse, OffsetWrist)
    q = rng.uniform(-np.pi, np.pi, (150, 6))
    smallest = np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1]
    off = missed(robot, q)
    assert off[smallest > 0.01].max() < 1e-6
    assert (off < 1e-6).mean() > 0.99


def test_limits_and_turns_are_those_of_every_arm(robot):
    lower, upper = (
        np.deg2rad([-190, -100, -60, -350, -180, -400]),
        np.deg2rad([190, 100, 200, 350, 180, 400]),
    )
    robot = replace(robot, lower=lower, upper=upper)
    q = np.random.default_rng(6).uniform(lower, upper, (8, 6))
    every = robot.inverse(robot.fk(q), every_turn=True)
    for i, posture in enumerate(q):
        assert np.abs(every.of(i) - posture).max(axis=1).min() < 1e-7  # in its own turn
        inside = every.of(i)
        assert (inside >= lower - 1e-9).all()
        assert (inside <= upper + 1e-9).all()
        best, found = robot.inverse(robot.fk(posture), near=posture).nearest()
        assert found[0]
        np.testing.assert_allclose(best[0], posture, atol=1e-7)


@pytest.mark.parametrize("place", [[3.5, 0, 0.9], [-1.6, 1, 0.5]])
def test_what_is_too_far_says_by_how_much(robot, place):
    pose = se3.transform(np.diag([1.0, -1.0, -1.0]), place)
    answers = robot.inverse(pose)
    assert len(answers.postures) == 0
    if robot.name == "oblique":  # its reach has another shape
        assert np.isnan(answers.gap_m[0])
        return
    solver = robot._inverse
    G, zero = solver._moved(pose[None]), robot.chain.forward(np.zeros(6))
    local = zero.rotations[2].T @ (solver._F.T @ solver._meeting - zero.origins[2])

    def short(x):
        # joint 6 of the pose, joints 1 to 3 of the arm: the wrist's point from both ends
        W = solver._F.T @ solver._wrist(G, x[:1])[0][:, 0]
        state = robot.chain.forward(np.append(x[1:], [0, 0, 0]))
        return np.linalg.norm(state.rotations[2] @ local + state.origins[2] - W)

    rng = np.random.default_rng(0)
    searched = min(minimize(short, start).fun for start in rng.uniform(-3, 3, (3, 4)))
    assert answers.gap_m[0] == pytest.approx(searched, abs=1e-3)


def test_what_the_axes_forbid_is_out_of_reach_by_nothing_known(robot):
    """The wrist's point can be reached, but axis 5 cannot follow."""
    rng = np.random.default_rng(7)
    poses = robot.fk(rng.uniform(-np.pi, np.pi, (100, 6)))
    poses[:, :3, :3] = se3.rotation_exp(rng.normal(0, 2, (100, 3)))
    answers = robot.inverse(poses)
    lost = np.setdiff1d(np.arange(100), answers.pose)
    assert len(lost)
    assert (np.isnan(answers.gap_m[lost]) | (answers.gap_m[lost] > 0)).all()
    for i in lost[:2]:
        assert not found_by_search(robot, poses[i], 200, int(i))


def test_many_poses_at_once_are_the_same_poses_one_by_one(robot, monkeypatch):
    poses = robot.fk(np.random.default_rng(8).uniform(-3, 3, (12, 6)))
    poses[4, :3, 3] += 9.0
    together = robot.inverse(poses)
    monkeypatch.setattr(offset_wrist.OffsetWrist, "poses_at_once", 5)
    parts = robot.inverse(poses)
    np.testing.assert_array_equal(parts.pose, together.pose)
    np.testing.assert_allclose(parts.postures, together.postures, atol=1e-9)
    assert len(robot.inverse(np.empty((0, 4, 4))).postures) == 0


def test_the_polynomial_has_the_degree_of_sixteen_postures(robot, monkeypatch):
    """Sampled as if its degree were 12, what is beyond 8 (or 4 of its square root) is rounding."""
    solver = robot._inverse
    G = solver._moved(robot.fk(np.random.default_rng(9).uniform(-3, 3, (20, 6))))
    degree = 4 if solver._mirrored else 8
    assert solver._mirrored == (robot.name in ("crx10ial", "hc10dt"))
    monkeypatch.setattr(offset_wrist, "_DEGREE", 12 * 8 // degree)
    monkeypatch.setattr(offset_wrist, "_SAMPLES", 64)
    size = np.abs(solver._polynomial(G)[0])
    assert size.shape == (20, 13)
    assert (size[:, degree] > 1e-9 * size.max(axis=1)).all()
    assert (size[:, degree + 1 :] < 1e-13 * size.max(axis=1, keepdims=True)).all()


def test_wrists_of_other_kinds_are_left_to_others(robot):
    chain = robot.chain
    placements = chain.placements.copy()
    placements[4, :3, 3] += [0.05, 0.0, 0.05]  # axes 4 and 5 miss each other
    assert OffsetWrist.of(replace(chain, placements=placements)) is None
    assert OffsetWrist.of(Robot.preset("r2000ic165f").chain) is None  # no offset
    assert OffsetWrist.of(Robot.preset("panda").chain) is None


def test_poses_beyond_all_measure_are_out_of_reach(robot):
    far = np.array([1e2, 1e8, 1e30, 1e100])
    places = np.column_stack([far, np.zeros((4, 2))])
    poses = np.stack([robot.fk(np.full(6, 0.3)), *se3.transform(np.eye(3), places)])
    answers = robot.inverse(poses)
    assert set(answers.pose.tolist()) == {0}
    gap = answers.gap_m[1:]
    assert (np.isnan(gap) | (np.abs(gap / far - 1.0) < 0.02)).all()
