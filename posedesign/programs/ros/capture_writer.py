"""Lists of poses to capture: the writers for ``moveit_calibration`` and ``robot_calibration``.

Sources: handeye_control_widget.cpp of moveit/moveit_calibration (saveJointStateBtnClicked and
loadJointStateBtnClicked), poses_from_yaml.cpp of mikeferguson/robot_calibration. Every entry is a
capture, so that poses that are only passed through are left out: MoveIt's planner finds the way.
Neither format has frames, speeds, times to settle or calls.
"""

from __future__ import annotations

from collections.abc import Iterator

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.programs.arm import Arm
from posedesign.programs.lists import check_options
from posedesign.programs.program import PoseProgram, ProgramPose
from posedesign.programs.ros.yaml_writing import (
    ending,
    heading,
    joint_values,
    label,
    name_lines,
    value_lines,
)


def render_moveit_joints(program: PoseProgram, arm: Arm) -> str:
    r"""Text for the button "Load joint states", its lines ended by ``\n``.

    MoveIt plans only where joint_names are those of the planning group, in its order. Joint values
    are rounded by 5e-13 rad.

    Parameters
    ----------
    program : PoseProgram
        What to write.
    arm : Arm
        Whose joints, in the signs of its description.

    Raises
    ------
    InputError
        No pose is measured, a text that cannot stand in a comment, a joint beyond +-720 deg, an
        output to be pulsed, or registers to be kept.
    """
    lines = heading(program, "joint states of moveit_calibration")
    lines += ["joint_names:", *name_lines(arm, ""), "joint_values:"]
    for number, pose, posture in _captures(program, arm):
        values = value_lines(posture, "  ")
        lines += [*label(number, pose), "- " + values[0].lstrip(), *values[1:]]
    return "\n".join([*lines, ending(program)]) + "\n"


def render_robot_calibration(program: PoseProgram, arm: Arm) -> str:
    r"""Text of the capture poses, its lines ended by ``\n``.

    No features are named: all feature finders that are configured look at each pose. Joint values
    are rounded by 5e-13 rad.

    Parameters
    ----------
    program : PoseProgram
        What to write.
    arm : Arm
        Whose joints, in the signs of its description.

    Raises
    ------
    InputError
        As for :func:`render_moveit_joints`.
    """
    lines = heading(program, "capture poses of robot_calibration")
    names = name_lines(arm, "  ")
    for number, pose, posture in _captures(program, arm):
        lines += [*label(number, pose), "- joints:", *names, "  positions:"]
        lines += [*value_lines(posture, "  "), "  features: []"]
    return "\n".join([*lines, ending(program)]) + "\n"


def _captures(program: PoseProgram, arm: Arm) -> Iterator[tuple[int, ProgramPose, FloatArray]]:
    """Number, pose and joint values [rad] of each pose that is measured."""
    check_options(program)
    if all(pose.via for pose in program.poses):
        raise InputError(
            f"program {program.name!r} has no poses to capture",
            hint="poses that are only passed through are left out of this format",
            name=program.name,
        )
    postures = joint_values(arm, program)
    for number, pose, posture in zip(program.numbers, program.poses, postures, strict=True):
        if not pose.via:
            yield number, pose, posture
