"""ABB RAPID modules (``.mod``, ``.modx``): writer, reader and validator."""

from __future__ import annotations

import re
from pathlib import Path

from posedesign.programs.abb_rapid.reader import parse_module
from posedesign.programs.abb_rapid.rules import check_module
from posedesign.programs.abb_rapid.writer import NAMES, render_module
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram

__all__ = ["AbbRapid"]

_MODULE = re.compile(rb"^[ \t]*MODULE[ \t]", re.IGNORECASE | re.MULTILINE)


class AbbRapid(Dialect):
    """ABB RAPID modules. Plain ASCII, so that a ``.modx`` (UTF-8) has the same content."""

    name = "abb-rapid"
    title = "ABB RAPID module"
    maker = "abb"
    suffixes = (".mod", ".modx", ".prg")
    names = NAMES
    newline = "\r\n"

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        return {f"{program.name}.mod": render_module(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return parse_module(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        return check_module(data, path)

    def recognises(self, data: bytes) -> bool:
        return _MODULE.search(data) is not None
