"""Recordings of cameras and arms by time: bags of ROS 2, videos; the stills in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.hand_eye.recordings.taking import Recording as Recording
    from posedesign.hand_eye.recordings.taking import take_from_bag as take_from_bag
    from posedesign.hand_eye.recordings.taking import take_from_video as take_from_video
    from posedesign.hand_eye.recordings.written_stills import Taken as Taken
else:
    __getattr__ = load_when_asked(__name__)
