"""What the writers of YAML lists share: what stands in comments, joint names, joint values.

Plain YAML in block style, one value a line, so that any reader takes it and changes can be seen
line by line. What the formats have no place for stands in comments that the readers of this package
know: title, mark of the plan, number and name of each pose.
"""

from __future__ import annotations

import json
import re

import numpy as np

from calib.se3 import FloatArray
from posedesign.programs.arm import Arm
from posedesign.programs.lists import WARNING_LENGTH, comment_text
from posedesign.programs.program import PoseProgram, ProgramPose
from posedesign.programs.writing import shown_deg, warning_lines

DECIMALS = 12
"""Of joint values [rad]: they are rounded by at most 5e-13 rad."""

_BARE = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")
_YAML_WORDS = {"y", "n", "yes", "no", "true", "false", "on", "off", "null"}
"""What YAML reads as something else than text."""


def heading(program: PoseProgram, what: str) -> list[str]:
    """Comments above the content: what it is, for people and for the reader."""
    options = program.options
    lines = [f"# {what}, joint values in rad", f"# program: {program.name}"]
    if options.comment:
        lines.append(f"# title: {comment_text('comment', options.comment)}")
    if program.mark:
        lines.append(f"# {program.mark}")
    lines += [f"# {line}" for line in warning_lines(program, WARNING_LENGTH)]
    lines.append(
        f"# tool frame {options.tool_frame}, user frame {options.user_frame}, "
        f"speed {options.speed_percent} percent, settling {options.settle_s:g} s"
    )
    return lines


def ending(program: PoseProgram) -> str:
    """The last line, without which a file is cut off."""
    return f"# end of {program.name}"


def label(number: int, pose: ProgramPose) -> list[str]:
    """Comments above a pose: a remark where it has one, its number and its name."""
    lines = []
    if pose.comment:
        lines.append(f"# remark: {comment_text(f'comment of pose {pose.name!r}', pose.comment)}")
    words = f"# {'via' if pose.via else 'pose'} {number}"
    return [*lines, f"{words}: {comment_text('name of a pose', pose.name)}" if pose.name else words]


def joint_values(arm: Arm, program: PoseProgram) -> FloatArray:
    """Joint values ``(N, n)`` [rad], rounded as they are written.

    Raises
    ------
    InputError
        A joint value is beyond +-720 deg.
    """
    return np.asarray(np.round(np.radians(shown_deg(arm, program.poses)), DECIMALS) + 0.0)


def value_lines(values: FloatArray, indent: str) -> list[str]:
    """One line for each value of a row."""
    return [f"{indent}- {value:.{DECIMALS}f}" for value in values.tolist()]


def name_lines(arm: Arm, indent: str) -> list[str]:
    """One line for each joint name, in quotes where YAML would read something else."""
    return [f"{indent}- {_text(name)}" for name in arm.joint_names]


def _text(name: str) -> str:
    if _BARE.fullmatch(name) and name.lower() not in _YAML_WORDS:
        return name
    return json.dumps(name)
