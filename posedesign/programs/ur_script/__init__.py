"""Universal Robots URScript programs (``.script``): writer, readers and validator."""

from __future__ import annotations

import re
from pathlib import Path

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.ur_script.log import is_log, parse_log
from posedesign.programs.ur_script.reader import parse_ur_script
from posedesign.programs.ur_script.rules import check_ur_script
from posedesign.programs.ur_script.writer import NAMES, render_ur_script

__all__ = ["UrScript"]

_SCRIPT = re.compile(rb"^[ \t]*(?:def[ \t]+\w{1,64}[ \t]*\(|movej[ \t]*\()", re.MULTILINE)


class UrScript(Dialect):
    """Universal Robots URScript programs, and logs of what they report."""

    name = "ur-script"
    title = "Universal Robots URScript program"
    maker = "ur"
    suffixes = (".script", ".urscript", ".log", ".txt")
    names = NAMES

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        return {f"{program.name}.script": render_ur_script(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return parse_log(data, path) if is_log(data) else parse_ur_script(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        return check_ur_script(data)

    def recognises(self, data: bytes) -> bool:
        return is_log(data) or _SCRIPT.search(data) is not None
