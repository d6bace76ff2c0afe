"""Robots: descriptions, kinematics over arrays, inverse kinematics, presets.

Names are loaded when they are first used: who reads a description need not wait for Pinocchio.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.robots.bounds import CoupledLimit
    from calib.robots.chain import ChainState, SerialChain
    from calib.robots.controller import POSITIVE_AXES, Controller
    from calib.robots.inverse import InverseSolutions
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

_WHERE = {
    "ChainState": "calib.robots.chain",
    "Controller": "calib.robots.controller",
    "CoupledLimit": "calib.robots.bounds",
    "InverseSolutions": "calib.robots.inverse",
    "POSITIVE_AXES": "calib.robots.controller",
    "Robot": "calib.robots.robot",
    "SerialChain": "calib.robots.chain",
    "find_preset": "calib.robots.presets",
    "preset_info": "calib.robots.presets",
    "preset_names": "calib.robots.presets",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'calib.robots' has no attribute {name!r}")
