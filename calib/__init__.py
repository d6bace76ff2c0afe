"""Robots, measurements and estimation: what a calibration is made of.

Knows nothing of pose planning. Names are loaded when they are first used: errors and conventions
must not wait for the robot libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib import robot_world
    from calib.identification import IdentificationResult, identify
    from calib.model import CalibrationModel
    from calib.robots import Robot, preset_names

__all__ = [
    "CalibrationModel",
    "IdentificationResult",
    "Robot",
    "identify",
    "preset_names",
    "robot_world",
]

_WHERE = {
    "CalibrationModel": "calib.model",
    "IdentificationResult": "calib.identification",
    "Robot": "calib.robots",
    "identify": "calib.identification",
    "preset_names": "calib.robots",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    if name == "robot_world":
        return import_module("calib.robot_world")
    raise AttributeError(f"module 'calib' has no attribute {name!r}")
