"""Staubli VAL 3 projects: writer, reader and validator as one dialect."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.staubli_val3.reader import parse_staubli_val3
from posedesign.programs.staubli_val3.rules import check_staubli_val3
from posedesign.programs.staubli_val3.writer import NAMES, render_staubli_val3
from posedesign.programs.writing import NameRule


class StaubliVal3(Dialect):
    """Staubli VAL 3 projects: a folder with data, programs and the project file."""

    name: ClassVar[str] = "staubli-val3"
    title: ClassVar[str] = "Staubli VAL 3 project"
    maker: ClassVar[str | None] = "staubli"
    suffixes: ClassVar[tuple[str, ...]] = (".dtx", ".pjx", ".pgx")
    companions: ClassVar[tuple[str, ...]] = (".pjx", ".pgx")
    in_folder: ClassVar[bool] = True
    names: ClassVar[NameRule] = NAMES
    encoding: ClassVar[str] = "utf-8"

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The files of the project; see `render_staubli_val3` for what is refused."""
        return render_staubli_val3(program, arm)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """The data of a project; see `reader`."""
        return parse_staubli_val3(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check one file of a project strictly; see `rules`."""
        return check_staubli_val3(data, path)
