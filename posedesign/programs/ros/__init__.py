"""Lists for ROS: the writer.

Plain YAML that any reader takes, a value or a point a line, so that changes can be seen line by
line. What the formats have no place for stands in comments that the reader of this package knows.

Sources: the message definitions of ROS 2 (common_interfaces, builtin_interfaces), and what the
joint trajectory controller of ros2_control asks of points; handeye_control_widget.cpp of
moveit/moveit_calibration (saveJointStateBtnClicked and loadJointStateBtnClicked);
poses_from_yaml.cpp of mikeferguson/robot_calibration.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from calib.errors import InputError
from calib.robots import shown_of
from calib.robots.move_times import ACCELERATION_S, move_times
from calib.se3 import FloatArray
from posedesign.programs import writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import Notation
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.ros.reader import joints_of, read_list
from posedesign.programs.ros.rules import CAPTURES, MOVEIT, TRAJECTORY, Layout, check_list
from posedesign.programs.writing import LIST_LENGTH, NameRule, comment_text, shown_deg

DECIMALS = 12  # of joint values [rad]: they are rounded by at most 5e-13 rad
UNKNOWN_SPEED = 1.0
"""Speed of the joints of an arm whose description gives none [rad/s]: below that of the slowest
joints of common arms, 1.3 to 2 rad/s for 200 kg payload."""

UNKNOWN_SLIDE = 0.2
"""Speed of a slide that nothing is known of [m/s]: rails are built for several times as much."""

CUBIC_PEAK = 1.5
"""Greatest speed over mean speed of a cubic from rest to rest: the joint trajectory controller
joins points with positions and velocities by cubics."""

SHORTEST_MS = 100
"""Of a move [ms]: points must not have the same time, also where the arm is there already."""

MOST_SECONDS = 2**31 - 1  # largest value of the field sec of a Duration
_STAMP = ["header:", "  stamp:", "    sec: 0", "    nanosec: 0", '  frame_id: ""']
"""Zero: the motion begins when the message arrives."""

_BARE = re.compile(r"(?!(?:y|n|yes|no|true|false|on|off|null)\Z)[a-z_][a-z0-9_./-]*", re.I | re.A)
"""Names that YAML reads as texts without quotes."""


def render_list(program: PoseProgram, arm: Arm, layout: Layout) -> str:
    """Text of a list with the joints of an arm, in the signs of its description.

    Captures have no poses that are only passed through, as MoveIt's planner finds the way; and no
    features, so that all feature finders look. MoveIt plans only where the joints are those of the
    planning group, in its order.
    """
    if not layout.timed and all(pose.via for pose in program.poses):
        raise InputError(
            f"program {program.name!r} has no poses to capture",
            hint="poses that are only passed through are left out of this format",
            name=program.name,
        )
    in_si = shown_deg(arm, program.poses) / shown_of(arm.n, arm.controller.external)[arm.order]
    postures = np.asarray(np.round(in_si, DECIMALS) + 0.0)
    names = [f"- {n if _BARE.fullmatch(n) else json.dumps(n)}" for n in arm.joint_names]
    lines = _heading(program, layout.title) + (_STAMP if layout.timed else [])
    if layout.keys:
        lines += [f"{layout.keys[-2]}:", *names, f"{layout.keys[-1]}:"]
    captures = ([f"  - {value:.{DECIMALS}f}" for value in row] for row in postures.tolist())
    entries = _points(program, arm, postures) if layout.timed else captures
    for number, pose, entry in zip(program.numbers, program.poses, entries, strict=True):
        if pose.via and not layout.timed:
            continue
        if pose.comment:
            remark = comment_text(f"comment of pose {pose.name!r}", pose.comment)
            lines.append(f"# remark: {remark}")
        name = f": {comment_text('name of a pose', pose.name)}" if pose.name else ""
        lines.append(f"# {'via' if pose.via else 'pose'} {number}{name}")
        if layout.timed:
            lines += entry
        elif layout.keys:  # a row is the list of its values
            lines += ["- " + entry[0].lstrip(), *entry[1:]]
        else:
            joints = [f"  {name}" for name in names]
            lines += ["- joints:", *joints, "  positions:", *entry, "  features: []"]
    return "\n".join([*lines, f"# end of {program.name}"]) + "\n"


def _heading(program: PoseProgram, what: str) -> list[str]:
    """Comments above the content: what it is, for people and for the reader."""
    options = program.options
    lines = [f"# {what}, joint values in rad", f"# program: {program.name}"]
    if options.comment:
        lines.append(f"# title: {comment_text('comment', options.comment)}")
    frames = f"tool frame {options.tool_frame}, user frame {options.user_frame}"
    motion = f"speed {options.speed_percent} percent, settling {options.settle_s:g} s"
    notes = [*writing.head_lines(program, LIST_LENGTH), f"{frames}, {motion}"]
    return lines + [f"# {note}" for note in notes]


def _points(program: PoseProgram, arm: Arm, postures: FloatArray) -> Iterator[list[str]]:
    """Lines of each pose of a trajectory: one point a line, in the form of YAML that is JSON, too.

    The arm comes to rest at every point. A pose that is measured has two, one where the arm arrives
    and one after the time to settle; who runs the trajectory measures while the arm stands.
    """
    options = program.options
    moving, standing = point_times_ms(postures, arm, options.speed_percent, options.settle_s)
    rest = f'"velocities": [{", ".join(["0.0"] * arm.n)}], "accelerations": [], "effort": []'
    now = 0
    stops = zip(program.numbers, program.poses, postures.tolist(), moving, strict=True)
    for number, pose, posture, move in stops:
        values = ", ".join([f"{value:.{DECIMALS}f}" for value in posture])
        point = f'- {{"positions": [{values}], {rest}, "time_from_start": '
        now += move
        lines = [point + _time(now)]
        if standing and not pose.via:
            now += standing
            lines += [f"# hold {number}", point + _time(now)]
        yield lines


def _time(milliseconds: int) -> str:
    seconds, rest = divmod(milliseconds, 1000)
    return f'{{"sec": {seconds}, "nanosec": {rest * 1_000_000}}}}}'


def joint_speeds(arm: Arm, percent: float) -> FloatArray:
    """Speeds ``(n,)`` [rad/s, m/s] at so many percent of the description's, in their order.

    Joints without one are as fast as the median of the others, or as :data:`UNKNOWN_SPEED`; slides
    without one go at :data:`UNKNOWN_SLIDE`.
    """
    speeds = np.full(arm.n, np.nan) if arm.robot is None else arm.robot.speed
    known, sliding = np.isfinite(speeds), arm.controller.external.slides_of(arm.n)
    turning = known & ~sliding
    usual = float(np.median(speeds[turning])) if turning.any() else UNKNOWN_SPEED
    each = np.where(known, speeds, np.where(sliding, UNKNOWN_SLIDE, usual))
    return each[arm.order] * percent / 100.0


def point_times_ms(
    path: FloatArray, arm: Arm, percent: float, settle_s: float
) -> tuple[list[int], int]:
    """Durations of the moves to each of ``(S, n)`` postures [ms], and of standing [ms].

    A move takes the time of :func:`calib.robots.move_times.move_times`, and never so little that a
    cubic would be faster than the joint speeds. The first one begins wherever the arm is: it takes
    the time from the farthest that the joint limits allow, or from a half turn away.

    Raises InputError: the whole takes longer than a Duration can say.
    """
    speeds, farthest = joint_speeds(arm, percent), np.full(arm.n, np.pi)
    if arm.robot is not None:
        upper, lower = (b[arm.order] for b in (arm.robot.upper, arm.robot.lower))
        farthest = np.maximum(np.abs(upper - path[0]), np.abs(path[0] - lower))
    moves = np.vstack([farthest, np.abs(np.diff(path, axis=0))])
    cubic = CUBIC_PEAK * (moves / speeds).max(axis=1)
    times = np.maximum(move_times(moves, speeds, ACCELERATION_S), cubic)
    moving = [max(SHORTEST_MS, math.ceil(1e3 * t)) for t in times.tolist()]
    standing = math.ceil(1e3 * settle_s)
    if sum(moving) + standing * len(path) > 1000 * MOST_SECONDS:
        raise InputError(
            f"the trajectory would take longer than {MOST_SECONDS} s",
            hint="settle for a shorter time, or move faster",
            name="settle_s",
            value=settle_s,
        )
    return moving, standing


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
    keeps = switches = controlled = False
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

    def read_data(self, data: bytes, path: Path) -> RecordedProgram:
        return read_list(data, path, self.layout)

    def judge_data(self, data: bytes, path: Path) -> list[Problem]:
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
