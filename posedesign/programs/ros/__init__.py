"""Lists of joint values for ROS: trajectories, and the capture poses of two calibration tools."""

from posedesign.programs.ros.dialect import MoveitJoints, RobotCalibration, RosTrajectory

__all__ = ["MoveitJoints", "RobotCalibration", "RosTrajectory"]
