"""ABB RAPID: tools and work objects that a module declares, and those that a motion names."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.se3 import FloatArray, rotation_from_quaternion, transform
from posedesign.programs.abb_rapid.stored import (
    NORM_WITHIN,
    Nested,
    StoredPosition,
    nested,
)
from posedesign.programs.reading import millimetres, number, refuse

_FLAGS = re.IGNORECASE | re.ASCII
_NAME = r"[A-Z]\w{0,99}"
_DECLARED = re.compile(
    rf"\b(?:CONST|PERS|VAR) (tooldata|wobjdata) ({_NAME}) ?(\{{[^}}]{{0,40}}\}})? ?(?::= ?(.*))?",
    _FLAGS,
)
_DATA = re.compile(r"\b(?:CONST|PERS|VAR) \w", _FLAGS)
_CHANGED = re.compile(
    rf"\b({_NAME})(?: ?\{{[^{{}}]{{0,40}}\}})?((?: ?\. ?\w{{1,24}}){{0,4}}) ?:=", _FLAGS
)
_DISPLACED = re.compile(r"\bPDisp(?:On|Set)\b", _FLAGS)
_MOTION = re.compile(
    r"\b(?:MoveAbsJ|MoveJ|MoveL) ?(?:\\\w+ ?(?::= ?\w+ ?)?,? ?)*(?=[\[\w])(.*)", _FLAGS
)
_TARGET = re.compile(rf"({_NAME})(?: ?\{{ ?(\w{{1,100}}) ?\}})?(?: ?\\.*)?", _FLAGS)
_FRAMES = re.compile(rf"({_NAME})((?: ?\\ ?\w{{1,32}} ?(?::= ?\w{{1,100}})?)*)", _FLAGS)
_WORK_OBJECT = re.compile(rf"\\ ?WObj ?:= ?({_NAME})", _FLAGS)
_MARK = re.compile(r"[\[\](){},]")


@dataclass
class MotionFrames:
    """What a module says of the frames of its motions.

    Attributes
    ----------
    declared : dict of (str, str) to (str, int)
        Text and line of tools and work objects, by kind and name in capitals.
    motions : list of (str, str, str, int)
        Target, tool, work object in capitals, and line.
    changes : list of (str, str, int)
        Name in capitals of what an assignment changes, which part of it, and line.
    displaced : int or None
        Line of the first program displacement.
    """

    declared: dict[tuple[str, str], tuple[str, int]] = field(default_factory=dict)
    motions: list[tuple[str, str, str, int]] = field(default_factory=list)
    changes: list[tuple[str, str, int]] = field(default_factory=list)
    displaced: int | None = None

    def take(self, code: str, row: int) -> None:
        """Note a declaration of frames, a motion, or what changes them, of one statement."""
        declared, motion = _DECLARED.search(code), _MOTION.search(code)
        if declared:
            key = (declared[1][:4].upper(), declared[2].upper())
            if declared[4] is not None and not declared[3]:
                self.declared[key] = declared[4], row
        elif motion:
            self._take_motion(motion[1], row)
        elif ":=" in code and not _DATA.search(code):
            self.changes += [(m[1].upper(), m[2], row) for m in _CHANGED.finditer(code)]
        elif _DISPLACED.search(code):
            self.displaced = self.displaced or row

    def _take_motion(self, text: str, row: int) -> None:
        parts = _arguments(text)
        target = _TARGET.fullmatch(parts[0])
        frames = _FRAMES.fullmatch(parts[-1])
        inline = parts[0].startswith("[")
        if frames is None or len(parts) != 4 or not (target or inline):
            return  # Offs(p1,...): no motion to a position of the file
        name = ""
        if target:
            name = target[1].upper() + (f"{{{target[2]}}}" if target[2] else "")
        work_object = _WORK_OBJECT.search(frames[2])
        used = work_object[1].upper() if work_object else "WOBJ0"
        self.motions.append((name or f"[{row}", frames[1].upper(), used, row))

    def give(self, positions: list[StoredPosition], path: Path | str) -> None:
        """Give poses the frames of the motions that go to them.

        Raises
        ------
        FileFormatError
            A pose is used in two frames, or in one that is not that of a tool at the flange, or is
            changed by the program.
        """
        poses = [p for p in positions if p.kind == "robtarget"]
        found = {p.variable.upper() or f"[{p.line}": p for p in poses}
        if poses and self.displaced is not None:
            hint = "measure without a program displacement"
            refuse("displaced positions (PDispOn) cannot be read", path, self.displaced, hint)
        self._refuse_changes(positions, path)
        changed = {name for name, _, _ in self.changes}
        values: dict[tuple[str, str], FloatArray | None] = {
            ("TOOL", "TOOL0"): np.eye(4),
            ("WOBJ", "WOBJ0"): np.eye(4),
        }
        used: dict[str, tuple[str, str]] = {}
        for name, tool, work_object, row in self.motions:
            position = found.get(name)
            if position is None:
                continue
            if used.setdefault(name, (tool, work_object)) != (tool, work_object):
                reason = f"{position.label} is used in other frames than before"
                refuse(reason, path, row, "use each position with one tool and one work object")
            for key in (("TOOL", tool), ("WOBJ", work_object)):
                if key not in values:
                    text, at = self.declared.get(key, ("", 0))
                    known = text and key[1] not in changed
                    values[key] = _value(key[0], key[1], text, path, at) if known else None
            position.T_tip_tool = values["TOOL", tool]
            position.T_world_user = values["WOBJ", work_object]

    def _refuse_changes(self, positions: list[StoredPosition], path: Path | str) -> None:
        """Refuse positions of which the program changes a part."""
        names = {p.variable.upper().partition("{")[0]: p.label for p in positions if p.variable}
        for name, part, row in self.changes:
            if part and name in names:
                reason = f"{names[name]} is changed in part"
                refuse(reason, path, row, "store the position whole")


def _arguments(text: str) -> list[str]:
    """Parts of a text between the commas that stand in no brackets."""
    parts, depth, start = [], 0, 0
    for mark in _MARK.finditer(text):
        if mark[0] in "[({":
            depth += 1
        elif mark[0] in "])}":
            depth -= 1
        elif depth == 0:
            parts.append(text[start : mark.start()].strip())
            start = mark.end()
    return [*parts, text[start:].strip()]


def _value(kind: str, name: str, text: str, path: Path | str, row: int) -> FloatArray:
    """The frame ``(4, 4)`` [m] of a tool or work object."""
    value = nested(text, name, path, row)
    # robhold; of a work object also ufprog: it stands where the program says
    usual = ["TRUE"] if kind == "TOOL" else ["FALSE", "TRUE"]
    if [str(part).upper() for part in value[: len(usual)]] != usual:
        what = "a tool that stands in the cell" if kind == "TOOL" else "a work object that moves"
        refuse(f"{name} is {what}", path, row, "measure with the tool at the flange")
    if len(value) != (3 if kind == "TOOL" else 5):
        refuse(f"{name} has not the parts of {kind.lower()}data", path, row)
    if kind == "TOOL":
        return _pose(value[1], name, path, row)
    return np.asarray(_pose(value[3], name, path, row) @ _pose(value[4], name, path, row))


def _pose(value: Nested | str, name: str, path: Path | str, row: int) -> FloatArray:
    parts = [part for part in value if isinstance(part, list)] if isinstance(value, list) else []
    if [len(part) for part in parts] != [3, 4]:
        refuse(f"{name} has not the lists of 3, 4 numbers of a frame", path, row)
    place = np.array([millimetres(str(x), f"{name}: x, y, z", path, row) for x in parts[0]])
    turn = np.array([number(str(q), f"{name}: q", path, row, 1.0 + NORM_WITHIN) for q in parts[1]])
    norm = float(np.linalg.norm(turn))
    if abs(norm - 1.0) > NORM_WITHIN:
        refuse(f"{name}: the quaternion's norm is {norm:.4f}, not 1", path, row)
    return transform(rotation_from_quaternion(turn), place / 1e3)
