"""FANUC teach pendant programs in ASCII (``.LS``): writer, reader and validator as one dialect."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from posedesign.files import write_text_atomic
from posedesign.programs.dialect import Dialect
from posedesign.programs.fanuc_ls_read import read_fanuc_ls
from posedesign.programs.fanuc_ls_validate import validate_fanuc_ls
from posedesign.programs.fanuc_ls_write import render_fanuc_ls
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram


class FanucLs(Dialect):
    """FANUC teach pendant programs in ASCII."""

    name: ClassVar[str] = "fanuc-ls"
    maker: ClassVar[str] = "fanuc"
    suffixes: ClassVar[tuple[str, ...]] = (".ls",)

    def write(self, program: PoseProgram, path: Path) -> None:
        """Write the program; see `render_fanuc_ls` for what is refused."""
        write_text_atomic(path, render_fanuc_ls(program), newline="\r\n", encoding="ascii")

    def read(self, path: Path) -> RecordedProgram:
        """Read a program back; see `fanuc_ls_read`."""
        return read_fanuc_ls(path)

    def validate(self, path: Path) -> list[Problem]:
        """Check a program strictly; see `fanuc_ls_validate`."""
        return validate_fanuc_ls(path)
