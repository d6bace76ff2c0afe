"""FANUC ``.LS`` and ``POSREG.VA``: positions of what controllers export.

Programs with any instructions, in any language of the controller, can be read: of them only the
mark of the plan is taken. Of several motion groups the first, GP1, is the arm: no posture is taken
from positions between which others move. What would be read wrong in silence is refused with its
line: increments, positions without a value. An extended axis that moves carries the arm, whose
description has to know it.

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
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any

from calib.errors import FileFormatError
from posedesign.programs import reading
from posedesign.programs.configurations import FanucConfiguration
from posedesign.programs.fanuc_ls.listing import (
    CHOSEN,
    LANGUAGE,
    Group,
    Listing,
    elements_of,
    places_of,
    read_listing,
)
from posedesign.programs.language import Line
from posedesign.programs.numbering import Numbering, Stored
from posedesign.programs.reading import (
    carried_off,
    configuration_in,
    joint_deg,
    no_positions,
    refuse,
    text_of,
)
from posedesign.programs.recorded import PlanMark, RecordedProgram

JOINTS = tuple(f"J{j}" for j in range(1, 7))
PLACE, TURN = ("X", "Y", "Z"), ("W", "P", "R")
EXTENDED = ("E1", "E2", "E3")
RELATIVE = {f"R{axis}" for axis in (*PLACE, *TURN)}

_ON_THE_PENDANT = "on the pendant choose POSITION, REPRE, Joint for it, and save the program again"
_GIVEN = re.compile(r"\s*P ?\[(?: ?(\d{1,9})(?=[^\w]))?[^=]*\] *(?:\.\w+ *)?=")
_INCREMENT = re.compile(r"\b(INC|INK)\b")
_NUMBERED = re.compile(r"PR?\[(\d+)\]")
_MARK = re.compile(r"[ \t]*\d{0,9}[ \t]*:[ \t]*!([^;]{0,99});?[ \t]*")
_PIECE = re.compile(r"\S(?:[^\n]++|\n(?![ \t]*\[))*+")
_HEADING = re.compile(r"\[\*(?:POSREG\*\][ \t]*(\$POSREG\b)|\w{1,12}\*\]).*\n?")
_LISTING = "name a program saved in ASCII, .LS"


@dataclass(eq=False)
class _Stored(Stored):
    """A position by its first motion group: six joint values, or a pose with a configuration."""

    group: Group

    @cached_property
    def cartesian(self) -> bool:
        return self.group.config is not None or bool({*PLACE, *TURN} & self.group.fields.keys())

    @property
    def is_taught(self) -> bool:
        """Whether it has any value of its own."""
        return any(self.group.has_value(name) for name in (*JOINTS, *PLACE, *TURN))

    @cached_property
    def external(self) -> list[tuple[str, str, str, int]]:
        valued = takewhile(self.group.has_value, EXTENDED)
        return [
            (self.label, axis, self.group.fields[axis][0], self.group.row_of(axis))
            for axis in valued
        ]

    def numbers(self, path: Path | str) -> list[float]:
        group, label = self.group, self.label
        own = (*PLACE, *TURN) if self.cartesian else JOINTS
        strange = group.fields.keys() - {*own, *EXTENDED}
        for name in sorted(strange) if strange else ():
            row = group.row_of(name)
            if name in RELATIVE:
                refuse(f"{label} is seen from a remote TCP: {name}", path, row, _ON_THE_PENDANT)
            if name in JOINTS:
                refuse(f"{label} has {name} beside X, Y, Z, W, P, R", path, row)
            refuse(f"{label}: {name} is no joint of a six-joint arm", path, row)
        if sum(map(group.has_value, EXTENDED)) > len(self.external):
            refuse(f"{label} has a value for some extended axes only", path, group.row)
        values = []
        for name in own:
            unit, read = ("mm", reading.millimetres) if name in PLACE else ("deg", joint_deg)
            text, found = group.fields.get(name, ("", ""))
            if found == unit:
                with suppress(FileFormatError):  # said below, with its own line
                    values.append(read(text, f"{label}: {name}", path, group.row))
                    continue
            row = group.row_of(name)
            if not text:
                hint = f"a position of this kind has {' '.join(own)}"
                refuse(f"{label}: {name} is missing", path, group.row, hint)
            if text.startswith("*"):
                refuse(f"{label}: {name} has no value (***)", path, row, "touch the position up")
            if found != unit:
                refuse(f"{label}: {name} is in {found or 'no unit'}, not in {unit}", path, row)
            read(text, f"{label}: {name}", path, row)
        return values

    def details(self, path: Path | str) -> dict[str, Any]:
        group, config = self.group, self.group.config
        if config and set(re.sub(r"[\s,]", "", config)) == {"*"}:
            reason = f"{self.label} has no configuration (***)"
            refuse(reason, path, group.row, "touch the position up")
        return {
            "configuration": None
            if not config
            else configuration_in(FanucConfiguration, config, self.label, path, group.row),
            "user_frame": group.frames.get("UF"),
            "tool_frame": group.frames.get("UT"),
            "external_units": tuple(group.fields[axis][1] for _, axis, _, _ in self.external),
        }


def _program(
    named: tuple[str, str],
    mark: PlanMark | None,
    stored: dict[str, _Stored],
    path: Path | str,
    unread: Sequence[FileFormatError] = (),
) -> RecordedProgram:
    """The program of a name and a comment with its positions, by their labels.

    Raises FileFormatError: a position is none, or an extended axis is not there in all of them.
    """
    axes = {label: p.group.fields.keys() & EXTENDED for label, p in stored.items()}
    taught = {label: p for label, p in stored.items() if p.is_taught}
    first = next(iter(taught), "")
    for label, p in taught.items():
        for axis in sorted(axes[label] ^ axes[first]):
            refuse(f"{label}: {axis} is not there as in {first}", path, p.group.row)
    names = {int(label[label.index("[") + 1 : -1]): p.name for label, p in stored.items()}
    numbering = Numbering(_NUMBERED, mark=mark, names=names)
    given = [*stored.values()]
    return numbering.program((*named, "fanuc"), given, reading.poses_of, path, unread)


def parse_fanuc_ls(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages."""
    text = text_of(data, path, "save a binary .TP as .LS")
    listing = read_listing(text)
    name = _name(listing, path)
    for row, fault in listing.faults:
        refuse(fault, path, row)
    if not listing.positions:
        no_positions(path, "save the program that was touched up")
    stored: dict[str, _Stored] = {}
    for p in listing.positions:
        if p.label in stored:
            refuse(f"{p.label} is there twice", path, p.row, "remove one of them")
        if 1 not in p.groups:
            refuse(f"{p.label} has no motion group GP1", path, p.row)
        stored[p.label] = _Stored(p.label, p.row, p.groups[1], name=p.name)
    others = (
        (p.label, f"GP{number} {axis}", text, group.row_of(axis))
        for p in listing.positions
        for number, group in p.groups.items()
        for axis, (text, _) in group.fields.items()
        if number != 1 and group.has_value(axis)
    )
    # a rail may be another motion group, and a positioner carries the target: no axes of the arm's
    moved = carried_off(others, path)
    lost: dict[str, tuple[str, int]] = {}
    for line in listing.instructions if _INCREMENT.search(text) else ():
        for label in places_of(line.statement) if _INCREMENT.search(line.code) else ():
            if label in stored and line.kind == "motion":
                lost[label] = f"moves by an increment (INC): {label} is no position", line.row
    if "=" in text[text.find("/MN") :]:
        lost |= _changed(listing)
    unread = [
        FileFormatError(reason, path=path, row=row, hint="store the position itself")
        for label, (reason, row) in lost.items()
        if stored.pop(label, None)
    ]
    for error in unread if not stored else ():
        raise error
    named = ("COMMENT", "KOMMENTAR")
    comment = next((text for _, key, text in listing.attributes if key in named), '""')
    marked = (_MARK.fullmatch(line.text) for line in listing.lines)
    marks = (PlanMark.found_in(found[1]) for found in marked if found)
    mark = next((mark for mark in marks if mark), None)
    read = _program((name, comment.split('"')[1].strip()), mark, stored, path, unread)
    strange = {
        n: {len(EXTENDED) + k: e for k, e in moved.get(f"P[{n}]", {}).items()}
        for n in (p.number for p in read.positions)
    }
    if not any(strange.values()):
        return read
    positions = (replace(p, carried={**p.carried, **strange[p.number]}) for p in read.positions)
    return replace(read, positions=tuple(positions))


def _changed(listing: Listing) -> dict[str, tuple[str, int]]:
    """Positions that an instruction gives other values, and a motion goes to: why not read."""
    given = [_GIVEN.match(line.code) for line in listing.instructions]
    if not any(given):
        return {}
    found: dict[str, tuple[str, int]] = {}
    whole = any(own and not own[1] for own in given)  # a register chooses which
    names = {f"P[{int(own[1])}]" for own in given if own and own[1]}
    for line in listing.instructions:
        for label in places_of(line.statement) if line.kind == "motion" else ():
            if label != CHOSEN and (whole or label in names):
                found.setdefault(label, (f"{label} is changed by the program", line.row))
    return found


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


def parse_registers(data: bytes, path: Path | str) -> RecordedProgram:
    """Positions of all registers that have one, by their numbers."""
    text = text_of(data, path)
    inside = found = False
    there: set[str] = set()
    stored: dict[str, _Stored] = {}
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
        if label in there:
            refuse(f"{label} is there twice", path, row, "remove one of them")
        there.add(label)
        if tree is not None:
            group = Group.of(row, body, next(elements_of(statement))[1])
            if group.twice:
                refuse(f"{label} has {group.twice} twice", path, group.row_of(group.twice))
            name = statement.word("TEXT").strip("'").strip()
            stored[label] = _Stored(label, row, group, name=name)
    if not found:
        refuse("is no backup of position registers: there is no $POSREG", path, 1, "POSREG.VA")
    if not stored:
        no_positions(path, "save the backup again", "holds no positions: all registers are empty")
    return replace(_program(("POSREG", ""), None, stored, path), in_registers=True)
