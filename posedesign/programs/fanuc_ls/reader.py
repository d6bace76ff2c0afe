"""FANUC teach pendant programs in ASCII (``.LS``): the reader of what controllers export.

Only ``/POS`` is interpreted, so programs with any instructions, in any language of the controller,
can be read. Fields may stand in any order and on any lines. Of several motion groups the first,
GP1, is the arm; the others have to rest. Positions are joint values, or poses of the tool with
their CONFIG. What would be read wrong in silence is refused with its line: increments, positions
without a value, an extended axis that carries the arm from one position to another.
"""

from __future__ import annotations

import re
from pathlib import Path

from posedesign.programs.fanuc_ls.positions import PositionParser, StoredPosition
from posedesign.programs.fanuc_ls.stored import StoredGroup, check_other_axes, recorded
from posedesign.programs.reading import refuse, text_lines
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

_SECTION = re.compile(r"\s*/(PROG|ATTR|APPL|MN|POS|END)(?![A-Za-z_])\s*(\S*)")
_COMMENT = re.compile(r'COMMENT\s*=\s*"([^"]*)"')
_REMARK = re.compile(r"\s*\d+\s*:\s*!([^;]{0,99})")
_LISTING = "name a program saved in ASCII, .LS"
_TEXT = "save a binary .TP as .LS"


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
    lines = text_lines(data, path, _TEXT)
    name = section = comment = ""
    mark: PlanMark | None = None
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
        elif section == "ATTR" and not comment:
            found = _COMMENT.match(line)
            comment = found[1].strip() if found else ""
        elif section == "MN" and mark is None:
            remark = _REMARK.match(line)
            mark = PlanMark.found_in(remark[1]) if remark else None
        elif not section and line.strip():
            refuse("is no FANUC program: it does not start with /PROG", path, row, _LISTING)
    if not name:
        refuse("is no FANUC program: there is no name behind /PROG", path, 1, _LISTING)
    if section != "END":
        refuse("is cut off: there is no /END", path, len(lines), "copy the file again")
    if not parser.positions:
        refuse("holds no positions", path, hint="save the program that was touched up")
    positions = tuple(_position(position, path) for position in parser.positions)
    check_other_axes({f"P[{p.number}]": p.groups for p in parser.positions}, path)
    return RecordedProgram(name, comment, mark or PlanMark(), positions, "fanuc")


def _position(position: StoredPosition, path: Path | str) -> RecordedPosition:
    label = f"P[{position.number}]"
    group: StoredGroup | None = position.groups.get(1)
    if group is None:
        refuse(f"{label} has no motion group GP1", path, position.line)
    return recorded(label, position.number, position.name, position.line, group, path)
