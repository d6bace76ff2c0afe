"""Mitsubishi MELFA-BASIC V and VI programs: writer, reader and validator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.mitsubishi_melfa import reader, rules, writer
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram

__all__ = ["MitsubishiMelfa"]

SIGNS = "signs of the joints, which are those of the robot's description"


class MitsubishiMelfa(Dialect):
    """Programs of MELFA arms; joints are those of the description, whatever the pendant shows."""

    name = "mitsubishi-melfa"
    title = "Mitsubishi MELFA-BASIC program"
    maker = None
    suffixes = (".mb5", ".mb6")
    forms = ("joint",)
    names = writer.NAMES
    newline = "\r\n"

    def most_poses(self, program: PoseProgram) -> int | None:
        return writer.MOST_POSES

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The file; see `writer`. It says that nobody has compared the signs of the joints."""
        unknown = replace(program, not_checked=(*program.not_checked, SIGNS))
        return writer.render_mitsubishi_melfa(unknown, arm)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return reader.parse_mitsubishi_melfa(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        return rules.check_mitsubishi_melfa(data, path)
