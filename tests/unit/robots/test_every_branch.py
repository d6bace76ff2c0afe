"""No posture is lost: of arms with rounded frames, axes that run against each other, or frames off.

Own postures at random, and all that a search finds.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calib import Robot, se3
from calib.robots.inverse.closed_form import ClosedForm
from calib.robots.inverse.folds import both_sides
from calib.robots.inverse.solutions import close_in, pose_error
from tests.arms import Joint, apart, arm_from, missed

ALMOST = float(np.rad2deg(1.5708))
"""A right angle as descriptions round it [deg]."""

JAKA_S5: list[Joint] = [
    # JakaCobot/jaka_ros2, jaka_description/urdf/jaka_s5.urdf: axes 5 and 6 miss by 0.26 mm
    ((0, -0.00022535, 0.12015), (0, 0, 0), "0 0 1", 359),
    ((0, 0, 0), (ALMOST, 0, 0), "0 0 1", 359),
    ((0.43, 0, 0), (0, 0, 0), "0 0 1", 175),
    ((0.3685, 0, -0.114), (0, 0, 0), "0 0 1", 359),
    ((0, -0.1135, 0), (ALMOST, 0, 0), "0 0 1", 359),
    ((0.00026137, 0.1175, 0.00025782), (-ALMOST, 0, 0), "0 0 1", 359),
]

AGAINST: list[Joint] = [
    # a UR5 (universal-robots.com, DH parameters), axes 3 and 4 counted against axis 2
    ((0, 0, 0.089159), (0, 0, 0), "0 0 1", 180),
    ((0, 0, 0), (90, 0, 0), "0 0 1", 180),
    ((-0.425, 0, 0), (0, 0, 0), "0 0 -1", 180),
    ((-0.39225, 0, 0.10915), (0, 0, 0), "0 0 -1", 180),
    ((0, 0, 0), (90, 0, 0), "0 0 1", 180),
    ((0, 0, 0.09465), (-90, 0, 0), "0 0 1", 180),
]


def off_by(robot: Robot, mrad: float) -> Robot:
    """The arm with the frames of all its joints turned, and moved by a tenth as many mm."""
    turns, shifts = np.random.default_rng(3).uniform(-1e-3, 1e-3, (2, robot.n, 3)) * mrad
    off = se3.transform(se3.rotation_exp(turns), 0.1 * shifts)
    return replace(robot, chain=replace(robot.chain, placements=robot.chain.placements @ off))


def rounded(robot: Robot, of_angles: int, of_lengths: int) -> Robot:
    """The arm with its angles [rad] and lengths [m] written to so many decimals."""
    placements = robot.chain.placements
    R = se3.rotation_from_wpr(np.round(se3.wpr_from_rotation(placements[:, :3, :3]), of_angles))
    written = se3.transform(R, np.round(placements[:, :3, 3], of_lengths))
    return replace(robot, chain=replace(robot.chain, placements=written))


def clear_postures(robot: Robot, count: int) -> np.ndarray:
    """Random postures that are not singular."""
    q = np.random.default_rng(4).uniform(robot.lower, robot.upper, (2 * count, 6))
    return q[robot.chain.smallest_singular_values(robot.chain.forward(q)) > 0.01][:count]


ARMS: dict[str, Callable[[], Robot]] = {
    "jaka_s5": lambda: arm_from(JAKA_S5),
    "against": lambda: arm_from(AGAINST),
    "ur5e": lambda: Robot.preset("ur5e"),
    "tx2_60": lambda: Robot.preset("tx2_60"),
    "kr6r900sixx": lambda: Robot.preset("kr6r900sixx"),
}

WRITTEN: dict[str, Callable[[Robot], Robot]] = {
    "nominal": lambda arm: arm,
    "rounded": lambda arm: rounded(arm, 4, 4),
    "1.57": lambda arm: rounded(arm, 2, 6),
    "off by 0.1 mrad": lambda arm: off_by(arm, 0.1),
    "off by 1 mrad": lambda arm: off_by(arm, 1.0),
    "off by 3 mrad": lambda arm: off_by(arm, 3.0),
}


@pytest.fixture(scope="module", params=ARMS)
def nominal(request) -> Robot:
    return replace(ARMS[request.param](), coupled_limits=())


@pytest.fixture(scope="module", params=WRITTEN)
def arm(request, nominal) -> Robot:
    return WRITTEN[request.param](nominal)


def test_each_posture_is_among_the_answers_to_its_pose(arm):
    assert isinstance(arm._inverse, ClosedForm)
    assert missed(arm, clear_postures(arm, 400)).max() < 1e-6


def test_all_that_a_search_finds_is_among_the_answers(arm):
    free = np.full(6, np.inf)
    for k, pose in enumerate(arm.fk(clear_postures(arm, 2))):
        answers = arm.inverse(pose).postures
        q = np.random.default_rng(k).uniform(-np.pi, np.pi, (300, 6))
        q = close_in(arm.chain, q, np.tile(pose, (300, 1, 1)), -free, free, 40)
        q = q[np.abs(pose_error(arm.chain, q, pose)).max(axis=1) < 1e-9]
        assert len(q) > 100
        assert apart(answers[:, None], q).min(axis=0).max() < 1e-5


@pytest.mark.parametrize("bend", [1e-3, 0.01, 0.05])
def test_both_postures_beside_a_fold_are_started_at(bend):
    """A straight elbow: poses a little short of the end of the reach are taken on either side."""
    arm, free = arm_from(AGAINST), np.full(6, np.inf)
    q = np.random.default_rng(5).uniform(0.4, 1.4, (20, 6))
    q[:, 2] = bend
    T, start = np.tile(arm.fk(q), (2, 1, 1)), q.copy()
    start[:, 2] = 0.0
    found = close_in(arm.chain, both_sides(arm.chain, start, T[:20]), T, -free, free, 20)
    assert np.abs(pose_error(arm.chain, found, T)).max() < 1e-9
    one, other = found.reshape(2, 20, 6)
    assert (apart(one, other) > bend).all()
    assert np.minimum(apart(one, q), apart(other, q)).max() < 1e-6
