"""FANUC teach pendant programs in ASCII (``.LS``): the reader of what controllers export.

Only ``/POS`` is interpreted, so programs with any instructions, in any language of the controller,
can be read. Fields may stand in any order and on any lines. Of several motion groups the first,
GP1, is the arm. What would be read wrong in silence is refused with its line: Cartesian positions,
positions without a value, an extended axis that carries the arm from one position to another.
"""

from __future__ import annotations

import re
from pathlib import Path

from posedesign.files import read_bytes_bounded
from posedesign.programs.controller_view import FANUC_JOINTS, urdf_from_pendant
from posedesign.programs.fanuc_ls_positions import (
    PositionParser,
    StoredGroup,
    StoredPosition,
    refuse,
)
from posedesign.programs.recorded import RecordedPosition, RecordedProgram

MOST_BYTES = 20_000_000
"""Largest file read: the largest program a controller holds is far smaller."""

MOST_JOINT_DEG = 720.0
"""No arm turns so far: a value beyond is a damaged file."""

_JOINTS = tuple(f"J{j}" for j in range(1, FANUC_JOINTS + 1))
_EXTENDED = ("E1", "E2", "E3")
_CARTESIAN = {"X", "Y", "Z", "W", "P", "R", "RX", "RY", "RZ", "RW", "RP", "RR"}

_SECTION = re.compile(r"\s*/(PROG|ATTR|APPL|MN|POS|END)(?![A-Za-z_])\s*(\S*)")
_HEADERS = {
    "ATTR": re.compile(r'COMMENT\s*=\s*"([^"]*)"'),
    "MN": re.compile(r"\s*\d+\s*:\s*!PLAN\s+([0-9A-Fa-f]{4,16})\s*;"),
}
_LISTING = "name a program saved in ASCII, .LS"
_NOT_TEXT = re.compile(rb"[^\t\r\n -~]")
_NUMBER = re.compile(r"[-+]?(?:\d{1,9}(?:\.\d{0,20})?|\.\d{1,20})")


def read_fanuc_ls(path: Path | str) -> RecordedProgram:
    """Read the joint positions of a FANUC program.

    Parameters
    ----------
    path : Path or str
        The ``.LS`` file, at most 20 MB.

    Returns
    -------
    RecordedProgram
        Its positions in the order of the file, in URDF signs [rad].

    Raises
    ------
    FileFormatError
        The file is not a FANUC program in ASCII, is cut off, or holds a position that is not six
        finite joint angles.
    """
    return parse_fanuc_ls(read_bytes_bounded(path, most_bytes=MOST_BYTES), path)


def parse_fanuc_ls(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages. See `read_fanuc_ls`."""
    lines = _text_lines(data, path)
    name = section = ""
    headers = dict.fromkeys(_HEADERS, "")
    parser = PositionParser(path)
    for row, line in enumerate(lines, start=1):
        heading = _SECTION.match(line)
        if heading:
            if section == "POS":
                parser.finish(row)
            section = heading[1]
            name = name or (heading[2] if section == "PROG" else "")
            if section == "END":
                break
        elif section == "POS":
            parser.feed(line, row)
        elif section in headers and not headers[section]:
            found = _HEADERS[section].match(line)
            headers[section] = found[1].strip() if found else ""
        elif not section and line.strip():
            refuse("is no FANUC program: it does not start with /PROG", path, row, _LISTING)
    if not name:
        refuse("is no FANUC program: there is no name behind /PROG", path, 1, _LISTING)
    if section != "END":
        refuse("is cut off: there is no /END", path, len(lines), "copy the file again")
    positions = tuple(_recorded(position, path) for position in parser.positions)
    if not positions:
        refuse("holds no positions", path, hint="save the program that was touched up")
    _check_extended_axes(parser.positions, path)
    return RecordedProgram(name, headers["ATTR"], headers["MN"], positions)


def _text_lines(data: bytes, path: Path | str) -> list[str]:
    """Lines of the file, after checking that it is plain ASCII text."""
    bad = _NOT_TEXT.search(data)
    if bad:
        refuse(
            f"holds the byte 0x{bad[0][0]:02x}, which is not plain ASCII text",
            path,
            data.count(b"\n", 0, bad.start()) + 1,
            "save a binary .TP as .LS; remove accented letters from comments",
        )
    return data.decode("ascii").split("\n")


def _recorded(position: StoredPosition, path: Path | str) -> RecordedPosition:
    """Joint position in URDF signs, from the first group of the position."""
    label = f"P[{position.number}]"
    group = position.groups.get(1)
    if group is None:
        refuse(f"{label} has no motion group GP1", path, position.line)
    cartesian = [row for name, (_, _, row) in group.fields.items() if name in _CARTESIAN]
    if cartesian or group.config_line is not None:
        refuse(
            f"{label} is Cartesian (X, Y, Z, W, P, R): only joint positions can be read",
            path,
            group.config_line or cartesian[0],
            "on the pendant choose POSITION, REPRE, Joint for it, and save the program again",
        )
    unknown = sorted(set(group.fields) - set(_JOINTS) - set(_EXTENDED))
    if unknown:
        row = group.fields[unknown[0]][2]
        refuse(f"{label}: {unknown[0]} is no joint of a six-joint arm", path, row)
    values = [_joint_deg(label, joint, group, path) for joint in _JOINTS]
    return RecordedPosition(
        position.number,
        position.name,
        urdf_from_pendant(values),
        group.frames.get("UF"),
        group.frames.get("UT"),
        position.line,
    )


def _joint_deg(label: str, joint: str, group: StoredGroup, path: Path | str) -> float:
    if joint not in group.fields:
        refuse(f"{label}: {joint} is missing", path, group.line, "a joint position has J1 to J6")
    text, unit, row = group.fields[joint]
    if set(text) == {"*"}:
        refuse(f"{label}: {joint} has no value (***)", path, row, "touch the position up")
    if not _NUMBER.fullmatch(text):
        refuse(f"{label}: {joint} is {text[:30]!r}, not a number", path, row)
    if unit != "deg":
        refuse(f"{label}: {joint} is in {unit or 'no unit'}, not in deg", path, row)
    if abs(float(text)) > MOST_JOINT_DEG:
        reason = f"{label}: {joint} is {text} deg, beyond +-{MOST_JOINT_DEG:g} deg"
        refuse(reason, path, row, "no arm turns so far")
    return float(text)


def _check_extended_axes(positions: list[StoredPosition], path: Path | str) -> None:
    """Refuse positions between which an extended axis moves: it would carry the arm's base."""
    first = positions[0].groups[1].fields
    for position in positions:
        fields = position.groups[1].fields
        for axis in _EXTENDED:
            if fields.get(axis, ("",))[0] != first.get(axis, ("",))[0]:
                row = position.groups[1].line
                reason = f"P[{position.number}]: {axis} differs from P[{positions[0].number}]"
                refuse(reason, path, row, "measure with the extended axes at rest")
