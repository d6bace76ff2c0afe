"""ABB RAPID modules: writer, reader and validator as one dialect."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from posedesign.programs.abb_rapid.reader import parse_module
from posedesign.programs.abb_rapid.rules import check_module
from posedesign.programs.abb_rapid.writer import NAMES, render_module
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.writing import NameRule

_MODULE = re.compile(rb"^[ \t]*MODULE[ \t]", re.IGNORECASE | re.MULTILINE)


class AbbRapid(Dialect):
    """ABB RAPID modules. Plain ASCII, so that a ``.modx`` (UTF-8) has the same content."""

    name: ClassVar[str] = "abb-rapid"
    title: ClassVar[str] = "ABB RAPID module"
    maker: ClassVar[str | None] = "abb"
    suffixes: ClassVar[tuple[str, ...]] = (".mod", ".modx", ".prg")
    names: ClassVar[NameRule] = NAMES
    newline: ClassVar[str] = "\r\n"

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The module; see `render_module` for what is refused."""
        return {f"{program.name}.mod": render_module(program, arm)}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """The positions of a module; see `reader`."""
        return parse_module(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a module strictly; see `rules`."""
        return check_module(data, path)

    def recognises(self, data: bytes) -> bool:
        """Whether there is a line that begins a module."""
        return _MODULE.search(data) is not None
