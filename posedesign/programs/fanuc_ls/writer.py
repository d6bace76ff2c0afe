"""FANUC teach pendant programs in ASCII (``.LS``): the writer.

The layout is that of controller exports, as far as the oldest controllers of interest (R-J3iB) take
it: names of 8 characters, five entries in DEFAULT_GROUP.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from calib.se3 import wpr_from_rotation
from posedesign.programs.arm import Arm
from posedesign.programs.program import PoseProgram, ProgramOptions, ProgramPose
from posedesign.programs.writing import (
    Limits,
    NameRule,
    Phrases,
    check_call,
    rounded_deg,
    shown_deg,
    warning_lines,
)

_RESERVED = "ABORT CALL CON ELSE END FOR IF JMP LBL MOVE NUL PAUSE PRN RUN SELECT TO WAIT"
NAMES = NameRule("a FANUC program name", 8, reserved=frozenset(_RESERVED.split()))
"""What every controller takes (R-J3iB; newer ones take longer names)."""

COMMENT_LENGTH = 16
"""Characters that the pendant shows of a program's or a position's comment."""

REMARK_LENGTH = 32
"""Characters of a remark line on the pendant."""

JOINTS = 6

MOST_LINES = 9999
"""Line numbers have four digits."""

LIMITS = Limits(
    text=COMMENT_LENGTH,
    remark=REMARK_LENGTH,
    forbidden="\"';",  # what ends a quoted text or a line
    settle_s=327.67,  # hundredths of a second in 15 bits
    pulse_s=(0.1, 25.5),  # as FANUC's manuals have it (from general knowledge)
    frames=(9, 10),  # that every controller has; a number past its own limit is refused at load
    registers=(100, "PR[{}]"),  # the number can be set higher
)

_PHRASES = Phrases(
    note="  !{}",
    # the three further spaces before the semicolon are those of controller exports
    move=("J P[{number}] {percent}% FINE   ",),
    wait="  WAIT {time:6.2f}(sec)",
    # tenths of a second with a zero before the point, as controllers export it
    pulse=("  DO[{output}]=PULSE,{time:.1f}sec",),
    call=("  CALL {call}({argument})",),
    bare=("  CALL {call}",),
    keep="  PR[{register}]={here}",
    least_s=0.01,
)
_NEGATIVE = re.compile(r"\((-\d+)\)$")
_POSITION_NAME = re.compile(rf"[A-Za-z0-9_.+#/()-][A-Za-z0-9_.+#/() -]{{0,{COMMENT_LENGTH - 1}}}")


def render_fanuc_ls(program: PoseProgram, arm: Arm) -> dict[str, str]:
    r"""Text of the program by its name, its lines ended by ``\n``.

    Positions are rounded to three decimals: joints by at most 0.0005 deg on the pendant and 0.001
    deg in the URDF's joint 3, which is the sum of two; poses by 0.0005 mm and deg. A pose's name
    becomes its position's comment where it has 1 to 16 plain characters; longer or other ones are
    left out.

    Raises InputError: a text that the controller would refuse, a number out of its range, or a
    joint beyond +-720 deg.
    """
    options = program.options
    LIMITS.check(program)
    check_call(NAMES, options, program.name)
    instructions = _instructions(program)
    lines = [f"/PROG  {program.name}", *_attributes(options, len(instructions)), "/MN"]
    lines += [f"{number:4d}:{text} ;" for number, text in enumerate(instructions, start=1)]
    lines.append("/POS")
    fields = _joint_fields if options.form == "joint" else _pose_fields
    stored = zip(program.numbers, program.poses, fields(program, arm), strict=True)
    for number, pose, values in sorted(stored, key=lambda entry: entry[0]):
        lines += [f"P[{_label(number, pose)}]{{", "   GP1:", *values, "};"]
    lines += ["/END", ""]
    return {f"{program.name}.LS": "\n".join(lines)}


def lines_besides(program: PoseProgram) -> tuple[int, int]:
    """Lines before the first pose, and most lines of one pose, remarks included."""
    pose = replace(program.poses[0], comment="remark", via=False)
    return len(_head(program)), len(_at_pose(program.options, pose, 1))


def _instructions(program: PoseProgram) -> list[str]:
    """Lines of the program as they stand behind their number and colon."""
    lines = _head(program)
    for number, pose in zip(program.numbers, program.poses, strict=True):
        lines += _at_pose(program.options, pose, number)
    return lines


def _head(program: PoseProgram) -> list[str]:
    options = program.options
    mark = [f"  !{program.mark}"] if program.mark else []
    mark += [f"  !{line}" for line in warning_lines(program, REMARK_LENGTH, LIMITS.forbidden)]
    return [*mark, f"  UFRAME_NUM={options.user_frame}", f"  UTOOL_NUM={options.tool_frame}"]


def _at_pose(options: ProgramOptions, pose: ProgramPose, number: int) -> list[str]:
    here = "JPOS" if options.form == "joint" else "LPOS"
    steps = _PHRASES.steps(options, pose, number, percent=options.speed_percent, here=here)
    # no zero stands before the point of a time, and a negative constant in parentheses of its own
    return [_NEGATIVE.sub(r"((\1))", step.replace("WAIT   0.", "WAIT    .")) for step in steps]


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


def _label(number: int, pose: ProgramPose) -> str:
    fits = _POSITION_NAME.fullmatch(pose.name) and not pose.name.endswith(" ")
    return f'{number}:"{pose.name}"' if fits else f"{number}"


def _joint_fields(program: PoseProgram, arm: Arm) -> list[list[str]]:
    options, units = program.options, arm.external_units
    # + 0.0 turns the -0.0 of a rounded small number into 0.0, which is written without a sign.
    values = np.round(shown_deg(arm, program.poses), 3) + 0.0
    frames = f"\tUF : {options.user_frame}, UT : {options.tool_frame},\t"
    return [
        [
            frames,
            *_in_rows(
                [f"J{j + 1}={v:10.3f} deg" for j, v in enumerate(q[:JOINTS])]
                + [
                    f"E{k}={v:10.3f} {unit:>3}"
                    for k, (v, unit) in enumerate(zip(q[JOINTS:], units, strict=True), start=1)
                ]
            ),
        ]
        for q in values
    ]


def _pose_fields(program: PoseProgram, arm: Arm) -> list[list[str]]:
    options = program.options
    shown_deg(arm, program.poses)  # refuses joints that no arm reaches
    poses = arm.tool_poses(program.postures_rad)
    words = arm.configurations(program.postures_rad)
    place = np.round(1e3 * poses[:, :3, 3], 3) + 0.0
    turn = rounded_deg(wpr_from_rotation(poses[:, :3, :3]), 3)
    found = []
    for config, xyz, wpr in zip(words, place, turn, strict=True):
        frames = (
            f"\tUF : {options.user_frame}, UT : {options.tool_frame},\t\tCONFIG : '{config.words}',"
        )
        fields = [f"{axis} ={v:10.3f}  mm" for axis, v in zip("XYZ", xyz, strict=True)]
        fields += [f"{axis} ={v:10.3f} deg" for axis, v in zip("WPR", wpr, strict=True)]
        found.append([frames, *_in_rows(fields)])
    return found


def _in_rows(fields: list[str]) -> list[str]:
    rows = [",\t".join(fields[k : k + 3]) for k in range(0, len(fields), 3)]
    return [*(f"\t{row}," for row in rows[:-1]), f"\t{rows[-1]}"]
