"""From a folder of pictures to a calibrated camera: the files, the steps, the results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.hand_eye.calibration import (
        CAMERA_FILES,
        Asked,
        Calibrated,
        Sightings,
        as_calibrated,
        calibrate_camera,
        find_boards,
    )
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "CAMERA_FILES",
    "Asked",
    "Calibrated",
    "Sightings",
    "as_calibrated",
    "calibrate_camera",
    "find_boards",
]
