"""Lists of joint values that macros of RoboDK move a robot along (CSV).

RoboDK's own macros (MonitorJoints.py writes such files, JointsPlayback.py and ProgramSplitJoints.py
of RoboDK/RoboDK-API read them) take J1 to Jn in degrees in the first columns, one row a stop, with
commas and without a header: to LoadList of ``robodk.robofileio`` a comment or a header is a row of
texts that no robot can be moved to. So title, mark of the plan and names stand in a text file
beside the CSV. RoboDK's documentation of its own import dialogs was not at hand.

The reader takes what the writer, RoboDK's macros and spreadsheets save: commas, semicolons, tabs or
spaces, empty lines, comments in lines of their own, a last comma. Without a header all columns are
joint values; with one those that are called J1, J2 and so on. The text file beside the list says
which pose a row is; without it, rows are counted.

Each rule is what ``LoadList`` and ``setJoints`` need: every row becomes a list of numbers, which
the robot is moved to.

===========  =======================================================================================
``ascii``    plain ASCII characters
``rows``     at least one row
``blank``    no empty lines: each would be a row without joint values
``text``     no header and no comments: each would be a row of texts
``columns``  as many values in each row
``number``   plain decimal numbers between commas: no exponent, NaN, ``-0.000`` or empty field
``range``    joint values within +-720 deg
``beside``   the text file with the names of the rows fits the list beside it
===========  =======================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.robots import POSITIVE_AXES
from posedesign.programs import reading, writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.reading import (
    MOST_JOINT_DEG,
    joint_deg,
    no_positions,
    read_program_bytes,
    refuse,
)
from posedesign.programs.recorded import PlanMark, Problem, RecordedPosition, RecordedProgram
from posedesign.programs.rules import MOST_PROBLEMS
from posedesign.programs.writing import LIST_LENGTH, NameRule, comment_text, plain_all, shown_deg

__all__ = ["RobodkCsv"]

DECIMALS = 6  # of degrees, as RoboDK saves them: joint values are rounded by at most 5e-7 deg
MOST_COLUMNS = 64  # most columns of a row: joints, and what RoboDK lists behind them
_JOINT = re.compile(r"(?:J|joint[ _]?)(\d{1,2})(?:\s*[\[(]?\s*(\w{1,10})\s*[\])]?)?", re.IGNORECASE)
_ROW = re.compile(r"row (\d{1,7}): (pose|via) (\d{1,7})(?:: (.*))?")
_LETTER = re.compile(r"[A-DF-Za-df-z_]|[eE](?![-+0-9])")
_COPY = "copy both files again, or remove the text file to count rows from 1"

_PLAIN = re.compile(r"-?[0-9]{1,9}(?:\.[0-9]{1,20})?")
_MINUS_ZERO = re.compile(r"-0+(?:\.0*)?")
_WORDS = re.compile(r"[#%\"|]|//|[A-Za-z_]{2}|[jJ][0-9]")
_NAN = re.compile(r"[+-]*(?:nan|inf|infinity)", re.IGNORECASE)


def render_robodk_csv(program: PoseProgram, arm: Arm) -> dict[str, str]:
    """Text of the list, and of the file with the names of its rows.

    Poses that are only passed through are rows as well. The format has no speed, no time to settle
    and no call: the macro that moves the robot sets them.
    """
    name, title = program.name, program.options.comment
    rows = [",".join(plain_all(row, DECIMALS)) for row in shown_deg(arm, program.poses)]
    beside = [f"posedesign rows of {name}.csv", f"program: {name}"]
    beside += [f"title: {comment_text('comment', title)}"] if title else []
    beside += [program.mark] if program.mark else []
    beside += [f"note: {line}" for line in writing.warning_lines(program, LIST_LENGTH)]
    beside += [f"controller: {arm.maker or 'as described'}", f"rows: {len(rows)}"]
    stops = zip(program.numbers, program.poses, strict=True)
    for row, (number, pose) in enumerate(stops, start=1):
        if pose.comment:
            remark = comment_text(f"comment of pose {pose.name!r}", pose.comment)
            beside.append(f"remark: {remark}")
        said = comment_text("name of a pose", pose.name)
        words = f"row {row}: {'via' if pose.via else 'pose'} {number}"
        beside.append(f"{words}: {said}" if said else words)
    return {f"{name}.csv": "\n".join([*rows, ""]), f"{name}.txt": "\n".join([*beside, ""])}


def _is_beside(data: bytes) -> bool:
    """Whether a file is the one that the writer puts beside a list."""
    return data.startswith(b"posedesign rows of")


def parse_robodk_csv(data: bytes, path: Path) -> RecordedProgram:
    """The rows of a list, with what the file beside it says of them."""
    if _is_beside(data):
        name = path.with_suffix(".csv").name
        reason = f"holds no positions: they are in {name} beside it"
        no_positions(path, f"name {name}", reason)
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
    for line, content in enumerate(reading.text_lines(data, path), start=1):
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
    found: dict[int, int] = {}
    for column, joint in enumerate(map(_JOINT.fullmatch, names)):
        if joint is None:
            continue
        if joint[2] and joint[2].lower() not in ("deg", "degree", "degrees"):
            reason = f"{names[column][:40]} is not in degrees"
            refuse(reason, path, line, "save joint values in degrees")
        if found.setdefault(int(joint[1]), column) != column:
            refuse(f"has the column J{joint[1]} twice", path, line)
    if sorted(found) != list(range(1, len(found) + 1)) or not found:
        refuse("has no columns J1, J2 and so on", path, line, "is it the right file?")
    return [found[j] for j in sorted(found)]


def _beside(path: Path) -> tuple[dict[str, str], dict[int, tuple[str, int, str]], PlanMark]:
    """What the text file beside a list says by its words, and of its rows; nothing of others."""
    words: dict[str, str] = {}
    poses: dict[int, tuple[str, int, str]] = {}
    numbers, mark = {0}, None
    data = read_program_bytes(path) if path.is_file() else b""
    text = data.decode("utf-8", "replace") if _is_beside(data) else ""
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


_LINE = re.compile(r"^[^\n]*$", re.MULTILINE)


def check_robodk_csv(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a list, or of the text file beside one; none for a good one."""
    if not _is_beside(data):
        return list(islice(_problems(data.decode("latin-1")), MOST_PROBLEMS))
    try:
        listed = path.with_suffix(".csv")
        parse_robodk_csv(read_program_bytes(listed), listed)
    except FileFormatError as error:
        return [Problem(1, "beside", error.message)]
    return []


def _problems(text: str) -> Iterator[Problem]:
    text, width = text.replace("\r\n", "\n").removesuffix("\n"), None
    if not text.strip("\n"):
        yield Problem(1, "rows", "there are no rows")
        return
    # one line after the other: a file may be nothing but line ends
    for row, found in enumerate(_LINE.finditer(text), start=1):
        line = found[0]
        bad = re.search(r"[^ -~]", line)
        fields = [field.strip() for field in line.split(",")]
        if bad:
            yield Problem(row, "ascii", f"the byte 0x{ord(bad[0]):02x} is not plain ASCII text")
        elif not line.strip():
            yield Problem(row, "blank", "the line is empty")
        elif _WORDS.search(line) and not any(map(_NAN.fullmatch, fields)):
            yield Problem(row, "text", "the line holds a text")
        else:
            width = width or len(fields)
            if len(fields) != width:
                yield Problem(row, "columns", f"{len(fields)} values, the first row has {width}")
            yield from _numbers(row, fields)


def _numbers(row: int, fields: list[str]) -> Iterator[Problem]:
    for column, field in enumerate(fields, start=1):
        if not _PLAIN.fullmatch(field) or _MINUS_ZERO.fullmatch(field):
            yield Problem(row, "number", f"value {column} is {field[:30]!a}, not a plain number")
        elif abs(float(field)) > MOST_JOINT_DEG:
            yield Problem(row, "range", f"value {column} is {field} deg, beyond +-720")


class RobodkCsv(Dialect):
    """Joint values of each stop in a row, as RoboDK shows them."""

    name = "robodk-csv"
    title = "joint list of RoboDK in CSV"
    maker = None
    suffixes = (".csv",)
    companions = (".txt",)
    forms = ("joint",)
    keeps = switches = controlled = False
    names = NameRule("a name for a list", 64, small=True)
    encoding = "utf-8"
    writer = render_robodk_csv
    reader = parse_robodk_csv
    rules = check_robodk_csv

    def is_companion(self, data: bytes) -> bool:
        return _is_beside(data)

    def seen(self, arm: Arm) -> Arm:
        """The arm as its pendant shows it: RoboDK's post-processors hand its joints on unchanged.

        Source: ros-industrial-attic/robodk_postprocessors; Fanuc_R30iA.py writes them as J1 to J6.
        """
        return arm
