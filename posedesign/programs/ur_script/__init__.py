"""Universal Robots URScript programs (``.script``): writer, readers and validator."""

from __future__ import annotations

import re

from calib.errors import InputError
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import Notation
from posedesign.programs.ur_script.reader import is_log, parse_ur_script
from posedesign.programs.ur_script.rules import check_ur_script
from posedesign.programs.ur_script.spec import NAMES
from posedesign.programs.ur_script.writer import NOTATION, render_ur_script

__all__ = ["UrScript"]

_SCRIPT = re.compile(rb"^[ \t]*(?:def[ \t]+\w{1,64}[ \t]*\(|movej[ \t]*\()", re.MULTILINE)


class UrScript(Dialect):
    """Universal Robots URScript programs, and logs of what they report."""

    name = "ur-script"
    title = "Universal Robots URScript program"
    maker = "ur"
    suffixes = (".script", ".urscript", ".log", ".txt")
    remark = (r"", "# {words}")
    names = NAMES
    notation = NOTATION
    writer = render_ur_script
    reader = parse_ur_script
    rules = check_ur_script

    def notation_of(self, text: str) -> Notation:
        """The usual one; a log of what was done is refused."""
        if is_log(text.encode("latin-1")):
            raise InputError("the log of a run is no program", hint="name the script", name="path")
        return self.notation

    def recognises(self, data: bytes) -> bool:
        return is_log(data) or _SCRIPT.search(data) is not None
