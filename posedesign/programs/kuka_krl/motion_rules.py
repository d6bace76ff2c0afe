"""KUKA KRL: the strict validator's rules of what a motion and a frame look like; see :mod:`.rules`.

Every word of a motion is looked at: a controller does not pass over one that it does not know.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from posedesign.programs.kuka_krl.listing import Module, instructions, named_target
from posedesign.programs.recorded import Problem

MOST_TOOL, MOST_BASE = 16, 32
"""Frames that controllers have as delivered; 0 is the flange, and the world."""

_IGNORE = re.IGNORECASE | re.ASCII
_PLACE = (
    r"(?:\{[^{}]*\}|\$?[A-Z_][\w$]{0,99}(?: ?\[[^\[\]]{0,40}\])?(?:\.[A-Z_]\w{0,23}){0,3}"
    r"(?: ?\([^()]{0,99}\))?)"
)
_TARGET = rf"{_PLACE}(?: ?: ?{_PLACE}){{0,4}}"
_ANGLE = r"(?: ?, ?CA [^,]{1,40}?)?"
_WORDS = r"(?: #(?:BASE|TOOL))?(?: C_(?:PTP|DIS|ORI|VEL|SPL)){0,2}(?: WITH \$.*)?"
_STRAIGHT = re.compile(_TARGET + _WORDS, _IGNORE)
_CIRCLE = re.compile(rf"{_TARGET} ?, ?{_TARGET}{_ANGLE}{_WORDS}", _IGNORE)
_ON_A_PATH = ("LIN", "SLIN", "CIRC", "SCIRC", "SPL")
_FRAME_NUMBER = re.compile(
    r"BAS ?\( ?#(TOOL|BASE) ?, ?([-+.\d]{1,20}) ?\)"
    r"|\$(?:TOOL|BASE) ?= ?(TOOL|BASE)_DATA ?\[ ?([-+.\d]{1,20}) ?\]",
    _IGNORE,
)
_FRAME_VALUE = re.compile(r"\$(TOOL|BASE) ?= ?\{(?: ?FRAME ?:)?([^{}]*)\}", _IGNORE)
_FRAME_FIELD = re.compile(
    r"([XYZABC]) [-+]?(?:\d{1,6}(?:\.\d{0,20})?|\.\d{1,20})(?:E[-+]?\d{1,3})?", _IGNORE
)
_SPEED = re.compile(r"BAS ?\( ?#(VEL_PTP|ACC_PTP) ?, ?([-+.\w]{1,20}) ?\)", _IGNORE)


def check_words(source: Module, data: Module | None) -> Iterator[Problem]:
    """Rule ``motion``."""
    defined = [*(data.fields if data else []), *source.fields]
    joints = {f.variable: "A1" in f.names for f in defined if f.variable}
    inline = {f.row: "A1" in f.names for f in source.fields if not f.variable}
    for row, word, rest in source.motions:
        form = _CIRCLE if word.startswith(("CIRC", "SCIRC")) else _STRAIGHT
        if not form.fullmatch(rest.strip()):
            reason = f"{word} {rest[:40]!a} is not a target, and C_PTP, C_DIS or the like behind it"
            yield Problem(row, "motion", reason)
        elif word in _ON_A_PATH and joints.get(named_target(rest), inline.get(row, False)):
            yield Problem(row, "motion", f"{word} goes to a pose, not to joint values")


def check_settings(source: Module) -> Iterator[Problem]:
    """Rules ``speed`` and ``frame-value``."""
    most = {"TOOL": MOST_TOOL, "BASE": MOST_BASE}
    for line in instructions(source):
        speed = _SPEED.match(line.code)
        numeric = speed is not None and re.fullmatch(r"[-+.\d]+", speed[2])
        if (
            speed
            and numeric
            and not (re.fullmatch(r"\d{1,3}", speed[2]) and 1 <= int(speed[2]) <= 100)
        ):
            yield Problem(line.row, "speed", f"{speed[1]} {speed[2]}: not from 1 to 100 percent")
        number, value = _FRAME_NUMBER.match(line.code), _FRAME_VALUE.match(line.code)
        if number:
            kind, text = (number[1] or number[3]).upper(), number[2] or number[4]
            if not (re.fullmatch(r"\d{1,3}", text) and int(text) <= most[kind]):
                reason = f"{kind} {text}: controllers have 0 to {most[kind]}"
                yield Problem(line.row, "frame-value", reason)
        elif value:
            fields = [_FRAME_FIELD.fullmatch(part.strip()) for part in value[2].split(",")]
            names = [field[1].upper() for field in fields if field]
            if len(fields) != 6 or sorted(names) != sorted("XYZABC"):
                reason = f"${value[1].upper()} has not X Y Z A B C: the others stay as they are"
                yield Problem(line.row, "frame-value", reason)
