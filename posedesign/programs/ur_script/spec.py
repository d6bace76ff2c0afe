"""Universal Robots URScript programs: writer, readers and validator as one dialect."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.ur_script.log import is_log, parse_log
from posedesign.programs.ur_script.reader import parse_ur_script
from posedesign.programs.ur_script.rules import check_ur_script
from posedesign.programs.ur_script.writer import NAMES, render_ur_script
from posedesign.programs.writing import NameRule

_SCRIPT = re.compile(rb"^[ \t]*(?:def[ \t]+\w{1,64}[ \t]*\(|movej[ \t]*\()", re.MULTILINE)


class UrScript(Dialect):
    """Universal Robots URScript programs, and logs of what they report."""

    name: ClassVar[str] = "ur-script"
    title: ClassVar[str] = "Universal Robots URScript program"
    maker: ClassVar[str | None] = "ur"
    suffixes: ClassVar[tuple[str, ...]] = (".script", ".urscript", ".log", ".txt")
    names: ClassVar[NameRule] = NAMES

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The script; see `render_ur_script` for what is refused."""
        return {f"{program.name}.script": render_ur_script(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """A script, or a saved log of a run; see `reader` and `log`."""
        return parse_log(data, path) if is_log(data) else parse_ur_script(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a script; see `rules`."""
        return check_ur_script(data)

    def recognises(self, data: bytes) -> bool:
        """Whether it is a script with functions or moves, or a log of such a script."""
        return is_log(data) or _SCRIPT.search(data) is not None
