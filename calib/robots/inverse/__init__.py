"""Inverse kinematics: poses in, for each pose every posture that takes it."""

from calib.robots.bounds import first_per_group as first_per_group
from calib.robots.inverse.solutions import CLOSURE_TOLERANCE as CLOSURE_TOLERANCE
from calib.robots.inverse.solutions import NEAR_SINGULAR as NEAR_SINGULAR
from calib.robots.inverse.solutions import InverseKinematics as InverseKinematics
from calib.robots.inverse.solutions import InverseSolutions as InverseSolutions
from calib.robots.inverse.solutions import pose_error as pose_error
from calib.robots.inverse.solutions import twist_to as twist_to
