"""MELFA-BASIC programs: the writer, of joint positions.

A file ``NAME.mb5`` of numbered steps, with the positions J1, J2, ... in a list behind them, as RT
ToolBox saves them. Touched-up positions are taught into J1, J2, ... themselves. Nothing was loaded
on a controller, and poses are not written: structure flags are not known well enough.
"""

from __future__ import annotations

from collections.abc import Iterator

from calib.errors import InputError
from posedesign.programs.arm import Arm
from posedesign.programs.program import PoseProgram, ProgramPose
from posedesign.programs.writing import (
    Limits,
    NameRule,
    check_call,
    plain,
    plain_all,
    shown_deg,
    warning_lines,
)

NAMES = NameRule("a MELFA program name", 12)
TEXT_LENGTH = 100
"""A step has at most 127 characters."""

LIMITS = Limits(TEXT_LENGTH, TEXT_LENGTH, settle_s=1e4)

MOST_POSES = 3000
"""Eight steps a pose, of 32,767."""


def render_mitsubishi_melfa(program: PoseProgram, arm: Arm) -> dict[str, str]:
    """Text of the file; InputError for texts that cannot stand in it, or registers to be kept."""
    options = program.options
    if options.keep == "register":
        raise InputError("MELFA programs keep no registers", hint="keep positions", name="keep")
    if arm.n > 8:
        raise InputError("a joint position has at most 8 values", name="poses", value=arm.n)
    check_call(NAMES, options, program.name)
    LIMITS.check(program)
    notes = [text for text in (options.comment, program.mark) if text]
    notes += warning_lines(program, TEXT_LENGTH)
    steps = [*(f"'{note}" for note in notes), "Servo On", "Cnt 0", f"JOvrd {options.speed_percent}"]
    for number, pose in zip(program.numbers, program.poses, strict=True):
        steps += _at_pose(program, pose, number)
    steps.append("End")
    rows = zip(program.numbers, shown_deg(arm, program.poses), strict=True)
    listed = [f"J{number}=({','.join(plain_all(row, 5))})" for number, row in rows]
    lines = [f"{k} {step}" for k, step in enumerate(steps, start=1)] + listed
    return {f"{program.name}.mb5": "\n".join([*lines, ""])}


def _at_pose(program: PoseProgram, pose: ProgramPose, number: int) -> Iterator[str]:
    options = program.options
    yield f"'POSE {number} {pose.name if LIMITS.fits(pose.name) else ''}".rstrip()
    if pose.comment.strip():
        yield f"'{pose.comment.strip()}"
    yield f"Mov J{number}"
    if pose.via:
        return
    # at least the time in which the arm comes to a stop
    yield f"Dly {plain(max(options.settle_s, 0.1), 3)}"
    if options.measure_output is not None:
        yield f"M_Out({options.measure_output})=1 Dly {plain(options.measure_pulse_s, 3)}"
    if options.measure_call is not None:
        argument = options.argument(number)
        yield f'CallP "{options.measure_call}"' + ("" if argument is None else f",{argument}")
