"""One posture by Pinocchio against the arrays of the chain."""

import numpy as np
import pytest

from calib.model.parameters import Payload
from calib.model.parameters.gravity import gravity_torque
from calib.robots import Robot, preset_names
from calib.robots.inverse.solutions import close_in
from calib.robots.one_posture import OnePosture
from calib.se3 import FloatArray
from calib.vision.touch_up import follow


def postures(robot: Robot, count: int) -> FloatArray:
    """Inside the limits, the wrist bent."""
    part = np.random.default_rng(5).uniform(0.2, 0.8, (count, robot.n))
    q = robot.lower + part * (robot.upper - robot.lower)
    q[:, -2] = np.where(np.abs(q[:, -2]) < 0.4, 0.8, q[:, -2])
    return np.clip(q, robot.lower, robot.upper)


@pytest.mark.parametrize("name", preset_names())
def test_the_same_as_for_many(name):
    robot = Robot.preset(name)
    payload = Payload(12.0, np.array([0.05, 0.02, 0.1]))
    one = OnePosture(robot, payload.mass_kg, payload.com_m)
    torque = gravity_torque(robot, postures(robot, 8), payload)
    scale = max(np.abs(torque).max(), 1.0)
    for q, expected in zip(postures(robot, 8), torque, strict=True):
        np.testing.assert_allclose(one.gravity_torque(q), expected, atol=1e-13 * scale)
        np.testing.assert_allclose(one.tip(q), robot.fk(q), atol=1e-13)
        wanted = robot.fk(q + np.deg2rad(0.5))
        many = close_in(robot.chain, q[None], wanted[None], robot.lower, robot.upper, 12)[0]
        alone, off = one.close_in(q, wanted, 1e-11, 12)
        assert off <= 1e-11
        np.testing.assert_allclose(alone, many, atol=1e-7)
        np.testing.assert_allclose(robot.fk(alone), wanted, atol=1e-10)


def test_limits_are_kept_and_what_is_out_of_reach_is_told():
    robot = Robot.preset("r2000ic165f")
    q = np.zeros(6)
    q[1] = robot.upper[1]
    wanted = robot.fk(q)
    wanted[:3, 3] += 5.0
    alone, off = OnePosture(robot).close_in(q, wanted, 1e-11, 12)
    assert (alone <= robot.upper).all()
    assert (alone >= robot.lower).all()
    assert off > 0.1
    assert not follow(robot, q[None], wanted[None])[1][0]
