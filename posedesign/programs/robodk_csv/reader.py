"""Joint lists of RoboDK: the reader.

Takes what the writer, RoboDK's macros and spreadsheets save: commas, semicolons, tabs or spaces,
empty lines, comments in lines of their own, a last comma. Without a header all columns are joint
values; with one they are those that are called J1, J2 and so on, and others (times, errors) are
left out. The text file beside the list says which pose a row is; without it, rows are counted.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.robots import POSITIVE_AXES
from posedesign.programs.reading import joint_deg, read_program_bytes, refuse, text_lines
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

MOST_COLUMNS = 64
"""Most columns of a row: joints, and what RoboDK lists behind them."""

_BEGINNING = "posedesign rows of"
_JOINT = re.compile(r"(?:J|joint[ _]?)(\d{1,2})(?:\s*[\[(]?\s*(\w{1,10})\s*[\])]?)?", re.IGNORECASE)
_ROW = re.compile(r"row (\d{1,7}): (pose|via) (\d{1,7})(?:: (.*))?")
_LETTER = re.compile(r"[A-DF-Za-df-z_]|[eE](?![-+0-9])")


@dataclass
class _Beside:
    """What the text file beside a list says.

    ``rows`` is None where there is no such file.
    """

    name: str = ""
    title: str = ""
    mark: PlanMark | None = None
    maker: str | None = None
    rows: int | None = None
    poses: dict[int, tuple[str, int, str]] = field(default_factory=dict)


def parse_robodk_csv(data: bytes, path: Path) -> RecordedProgram:
    """The rows of a list.

    Raises
    ------
    FileFormatError
        A row has not as many finite joint values within +-720 deg as the others, or the file beside
        the list is that of another one.
    """
    beside = _beside(path)
    rows, header = _rows(data, path)
    columns = _columns(header[1], path, header[0]) if header else None
    width = len(header[1]) if header else len(rows[0][1])
    positions = []
    for count, (line, fields) in enumerate(rows, start=1):
        if len(fields) != width:
            refuse(f"row {count} has {len(fields)} values, others have {width}", path, line)
        taken = fields if columns is None else [fields[k] for k in columns]
        values = [joint_deg(t, f"row {count}: J{j}", path, line) for j, t in enumerate(taken, 1)]
        number, name = _pose(beside, count, line, path)
        positions.append(RecordedPosition(number, name, line, np.array(values)))
    if beside.rows is not None and beside.rows != len(positions):
        refuse(
            f"has {len(positions)} rows, {path.stem}.txt beside it names {beside.rows}",
            path,
            hint="copy both files again, or remove the text file to count rows from 1",
        )
    mark = beside.mark or PlanMark()
    passed = [number for kind, number, _ in beside.poses.values() if kind == "via"]
    if passed and mark.measured is None:
        mark = PlanMark(mark.fingerprint, min(passed) - 1)
    return RecordedProgram(
        beside.name or path.stem, beside.title, mark, tuple(positions), beside.maker
    )


def _rows(
    data: bytes, path: Path
) -> tuple[list[tuple[int, list[str]]], tuple[int, list[str]] | None]:
    """Line and fields of each row, and of the header where there is one."""
    rows: list[tuple[int, list[str]]] = []
    header = None
    for line, content in enumerate(text_lines(data.removeprefix(b"\xef\xbb\xbf"), path), start=1):
        text = content.strip()
        if not text or text.startswith(("#", "%", "//")):
            continue
        fields = _fields(text, path, line)
        if _LETTER.search(text) and header is None and not rows:
            header = (line, fields)
        else:
            rows.append((line, fields))
    if not rows:
        refuse("holds no rows of joint values", path, hint="is it the right file?")
    return rows, header


def _fields(text: str, path: Path, line: int) -> list[str]:
    """Fields of a row, whatever stands between them; none behind a last separator."""
    found = [mark for mark in ",;\t" if mark in text]
    if len(found) > 1:
        reason = f"has both {found[0]!r} and {found[1]!r} between values"
        refuse(reason, path, line, "use commas between values, and points in them")
    fields = [part.strip(" \"'") for part in text.split(found[0])] if found else text.split()
    if found and not fields[-1]:
        fields.pop()
    if not 0 < len(fields) <= MOST_COLUMNS:
        refuse(f"has {len(fields)} values in a row", path, line, "is it the right file?")
    return fields


def _columns(names: list[str], path: Path, line: int) -> list[int]:
    """Columns of J1 to Jn by the names in a header."""
    found: dict[int, int] = {}
    for column, name in enumerate(names):
        joint = _JOINT.fullmatch(name)
        if joint is None:
            continue
        if joint[2] and joint[2].lower() not in ("deg", "degree", "degrees"):
            refuse(f"{name[:40]} is not in degrees", path, line, "save joint values in degrees")
        if int(joint[1]) in found:
            refuse(f"has the column J{joint[1]} twice", path, line)
        found[int(joint[1])] = column
    if sorted(found) != list(range(1, len(found) + 1)) or not found:
        refuse("has no columns J1, J2 and so on", path, line, "is it the right file?")
    return [found[j] for j in sorted(found)]


def _pose(beside: _Beside, row: int, line: int, path: Path) -> tuple[int, str]:
    if beside.rows is None:
        return row, ""
    if row not in beside.poses:
        reason = f"row {row} is not named in {path.stem}.txt beside it"
        refuse(reason, path, line, "copy both files again, or remove the text file")
    _, number, name = beside.poses[row]
    return number, name


def _beside(path: Path) -> _Beside:
    """What the text file beside a list says, where it is one of the writer."""
    companion = path.with_suffix(".txt")
    found = _Beside()
    if not companion.is_file():
        return found
    text = read_program_bytes(companion).decode("utf-8", "replace")
    if not text.startswith(_BEGINNING):
        return found
    found.rows = -1
    numbers: set[int] = set()
    for line, content in enumerate(text.splitlines(), start=1):
        row = _ROW.fullmatch(content.strip())
        key, _, rest = content.partition(": ")
        if row:
            number = int(row[3])
            if int(row[1]) in found.poses or number in numbers or number < 1:
                refuse(f"row {row[1]} or pose {number} is there twice", companion, line)
            numbers.add(number)
            found.poses[int(row[1])] = (row[2], number, (row[4] or "").strip())
        elif key == "program":
            found.name = rest.strip()
        elif key == "title":
            found.title = rest.strip()
        elif key == "controller":
            found.maker = rest.strip() if rest.strip() in POSITIVE_AXES else None
        elif key == "rows" and rest.strip().isdecimal() and len(rest.strip()) < 9:
            found.rows = int(rest)
        elif key != "remark":
            found.mark = found.mark or PlanMark.found_in(content)
    return found
