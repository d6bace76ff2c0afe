"""Visual touch-up: a robot brings the camera on its flange to a target by what the camera sees."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.vision.touch_up.arms import Arms, RobotAdapter, SimulatedArms, TrueCell
    from calib.vision.touch_up.board_target import BoardTarget
    from calib.vision.touch_up.drive import Drive, follow
    from calib.vision.touch_up.jacobian import ImageJacobian, Relation
    from calib.vision.touch_up.servo import Loop, Station, TouchUps, touch_up
    from calib.vision.touch_up.set_up import find_set_up
    from calib.vision.touch_up.sighting import NoSetUp, SetUp, TiltBias
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "Arms",
    "BoardTarget",
    "Drive",
    "ImageJacobian",
    "Loop",
    "NoSetUp",
    "Relation",
    "RobotAdapter",
    "SetUp",
    "SimulatedArms",
    "Station",
    "TiltBias",
    "TouchUps",
    "TrueCell",
    "find_set_up",
    "follow",
    "touch_up",
]
