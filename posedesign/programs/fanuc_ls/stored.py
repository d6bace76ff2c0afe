"""What FANUC stores of a position, in a program or in a register, as a recorded position."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.se3 import rotation_from_wpr, transform
from posedesign.programs.configurations import FanucConfiguration
from posedesign.programs.reading import at_rest, joint_deg, millimetres, refuse
from posedesign.programs.recorded import RecordedPosition

JOINTS = tuple(f"J{j}" for j in range(1, 7))
PLACE, TURN = ("X", "Y", "Z"), ("W", "P", "R")
EXTENDED = ("E1", "E2", "E3")

_RELATIVE = {f"R{axis}" for axis in (*PLACE, *TURN)}
_ON_THE_PENDANT = "on the pendant choose POSITION, REPRE, Joint for it, and save the program again"


@dataclass
class StoredGroup:
    """One motion group of a position, as it stands in the file.

    ``fields`` hold for each name the text of the value, its unit, and its line.
    """

    line: int
    frames: dict[str, int | None] = field(default_factory=dict)
    fields: dict[str, tuple[str, str, int]] = field(default_factory=dict)
    config: str | None = None


def recorded(
    label: str, number: int, name: str, line: int, group: StoredGroup, path: Path | str
) -> RecordedPosition:
    """A position from its first group: six joint values, or a pose with its configuration."""
    known = {*JOINTS, *EXTENDED, *PLACE, *TURN}
    strange = sorted(set(group.fields) - known)
    if strange:
        row = group.fields[strange[0]][2]
        if strange[0] in _RELATIVE:
            refuse(f"{label} is a matrix or an increment", path, row, _ON_THE_PENDANT)
        refuse(f"{label}: {strange[0]} is no joint of a six-joint arm", path, row)
    cartesian = [axis for axis in (*PLACE, *TURN) if axis in group.fields]
    user, tool = group.frames.get("UF"), group.frames.get("UT")
    if not cartesian and group.config is None:
        values = [_number(label, joint, "deg", group, path) for joint in JOINTS]
        return RecordedPosition(
            number, name, line, shown_deg=np.array(values), user_frame=user, tool_frame=tool
        )
    mixed = next((joint for joint in JOINTS if joint in group.fields), None)
    if mixed is not None:
        row = group.fields[mixed][2]
        refuse(f"{label} has {mixed} beside X, Y, Z, W, P, R", path, row)
    place = [_number(label, axis, "mm", group, path) for axis in PLACE]
    turn = [_number(label, axis, "deg", group, path) for axis in TURN]
    T_user_tool = transform(rotation_from_wpr(np.deg2rad(turn)), np.array(place) / 1e3)
    return RecordedPosition(
        number,
        name,
        line,
        T_user_tool=T_user_tool,
        configuration=_configuration(label, group, path),
        user_frame=user,
        tool_frame=tool,
    )


def _configuration(label: str, group: StoredGroup, path: Path | str) -> FanucConfiguration | None:
    if group.config is None:
        return None
    if set(re.sub(r"[\s,]", "", group.config)) == {"*"}:
        refuse(f"{label} has no configuration (***)", path, group.line, "touch the position up")
    try:
        return FanucConfiguration.parse(group.config)
    except InputError as error:
        refuse(f"{label}: {error.message}", path, group.line, error.hint)


def _number(label: str, name: str, unit: str, group: StoredGroup, path: Path | str) -> float:
    if name not in group.fields:
        needed = "J1 to J6" if name in JOINTS else "X Y Z W P R"
        refuse(
            f"{label}: {name} is missing", path, group.line, f"a position of this kind has {needed}"
        )
    text, found, row = group.fields[name]
    if set(text) == {"*"}:
        refuse(f"{label}: {name} has no value (***)", path, row, "touch the position up")
    if found != unit:
        refuse(f"{label}: {name} is in {found or 'no unit'}, not in {unit}", path, row)
    if "e" in text.lower():
        refuse(f"{label}: {name} is {text[:30]!r}, not a number", path, row)
    read = joint_deg if unit == "deg" else millimetres
    return read(text, f"{label}: {name}", path, row)


def check_other_axes(groups: Mapping[str, Mapping[int, StoredGroup]], path: Path | str) -> None:
    """Refuse positions between which an extended axis or another motion group moves.

    A rail may be either, and a positioner carries the target. Axes without a value are passed over.
    """
    owned = {label: set(of[1].fields) & set(EXTENDED) for label, of in groups.items() if 1 in of}
    first = next(iter(owned), "")
    for label, axes in owned.items():
        other = sorted(axes ^ owned[first])
        if other:
            refuse(f"{label}: {other[0]} is not there as in {first}", path, groups[label][1].line)
    at_rest(
        (
            (label, axis if number == 1 else f"GP{number} {axis}", text, row)
            for label, of_position in groups.items()
            for number, group in of_position.items()
            for axis, (text, _, row) in group.fields.items()
            if (axis in EXTENDED or number != 1) and set(text) != {"*"}
        ),
        path,
    )
