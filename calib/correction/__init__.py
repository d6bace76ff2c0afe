"""What an identified robot is for: a corrected chain, its URDF, and commands that compensate."""

from calib.correction.compensation import Compensated, compensate
from calib.correction.corrected_robot import CorrectedRobot, corrected_robot, corrected_urdf

__all__ = [
    "Compensated",
    "CorrectedRobot",
    "compensate",
    "corrected_robot",
    "corrected_urdf",
]
