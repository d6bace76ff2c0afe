"""KUKA KRL: the tool and the base that are active at a motion, as far as the file says."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from calib.se3 import FloatArray, rotation_from_wpr, transform

_FLAGS = re.IGNORECASE | re.ASCII
_BAS = re.compile(r"BAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\w{1,24})\s*\)", _FLAGS)
_SET = re.compile(r"\$(TOOL|BASE)\b\s*(\.\s*\w{1,24}\s*)?=\s*(.*)", _FLAGS)
_OF_NUMBER = re.compile(r"(TOOL|BASE)_DATA\s*\[\s*(\d{1,3})\s*\]", _FLAGS)
_ALL = re.compile(r"FDAT_ACT\b|BAS\s*\(\s*#FRAMES\b", _FLAGS)
_ALL_NUMBER = re.compile(r"\b(TOOL|BASE)_NO\s+(\d{1,3})\b", _FLAGS)
_MODE = re.compile(r"\$IPO_MODE\s*=\s*(#\w{1,24})?", _FLAGS)
_FIELD = re.compile(
    r"\s*([XYZABC])\s+([-+]?(?:\d{1,6}\.?\d{0,20}|\.\d{1,20})(?:E[-+]?\d{1,2})?)\s*", _FLAGS
)
_OPENS = re.compile(r"(?:IF|FOR|WHILE|LOOP|REPEAT|SWITCH)\b", _FLAGS)
_PARTS = re.compile(r"(?:ELSE|CASE|DEFAULT)\b", _FLAGS)
_CLOSES = re.compile(r"(?:ENDIF|ENDFOR|ENDWHILE|ENDLOOP|UNTIL|ENDSWITCH)\b", _FLAGS)


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

    def with_frame(self, kind: str, frame: Frame) -> Frames:
        """These, with another tool or base."""
        if kind.upper() == "TOOL":
            return replace(self, tool=frame)
        return replace(self, base=frame)


@dataclass
class ActiveFrames:
    """Tool and base, line by line of a routine."""

    frames: Frames = field(default_factory=Frames)
    _opened: list[Frames] = field(default_factory=list)

    def give(self, tool: int, base: int) -> None:
        """Make frames of these numbers active."""
        self.frames = Frames(Frame(tool), Frame(base))

    def take(self, code: str) -> bool:
        """Follow an instruction; return whether it does nothing else than to set frames."""
        by_bas, is_set, mode = _BAS.match(code), _SET.match(code), _MODE.match(code)
        if by_bas:
            known = by_bas[2].isdigit() and len(by_bas[2]) <= 3
            self._activate(by_bas[1], Frame(int(by_bas[2])) if known else UNKNOWN)
        elif is_set:
            self._activate(is_set[1], UNKNOWN if is_set[2] else _frame(is_set[3]))
        elif mode:
            tcp = (mode[1] or "").upper() == "#TCP"
            self.frames = replace(self.frames, external_tool=tcp)
        elif _ALL.match(code):
            numbers = {kind.upper(): Frame(int(n)) for kind, n in _ALL_NUMBER.findall(code)}
            for kind in ("TOOL", "BASE"):
                self._activate(kind, numbers.get(kind, UNKNOWN))
        else:
            self._follow_blocks(code)
            return False
        return True

    def of_motion(self, rest: str) -> Frames:
        """The frames of a motion; ``rest`` is what stands behind its target."""
        found = self.frames
        for kind in ("TOOL", "BASE"):
            if "$" + kind in rest.upper():  # WITH $TOOL=...: from the data of its inline form
                found = found.with_frame(kind, UNKNOWN)
        return found

    def _activate(self, kind: str, frame: Frame) -> None:
        self.frames = self.frames.with_frame(kind, frame)

    def _follow_blocks(self, code: str) -> None:
        """What one branch sets is not known behind it."""
        if _OPENS.match(code):
            self._opened.append(self.frames)
        elif _PARTS.match(code) or _CLOSES.match(code):
            before = self._opened[-1] if self._opened else Frames()
            if _CLOSES.match(code) and self._opened:
                self._opened.pop()
            for kind in ("tool", "base"):
                if getattr(before, kind) != getattr(self.frames, kind):
                    self._activate(kind, UNKNOWN)


def _frame(text: str) -> Frame:
    """What is assigned to $TOOL or $BASE: a frame of a number, or all its six values."""
    number = _OF_NUMBER.fullmatch(text.strip())
    if number:
        return Frame(int(number[2]))
    if text.strip().upper() == "$NULLFRAME":
        return Frame(value=np.eye(4))
    inside = re.fullmatch(r"\{\s*(?:FRAME\s*:)?([^{}]*)\}", text.strip(), _FLAGS)
    fields = [_FIELD.fullmatch(part) for part in inside[1].split(",")] if inside else []
    values = {f[1].upper(): float(f[2]) for f in fields if f}
    if len(fields) != 6 or len(values) != 6:
        return UNKNOWN  # KRL leaves values that are not given as they are
    angles = np.deg2rad([values[axis] for axis in "CBA"])
    place = np.array([values[axis] for axis in "XYZ"])
    return Frame(value=transform(rotation_from_wpr(angles), place / 1e3))
