"""Pin tip and target from touch-ups, against known ones."""

import numpy as np

from calib.se3 import FloatArray, rotation_exp, transform
from calib.vision.touch_up import follow
from calib.vision.touch_up.set_up import solve_pin
from tests.visual_cells import preset, usual_posture

TOOL = np.array([0.06, -0.1, 0.4])
GUESS = np.array([0.0, 0.0, 0.5])


def touched(offsets: FloatArray, widest_deg: float = 15.0) -> FloatArray:
    """Postures ``(9, n)`` at which an arm with zero offsets has its pin tip on one point."""
    robot, q0 = preset("m20ia"), usual_posture("m20ia")
    T0 = robot.fk(q0 + offsets)
    axes = np.vstack([np.zeros(3), np.eye(3), -np.eye(3), [[0.7, 0.7, 0], [-0.7, 0.7, 0]]])
    R = rotation_exp(np.deg2rad(widest_deg) * axes)
    T = T0 @ transform(R, TOOL - R @ TOOL)
    true, found = follow(robot, np.tile(q0 + offsets, (9, 1)), T)
    assert found.all()
    return true - offsets


def test_pin_of_an_arm_without_errors():
    robot = preset("m20ia")
    q = touched(np.zeros(6))
    pin = solve_pin(robot, q, GUESS)
    assert np.abs(pin.tool_m - TOOL).max() < 1e-6
    target = robot.state(q[:1]).point(TOOL)[0]
    assert np.abs(pin.target_m - target).max() < 1e-6
    assert pin.rms_m < 1e-6
    assert pin.left_m < 1e-6


def test_offsets_are_told_from_a_longer_pin():
    """Better than plain least squares, which is written out here, and as well as it says."""
    robot, rng = preset("m20ia"), np.random.default_rng(8)
    off, plain, said = [], [], []
    for _ in range(40):
        q = touched(np.deg2rad(0.1) * rng.standard_normal(6))
        pin = solve_pin(robot, q, GUESS)
        off.append(pin.tool_m - TOOL)
        said.append(pin.sigma_tool_m)
        T = robot.fk(q)
        A = np.hstack([T[:, :3, :3].reshape(-1, 3), np.tile(-np.eye(3), (9, 1))])
        plain.append(np.linalg.lstsq(A, -T[:, :3, 3].ravel(), rcond=None)[0][:3] - TOOL)
    worst = np.sqrt((np.array(off) ** 2).mean(axis=0)).max()
    # without errors of links and pictures what is said is too much, never too little
    assert worst < np.mean(said)
    assert worst < 0.8 * np.sqrt((np.array(plain) ** 2).mean(axis=0)).max()


def test_small_turns_tell_little():
    """A pin that is seen under a tenth of the turn is known ten times worse."""
    robot = preset("m20ia")
    wide = solve_pin(robot, touched(np.zeros(6)), GUESS).sigma_tool_m
    small = solve_pin(robot, touched(np.zeros(6), 1.5), GUESS).sigma_tool_m
    assert small > 5.0 * wide


def test_another_robot_leaves_what_no_offsets_explain():
    q = touched(np.zeros(6))
    q[1:, 1] += np.deg2rad([0.5, -0.5] * 4)  # as if the arm went elsewhere than its joints say
    assert solve_pin(preset("m20ia"), q, GUESS).left_m > 1e-3


def test_one_touch_up_gives_the_guess():
    q = usual_posture("m20ia")[None]
    pin = solve_pin(preset("m20ia"), q, GUESS)
    assert np.abs(pin.tool_m - GUESS).max() < 1e-6
