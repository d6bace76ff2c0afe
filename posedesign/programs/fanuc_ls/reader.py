"""FANUC ``.LS`` and ``POSREG.VA``: positions of what controllers export.

Programs with any instructions, in any language of the controller, can be read: of them only the
mark of the plan is taken. Of several motion groups the first, GP1, is the arm; the others have to
rest. What would be read wrong in silence is refused with its line: increments, positions without a
value. An extended axis that moves carries the arm, whose description has to know it.

A backup of position registers is for programs that keep the touched-up positions in them: PR[n]
becomes position n. Registers without a position are passed over, and so is what belongs to other
motion groups than the first. The layout is that of public backups::

    [*POSREG*]$POSREG  Storage: SHADOW  Access: RW  : ARRAY[1,100] OF Position Reg
        [1,1] =   'HOME'   Group: 1
      J1 =    60.000 deg   J2 =   -50.000 deg   J3 =    10.000 deg
      J4 =   -10.000 deg   J5 =   -95.000 deg   J6 =   -50.000 deg

        [1,2] =   '' Uninitialized
        [1,3] =   ''
      Group: 1   Config: N U T, 0, 0, 0
      X:  -820.507   Y:  2309.503   Z:   945.836
      W:    90.594   P:    -1.149   R:  -160.248
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from posedesign.programs.configurations import FanucConfiguration
from posedesign.programs.fanuc_ls.listing import LANGUAGE, Group, Listing, read_listing
from posedesign.programs.language import Line
from posedesign.programs.reading import (
    at_rest,
    carried_off,
    configuration_in,
    joint_deg,
    millimetres,
    poses_of,
    refuse,
    text_of,
)
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

JOINTS = tuple(f"J{j}" for j in range(1, 7))
PLACE, TURN = ("X", "Y", "Z"), ("W", "P", "R")
EXTENDED = ("E1", "E2", "E3")
RELATIVE = {f"R{axis}" for axis in (*PLACE, *TURN)}

_ON_THE_PENDANT = "on the pendant choose POSITION, REPRE, Joint for it, and save the program again"
_MARK = re.compile(r"[ \t]*\d{0,9}[ \t]*:[ \t]*!([^;]{0,99});?[ \t]*")
_PIECE = re.compile(r"\S(?:[^\n]++|\n(?![ \t]*\[))*+")
_HEADING = re.compile(r"\[\*(?:POSREG\*\][ \t]*(\$POSREG\b)|\w{1,12}\*\]).*\n?")
_LISTING = "name a program saved in ASCII, .LS"


def parse_fanuc_ls(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages.

    Returns
    -------
    RecordedProgram
        Its positions in the order of the file.

    Raises
    ------
    FileFormatError
        The file is not a FANUC program in ASCII, is cut off, or holds a position that is neither
        six joint angles nor a pose.
    """
    listing = read_listing(text_of(data, path, "save a binary .TP as .LS"))
    name = _name(listing, path)
    for row, fault in listing.faults:
        refuse(fault, path, row)
    if not listing.positions:
        refuse("holds no positions", path, hint="save the program that was touched up")
    positions = []
    seen: set[int] = set()
    for position in listing.positions:
        if position.number in seen:
            refuse(f"{position.label} is there twice", path, position.row, "remove one of them")
        seen.add(position.number)
        group = position.groups.get(1)
        if group is None:
            refuse(f"{position.label} has no motion group GP1", path, position.row)
        where = (position.label, position.number, position.name, position.row)
        positions.append(_recorded(*where, group, path))
    groups = {position.label: position.groups for position in listing.positions}
    stored = _with_other_axes(positions, groups, path)
    named = ("COMMENT", "KOMMENTAR")
    comment = next((text for _, key, text in listing.attributes if key in named), '""')
    marked = (_MARK.fullmatch(line.text) for line in listing.lines)
    marks = (PlanMark.found_in(found[1]) for found in marked if found)
    mark = next((mark for mark in marks if mark), PlanMark())
    return RecordedProgram(name, comment.split('"')[1].strip(), mark, stored, "fanuc")


def _name(listing: Listing, path: Path | str) -> str:
    """The name behind /PROG; refuses what is no whole program."""
    first = listing.headings[0][0] if listing.headings else listing.rows + 1
    if listing.stray and listing.stray[0][0] < first:
        reason = "is no FANUC program: it does not start with /PROG"
        refuse(reason, path, listing.stray[0][0], _LISTING)
    names = [rest.split()[0] for _, section, rest in listing.headings if section == "PROG" and rest]
    if not names:
        refuse("is no FANUC program: there is no name behind /PROG", path, 1, _LISTING)
    if listing.headings[-1][1] != "END":
        refuse("is cut off: there is no /END", path, listing.rows, "copy the file again")
    return names[0]


def _recorded(
    label: str, number: int, name: str, row: int, group: Group, path: Path | str
) -> RecordedPosition:
    """A position from its first group: six joint values, or a pose with its configuration.

    Raises FileFormatError: a value is missing, is none, or is in another unit.
    """
    known = {*JOINTS, *EXTENDED, *PLACE, *TURN}
    strange = sorted(set(group.fields) - known)
    if strange:
        at = group.row_of(strange[0])
        if strange[0] in RELATIVE:
            refuse(f"{label} is a matrix or an increment", path, at, _ON_THE_PENDANT)
        refuse(f"{label}: {strange[0]} is no joint of a six-joint arm", path, at)
    cartesian = [axis for axis in (*PLACE, *TURN) if axis in group.fields]
    user, tool = group.frames.get("UF"), group.frames.get("UT")
    if not cartesian and group.config is None:
        values = np.array([_number(label, joint, "deg", group, path) for joint in JOINTS])
        return RecordedPosition(number, name, row, values, None, None, user, tool)
    mixed = next((joint for joint in JOINTS if joint in group.fields), None)
    if mixed is not None:
        refuse(f"{label} has {mixed} beside X, Y, Z, W, P, R", path, group.row_of(mixed))
    place = [_number(label, axis, "mm", group, path) for axis in PLACE]
    turn = [_number(label, axis, "deg", group, path) for axis in TURN]
    configuration = None
    if group.config is not None:
        if set(re.sub(r"[\s,]", "", group.config)) == {"*"}:
            refuse(f"{label} has no configuration (***)", path, group.row, "touch the position up")
        configuration = configuration_in(FanucConfiguration, group.config, label, path, group.row)
    T_user_tool = poses_of([*place, *turn])[0]
    return RecordedPosition(number, name, row, None, T_user_tool, configuration, user, tool)


def _number(label: str, name: str, unit: str, group: Group, path: Path | str) -> float:
    if name not in group.fields:
        needed = "J1 to J6" if name in JOINTS else "X Y Z W P R"
        hint = f"a position of this kind has {needed}"
        refuse(f"{label}: {name} is missing", path, group.row, hint)
    text, found = group.fields[name]
    row = group.row_of(name)
    if text.startswith("*"):
        refuse(f"{label}: {name} has no value (***)", path, row, "touch the position up")
    if found != unit:
        refuse(f"{label}: {name} is in {found or 'no unit'}, not in {unit}", path, row)
    read = joint_deg if unit == "deg" else millimetres
    return read(text, f"{label}: {name}", path, row)


def _with_other_axes(
    positions: list[RecordedPosition],
    groups: Mapping[str, Mapping[int, Group]],
    path: Path | str,
) -> tuple[RecordedPosition, ...]:
    """Positions with the extended axes of their first group; of ``groups``, in their order.

    A rail may be such an axis or another motion group, and a positioner carries the target. Axes
    without a value are passed over.

    Raises FileFormatError: another group moves, or an extended axis is not there in all positions.
    """
    owned = {label: set(of[1].fields) & set(EXTENDED) for label, of in groups.items() if 1 in of}
    first = next(iter(owned), "")
    for label, axes in owned.items():
        other = sorted(axes ^ owned[first])
        if other:
            refuse(f"{label}: {other[0]} is not there as in {first}", path, groups[label][1].row)
    values = [
        (number, (label, axis if number == 1 else f"GP{number} {axis}", text, group.row_of(axis)))
        for label, of_position in groups.items()
        for number, group in of_position.items()
        for axis, (text, _) in group.fields.items()
        if (axis in EXTENDED or number != 1) and not text.startswith("*")
    ]
    at_rest((value for number, value in values if number != 1), path)
    carried = carried_off((value for number, value in values if number == 1), path)
    found = []
    for position, (label, of_position) in zip(positions, groups.items(), strict=True):
        extended, units = _extended(of_position[1])
        own = replace(position, external_shown=extended, external_units=units)
        found.append(replace(own, carried=carried.get(label, {})))
    return tuple(found)


def _extended(group: Group) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Values and units of the extended axes, up to the first that has none."""
    values, units = [], []
    for axis in EXTENDED:
        text, unit = group.fields.get(axis, ("*", ""))
        if text.startswith("*"):
            break
        values.append(float(text))
        units.append(unit)
    return tuple(values), tuple(units)


def parse_registers(data: bytes, path: Path | str) -> RecordedProgram:
    """Positions of all registers that have one, by their numbers.

    Raises FileFormatError: the file is no such backup, holds no positions, or one that is damaged.
    """
    text = text_of(data, path)
    inside = found = False
    positions: list[RecordedPosition] = []
    groups: dict[str, Group | None] = {}
    row, last = 1, 0
    for piece in _PIECE.finditer(text):
        row += text.count("\n", last, piece.start())
        last = piece.start()
        heading, body = _HEADING.match(piece[0]), piece[0]
        if heading:
            inside = heading[1] is not None
            found = found or inside
            row += heading[0].count("\n")
            last, body = last + heading.end(), body[heading.end() :]
        if not inside or not body.strip():
            continue
        statement = LANGUAGE.statement(Line(row, body), "register")
        if statement.fault:
            reason = f"cannot make sense of {body.strip()[:30]!r}: {statement.fault}"
            refuse(reason, path, statement.row)
        arm, number = (int(found) if len(found) <= 5 else 0 for found in statement.words("INT")[:2])
        label, tree = f"PR[{number}]", statement.one("registered")
        if not arm or not number:
            refuse(f"there is no register {body.strip()[:20]!r}", path, row)
        if arm != 1:
            continue
        if label in groups:
            refuse(f"{label} is there twice", path, row, "remove one of them")
        groups[label] = group = Group.of(row, body, tree) if tree else None
        if group is not None:
            if group.twice:
                refuse(f"{label} has {group.twice} twice", path, group.row_of(group.twice))
            name = statement.word("TEXT").strip("'").strip()
            positions.append(_recorded(label, number, name, row, group, path))
    if not found:
        refuse("is no backup of position registers: there is no $POSREG", path, 1, "POSREG.VA")
    if not positions:
        refuse("holds no positions: all registers are empty", path, hint="save the backup again")
    own = {label: {1: group} for label, group in groups.items() if group}
    stored = _with_other_axes(positions, own, path)
    return RecordedProgram("POSREG", "", PlanMark(), stored, "fanuc", in_registers=True)
