"""Other numbers in the positions of a program that is there: nothing else of its text changes.

The reader says in which line a position begins and what it is. Its numbers are the first ones from
there on that say the same, in the order that the controller has them in. Numbers that say the new
position already are left as they stand, so that a program without any change is the same, byte for
byte. What was written is read again by the dialect's own reader: only where it then finds every new
position, and all others as they were, it is given back.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from calib.se3 import FloatArray, rotation_angle
from posedesign.programs.configurations import Configuration
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import QUATERNION, Literal, Notation
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import RecordedPosition, RecordedProgram
from posedesign.programs.writing import plain

_SAME = 1e-9
"""Relative difference of a number in the file from what the reader made of it: rounding alone."""

UNCHANGED = 1e-10
"""Change [m, rad] from which on numbers are written anew: no controller stores less."""

_UNCHANGED_DEG = 1e-9

MOST_NUMBERS = 1_000_000  # of a file: 10,000 positions have a quarter of them
_WIDEST = 40  # blanks before a number that is right-aligned, at most
_NEAR = 400  # numbers that are looked through first; a position has its own right behind its line


@dataclass(frozen=True, eq=False)
class Change:
    """What a position is to be: joint values as shown ``(n,)`` [deg], and its pose ``(4, 4)`` [m].

    None: the position has none, or it stays. Of the configuration only counts can be others.
    """

    shown_deg: FloatArray | None = None
    T_user_tool: FloatArray | None = None
    configuration: Configuration | None = None


class _Text:
    """A text with its numbers, of which some are to be others."""

    def __init__(self, text: str, notation: Notation) -> None:
        self.text, self.notation = text, notation
        self.literals = list(islice(notation.literals(text), MOST_NUMBERS + 1))
        self.values = np.array([literal.value for literal in self.literals])
        self.starts = [literal.start for literal in self.literals]
        self.lines = [0, *(found.end() for found in re.finditer("\n", text))]
        self.edits: list[tuple[int, int, str]] = []
        self._used = np.zeros(len(self.literals), dtype=bool)

    def find(self, line: int, values: FloatArray, rest: int, fits: Callable[[int], bool]) -> int:
        """Index of the first of some numbers, from a line on, else from the top; -1 for none.

        ``rest``: how many others belong to them, of which ``fits`` tells.
        """
        count = len(values) + rest
        first = bisect_left(self.starts, self.lines[min(line, len(self.lines)) - 1])
        last = len(self.values) - count + 1
        for a, b in ((first, min(first + _NEAR, last)), (first, last), (0, last)):
            for k in range(a, b) if b - a <= _NEAR else self._like(values[0], a, b):
                own = self.values[k : k + len(values)]
                same = np.abs(own - values) <= _SAME * np.maximum(1.0, np.abs(values))
                if same.all() and not self._used[k : k + count].any() and fits(k):
                    self._used[k : k + count] = True
                    return k
        return -1

    def again(self, k: int, count: int, end: int) -> int:
        """Index of the same numbers behind those from the k-th on; -1 for none before an end."""
        same = k + count
        if same + count > end or (self.values[k:same] != self.values[same : same + count]).any():
            return -1
        self._used[same : same + count] = True
        return same

    def _like(self, value: float, a: int, b: int) -> list[int]:
        near = np.abs(self.values[a:b] - value) <= _SAME * max(1.0, abs(value))
        found: list[int] = (np.flatnonzero(near) + a).tolist()
        return found

    def put(self, k: int, values: FloatArray, least: int) -> None:
        """Write numbers from the k-th on; of whole numbers ``least`` is 0."""
        own = self.literals[k : k + len(values)]
        most = max(literal.decimals(least) for literal in own) if least else 0
        for literal, value in zip(own, values, strict=True):
            text = plain(value / literal.scale, most)
            if float(text) != float(literal.text):
                self._edit(literal, literal.before + text + literal.after)

    def put_angles(self, k: int, values: FloatArray, least: int) -> None:
        """The same of a rotation in degrees: -180 that comes of rounding is 180."""
        most = max(literal.decimals(least) for literal in self.literals[k : k + len(values)])
        rounded = np.round(values, most)
        self.put(k, np.where(rounded <= -180.0, 180.0, values), least)

    def _edit(self, literal: Literal, text: str) -> None:
        start = literal.start
        before = self.text[max(start - _WIDEST, 0) : start]
        blanks = len(before) - len(before.rstrip(" "))
        in_column = blanks > 1 and before.rstrip(" ")[-1:] not in ("", "\n")
        if in_column:  # numbers stand right-aligned
            width = max(blanks + literal.end - start, len(text) + 1)
            start, text = start - blanks, text.rjust(width)
        self.edits.append((start, literal.end, text))

    def result(self) -> str:
        parts, last = [], 0
        for start, end, text in sorted(self.edits, key=lambda edit: edit[:2]):
            parts += [self.text[last:start], text]
            last = end
        return "".join([*parts, self.text[last:]])


def rewritten(
    dialect: Dialect, data: bytes, path: Path, program: RecordedProgram, changes: Sequence[Change]
) -> tuple[bytes, RecordedProgram]:
    """The content of a program with other positions, and what is read of it.

    Parameters
    ----------
    data : bytes
        Content of the file, of which ``program`` was read.
    changes : sequence of Change
        Of each position of the program.

    Raises
    ------
    FileFormatError
        The numbers of a position cannot be told from others, or it is not read as it was written.
    """
    source = data.decode("latin-1")
    text = _Text(source, dialect.notation_of(source))
    if len(text.literals) > MOST_NUMBERS:
        refuse(f"holds more than {MOST_NUMBERS} numbers", path, hint="is it the right file?")
    lines = [*(position.line for position in program.positions), len(text.lines) + 1]
    ends = {a: b for a, b in pairwise(sorted(lines)) if b > a}
    for position, change in zip(program.positions, changes, strict=True):
        if change.T_user_tool is not None and position.T_user_tool is not None:
            k = _put_pose(text, position, change.T_user_tool, path)
            _put_counts(text, k, position, change.configuration, path)
        if change.shown_deg is not None and position.shown_deg is not None:
            _put_joints(text, position, change.shown_deg, path, ends[position.line])
    new = text.result().encode("latin-1")
    again = dialect.parse(new, path)
    _check(program, again, changes, text.notation, path)
    return new, again


def _lost(position: RecordedPosition, path: Path) -> None:
    refuse(
        f"the numbers of {position.label} cannot be told from others",
        path,
        position.line,
        "correct it by hand, or write it as the controller does",
    )


def _put_joints(
    text: _Text, position: RecordedPosition, new: FloatArray, path: Path, end: int
) -> None:
    notation, old = text.notation, np.asarray(position.shown_deg)
    units = notation.joint_units * np.ones(len(old))
    k = text.find(position.line, old * units, 0, lambda k: True)
    if k < 0:
        _lost(position, path)
    changed = np.abs(new - old).max() > _UNCHANGED_DEG
    before_next = bisect_left(text.starts, [*text.lines, len(text.text)][end - 1])
    while k >= 0:
        if changed:
            text.put(k, new * units, notation.joint)
        k = text.again(k, len(old), before_next) if notation.repeated else -1


def _put_counts(
    text: _Text, k: int, position: RecordedPosition, new: Configuration | None, path: Path
) -> None:
    """Write other counts of turns beside the pose whose first number is the k-th."""
    if new is None or position.configuration is None:
        return
    first, old = k + text.notation.counts_at, position.configuration.counted
    there = text.values[max(first, 0) : first + len(old)].tolist()
    if not text.notation.counts_at or first < 0 or there != [*old]:
        _lost(position, path)
    text.put(first, np.array(new.counted, dtype=float), 0)


def _put_pose(text: _Text, position: RecordedPosition, T: FloatArray, path: Path) -> int:
    """Write another pose; return the index of its first number."""
    notation, turn, old = text.notation, text.notation.turn, np.asarray(position.T_user_tool)

    def numbers(k: int) -> FloatArray:
        return text.values[k + 3 : k + 3 + turn.count]

    def fits(k: int) -> bool:
        if turn is QUATERNION and not numbers(k).any():
            return False
        return float(rotation_angle(turn.read(numbers(k)).T @ old[:3, :3])) < 1e-7

    place = old[:3, 3] * notation.place_unit
    k = text.find(position.line, place, turn.count, fits)
    if k < 0:
        _lost(position, path)
    if np.abs(T[:3, 3] - old[:3, 3]).max() > UNCHANGED:
        text.put(k, T[:3, 3] * notation.place_unit, notation.place)
    if rotation_angle(old[:3, :3].T @ T[:3, :3]) > UNCHANGED:
        put = text.put_angles if turn.in_deg else text.put
        put(k + 3, turn.write(T[:3, :3], numbers(k)), notation.turned)
    return k


def _check(
    before: RecordedProgram,
    after: RecordedProgram,
    changes: Sequence[Change],
    notation: Notation,
    path: Path,
) -> None:
    """Refuse a program that is not read as it was to be written: what is wrong is ours, or odd."""
    units = np.min(np.abs(notation.joint_units))
    joint = 0.51 * 10.0**-notation.joint / units + 2 * _UNCHANGED_DEG
    place = 0.51 * 10.0**-notation.place / notation.place_unit + 2 * UNCHANGED
    turned = 2.0 * 10.0**-notation.turned * (np.pi / 180 if notation.turn.in_deg else 1.0)
    if len(before.positions) != len(after.positions):
        refuse("has other positions once its numbers are changed", path)
    for old, new, change in zip(before.positions, after.positions, changes, strict=True):
        good = (old.number, old.name, old.line) == (new.number, new.name, new.line)
        good &= new.configuration == (change.configuration or old.configuration)
        shown = old.shown_deg if change.shown_deg is None else change.shown_deg
        T = old.T_user_tool if change.T_user_tool is None else change.T_user_tool
        good &= (new.shown_deg is None, new.T_user_tool is None) == (shown is None, T is None)
        if good and shown is not None and new.shown_deg is not None:
            good &= bool(np.abs(new.shown_deg - shown).max() <= joint)
        if good and T is not None and new.T_user_tool is not None:
            off = np.abs(new.T_user_tool[:3, 3] - T[:3, 3]).max()
            good &= bool(off <= place)
            good &= bool(rotation_angle(new.T_user_tool[:3, :3].T @ T[:3, :3]) <= turned + 2e-10)
        if not good:
            _lost(old, path)
