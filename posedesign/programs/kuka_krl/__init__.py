"""KUKA KRL programs (``.src`` and ``.dat``): writer, reader and validator."""

from __future__ import annotations

import re
from pathlib import Path

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.kuka_krl.reader import parse_kuka_krl
from posedesign.programs.kuka_krl.rules import check_kuka_krl
from posedesign.programs.kuka_krl.writer import NAMES, render_kuka_krl
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram

__all__ = ["KukaKrl"]

_MODULE = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(?:DEFDAT|DEF|DEFFCT)[ \t]", re.I | re.M)


class KukaKrl(Dialect):
    """KUKA KRL programs: a ``.src`` with the instructions, a ``.dat`` with the positions."""

    name = "kuka-krl"
    title = "KUKA KRL program"
    maker = "kuka"
    suffixes = (".dat", ".src")
    companions = (".src",)
    names = NAMES
    newline = "\r\n"

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        dat, src = render_kuka_krl(program, arm)
        return {f"{program.name}.dat": dat, f"{program.name}.src": src}

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return parse_kuka_krl(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        return check_kuka_krl(data, path)

    def recognises(self, data: bytes) -> bool:
        return _MODULE.search(data) is not None
