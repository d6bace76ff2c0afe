"""ABB RAPID: jointtargets and robtargets as a module stores them, as recorded positions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, rotation_from_quaternion, transform
from posedesign.programs.configurations import AbbConfiguration
from posedesign.programs.reading import at_rest, joint_deg, millimetres, number, refuse
from posedesign.programs.recorded import RecordedPosition

Nested = list["Nested | str"]

NORM_WITHIN = 2e-3
"""Of a quaternion's norm from 1, as people type them; the controller asks for less."""

_MOST_DEPTH = 6
_TOKEN = re.compile(r"\s*(?:([\[\],])|([^\s\[\],]{1,40}))", re.ASCII)
_ROW = r"\[[-+.\dE]{1,40}(?:,[-+.\dE]{1,40})*\]"
_LISTS = re.compile(rf"\[{_ROW}(?:,{_ROW})*\]", re.IGNORECASE | re.ASCII)
_UNCONNECTED = re.compile(r"9\.?0*E\+?0*9", re.IGNORECASE)
_SHAPES = {"jointtarget": (6, 6), "robtarget": (3, 4, 4, 6)}


@dataclass(eq=False)
class StoredPosition:
    """One position as it stands in the file.

    ``variable`` is empty for one that stands in a motion instruction; ``parts`` are the texts of
    its numbers. ``other``: no numbered position of the program. The frames are those of the motion
    to it, where the module gives their values.
    """

    variable: str
    line: int
    kind: str
    parts: list[list[str]]
    name: str = ""
    other: bool = False
    T_world_user: FloatArray | None = None
    T_tip_tool: FloatArray | None = None

    @property
    def label(self) -> str:
        """What to call it in messages."""
        return self.variable or "the position"

    @property
    def is_empty(self) -> bool:
        """Whether it is a place for a position and no position of the arm."""
        if self.kind == "jointtarget":
            return all(map(is_unconnected, self.parts[0]))
        return set(self.parts[1]) == {"0"}


def is_unconnected(text: str) -> bool:
    """Whether a number is that of an axis which is not there, 9E9."""
    return _UNCONNECTED.fullmatch(text) is not None


def nested(text: str, label: str, path: Path | str, row: int) -> Nested:
    """Lists in brackets, to any depth of six, with the texts of their numbers.

    Raises
    ------
    FileFormatError
        The text is not one list.
    """
    if _LISTS.fullmatch(text):
        # what nearly all positions are: lists of plain numbers
        return [part.split(",") for part in text[2:-2].split("],[")]  # type: ignore[misc]
    root: Nested = []
    stack = [root]
    at, value_due = 0, True
    while at < len(text) and not (len(stack) == 1 and root):
        token = _TOKEN.match(text, at)
        if token is None:
            break
        at = token.end()
        mark = token[1]
        fits = value_due if mark == "[" or not mark else not value_due
        if not fits or len(stack) > _MOST_DEPTH:
            refuse(f"{label}: cannot make sense of {token[0].strip()!r}", path, row)
        if mark == "[":
            inner: Nested = []
            stack[-1].append(inner)
            stack.append(inner)
        elif mark == "]":
            stack.pop()
        elif not mark:
            stack[-1].append(token[2])
        value_due = mark in ("[", ",")
    if len(stack) != 1 or len(root) != 1 or text[at:].strip() or isinstance(root[0], str):
        refuse(f"{label}: cannot make sense of {text[:30]!r}", path, row)
    return root[0]


def stored(variable: str, kind: str, value: Nested, path: Path | str, row: int) -> StoredPosition:
    """A position from its nested numbers.

    Raises
    ------
    FileFormatError
        The numbers are not those of such a position.
    """
    parts: list[list[str]] = []
    for part in value:
        if isinstance(part, list):
            parts.append([item for item in part if isinstance(item, str)])
            if len(parts[-1]) == len(part):
                continue
        break
    shape = tuple(map(len, parts))
    if len(parts) != len(value) or shape != _SHAPES[kind]:
        wanted = ", ".join(map(str, _SHAPES[kind]))
        reason = f"{variable or 'the position'} has not the lists of {wanted} numbers of a {kind}"
        refuse(reason, path, row)
    return StoredPosition(variable, row, kind, parts)


def recorded(
    numbered: Sequence[tuple[int, StoredPosition]], path: Path | str
) -> tuple[RecordedPosition, ...]:
    """Stored positions with their numbers as recorded ones.

    Raises
    ------
    FileFormatError
        A number that is none, a quaternion or a confdata that is none, or an external axis that
        moves between two positions.
    """
    numbered_ones = [position for _, position in numbered if not position.other]
    at_rest(_external_axes(numbered_ones or [position for _, position in numbered]), path)
    posed = [position for _, position in numbered if position.kind == "robtarget"]
    poses = iter(_poses(posed, path))
    found = []
    for n, position in numbered:
        joint = position.kind == "jointtarget"
        found.append(
            RecordedPosition(
                n,
                position.name,
                position.line,
                shown_deg=_joints(position, path) if joint else None,
                T_user_tool=None if joint else next(poses),
                configuration=None if joint else _configuration(position, path),
                T_world_user=position.T_world_user,
                T_tip_tool=position.T_tip_tool,
            )
        )
    return tuple(found)


def _joints(position: StoredPosition, path: Path | str) -> FloatArray:
    texts, label, row = position.parts[0], position.label, position.line
    for j, text in enumerate(texts, start=1):
        if is_unconnected(text):
            refuse(f"{label}: axis {j} has no value (9E9)", path, row, "is it a six-axis arm?")
    return np.array(
        [joint_deg(text, f"{label}: axis {j}", path, row) for j, text in enumerate(texts, start=1)]
    )


def _poses(positions: Sequence[StoredPosition], path: Path | str) -> FloatArray:
    """Poses of the tool ``(N, 4, 4)`` [m]."""
    values = np.empty((len(positions), 7))
    for i, position in enumerate(positions):
        label, row = position.label, position.line
        place = [
            millimetres(text, f"{label}: {axis}", path, row)
            for axis, text in zip("xyz", position.parts[0], strict=True)
        ]
        turn = [
            number(text, f"{label}: q{k}", path, row, 1.0 + NORM_WITHIN)
            for k, text in enumerate(position.parts[1], start=1)
        ]
        norm = float(np.linalg.norm(turn))
        if abs(norm - 1.0) > NORM_WITHIN:
            refuse(f"{label}: the quaternion's norm is {norm:.4f}, not 1", path, row)
        values[i] = [*place, *turn]
    rotations = rotation_from_quaternion(values[:, 3:]) if len(values) else np.empty((0, 3, 3))
    return transform(rotations, values[:, :3] / 1e3)


def _configuration(position: StoredPosition, path: Path | str) -> AbbConfiguration:
    try:
        return AbbConfiguration.parse(f"[{','.join(position.parts[2])}]")
    except InputError as error:
        refuse(f"{position.label}: {error.message}", path, position.line, error.hint)


def _external_axes(positions: Sequence[StoredPosition]) -> Iterator[tuple[str, str, str, int]]:
    for position in positions:
        for letter, text in zip("abcdef", position.parts[-1], strict=True):
            if not is_unconnected(text):
                yield position.label, f"eax_{letter}", text, position.line
