"""What an identified robot is for: a corrected chain, its URDF, and commands that compensate."""

from calib.correction.compensation import Compensated as Compensated
from calib.correction.compensation import compensate as compensate
from calib.correction.corrected_robot import CorrectedRobot as CorrectedRobot
from calib.correction.corrected_robot import corrected_robot as corrected_robot
from calib.correction.corrected_robot import corrected_urdf as corrected_urdf
