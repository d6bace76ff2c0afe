"""Staubli VAL 3 projects: writer, reader and validator."""

from __future__ import annotations

from pathlib import Path

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.staubli_val3.reader import parse_staubli_val3
from posedesign.programs.staubli_val3.rules import check_staubli_val3
from posedesign.programs.staubli_val3.writer import NAMES, render_staubli_val3

__all__ = ["StaubliVal3"]


class StaubliVal3(Dialect):
    """Staubli VAL 3 projects: a folder with data, programs and the project file."""

    name = "staubli-val3"
    title = "Staubli VAL 3 project"
    maker = "staubli"
    suffixes = (".dtx", ".pjx", ".pgx")
    companions = (".pjx", ".pgx")
    in_folder = True
    names = NAMES
    encoding = "utf-8"

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        return render_staubli_val3(program, arm)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return parse_staubli_val3(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        return check_staubli_val3(data, path)
