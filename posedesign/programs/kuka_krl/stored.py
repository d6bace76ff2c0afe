"""KUKA KRL: positions as a ``.dat`` or a ``.src`` stores them, in braces, as recorded positions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.se3 import rotation_from_wpr, transform
from posedesign.programs.configurations import KukaConfiguration
from posedesign.programs.kuka_krl.frames import Frames
from posedesign.programs.reading import at_rest, joint_deg, millimetres, refuse
from posedesign.programs.recorded import RecordedPosition

AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
PLACE, TURN = ("X", "Y", "Z"), ("A", "B", "C")
EXTERNAL = ("E1", "E2", "E3", "E4", "E5", "E6")
CONFIGURATION = ("S", "T")

_KNOWN = {*AXES, *PLACE, *TURN, *EXTERNAL, *CONFIGURATION}
_TYPE = re.compile(r"\s*[A-Z]\w{0,23}\s*:", re.IGNORECASE | re.ASCII)
_FIELD = re.compile(
    r"\s*([A-Z]\w{0,23})(?:\s+|(?=[-+']))([^\s,{}]{1,40})\s*(,|$)", re.IGNORECASE | re.ASCII
)


@dataclass(eq=False)
class StoredPosition:
    """One position as it stands in the file.

    ``variable`` is empty for one that stands in a motion instruction. ``fields`` hold the texts of
    the values by their names in capitals. ``other``: no numbered position of the program, such as
    its home. ``frames``: those that it is used in; None where no motion goes to it.
    """

    variable: str
    line: int
    fields: dict[str, str]
    name: str = ""
    other: bool = False
    frames: Frames | None = None
    cartesian: bool = field(init=False)

    def __post_init__(self) -> None:
        self.cartesian = not any(axis in self.fields for axis in AXES)

    @property
    def label(self) -> str:
        """What to call it in messages."""
        return self.variable or "the position"


def fields_of(text: str, label: str, path: Path | str, row: int) -> dict[str, str]:
    """Values between braces by their names in capitals.

    Raises
    ------
    FileFormatError
        The text is not a list of names and values, or has one twice.
    """
    found: dict[str, str] = {}
    kind = _TYPE.match(text)
    at, comma = kind.end() if kind else 0, ","
    while comma:
        token = _FIELD.match(text, at)
        if token is None:
            refuse(f"{label}: cannot make sense of {text[at:].strip()[:30]!r}", path, row)
        name, at, comma = token[1].upper(), token.end(), token[3]
        if name in found:
            refuse(f"{label} has {name} twice", path, row)
        found[name] = token[2]
    return found


def recorded(
    numbered: Sequence[tuple[int, StoredPosition]], path: Path | str
) -> tuple[RecordedPosition, ...]:
    """Stored positions with their numbers as recorded ones.

    Raises
    ------
    FileFormatError
        A position is neither six joint values nor a pose, or an external axis moves between two.
    """
    for _, position in numbered:
        _check_names(position, path)
    numbered_ones = [position for _, position in numbered if not position.other]
    at_rest(_external_axes(numbered_ones or [position for _, position in numbered]), path)
    posed = [position for _, position in numbered if position.cartesian]
    poses = iter(_poses(posed, path))
    found = []
    for n, position in numbered:
        frames, posed_one = position.frames or Frames(), position.cartesian
        found.append(
            RecordedPosition(
                n,
                position.name,
                position.line,
                shown_deg=None if posed_one else _joints(position, path),
                T_user_tool=next(poses) if posed_one else None,
                configuration=_configuration(position, path) if posed_one else None,
                user_frame=frames.base.number,
                tool_frame=frames.tool.number,
                T_world_user=frames.base.value if posed_one else None,
                T_tip_tool=frames.tool.value if posed_one else None,
            )
        )
    return tuple(found)


def _check_names(position: StoredPosition, path: Path | str) -> None:
    strange = [name for name in position.fields if name not in _KNOWN]
    if strange:
        reason = f"{position.label}: {strange[0]} is no joint of a six-joint arm"
        refuse(reason, path, position.line)
    mixed = [name for name in (*PLACE, *TURN, *CONFIGURATION) if name in position.fields]
    if mixed and not position.cartesian:
        refuse(f"{position.label} has {mixed[0]} beside A1 to A6", path, position.line)
    for name in (*PLACE, *TURN) if position.cartesian else AXES:
        if name not in position.fields:
            whole = "a pose has X Y Z A B C" if position.cartesian else "a posture has A1 to A6"
            refuse(f"{position.label}: {name} is missing", path, position.line, whole)


def _joints(position: StoredPosition, path: Path | str) -> np.ndarray:
    fields, label, row = position.fields, position.label, position.line
    return np.array([joint_deg(fields[a], f"{label}: {a}", path, row) for a in AXES])


def _poses(positions: Sequence[StoredPosition], path: Path | str) -> np.ndarray:
    """Poses of the tool ``(N, 4, 4)`` [m]: ``Rz(A) Ry(B) Rx(C)``."""
    values = np.empty((len(positions), 6))
    for i, position in enumerate(positions):
        fields, label, row = position.fields, position.label, position.line
        place = [millimetres(fields[a], f"{label}: {a}", path, row) for a in PLACE]
        turn = [joint_deg(fields[a], f"{label}: {a}", path, row) for a in reversed(TURN)]
        values[i] = [*place, *turn]
    return transform(rotation_from_wpr(np.deg2rad(values[:, 3:])), values[:, :3] / 1e3)


def _configuration(position: StoredPosition, path: Path | str) -> KukaConfiguration | None:
    """Status and Turn; None where the position has neither."""
    given = [name for name in CONFIGURATION if name in position.fields]
    if not given:
        return None
    if len(given) == 1:
        other = "T" if given == ["S"] else "S"
        refuse(f"{position.label} has {given[0]} and no {other}", path, position.line)
    try:
        return KukaConfiguration.parse(
            ",".join(f"{name} {position.fields[name]}" for name in given)
        )
    except InputError as error:
        refuse(f"{position.label}: {error.message}", path, position.line, error.hint)


def _external_axes(positions: Sequence[StoredPosition]) -> Iterator[tuple[str, str, str, int]]:
    for position in positions:
        for axis in EXTERNAL:
            if axis in position.fields:
                yield position.label, axis, position.fields[axis], position.line
