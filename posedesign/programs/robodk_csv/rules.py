"""Joint lists of RoboDK: the strict validator.

Each rule is what ``LoadList`` of ``robodk.robofileio`` and ``setJoints`` need: every row becomes a
list of numbers, which the robot is moved to.

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

from calib.errors import FileFormatError
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import Problem
from posedesign.programs.robodk_csv.reader import is_beside, parse_robodk_csv

MOST_PROBLEMS = 1000
"""Most problems told by one check."""

_PLAIN = re.compile(rb"-?[0-9]{1,9}(?:\.[0-9]{1,20})?")
_MINUS_ZERO = re.compile(rb"-0+(?:\.0*)?")
_WORDS = re.compile(rb"[#%\"|]|//|[A-Za-z_]{2}|[jJ][0-9]")
_NAN = re.compile(rb"nan|inf|infinity", re.IGNORECASE)


def check_robodk_csv(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a list, or of the text file beside one; none for a good one."""
    if not is_beside(data):
        return list(islice(_problems(data), MOST_PROBLEMS))
    try:
        listed = path.with_suffix(".csv")
        parse_robodk_csv(read_program_bytes(listed), listed)
    except FileFormatError as error:
        return [Problem(1, "beside", error.message)]
    return []


def _problems(data: bytes) -> Iterator[Problem]:
    lines = data.replace(b"\r\n", b"\n").split(b"\n")
    lines = lines[:-1] if not lines[-1] else lines
    if not any(lines):
        yield Problem(1, "rows", "there are no rows")
        return
    width = None
    for row, line in enumerate(lines, start=1):
        bad = re.search(rb"[^ -~]", line)
        if bad:
            yield Problem(row, "ascii", f"the byte 0x{bad[0][0]:02x} is not plain ASCII text")
            continue
        if not line.strip():
            yield Problem(row, "blank", "the line is empty")
            continue
        fields = [field.strip() for field in line.split(b",")]
        if _WORDS.search(line) and not any(_NAN.fullmatch(field.lstrip(b"+-")) for field in fields):
            yield Problem(row, "text", "the line holds a text")
            continue
        width = len(fields) if width is None else width
        if len(fields) != width:
            yield Problem(row, "columns", f"{len(fields)} values, the first row has {width}")
        yield from _numbers(row, fields)


def _numbers(row: int, fields: list[bytes]) -> Iterator[Problem]:
    for column, field in enumerate(fields, start=1):
        if not _PLAIN.fullmatch(field) or _MINUS_ZERO.fullmatch(field):
            shown = ascii(field[:30].decode("ascii"))
            yield Problem(row, "number", f"value {column} is {shown}, not a plain number")
        elif abs(float(field)) > 720.0:
            yield Problem(row, "range", f"value {column} is {field.decode()} deg, beyond +-720")
