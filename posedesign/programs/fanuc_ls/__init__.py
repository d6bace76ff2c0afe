"""FANUC teach pendant programs in ASCII (``.LS``), and position registers (``POSREG.VA``)."""

from __future__ import annotations

import re
from pathlib import Path

from posedesign.programs.dialect import Dialect
from posedesign.programs.fanuc_ls import writer
from posedesign.programs.fanuc_ls.reader import parse_fanuc_ls, parse_registers
from posedesign.programs.fanuc_ls.rules import check_fanuc_ls
from posedesign.programs.notation import Notation
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram

__all__ = ["FanucLs"]

REGISTERS = ".va"
"""Ending of a backup of the position registers."""


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
    names = writer.NAMES
    newline = "\r\n"
    numbered_frames = True
    joint_step_deg = 1e-3
    notation = Notation(joint=3, place=3, turned=3, counts_at=-3)
    writer = writer.render_fanuc_ls

    def with_remark(self, text: str, words: str) -> str:
        """The same, with one line more to count."""
        new = super().with_remark(text, words)
        return new if new == text else _COUNTED.sub(lambda f: f"{f[1]}{int(f[2]) + 1}", new, 1)

    def most_poses(self, program: PoseProgram) -> int | None:
        head, each = writer.lines_besides(program)
        return (writer.MOST_LINES - head) // each  # line numbers have four digits

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        registers = path.suffix.lower() == REGISTERS
        return (parse_registers if registers else parse_fanuc_ls)(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        if path.suffix.lower() == REGISTERS:
            return [Problem(1, "program", "a backup of registers is no program: nothing to check")]
        return check_fanuc_ls(data)
