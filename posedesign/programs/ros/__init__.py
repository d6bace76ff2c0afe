"""Lists of joint values in YAML that tools of ROS read: three dialects of one package."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import Notation
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.ros.reader import joints_of, read_list
from posedesign.programs.ros.rules import CAPTURES, MOVEIT, TRAJECTORY, Layout, check_list
from posedesign.programs.ros.writer import DECIMALS, render_list
from posedesign.programs.writing import NameRule

__all__ = ["MoveitJoints", "RobotCalibration", "RosTrajectory"]


class _RosList(Dialect):
    """A list of joint values in YAML, with the joints by their names in the description.

    Every entry of a list of captures is a sample that is taken: poses that the arm only passes
    through are left out, and the planner of MoveIt finds the way.
    """

    maker = None
    suffixes = (".yaml", ".yml")
    remark = (r"", "# {words}")
    external_axes = 6
    turning_axes = True
    forms = ("joint",)
    keeps = switches = False
    names = NameRule("a name for a list", 64, small=True)
    encoding = "utf-8"
    passes = False
    layout: ClassVar[Layout]
    notation = Notation(DECIMALS, joint_units=np.pi / 180, literals=joints_of)
    known_by: ClassVar[tuple[tuple[bytes, ...], ...]]
    """Keys that such a file has: all of one of these sets."""

    def recognises(self, data: bytes) -> bool:
        """Whether the keys of such a file stand in the text, outside comments."""
        return any(all(_has_key(data, key) for key in keys) for keys in self.known_by)

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        return {f"{program.name}.yaml": render_list(program, arm, self.layout)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return read_list(data, path, self.layout)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        return check_list(data, path, self.layout)


class RosTrajectory(_RosList):
    """A ``trajectory_msgs/msg/JointTrajectory``, as ``ros2 topic pub --yaml-file`` takes it."""

    name = "ros-trajectory"
    title = "ROS joint trajectory in YAML"
    passes = True
    layout = TRAJECTORY
    notation = replace(_RosList.notation, repeated=True)
    known_by = ((b"joint_names", b"points"),)


class MoveitJoints(_RosList):
    """Joint states of the hand-eye calibration of MoveIt (``moveit_calibration``)."""

    name = "moveit-joints"
    title = "joint states of moveit_calibration in YAML"
    layout = MOVEIT
    known_by = ((b"joint_names", b"joint_values"),)


class RobotCalibration(_RosList):
    """Capture poses of mikeferguson/robot_calibration, as its ROS 2 version loads them."""

    name = "robot-calibration"
    title = "capture poses of robot_calibration in YAML"
    layout = CAPTURES
    known_by = ((b"joints", b"positions"), (b"joint_states",))


def _has_key(data: bytes, key: bytes) -> bool:
    pattern = rb"(?m)^[^#\n]*?(?<!\w)" + key + rb"['\"]?[ \t]*:"
    return key in data and re.search(pattern, data) is not None
