"""Robots: descriptions, kinematics over arrays, inverse kinematics, presets.

Names are loaded when they are first used: who reads a description need not wait for Pinocchio.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.robots.bounds import CoupledLimit as CoupledLimit
    from calib.robots.chain import NO_EXTERNAL_AXES as NO_EXTERNAL_AXES
    from calib.robots.chain import ChainState as ChainState
    from calib.robots.chain import ExternalAxes as ExternalAxes
    from calib.robots.chain import SerialChain as SerialChain
    from calib.robots.controller import POSITIVE_AXES as POSITIVE_AXES
    from calib.robots.controller import Controller as Controller
    from calib.robots.controller import shown_of as shown_of
    from calib.robots.flange_poses import flange_robot as flange_robot
    from calib.robots.flange_poses import posture_of_pose as posture_of_pose
    from calib.robots.inverse import InverseSolutions as InverseSolutions
    from calib.robots.model_chain import HeldJoint as HeldJoint
    from calib.robots.presets import find_preset as find_preset
    from calib.robots.presets import preset_info as preset_info
    from calib.robots.presets import preset_names as preset_names
    from calib.robots.robot import Robot as Robot
else:
    __getattr__ = load_when_asked(__name__)
