"""The same robot with its joints in other places."""

from __future__ import annotations

from dataclasses import replace

import pinocchio as pin

from calib.errors import InputError
from calib.robots.model_chain import frame_id
from calib.robots.robot import Robot
from calib.se3 import FloatArray, check_transforms


def with_placements(robot: Robot, placements: FloatArray) -> Robot:
    """A robot whose joint frames sit elsewhere in the links before them.

    Limits, speeds, masses, solids and controller are kept: those of a link go with its joint.

    Parameters
    ----------
    robot : Robot
    placements : array (n, 4, 4)
        Frame of each joint at zero, in the frame of the link before it (the first: in the base)
        [m].

    Raises
    ------
    InputError
        Not one rigid transform for each joint.
    """
    placed = check_transforms(placements, "placements")
    if placed.shape != (robot.n, 4, 4):
        raise InputError(
            f"{robot.name} has {robot.n} joints, the placements have shape {placed.shape}",
            name="placements",
        )
    model = robot.model
    if model is not None:
        model = pin.Model(model)
        T_root_base = model.frames[frame_id(model, robot.base_frame)].placement
        for j, name in enumerate(robot.joint_names):
            T = pin.SE3(placed[j, :3, :3], placed[j, :3, 3])
            model.jointPlacements[model.getJointId(name)] = T_root_base * T if j == 0 else T
    return replace(robot, chain=replace(robot.chain, placements=placed), model=model)
