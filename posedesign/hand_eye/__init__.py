"""From a folder of pictures to a calibrated camera: the files, the steps, the results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.hand_eye.calibration import CAMERA_FILES as CAMERA_FILES
    from posedesign.hand_eye.calibration import Asked as Asked
    from posedesign.hand_eye.calibration import Calibrated as Calibrated
    from posedesign.hand_eye.calibration import Sightings as Sightings
    from posedesign.hand_eye.calibration import as_calibrated as as_calibrated
    from posedesign.hand_eye.calibration import board_of as board_of
    from posedesign.hand_eye.calibration import calibrate_camera as calibrate_camera
    from posedesign.hand_eye.calibration import find_boards as find_boards
else:
    __getattr__ = load_when_asked(__name__)
