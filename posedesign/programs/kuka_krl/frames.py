"""KUKA KRL: the tool and the base that are active at a motion, as far as the file says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.programs.kuka_krl import syntax as krl
from posedesign.programs.kuka_krl.syntax import POSE, Node
from posedesign.programs.language import Statement

_OPEN = ("if_", "for_", "while_", "loop", "repeat", "switch")
_PARTS = ("else_", "case", "default")
_CLOSE = ("endif", "endfor", "endwhile", "endloop", "until", "endswitch")


@dataclass(frozen=True, eq=False)
class Frame:
    """A tool or base: its number, its value ``(4, 4)`` [m], or neither where it is not known."""

    number: int | None = None
    value: FloatArray | None = None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Frame) or self.number != other.number:
            return False
        if self.value is None or other.value is None:
            return self.value is other.value
        return np.array_equal(self.value, other.value)

    def __hash__(self) -> int:
        return hash(self.number)


UNKNOWN = Frame()


@dataclass(frozen=True)
class Frames:
    """What is active at a motion; ``external_tool``: the tool stands in the cell."""

    tool: Frame = UNKNOWN
    base: Frame = UNKNOWN
    external_tool: bool = False

    def having(self, kind: str, frame: Frame) -> Frames:
        """These, with another ``TOOL`` or ``BASE``."""
        if kind == "TOOL":
            return replace(self, tool=frame)
        return replace(self, base=frame) if kind == "BASE" else self

    @classmethod
    def of_fdat(cls, fields: Mapping[str, str]) -> Frames:
        """The frames that the data of an inline form name."""
        tool, base = (_of_number(fields.get(name, "")) for name in ("TOOL_NO", "BASE_NO"))
        return cls(tool, base, fields.get("IPO_FRAME", "").upper() == "#TCP")


@dataclass
class ActiveFrames:
    """Tool and base, statement by statement of a routine."""

    frames: Frames = field(default_factory=Frames)
    _opened: list[Frames] = field(default_factory=list)

    def take(self, statement: Statement) -> bool:
        """Follow a statement; return whether it does nothing else than to set frames."""
        kind = statement.kind
        if kind == "call":
            command, number = krl.bas_of(statement)
            if command in ("TOOL", "BASE"):
                self._activate(command, _of_number(number))
            elif command == "FRAMES":
                self.frames = replace(self.frames, tool=UNKNOWN, base=UNKNOWN)
            return command in ("TOOL", "BASE", "FRAMES")
        if kind == "assignment":
            variable, value = statement.tree.children
            return self._take_assignment(krl.key_of(variable), value)
        self._follow_blocks(kind)
        return False

    def of_motion(self, statement: Statement) -> Frames:
        """The frames of a motion."""
        found = self.frames
        for name, _ in krl.settings_of(statement):  # from the data of its inline form
            found = found.having(name.removeprefix("$"), UNKNOWN)
        return found

    def _take_assignment(self, name: str, value: Node) -> bool:
        whole, _, part = name.partition(".")
        if whole in ("$TOOL", "$BASE"):
            self._activate(whole[1:], UNKNOWN if part else _frame(value))
        elif whole == "FDAT_ACT":
            fdat = Frames.of_fdat(dict(krl.fields_of(value)))
            self.frames = replace(self.frames, tool=fdat.tool, base=fdat.base)
        elif whole == "$IPO_MODE":
            self.frames = replace(self.frames, external_tool=str(value).upper() == "#TCP")
        else:
            return False
        return True

    def _activate(self, name: str, frame: Frame) -> None:
        self.frames = self.frames.having(name, frame)

    def _follow_blocks(self, kind: str) -> None:
        """What one branch sets is not known behind it."""
        if kind in _OPEN:
            self._opened.append(self.frames)
        elif kind in _PARTS or kind in _CLOSE:
            before = self._opened[-1] if self._opened else Frames()
            if kind in _CLOSE and self._opened:
                self._opened.pop()
            if before.tool != self.frames.tool:
                self._activate("TOOL", UNKNOWN)
            if before.base != self.frames.base:
                self._activate("BASE", UNKNOWN)


def _of_number(text: str) -> Frame:
    return Frame(int(text)) if text.isdigit() and len(text) <= 3 else UNKNOWN


def _frame(value: Node) -> Frame:
    """What is assigned to $TOOL or $BASE: a frame of a number, or all its six values."""
    name = krl.key_of(value)
    if name.startswith(("TOOL_DATA[", "BASE_DATA[")):
        return _of_number(name[10:-1])
    if name == "$NULLFRAME":
        return Frame(value=np.eye(4))
    fields = krl.fields_of(value)
    values = {axis: krl.as_number(text) for axis, text in fields}
    if len(fields) != 6 or set(values) != set(POSE) or any(map(math.isnan, values.values())):
        return UNKNOWN  # KRL leaves values that are not given as they are
    angles = np.deg2rad([values[axis] for axis in "CBA"])
    place = np.array([values[axis] for axis in "XYZ"])
    return Frame(value=transform(rotation_from_wpr(angles), place / 1e3))
