"""FANUC teach pendant programs in ASCII: writer, readers and validator as one dialect."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.fanuc_ls.reader import parse_fanuc_ls
from posedesign.programs.fanuc_ls.registers import parse_registers
from posedesign.programs.fanuc_ls.rules import check_fanuc_ls
from posedesign.programs.fanuc_ls.writer import MOST_LINES, NAMES, lines_besides, render_fanuc_ls
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.writing import NameRule

REGISTERS = ".va"
"""Ending of a backup of the position registers."""


class FanucLs(Dialect):
    """FANUC teach pendant programs in ASCII."""

    name: ClassVar[str] = "fanuc-ls"
    title: ClassVar[str] = "FANUC teach pendant program in ASCII"
    maker: ClassVar[str | None] = "fanuc"
    suffixes: ClassVar[tuple[str, ...]] = (".ls", REGISTERS)
    names: ClassVar[NameRule] = NAMES
    newline: ClassVar[str] = "\r\n"
    numbered_frames: ClassVar[bool] = True
    joint_step_deg: ClassVar[float] = 1e-3

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The program; see `render_fanuc_ls` for what is refused."""
        return {f"{program.name}.LS": render_fanuc_ls(program, arm)}

    def most_poses(self, program: PoseProgram) -> int | None:
        """As many as fit into four-digit line numbers."""
        head, each = lines_besides(program)
        return (MOST_LINES - head) // each

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """A program, or the registers of a backup; see `reader` and `registers`."""
        if path.suffix.lower() == REGISTERS:
            return parse_registers(data, path)
        return parse_fanuc_ls(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a program strictly; see `rules`. There are none for a backup of registers."""
        if path.suffix.lower() == REGISTERS:
            return [Problem(1, "program", "a backup of registers is no program: nothing to check")]
        return check_fanuc_ls(data)
