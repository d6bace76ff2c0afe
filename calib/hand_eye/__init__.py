"""Hand-eye calibration from pictures: camera, board, lens and robot in one estimate over pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.hand_eye.estimate import calibrate
    from calib.hand_eye.pictures import Pictures, motion_at
    from calib.hand_eye.result import HandEyeResult, PlacedFrame
else:
    __getattr__ = load_when_asked(__name__)

__all__ = ["HandEyeResult", "Pictures", "PlacedFrame", "calibrate", "motion_at"]
