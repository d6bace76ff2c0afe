"""Lists of joint values in YAML that tools of ROS read: three dialects of one package."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import Form, PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.ros.capture_reader import parse_moveit_joints, parse_robot_calibration
from posedesign.programs.ros.capture_rules import check_moveit_joints, check_robot_calibration
from posedesign.programs.ros.capture_writer import render_moveit_joints, render_robot_calibration
from posedesign.programs.ros.trajectory_reader import parse_trajectory
from posedesign.programs.ros.trajectory_rules import check_trajectory
from posedesign.programs.ros.trajectory_writer import render_trajectory
from posedesign.programs.writing import NameRule


def _has_key(data: bytes, key: bytes) -> bool:
    """Whether a key of YAML stands in a text, outside comments."""
    pattern = rb"(?m)^[^#\n]*?(?<!\w)" + key + rb"['\"]?[ \t]*:"
    return key in data and re.search(pattern, data) is not None


class RosList(Dialect):
    """A list of joint values in YAML, with the joints by their names in the description."""

    maker: ClassVar[str | None] = None
    suffixes: ClassVar[tuple[str, ...]] = (".yaml", ".yml")
    forms: ClassVar[tuple[Form, ...]] = ("joint",)
    names: ClassVar[NameRule] = NameRule("a name for a list", 64, small=True)
    encoding: ClassVar[str] = "utf-8"
    keys: ClassVar[tuple[set[bytes], ...]]
    """Keys that such a file has: all of one of these sets."""

    def recognises(self, data: bytes) -> bool:
        """Whether the keys of such a file stand in the text, outside comments."""
        return any(all(_has_key(data, key) for key in keys) for keys in self.keys)


class RosTrajectory(RosList):
    """A ``trajectory_msgs/msg/JointTrajectory``, as ``ros2 topic pub --yaml-file`` takes it."""

    name: ClassVar[str] = "ros-trajectory"
    title: ClassVar[str] = "ROS joint trajectory in YAML"
    keys: ClassVar[tuple[set[bytes], ...]] = ({b"joint_names", b"points"},)

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The trajectory; see `render_trajectory` for what is refused."""
        return {f"{program.name}.yaml": render_trajectory(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """Read the points back; see `trajectory_reader`."""
        return parse_trajectory(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a trajectory strictly; see `trajectory_rules`."""
        return check_trajectory(data)


class MoveitJoints(RosList):
    """Joint states of the hand-eye calibration of MoveIt (``moveit_calibration``).

    Every row is a sample that is taken: poses that the arm only passes through are left out, and
    the planner of MoveIt finds the way.
    """

    name: ClassVar[str] = "moveit-joints"
    title: ClassVar[str] = "joint states of moveit_calibration in YAML"
    keys: ClassVar[tuple[set[bytes], ...]] = ({b"joint_names", b"joint_values"},)
    passes: ClassVar[bool] = False

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The list; see `render_moveit_joints` for what is refused."""
        return {f"{program.name}.yaml": render_moveit_joints(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """Read the rows back; see `capture_reader`."""
        return parse_moveit_joints(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a list strictly; see `capture_rules`."""
        return check_moveit_joints(data, path)


class RobotCalibration(RosList):
    """Capture poses of mikeferguson/robot_calibration, as its ROS 2 version loads them.

    Every entry is a sample that is taken: poses that the arm only passes through are left out, and
    the planner of MoveIt finds the way.
    """

    name: ClassVar[str] = "robot-calibration"
    title: ClassVar[str] = "capture poses of robot_calibration in YAML"
    keys: ClassVar[tuple[set[bytes], ...]] = ({b"joints", b"positions"}, {b"joint_states"})
    passes: ClassVar[bool] = False

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The list; see `render_robot_calibration` for what is refused."""
        return {f"{program.name}.yaml": render_robot_calibration(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """Read the entries back; see `capture_reader`."""
        return parse_robot_calibration(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a list strictly; see `capture_rules`."""
        return check_robot_calibration(data)
