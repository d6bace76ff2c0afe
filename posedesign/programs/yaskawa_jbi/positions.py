"""Yaskawa INFORM jobs: the variables of a //POS section as they stand, and what they mean."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.programs.configurations import YaskawaConfiguration
from posedesign.programs.reading import MOST_JOINT_DEG, joint_deg, millimetres, refuse
from posedesign.programs.yaskawa_jbi.pulses import AXES

_HEADING = re.compile(r"///\s*([A-Z]+)(.*)", re.ASCII)
_VARIABLE = re.compile(r"(C|BC|EC|P|BP|EX)(\d{1,5})\s*=(.*)", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d{1,10}", re.ASCII)

KINDS = ("C", "BC", "EC", "P", "BP", "EX")
"""In the order of ///NPOS."""

_BASE_FRAMES = ("BASE", "ROBOT")
"""The frame on the robot's foot; they differ where a base axis carries the robot, whose positions
are then in BC variables."""


@dataclass(frozen=True)
class StoredVariable:
    """A variable of the job: its values as text, and what was in force above it."""

    line: int
    form: str
    frame: str
    tool: int | None
    user: int | None
    rconf: tuple[str, int]
    values: tuple[str, ...]


class PositionSection:
    """Collects the variables of the //POS section, one line at a time."""

    def __init__(self, path: Path | str) -> None:
        self.path = path
        self.variables: dict[tuple[str, int], StoredVariable] = {}
        self._npos: tuple[list[int], int] | None = None
        self._form = self._frame = ""
        self._tool: int | None = None
        self._user: int | None = None
        self._rconf = ("", 0)

    def feed(self, text: str, row: int) -> None:
        """Take one more line, without the spaces around it."""
        if not text:
            return
        heading = _HEADING.fullmatch(text)
        variable = _VARIABLE.fullmatch(text)
        if heading:
            self._head(heading[1], heading[2].strip(), row)
        elif variable:
            self._take(variable[1], int(variable[2]), variable[3], row)
        else:
            refuse(f"cannot make sense of {text[:30]!a} in //POS", self.path, row)

    def finish(self, row: int) -> None:
        """End of the section: there must be as many variables as ///NPOS says."""
        if self._npos is None:
            refuse("//POS has no ///NPOS", self.path, row)
        stated, line = self._npos
        for kind, count in zip(KINDS, stated, strict=False):
            found = sum(name == kind for name, _ in self.variables)
            if found != count:
                reason = f"///NPOS says {count} {kind} positions, there are {found}"
                refuse(reason, self.path, line, "lines are lost or doubled: save the job again")

    def _head(self, word: str, rest: str, row: int) -> None:
        if word == "NPOS":
            numbers = [part.strip() for part in rest.split(",")]
            if len(numbers) > len(KINDS) or not all(_WHOLE.fullmatch(n) for n in numbers):
                refuse(f"///NPOS {rest[:30]!a} is not six counts", self.path, row)
            if self._npos is not None:
                refuse("///NPOS is there twice", self.path, row)
            self._npos = ([int(n) for n in numbers], row)
        elif word == "TOOL":
            self._tool = self._number("TOOL", rest.split(",")[0], row)
        elif word == "USER":
            self._user = self._number("USER", rest, row)
        elif word == "POSTYPE":
            self._frame, self._form = rest, ""
        elif word in ("PULSE", "RECTAN"):
            self._form = word
        elif word == "RCONF":
            self._rconf = (rest, row)
        # others are about how the job was taught, e.g. ///MTOOL

    def _number(self, word: str, text: str, row: int) -> int:
        if not re.fullmatch(r"\d{1,3}", text, re.ASCII):
            refuse(f"///{word} {text[:30]!a} is not a number", self.path, row)
        return int(text)

    def _take(self, kind: str, number: int, values: str, row: int) -> None:
        name = f"{kind}{number:05d}"
        if (kind, number) in self.variables:
            refuse(f"{name} is there twice", self.path, row, "remove one of them")
        if not self._form or (self._form == "PULSE") != (self._frame == "PULSE"):
            reason = f"{name} is neither in pulses nor in a frame: ///POSTYPE and ///PULSE or"
            refuse(f"{reason} ///RECTAN are missing above", self.path, row)
        self.variables[kind, number] = StoredVariable(
            row,
            self._form,
            self._frame,
            self._tool,
            self._user,
            self._rconf,
            tuple(part.strip() for part in values.split(",")),
        )


def pulse_deg(
    stored: StoredVariable, name: str, pulses_per_deg: tuple[float, ...], path: Path | str
) -> FloatArray:
    """Joint values ``(6,)`` [deg] of a variable in pulses."""
    _check_count(stored, name, path)
    values = []
    for axis, text, ratio in zip(AXES, stored.values, pulses_per_deg, strict=True):
        if not _WHOLE.fullmatch(text):
            refuse(f"{name}: {axis} is {text[:30]!a}, not a whole number", path, stored.line)
        values.append(int(text) / ratio)
        if abs(values[-1]) > MOST_JOINT_DEG:
            reason = f"{name}: {axis} is {text} pulses, {values[-1]:.0f} deg"
            refuse(reason, path, stored.line, "are the pulses/deg those of this arm?")
    return np.array(values)


def rectangular(
    stored: StoredVariable, name: str, path: Path | str
) -> tuple[list[float], YaskawaConfiguration, int]:
    """X, Y, Z [mm], Rx, Ry, Rz [deg], arm position and user frame (0: base) of a variable."""
    _check_count(stored, name, path)
    if stored.frame == "USER" and stored.user is None:
        refuse(f"{name} is in a user frame, and no ///USER says which", path, stored.line)
    if stored.frame not in ("USER", *_BASE_FRAMES):
        reason = f"{name} is in the frame {stored.frame[:20]!a}"
        refuse(reason, path, stored.line, "store it in pulses, or in the base or a user frame")
    rconf, row = stored.rconf
    try:
        configuration = _parsed(rconf)
    except InputError as error:
        what = error.message if rconf else f"{name} has no ///RCONF above"
        refuse(what, path, row or stored.line, error.hint)
    xyz = [
        millimetres(text, f"{name}: {axis}", path, stored.line)
        for axis, text in zip("XYZ", stored.values[:3], strict=True)
    ]
    angles = [
        joint_deg(text, f"{name}: R{axis}", path, stored.line)
        for axis, text in zip("xyz", stored.values[3:], strict=True)
    ]
    return xyz + angles, configuration, (stored.user or 0) if stored.frame == "USER" else 0


_parsed = lru_cache(maxsize=64)(YaskawaConfiguration.parse)
"""A job has few different ones."""


def _check_count(stored: StoredVariable, name: str, path: Path | str) -> None:
    if len(stored.values) != len(AXES):
        reason = f"{name} has {len(stored.values)} values, a six-axis arm six"
        refuse(reason, path, stored.line, "is this the job of another robot?")
