"""FANUC teach pendant programs in ASCII (``.LS``): the writer.

The layout is that of controller exports, as far as the oldest controllers of interest (R-J3iB) take
it: names of 8 characters, five entries in DEFAULT_GROUP.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.se3 import wpr_from_rotation
from posedesign.programs import writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.fanuc_ls.reader import parse_fanuc_ls, parse_registers
from posedesign.programs.fanuc_ls.rules import check_fanuc_ls
from posedesign.programs.notation import Notation
from posedesign.programs.program import PoseProgram, ProgramOptions, ProgramPose
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.writing import Limits, NameRule, Phrases, rounded_deg

_RESERVED = "ABORT CALL CON ELSE END FOR IF JMP LBL MOVE NUL PAUSE PRN RUN SELECT TO WAIT"
NAMES = NameRule("a FANUC program name", 8, reserved=frozenset(_RESERVED.split()))
"""What every controller takes (R-J3iB; newer ones take longer names)."""

COMMENT_LENGTH = 16  # characters that the pendant shows of a program's or a position's comment
REMARK_LENGTH = 32  # characters of a remark line on the pendant
JOINTS = 6

MOST_LINES = 9999  # line numbers have four digits
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
    """Text of the program by its name.

    Positions are rounded to three decimals: joints by at most 0.0005 deg on the pendant and 0.001
    deg in the URDF's joint 3, which is the sum of two; poses by 0.0005 mm and deg. A pose's name
    becomes its position's comment where it has 1 to 16 plain characters.
    """
    options = program.options
    instructions = _head(program)
    for number, pose in zip(program.numbers, program.poses, strict=True):
        instructions += _at_pose(options, pose, number)
    lines = [f"/PROG  {program.name}", *_attributes(options, len(instructions)), "/MN"]
    lines += [f"{number:4d}:{text} ;" for number, text in enumerate(instructions, start=1)]
    lines.append("/POS")
    stored = zip(program.numbers, program.poses, _fields(program, arm), strict=True)
    for number, pose, values in sorted(stored, key=lambda entry: entry[0]):
        lines += [f"P[{_label(number, pose)}]{{", "   GP1:", *values, "};"]
    lines += ["/END", ""]
    return {f"{program.name}.LS": "\n".join(lines)}


def lines_besides(program: PoseProgram) -> tuple[int, int]:
    """Lines before the first pose, and most lines of one pose, remarks included."""
    pose = replace(program.poses[0], comment="remark", via=False)
    return len(_head(program)), len(_at_pose(program.options, pose, 1))


def _head(program: PoseProgram) -> list[str]:
    """Lines before the first pose, as they stand behind their number and colon."""
    options = program.options
    notes = writing.head_lines(program, REMARK_LENGTH, LIMITS.forbidden)
    frames = [f"  UFRAME_NUM={options.user_frame}", f"  UTOOL_NUM={options.tool_frame}"]
    return [*map(_PHRASES.note.format, notes), *frames]


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


def _fields(program: PoseProgram, arm: Arm) -> Iterator[list[str]]:
    """Lines of each position between its braces."""
    options = program.options
    shown = writing.shown_deg(arm, program.poses)  # refuses joints that no arm reaches
    names, units, values = [f"J{j + 1}" for j in range(JOINTS)], ["deg"] * JOINTS, shown
    ends = [""] * len(shown)
    if options.form == "joint":
        names += [f"E{k + 1}" for k in range(arm.n_external)]
        units += arm.external_units
    else:
        names, units = [*"XYZWPR"], ["mm"] * 3 + ["deg"] * 3
        poses = arm.tool_poses(program.postures_rad)
        turned = rounded_deg(wpr_from_rotation(poses[:, :3, :3]), 3)
        values = np.hstack([1e3 * poses[:, :3, 3], turned])
        ends = [f"\tCONFIG : '{c.words}'," for c in arm.configurations(program.postures_rad)]
    frames = f"\tUF : {options.user_frame}, UT : {options.tool_frame},\t"
    # + 0.0 turns the -0.0 of a rounded small number into 0.0, which is written without a sign
    for row, end in zip(np.round(values, 3) + 0.0, ends, strict=True):
        fields = zip(names, row, units, strict=True)
        yield [frames + end, *_in_rows([f"{n:2}={v:10.3f} {unit:>3}" for n, v, unit in fields])]


def _in_rows(fields: list[str]) -> list[str]:
    rows = [",\t".join(fields[k : k + 3]) for k in range(0, len(fields), 3)]
    return [*(f"\t{row}," for row in rows[:-1]), f"\t{rows[-1]}"]


REGISTERS = ".va"  # ending of a backup of the position registers


_COUNTED = re.compile(r"^((?:LINE_COUNT|ZEILEN)[ \t]*=[ \t]*)(\d+)", re.MULTILINE)


class FanucLs(Dialect):
    """FANUC teach pendant programs in ASCII."""

    name = "fanuc-ls"
    title = "FANUC teach pendant program in ASCII"
    maker = "fanuc"
    suffixes = (".ls", REGISTERS)
    remark = (r"^/MN[^\n]*\n(?:(?!/)[^\n]*\n)*", "{number:4d}:  !{words} ;")
    external_axes = 3
    turning_axes = True
    names = NAMES
    limits = LIMITS
    newline = "\r\n"
    numbered_frames = True
    joint_step_deg = 1e-3
    notation = Notation(joint=3, place=3, turned=3, counts_at=-3)
    writer = render_fanuc_ls

    def with_remark(self, text: str, words: str) -> str:
        """The same, with one line more to count."""
        new = super().with_remark(text, words)
        return new if new == text else _COUNTED.sub(lambda f: f"{f[1]}{int(f[2]) + 1}", new, 1)

    def most_poses(self, program: PoseProgram) -> int | None:
        head, each = lines_besides(program)
        return (MOST_LINES - head) // each  # line numbers have four digits

    def read_data(self, data: bytes, path: Path) -> RecordedProgram:
        registers = path.suffix.lower() == REGISTERS
        return (parse_registers if registers else parse_fanuc_ls)(data, path)

    def judge_data(self, data: bytes, path: Path) -> list[Problem]:
        if path.suffix.lower() == REGISTERS:
            said = "a backup of registers is no program: there are no rules"
            return [Problem(1, "program", said, "note")]
        return check_fanuc_ls(data)
