"""Measuring poses: the paper's loop, checks of what was planned, and the best poses of a cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.planning.checks import NEAR_TARGET_M as NEAR_TARGET_M
    from posedesign.planning.checks import check_fit as check_fit
    from posedesign.planning.checks import check_not_hand_eye as check_not_hand_eye
    from posedesign.planning.checks import check_plain as check_plain
    from posedesign.planning.checks import off_target as off_target
    from posedesign.planning.checks import outside_limits as outside_limits
    from posedesign.planning.loop import plan as plan
    from posedesign.planning.loop import scaling_of as scaling_of
    from posedesign.planning.loop import to_be_measured as to_be_measured
    from posedesign.planning.loop import told_by as told_by
    from posedesign.planning.pose_plan import PosePlan as PosePlan
    from posedesign.planning.pose_plan import Round as Round
    from posedesign.planning.pose_plan import displayed as displayed
    from posedesign.planning.pose_plan import fingerprint as fingerprint
    from posedesign.planning.poses_file import POSE_AXES as POSE_AXES
    from posedesign.planning.poses_file import Margins as Margins
    from posedesign.planning.poses_file import PoseList as PoseList
    from posedesign.planning.poses_file import read_poses as read_poses
    from posedesign.planning.poses_file import read_robot_poses as read_robot_poses
    from posedesign.planning.poses_file import write_pose_list as write_pose_list
else:
    __getattr__ = load_when_asked(__name__)
