"""Calibration by sight: from one taught pose to an identified robot, by what a camera sees.

:func:`calibrate_robot` for a robot behind a :class:`RobotAdapter` of one's own,
:class:`FolderRobot` for one that is reached through a folder, :class:`VideoCamera` for a camera
that is connected to this computer, :func:`run_by_sight` for what the command does.
"""

from calib.vision.touch_up.arms import RobotAdapter as RobotAdapter
from posedesign.autonomous.by_sight import SightResult as SightResult
from posedesign.autonomous.by_sight import calibrate_robot as calibrate_robot
from posedesign.autonomous.by_sight import run_by_sight as run_by_sight
from posedesign.autonomous.folder_robot import FolderRobot as FolderRobot
from posedesign.autonomous.process import Calibration as Calibration
from posedesign.autonomous.video_camera import VideoCamera as VideoCamera
