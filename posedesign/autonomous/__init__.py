"""Calibration by sight: from one taught pose to an identified robot, by what a camera sees.

:func:`calibrate_robot` for a robot behind a :class:`RobotAdapter` of one's own,
:class:`FolderRobot` for one that is reached through a folder, :func:`run_by_sight` for what the
command does. Names are loaded when they are first used: planning must not wait for OpenCV.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.vision.touch_up.arms import RobotAdapter
    from posedesign.autonomous.by_sight import SightResult, calibrate_robot, run_by_sight
    from posedesign.autonomous.folder_robot import FolderRobot
    from posedesign.autonomous.process import Calibration

__all__ = [
    "Calibration",
    "FolderRobot",
    "RobotAdapter",
    "SightResult",
    "calibrate_robot",
    "run_by_sight",
]

_WHERE = {
    "Calibration": "posedesign.autonomous.process",
    "FolderRobot": "posedesign.autonomous.folder_robot",
    "RobotAdapter": "calib.vision.touch_up.arms",
    "SightResult": "posedesign.autonomous.by_sight",
    "calibrate_robot": "posedesign.autonomous.by_sight",
    "run_by_sight": "posedesign.autonomous.by_sight",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'posedesign.autonomous' has no attribute {name!r}")
