"""Joint lists of RoboDK: the reader.

Takes what the writer, RoboDK's macros and spreadsheets save: commas, semicolons, tabs or spaces,
empty lines, comments in lines of their own, a last comma. Without a header all columns are joint
values; with one those that are called J1, J2 and so on. The text file beside the list says which
pose a row is; without it, rows are counted.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.robots import POSITIVE_AXES
from posedesign.programs.reading import joint_deg, read_program_bytes, refuse, text_lines
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

MOST_COLUMNS = 64
"""Most columns of a row: joints, and what RoboDK lists behind them."""

_JOINT = re.compile(r"(?:J|joint[ _]?)(\d{1,2})(?:\s*[\[(]?\s*(\w{1,10})\s*[\])]?)?", re.IGNORECASE)
_ROW = re.compile(r"row (\d{1,7}): (pose|via) (\d{1,7})(?:: (.*))?")
_LETTER = re.compile(r"[A-DF-Za-df-z_]|[eE](?![-+0-9])")
_COPY = "copy both files again, or remove the text file to count rows from 1"


def is_beside(data: bytes) -> bool:
    """Whether a file is the one that the writer puts beside a list."""
    return data.startswith(b"posedesign rows of")


def parse_robodk_csv(data: bytes, path: Path) -> RecordedProgram:
    """The rows of a list.

    Raises
    ------
    FileFormatError
        A row has not as many finite joint values within +-720 deg as the others, or the file beside
        the list is that of another one.
    """
    if is_beside(data):
        name = path.with_suffix(".csv").name
        refuse(f"holds no positions: they are in {name} beside it", path, hint=f"name {name}")
    words, poses, mark = _beside(path.with_suffix(".txt"))
    rows, columns, width = _rows(data, path)
    positions = []
    for count, (line, fields) in enumerate(rows, start=1):
        if len(fields) != width:
            refuse(f"row {count} has {len(fields)} values, others have {width}", path, line)
        taken = [fields[k] for k in columns]
        values = [joint_deg(t, f"row {count}: J{j}", path, line) for j, t in enumerate(taken, 1)]
        if words and count not in poses:
            refuse(f"row {count} is not named in {path.stem}.txt beside it", path, line, _COPY)
        _, number, name = poses.get(count, ("", count, ""))
        positions.append(RecordedPosition(number, name, line, np.array(values)))
    named = words.get("rows", "-1")
    if words and named != str(len(positions)):
        reason = f"has {len(positions)} rows, {path.stem}.txt beside it names {named[:9]}"
        refuse(reason, path, hint=_COPY)
    passed = [number for kind, number, _ in poses.values() if kind == "via"]
    if passed and mark.measured is None:
        mark = PlanMark(mark.fingerprint, min(passed) - 1)
    maker = words.get("controller") if words.get("controller") in POSITIVE_AXES else None
    name = words.get("program") or path.stem
    return RecordedProgram(name, words.get("title", ""), mark, tuple(positions), maker)


def _rows(data: bytes, path: Path) -> tuple[list[tuple[int, list[str]]], list[int], int]:
    """Line and fields of each row, columns of the joints, and fields that each row should have."""
    rows: list[tuple[int, list[str]]] = []
    columns: list[int] = []
    width = 0
    for line, content in enumerate(text_lines(data.removeprefix(b"\xef\xbb\xbf"), path), start=1):
        text = content.strip()
        if not text or text.startswith(("#", "%", "//")):
            continue
        fields = _fields(text, path, line)
        if width or not _LETTER.search(text):
            rows.append((line, fields))
        else:
            columns = _columns(fields, path, line)
        width = width or len(fields)
    if not rows:
        refuse("holds no rows of joint values", path, hint="is it the right file?")
    return rows, columns or [*range(width)], width


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


def _beside(path: Path) -> tuple[dict[str, str], dict[int, tuple[str, int, str]], PlanMark]:
    """What the text file beside a list says by its words, and of its rows; nothing of others."""
    words: dict[str, str] = {}
    poses: dict[int, tuple[str, int, str]] = {}
    numbers, mark = {0}, None
    data = read_program_bytes(path) if path.is_file() else b""
    text = data.decode("utf-8", "replace") if is_beside(data) else ""
    for line, content in enumerate(text.splitlines(), start=1):
        row = _ROW.fullmatch(content.strip())
        if row is None:
            key, _, rest = content.partition(": ")
            words[key] = rest.strip()
            mark = mark or PlanMark.found_in(content)
            continue
        count, number = int(row[1]), int(row[3])
        if count in poses or number in numbers:
            refuse(f"row {row[1]} or pose {number} is there twice", path, line)
        numbers.add(number)
        poses[count] = (row[2], number, (row[4] or "").strip())
    return words, poses, mark or PlanMark()
