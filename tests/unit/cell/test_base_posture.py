"""The posture that a template begins with: none that was tried is better."""

from itertools import pairwise, product

import numpy as np
import pytest

from calib import Robot, preset_names
from calib.se3 import rotation_from_wpr
from posedesign.cell import orientations
from posedesign.cell.orientations import (
    is_clear_below,
    suggest_base_posture,
    suggest_tool,
    touching_poses,
    trial_poses,
)
from tests.arms import arm_from


@pytest.mark.parametrize("name", ["irb120", "ur5e", "hp3"])
def test_no_posture_that_was_tried_allows_more_or_has_more_room(name):
    robot = Robot.preset(name)
    tool = suggest_tool(robot)
    size, height = robot.chain.reach_m, robot.state(np.zeros(6)).origins[1, 2]
    front = orientations._front(robot)
    best: tuple[float, ...] = (-1.0,)
    for roll, part, up in product(
        orientations._ROLLS, orientations._FRACTIONS, orientations._HEIGHTS
    ):
        down = rotation_from_wpr([np.pi, 0.0, roll])[None]
        pose = touching_poses(down, tool, part * size * front + [0.0, 0.0, height + up * size])
        found = np.deg2rad(np.round(np.rad2deg(robot.inverse(pose).of(0))))
        for q in sorted(found, key=lambda q: -orientations._room(robot, q))[:2]:
            room = round(orientations._room(robot, q), 2)
            worth = orientations._WORTH if is_clear_below(robot, tool, q) else 0
            trials = trial_poses(robot, tool, q) + worth
            best = max(best, (trials, room, -np.abs(q).sum(), *q))
    assert suggest_base_posture(robot, tool) == pytest.approx(best[3:])
    assert best[0] == 27 + orientations._WORTH


@pytest.mark.parametrize("name", preset_names())
def test_targets_are_in_front_with_nothing_of_the_arm_below_them(name):
    """What stands under a target, from the floor up, runs through no link."""
    robot = Robot.preset(name)
    tool = suggest_tool(robot)
    q = suggest_base_posture(robot, tool)
    state = robot.state(q)
    target, size = state.point(tool), robot.chain.reach_m
    joints, below = state.origins, target - [0.0, 0.0, 0.1 * size]
    for a, b in pairwise(joints):
        at = a + np.linspace(0.0, 1.0, 50)[:, None] * (b - a)
        beside = np.linalg.norm((at - target)[:, :2], axis=1)
        assert ((beside > 0.08 * size) | (at[:, 2] > below[2])).all()
    ahead = (target - joints[0])[:2]
    assert ahead @ orientations._front(robot)[:2] > 0.5 * np.linalg.norm(ahead)


def test_the_front_of_an_arm_that_leans_back_at_zero():
    """Upright at zero, its elbow goes forward only: the numbers of a Mitsubishi RV-2F.

    Facts from its robot toolbox table (mdl_rv2f.m): links of 295, 230, 50, 270 and 70 mm.
    """
    robot = arm_from(
        [
            ((0, 0, 0.295), (0, 0, 0), "0 0 1", 240),
            ((0, 0, 0), (0, 0, 0), "0 1 0", 120),
            ((0, 0, 0.23), (0, 0, 0), "0 1 0", (0, 160)),
            ((-0.05, 0, 0.1), (0, 0, 0), "0 0 1", 200),
            ((0, 0, 0.17), (0, 0, 0), "0 1 0", 120),
            ((0, 0, 0.07), (0, 0, 0), "0 0 1", 360),
        ]
    )
    np.testing.assert_allclose(orientations._front(robot), [1.0, 0.0, 0.0], atol=0.1)
    q = suggest_base_posture(robot, suggest_tool(robot))
    assert abs(q[0]) < np.deg2rad(60.0)


def test_a_tip_whose_z_lies_across_the_last_axis_has_this_axis_point_down():
    """As descriptions have it that keep the axes of the base in all links."""
    robot = arm_from(
        [
            ((0, 0, 0.135), (0, 0, 0), "0 0 1", 175),
            ((0, 0, 0), (0, 0, 0), "0 1 0", (-70, 90)),
            ((0, 0, 0.135), (0, 0, 0), "0 1 0", (-135, 70)),
            ((0, 0, 0.038), (0, 0, 0), "1 0 0", 60),
            ((0.12, 0, 0), (0, 0, 0), "0 1 0", 75),
            ((0.07, 0, 0), (0, 0, 0), "1 0 0", 40),
        ]
    )
    q = suggest_base_posture(robot, suggest_tool(robot))
    assert robot.state(q).axes[-1, 2] == pytest.approx(-1.0, abs=0.02)


def test_an_arm_of_one_joint_has_its_tool_where_it_comes(random_urdf):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 1))
    q = suggest_base_posture(robot, np.array([0.05, 0.0, 0.1]))
    assert robot.lower[0] < q[0] < robot.upper[0]
