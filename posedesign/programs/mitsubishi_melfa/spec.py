"""Mitsubishi MELFA-BASIC V and VI as one dialect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.mitsubishi_melfa import reader, rules, writer
from posedesign.programs.program import Form, PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.writing import NameRule

SIGNS = "signs of the joints, which are those of the robot's description"


class MitsubishiMelfa(Dialect):
    """Programs of MELFA arms; joints are those of the description, whatever the pendant shows."""

    name: ClassVar[str] = "mitsubishi-melfa"
    title: ClassVar[str] = "Mitsubishi MELFA-BASIC program"
    maker: ClassVar[str | None] = None
    suffixes: ClassVar[tuple[str, ...]] = (".mb5", ".mb6")
    forms: ClassVar[tuple[Form, ...]] = ("joint",)
    names: ClassVar[NameRule] = writer.NAMES
    newline: ClassVar[str] = "\r\n"

    def most_poses(self, program: PoseProgram) -> int | None:
        """Programs of more steps are split."""
        return writer.MOST_POSES

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The file; see `writer`. It says that nobody has compared the signs of the joints."""
        unknown = replace(program, not_checked=(*program.not_checked, SIGNS))
        return writer.render_mitsubishi_melfa(unknown, arm)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """A program with its positions; see `reader`."""
        return reader.parse_mitsubishi_melfa(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a program; see `rules`."""
        return rules.check_mitsubishi_melfa(data, path)
