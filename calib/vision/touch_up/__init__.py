"""Visual touch-up: a robot brings the camera on its flange to a target by what the camera sees."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.vision.touch_up.arms import Arms as Arms
    from calib.vision.touch_up.arms import RobotAdapter as RobotAdapter
    from calib.vision.touch_up.arms import SimulatedArms as SimulatedArms
    from calib.vision.touch_up.arms import TrueCell as TrueCell
    from calib.vision.touch_up.board_target import BoardTarget as BoardTarget
    from calib.vision.touch_up.drive import Drive as Drive
    from calib.vision.touch_up.drive import follow as follow
    from calib.vision.touch_up.jacobian import ImageJacobian as ImageJacobian
    from calib.vision.touch_up.jacobian import Relation as Relation
    from calib.vision.touch_up.servo import Loop as Loop
    from calib.vision.touch_up.servo import Station as Station
    from calib.vision.touch_up.servo import TouchUps as TouchUps
    from calib.vision.touch_up.servo import touch_up as touch_up
    from calib.vision.touch_up.set_up import find_set_up as find_set_up
    from calib.vision.touch_up.sighting import NoSetUp as NoSetUp
    from calib.vision.touch_up.sighting import SetUp as SetUp
    from calib.vision.touch_up.sighting import TiltBias as TiltBias
else:
    __getattr__ = load_when_asked(__name__)
