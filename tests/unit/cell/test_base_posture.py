"""The posture that a template begins with: none that was tried is better."""

from itertools import product

import numpy as np
import pytest

from calib import Robot
from calib.se3 import rotation_from_wpr
from posedesign.cell import orientations
from posedesign.cell.orientations import suggest_base_posture, suggest_tool, touching_poses


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
            trials = orientations._trial_poses(robot, tool, q)
            best = max(best, (trials, room, -np.abs(q).sum(), *q))
    assert suggest_base_posture(robot, tool) == pytest.approx(best[3:])
    assert best[0] == 27


def test_an_arm_of_one_joint_has_its_tool_where_it_comes(random_urdf):
    robot = Robot.from_urdf(random_urdf(np.random.default_rng(0), 1))
    q = suggest_base_posture(robot, np.array([0.05, 0.0, 0.1]))
    assert robot.lower[0] < q[0] < robot.upper[0]
