"""ABB RAPID modules (``.mod``, ``.modx``, ``.sys``): writer, reader and validator."""

from __future__ import annotations

import re

from posedesign.programs.abb_rapid.reader import parse_abb_rapid
from posedesign.programs.abb_rapid.rules import check_abb_rapid
from posedesign.programs.abb_rapid.writer import NAMES, NOTATION, render_abb_rapid
from posedesign.programs.dialect import Dialect

__all__ = ["AbbRapid"]


class AbbRapid(Dialect):
    """ABB RAPID modules. Plain ASCII, so that a ``.modx`` (UTF-8) has the same content."""

    name = "abb-rapid"
    title = "ABB RAPID module"
    maker = "abb"
    suffixes = (".mod", ".modx", ".prg", ".sys", ".sysx")
    remark = (r"^[ \t]*MODULE[ \t][^\n]*\n", "  ! {words}")
    external_axes = 6
    turning_axes = True
    names = NAMES
    newline = "\r\n"
    notation = NOTATION
    begins = re.compile(rb"^[ \t]*MODULE[ \t]", re.IGNORECASE | re.MULTILINE)
    writer = render_abb_rapid
    reader = parse_abb_rapid
    rules = check_abb_rapid
