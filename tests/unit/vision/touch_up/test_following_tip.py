"""Short straight moves as a controller runs them, against the closed-form inverse kinematics."""

import numpy as np
import pytest

from calib.se3 import rotation_exp, transform
from calib.vision.touch_up import follow
from calib.vision.touch_up.drive import shifted
from tests.visual_cells import PRESETS, preset, usual_posture

SIX_AXES = [name for name in PRESETS if preset(name).n == 6]


@pytest.mark.parametrize("name", SIX_AXES)
def test_posture_is_the_nearest_of_all_branches(name):
    robot, q = preset(name), usual_posture(name)
    rng = np.random.default_rng(3)
    R = rotation_exp(np.deg2rad(rng.uniform(-8, 8, (5, 3))))
    T = robot.fk(q) @ transform(R, rng.uniform(-0.03, 0.03, (5, 3)))
    found, reached = follow(robot, np.tile(q, (5, 1)), T)
    assert reached.all()
    answer = robot.inverse(T, near=q)
    for k in range(5):
        branches = answer.postures[answer.pose == k]
        nearest = branches[np.abs(branches - q).max(axis=1).argmin()]
        assert np.abs(found[k] - nearest).max() < 1e-7


def test_out_of_reach_is_told():
    robot, q = preset("m20ia"), usual_posture("m20ia")
    T = robot.fk(q) @ transform(np.eye(3), [0.0, 0.0, 5.0])
    _, reached = follow(robot, q[None], T[None])
    assert not reached[0]


def test_limits_are_kept():
    """A joint at its limit is not turned beyond it to get to a pose."""
    robot, q = preset("m20ia"), usual_posture("m20ia").copy()
    q[5] = robot.upper[5]
    turned = q.copy()
    turned[5] += 0.1
    found, reached = follow(robot, q[None], robot.fk(turned)[None])
    assert not reached[0]
    assert (found[0] <= robot.upper).all()


def test_shift_is_along_the_axes_of_the_tip():
    T = preset("m20ia").fk(usual_posture("m20ia"))
    moved = shifted(T, np.array([0.0, 0.0, 0.1]))
    assert moved[:3, 3] - T[:3, 3] == pytest.approx(0.1 * T[:3, 2])
    assert np.array_equal(moved[:3, :3], T[:3, :3])
