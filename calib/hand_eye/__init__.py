"""Hand-eye calibration from pictures: camera, board, lens and robot in one estimate over pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.hand_eye.arm import ArmErrors as ArmErrors
    from calib.hand_eye.estimate import calibrate as calibrate
    from calib.hand_eye.pictures import Pictures as Pictures
    from calib.hand_eye.pictures import motion_at as motion_at
    from calib.hand_eye.result import HandEyeResult as HandEyeResult
    from calib.hand_eye.result import PlacedFrame as PlacedFrame
else:
    __getattr__ = load_when_asked(__name__)
