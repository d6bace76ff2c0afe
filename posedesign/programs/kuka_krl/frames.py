"""KUKA KRL: the tool and the base that are active at a motion, as far as the file says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from calib.se3 import FloatArray
from posedesign.programs.kuka_krl import syntax as krl
from posedesign.programs.kuka_krl.syntax import BLOCKS, POSE
from posedesign.programs.language import Node, Statement
from posedesign.programs.reading import poses_of

_ENDS = {block.closes for block in BLOCKS.values()}
_PARTS = {part for block in BLOCKS.values() for part in block.divides}
_KINDS = ("TOOL", "BASE")


@dataclass(frozen=True)
class Frame:
    """A tool or base: its number, its value X Y Z [mm] C B A [deg], or neither where not known."""

    number: int | None = None
    value: tuple[float, ...] | None = None

    @property
    def transform(self) -> FloatArray | None:
        """The value ``(4, 4)`` [m]."""
        return None if self.value is None else poses_of(self.value)[0]


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
        kind, frames = statement.kind, self.frames
        if kind == "call":
            command, number = krl.bas_of(statement)
            if command == "FRAMES":
                self.frames = replace(frames, tool=UNKNOWN, base=UNKNOWN)
                return True
            self.frames = frames.having(command, _of_number(number))
            return command in _KINDS
        if kind == "assignment":
            variable, value = statement.tree.children
            return self._take_assignment(krl.key_of(variable), value)
        if kind in BLOCKS:
            self._opened.append(frames)
        elif kind in _PARTS or kind in _ENDS:  # what one branch sets is not known behind it
            before = self._opened[-1] if self._opened else Frames()
            if kind in _ENDS and self._opened:
                self._opened.pop()
            tool = frames.tool if frames.tool == before.tool else UNKNOWN
            base = frames.base if frames.base == before.base else UNKNOWN
            self.frames = replace(frames, tool=tool, base=base)
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
            self.frames = self.frames.having(whole[1:], UNKNOWN if part else _frame(value))
        elif whole == "FDAT_ACT":
            fdat = Frames.of_fdat(dict(krl.fields_of(value)))
            self.frames = replace(self.frames, tool=fdat.tool, base=fdat.base)
        elif whole == "$IPO_MODE":
            self.frames = replace(self.frames, external_tool=str(value).upper() == "#TCP")
        return whole in ("$TOOL", "$BASE", "FDAT_ACT", "$IPO_MODE")


def _of_number(text: str) -> Frame:
    return Frame(int(text)) if text.isdigit() and len(text) <= 3 else UNKNOWN


def _frame(value: Node) -> Frame:
    """What is assigned to $TOOL or $BASE: a frame of a number, or all its six values."""
    name = krl.key_of(value)
    if name.startswith(("TOOL_DATA[", "BASE_DATA[")):
        return _of_number(name[10:-1])
    if name == "$NULLFRAME":
        return Frame(value=(0.0,) * 6)
    fields = krl.fields_of(value)
    values = {axis: krl.as_number(text) for axis, text in fields}
    if len(fields) != 6 or set(values) != set(POSE) or any(map(math.isnan, values.values())):
        return UNKNOWN  # KRL leaves values that are not given as they are
    return Frame(value=tuple(values[axis] for axis in "XYZCBA"))
