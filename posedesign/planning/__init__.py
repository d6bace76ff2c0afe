"""Measuring poses: the paper's loop, checks of what was planned, and the best poses of a cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.planning.checks import (
        NEAR_TARGET_M,
        check_fit,
        check_not_hand_eye,
        check_plain,
        off_target,
        outside_limits,
    )
    from posedesign.planning.loop import plan, scaling_of, to_be_measured, told_by
    from posedesign.planning.pose_plan import PosePlan, Round, displayed, fingerprint
    from posedesign.planning.poses_file import (
        POSE_AXES,
        Margins,
        PoseList,
        read_poses,
        read_robot_poses,
        write_pose_list,
    )
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "NEAR_TARGET_M",
    "POSE_AXES",
    "Margins",
    "PoseList",
    "PosePlan",
    "Round",
    "check_fit",
    "check_not_hand_eye",
    "check_plain",
    "displayed",
    "fingerprint",
    "off_target",
    "outside_limits",
    "plan",
    "read_poses",
    "read_robot_poses",
    "scaling_of",
    "to_be_measured",
    "told_by",
    "write_pose_list",
]
