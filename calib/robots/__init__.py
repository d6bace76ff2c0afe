"""Robots: descriptions, kinematics over arrays, inverse kinematics, presets."""

from calib.robots.chain import ChainState, SerialChain
from calib.robots.controller import POSITIVE_AXES, Controller
from calib.robots.inverse import InverseSolutions
from calib.robots.limits import CoupledLimit
from calib.robots.presets import find_preset, preset_info, preset_names
from calib.robots.robot import Robot

__all__ = [
    "POSITIVE_AXES",
    "ChainState",
    "Controller",
    "CoupledLimit",
    "InverseSolutions",
    "Robot",
    "SerialChain",
    "find_preset",
    "preset_info",
    "preset_names",
]
