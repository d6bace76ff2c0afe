"""KUKA KRL programs (``.src`` and ``.dat``): writer, reader and validator."""

from __future__ import annotations

import re

from posedesign.programs.dialect import Dialect
from posedesign.programs.kuka_krl.reader import parse_kuka_krl
from posedesign.programs.kuka_krl.rules import check_kuka_krl
from posedesign.programs.kuka_krl.writer import NAMES, NOTATION, render_kuka_krl

__all__ = ["KukaKrl"]


class KukaKrl(Dialect):
    """KUKA KRL programs: a ``.src`` with the instructions, a ``.dat`` with the positions."""

    name = "kuka-krl"
    title = "KUKA KRL program"
    maker = "kuka"
    suffixes = (".dat", ".src")
    remark = (r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:DAT)?[ \t][^\n]*\n", ";{words}")
    companions = (".src",)
    external_axes = 6
    turning_axes = True
    names = NAMES
    newline = "\r\n"
    notation = NOTATION
    begins = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(?:DEFDAT|DEF|DEFFCT)[ \t]", re.I | re.M)
    writer = render_kuka_krl
    reader = parse_kuka_krl
    rules = check_kuka_krl
