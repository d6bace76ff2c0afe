"""FANUC teach pendant programs in ASCII (``.LS``): the writer.

Joint positions only: they need no CONFIG string and no frame, and the controller cannot choose
another branch. The layout is that of controller exports, as far as the oldest controllers of
interest (R-J3iB) take it: names of 8 characters, five entries in DEFAULT_GROUP.
"""

from __future__ import annotations

import re

import numpy as np

from calib.errors import InputError
from posedesign.programs.controller_view import pendant_from_urdf
from posedesign.programs.program import (
    FloatArray,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    in_range,
)

NAME_LENGTH = 8
"""Longest program name that every controller takes (R-J3iB; newer ones take more)."""

COMMENT_LENGTH = 16
"""Characters that the pendant shows of a program's or a position's comment."""

REMARK_LENGTH = 32
"""Characters of a remark line on the pendant."""

MOST_LINES = 9999
"""Line numbers have four digits."""

MOST_JOINT_DEG = 720.0
"""No arm turns so far: a value beyond is in another unit, or wrong."""

LONGEST_WAIT_S = 327.67
"""Largest constant of a WAIT: hundredths of a second in 15 bits."""

MOST_USER_FRAME, MOST_TOOL_FRAME = 9, 10
"""Frames that every controller has; a number past its own limit is refused at load."""

_NAME = re.compile(rf"[A-Z][A-Z0-9_]{{0,{NAME_LENGTH - 1}}}")
_TEXT = re.compile(r"[ -~]*")
_POSITION_NAME = re.compile(rf"[A-Za-z0-9_.+#/()-][A-Za-z0-9_.+#/() -]{{0,{COMMENT_LENGTH - 1}}}")


def render_fanuc_ls(program: PoseProgram) -> str:
    r"""Text of the program, its lines ended by ``\n``.

    Positions are rounded to three decimals, so by at most 0.0005 deg on the pendant and 0.001 deg
    in the URDF's joint 3, which is the sum of two. A pose's name becomes its position's comment
    where it has 1 to 16 plain characters; longer or other ones are left out.

    Parameters
    ----------
    program : PoseProgram
        What to write.

    Returns
    -------
    str
        The program from ``/PROG`` to ``/END``.

    Raises
    ------
    InputError
        A name or a text that the controller would refuse, a number out of its range, an arm that
        has not six joints, a joint beyond +-720 deg, or more than 9999 lines.
    """
    options = program.options
    check_program_name(program.name)
    _check_options(program.name, options)
    instructions = _instructions(program)
    if len(instructions) > MOST_LINES:
        raise InputError(
            f"program {program.name} needs {len(instructions)} lines, at most {MOST_LINES} fit",
            hint="split it into several programs",
            name=program.name,
            value=len(instructions),
            bound=MOST_LINES,
        )
    lines = [f"/PROG  {program.name}", *_attributes(options, len(instructions)), "/MN"]
    lines += [f"{number:4d}:{text} ;" for number, text in enumerate(instructions, start=1)]
    lines.append("/POS")
    for number, pose in sorted(zip(program.numbers, program.poses, strict=True), key=_number):
        lines += _position(number, pose, options)
    lines.append("/END")
    return "\n".join(lines) + "\n"


def check_program_name(name: str) -> None:
    """Raise InputError, with a name that would do, where a name is not legal on every controller.

    Legal is a capital letter, then capital letters, digits and underscores, 8 in all.
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{name!r} is not a FANUC program name",
            hint=f"for instance {legal_program_name(name)}: a letter first, then A-Z 0-9 _, "
            f"at most {NAME_LENGTH} characters",
            name=name,
            bound=NAME_LENGTH,
        )


def legal_program_name(name: str) -> str:
    """Nearest legal program name: capitals, other characters as underscores, cut to length."""
    plain = re.sub(r"[^A-Z0-9]+", "_", name.upper()).strip("_")
    if not plain:
        return "CALPOSE"
    return (plain if plain[0].isalpha() else "P" + plain)[:NAME_LENGTH].rstrip("_")


def _check_options(program_name: str, options: ProgramOptions) -> None:
    in_range("user_frame", options.user_frame, 0, MOST_USER_FRAME)
    in_range("tool_frame", options.tool_frame, 1, MOST_TOOL_FRAME)
    in_range("settle_s", options.settle_s, 0, LONGEST_WAIT_S)
    _check_text("comment", options.comment, COMMENT_LENGTH)
    if options.measure_call is not None:
        check_program_name(options.measure_call)
        if options.measure_call == program_name:
            raise InputError(
                f"program {program_name} would call itself",
                hint="name the program that measures in measure_call",
                name="measure_call",
                value=options.measure_call,
            )


def _check_text(name: str, text: str, length: int) -> None:
    """Refuse what would end a quoted text or a line, or what the pendant cannot show."""
    if len(text) > length or not _TEXT.fullmatch(text) or any(c in "\"';" for c in text):
        raise InputError(
            f"{name} {text!a} cannot be shown on the pendant",
            hint=f"use at most {length} ASCII characters, without quotes and semicolons",
            name=name,
            value=text,
            bound=length,
        )


def _instructions(program: PoseProgram) -> list[str]:
    """Lines of the program as they stand behind their number and colon."""
    options = program.options
    lines = [f"  !PLAN {options.fingerprint}"] if options.fingerprint else []
    lines += [f"  UFRAME_NUM={options.user_frame}", f"  UTOOL_NUM={options.tool_frame}"]
    for number, pose in zip(program.numbers, program.poses, strict=True):
        if pose.comment:
            _check_text(f"comment of pose {pose.name!r}", pose.comment, REMARK_LENGTH)
            lines.append(f"  !{pose.comment.strip()}")
        # The three further spaces before the semicolon are those of controller exports.
        lines.append(f"J P[{number}] {options.speed_percent}% FINE   ")
        if pose.via:
            continue
        if options.settle_s > 0:
            # At least one hundredth: a wait that is asked for must not round to none.
            wait = f"{max(options.settle_s, 0.01):.2f}".removeprefix("0")
            lines.append(f"  WAIT {wait:>6}(sec)")
        if options.measure_call is not None:
            lines.append(f"  CALL {options.measure_call}({number})")
    return lines


def _number(entry: tuple[int, ProgramPose]) -> int:
    return entry[0]


def _attributes(options: ProgramOptions, line_count: int) -> list[str]:
    """The /ATTR section. Zero sizes are accepted: the controller computes its own."""
    date = options.written.strftime("DATE %y-%m-%d  TIME %H:%M:%S")
    return [
        "/ATTR",
        "OWNER\t\t= MNEDITOR;",
        f'COMMENT\t\t= "{options.comment}";',
        "PROG_SIZE\t= 0;",
        f"CREATE\t\t= {date};",
        f"MODIFIED\t= {date};",
        "FILE_NAME\t= ;",
        "VERSION\t\t= 0;",
        f"LINE_COUNT\t= {line_count};",
        "MEMORY_SIZE\t= 0;",
        "PROTECT\t\t= READ_WRITE;",
        "TCD:  STACK_SIZE\t= 0,",
        "      TASK_PRIORITY\t= 50,",
        "      TIME_SLICE\t= 0,",
        "      BUSY_LAMP_OFF\t= 0,",
        "      ABORT_REQUEST\t= 0,",
        "      PAUSE_REQUEST\t= 0;",
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "CONTROL_CODE\t= 00000000 00000000;",
    ]


def _position(number: int, pose: ProgramPose, options: ProgramOptions) -> list[str]:
    fits = _POSITION_NAME.fullmatch(pose.name) and not pose.name.endswith(" ")
    label = f'{number}:"{pose.name}"' if fits else f"{number}"
    # + 0.0 turns the -0.0 of a rounded small number into 0.0, which is written without a sign.
    values = np.round(_pendant_deg(pose), 3) + 0.0
    joints = [f"J{j}={value:10.3f} deg" for j, value in enumerate(values, start=1)]
    return [
        f"P[{label}]{{",
        "   GP1:",
        f"\tUF : {options.user_frame}, UT : {options.tool_frame},\t",
        "\t" + ",\t".join(joints[:3]) + ",",
        "\t" + ",\t".join(joints[3:]),
        "};",
    ]


def _pendant_deg(pose: ProgramPose) -> FloatArray:
    """Joint values of a pose on the pendant ``(6,)`` [deg], each within +-720."""
    most_rad = np.radians(MOST_JOINT_DEG)
    # The URDF's values first: far larger ones would overflow when they become degrees.
    too_far = np.abs(pose.posture_rad) > most_rad
    if not too_far.any():
        pendant = pendant_from_urdf(pose.posture_rad)
        too_far = np.abs(pendant) > MOST_JOINT_DEG
        if not too_far.any():
            return pendant
    j = int(np.argmax(too_far))
    raise InputError(
        f"pose {pose.name!r}: J{j + 1} is beyond +-{MOST_JOINT_DEG:g} deg",
        hint="postures are in radians, and no arm turns so far",
        name=pose.name,
        value=float(pose.posture_rad[j]),
        bound=float(most_rad),
    )
