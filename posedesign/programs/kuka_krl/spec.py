"""KUKA KRL programs: the dialect, and what its controllers have."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.kuka_krl.reader import parse_kuka_krl
from posedesign.programs.kuka_krl.rules import check_kuka_krl
from posedesign.programs.kuka_krl.writer import NAMES, render_kuka_krl
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.writing import NameRule

_MODULE = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(?:DEFDAT|DEF|DEFFCT)[ \t]", re.I | re.M)


class KukaKrl(Dialect):
    """KUKA KRL programs: a ``.src`` with the instructions, a ``.dat`` with the positions."""

    name: ClassVar[str] = "kuka-krl"
    title: ClassVar[str] = "KUKA KRL program"
    maker: ClassVar[str | None] = "kuka"
    suffixes: ClassVar[tuple[str, ...]] = (".dat", ".src")
    companions: ClassVar[tuple[str, ...]] = (".src",)
    names: ClassVar[NameRule] = NAMES
    newline: ClassVar[str] = "\r\n"

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """Both files; see `render_kuka_krl` for what is refused."""
        dat, src = render_kuka_krl(program, arm)
        return {f"{program.name}.dat": dat, f"{program.name}.src": src}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """The positions of either file; see `reader`."""
        return parse_kuka_krl(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check either file strictly, with the other one beside it; see `rules`."""
        return check_kuka_krl(data, path)

    def recognises(self, data: bytes) -> bool:
        """Whether there is a line that begins a module."""
        return _MODULE.search(data) is not None
