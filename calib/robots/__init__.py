"""Robots: descriptions, kinematics over arrays, inverse kinematics, presets.

Names are loaded when they are first used: who reads a description need not wait for Pinocchio.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.robots.bounds import CoupledLimit
    from calib.robots.chain import NO_EXTERNAL_AXES, ChainState, ExternalAxes, SerialChain
    from calib.robots.controller import POSITIVE_AXES, Controller, shown_of
    from calib.robots.flange_poses import flange_robot, posture_of_pose
    from calib.robots.inverse import InverseSolutions
    from calib.robots.presets import find_preset, preset_info, preset_names
    from calib.robots.robot import Robot
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "NO_EXTERNAL_AXES",
    "POSITIVE_AXES",
    "ChainState",
    "Controller",
    "CoupledLimit",
    "ExternalAxes",
    "InverseSolutions",
    "Robot",
    "SerialChain",
    "find_preset",
    "flange_robot",
    "posture_of_pose",
    "preset_info",
    "preset_names",
    "shown_of",
]
