"""CSV files: hostile until read. Size, encoding, header, every cell that should be a number.

Lines that start with # may stand before the header, and say something of the whole table. A cell
that holds a # is quoted, so that ``pandas.read_csv(path, comment="#")`` reads it as it is, with its
usual engine; with ``engine="python"`` quotes do not protect it.
"""

from __future__ import annotations

import csv
import difflib
import io
import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import FileFormatError, near_names, one_line
from calib.se3 import FloatArray
from posedesign.files.safe import StrPath, read_bytes_bounded, write_text_atomic

LARGEST_CSV_BYTES = 50_000_000
DECIMALS = 9
"""Of mm and degrees in a file: 1e-12 m and 2e-11 rad, so that nothing is lost by writing."""

_ESCAPED = (*"=+-@\t\r#'", *"\uff1d\uff0b\uff0d\uff20")
"""First characters of a text that a spreadsheet would run, or that start a comment: such a text is
written with an apostrophe before it, as in a spreadsheet, and read without. The last four are the
wide forms of = + - @, which some spreadsheets take for the same."""

_QUOTED = frozenset(',"#\n')
"""Characters for which a cell is put between quotation marks."""

_NO_COMMENT = re.compile(r'[\x00-\x1f\x7f-\x9f\u2028\u2029"]+')
"""What ends a line of comment, or begins a quoted cell."""

_BARE_COMMA = re.compile(rf"[,;](?=\s*([,;{re.escape(''.join(_ESCAPED))}]|$))")
"""One that a spreadsheet would cut a comment at into a cell that it runs, or into an empty one."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
"""``float()`` would take more: 1_0, nan, digits of other scripts."""

LONGEST_SHOWN = 40
"""Characters of a cell that an error shows."""

MOST_LISTED = 5
"""Names, or lines, of which a message lists no more."""


@dataclass(frozen=True)
class Row:
    """One row of a table: the line it stands on, and its cells by column."""

    line: int
    cells: dict[str, str]


@dataclass(frozen=True)
class Table:
    """What stands in a CSV file."""

    columns: list[str]
    rows: list[Row]
    comments: list[str]  # the lines before the header that start with #, without it
    notes: tuple[str, ...] = ()
    """In what another form it was written than with commas between cells and a point in numbers."""


class AsItIs(str):
    """The digits of a number: written without an apostrophe, whatever sign they start with."""


def as_read(text: str) -> str:
    """A cell that was read, to be written again: a number as it is, all else as a text."""
    return AsItIs(text) if _NUMBER.fullmatch(text) else text


def write_table(
    path: StrPath,
    columns: Sequence[str],
    rows: Iterable[Mapping[str, object]],
    comments: Sequence[str] = (),
) -> Path:
    """Write rows as CSV, whole or not at all.

    ``rows``: by column; missing values are empty cells. ``comments``: lines to stand before the
    header, each with # before it. What would end such a line, or be run by a spreadsheet that cuts
    it into cells, becomes a space, and a semicolon a comma: at commas such a line can be cut and
    put together again (:func:`read_table`).
    """
    return write_text_atomic(path, table_text(columns, rows, comments))


def table_text(
    columns: Sequence[str], rows: Iterable[Mapping[str, object]], comments: Sequence[str] = ()
) -> str:
    """The text of such a file."""
    lines = ["# " + comment_text(text) for text in comments]
    columns = _as_counted(columns)
    lines.append(_line(columns))
    lines += [_line([row.get(column) for column in columns]) for row in rows]
    return "\n".join([*lines, ""])


def _as_counted(columns: Sequence[str]) -> list[str]:
    """Columns with those of external axes in the order of their numbers, where these stand."""
    out = list(columns)
    for kind in ("", "pendant_"):
        there = [k for k, c in enumerate(columns) if re.fullmatch(rf"{kind}e\d+_(mm|deg)", c)]
        counted = sorted((columns[k] for k in there), key=lambda c: int(re.sub(r"\D", "", c)))
        for k, column in zip(there, counted, strict=True):
            out[k] = column
    return out


def read_rows(path: Path, header: Sequence[str] = ()) -> tuple[list[str], list[Row]]:
    """Header and rows of a CSV file; see :func:`read_table`."""
    table = read_table(path, header)
    return table.columns, table.rows


def read_table(path: Path, header: Sequence[str] = (), *, loose: bool = False) -> Table:
    """Header and rows of a CSV file, and the lines with # before them.

    ``header``: names of the columns, for a file without a header line. ``loose``: take semicolons,
    tabs or spaces between the cells, too, and commas in numbers then, with a note; without it they
    are refused. Raises FileFormatError: the file is missing, too large, not text, without rows, or
    a row has too few or too many cells.
    """
    data = read_bytes_bounded(path, most_bytes=LARGEST_CSV_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            "is not UTF-8 text", path=path, hint="save it as CSV (UTF-8)"
        ) from error
    return parse_table(path, text, header, loose=loose)


def parse_table(
    path: Path,
    text: str,
    header: Sequence[str] = (),
    *,
    loose: bool = False,
    only: Collection[str] | None = None,
) -> Table:
    """The table in a text that is the content of a file; see :func:`read_table`.

    ``only``: columns whose cells are kept; recordings have hundreds that are not read. All by
    default. Raises FileFormatError: it is no such table; of JSON, XML or TOML with that word.
    """
    try:
        return _parsed(path, text, header, loose, only)
    except FileFormatError as error:
        kind = other_kind(text)
        if not kind:
            raise
        raise FileFormatError(
            f"is {kind}, and a table (CSV) is read here", path=path, hint=_NO_TABLE
        ) from error


_NO_TABLE = "give the table: a line with the names of the columns, then a row a line"


def other_kind(text: str) -> str:
    """Return the kind of a text that is no table: JSON, XML, TOML; empty where none is told."""
    start = text.lstrip()[:1]
    try:
        if start in ("{", "["):
            load_json(text)
            return "JSON"
        if start == "<":
            return "XML or HTML"
        if len(text) <= _LONGEST_TOML and tomllib.loads(text):
            return "TOML, as a cell is"
    except (ValueError, RecursionError):
        pass
    return ""


_LONGEST_TOML = 1_000_000
"""Characters of a text that is tried as TOML; cells are far shorter."""


def _parsed(
    path: Path, text: str, header: Sequence[str], loose: bool, only: Collection[str] | None
) -> Table:
    mark = separator_of(text) if loose else ","
    if mark == " ":
        text = "\n".join(" ".join(line.split()) for line in text.split("\n"))
    reader = csv.reader(io.StringIO(text), strict=True, delimiter=mark)
    columns = list(header)
    rows: list[Row] = []
    comments: list[str] = []
    try:
        for cells in reader:
            if not any(cells):
                continue
            at_start = not rows if header else not columns
            if at_start and cells[0].startswith("#"):
                # a spreadsheet that saves the table fills the line up with commas
                comments.append(",".join(cells)[1:].strip(" ,"))
                continue
            stripped = [_unescaped(cell.strip()) for cell in cells]
            # some programs end lines of numbers with a comma; below names it may be an empty cell
            spare = loose and not stripped[-1] and len(stripped) == len(columns or stripped[1:]) + 1
            if spare and (header or all(map(is_number, columns or stripped[:-1]))):
                del stripped[-1]
            if not columns:
                columns = stripped
                _check_separator(path, reader.line_num, columns)
                continue
            if len(stripped) != len(columns):
                raise FileFormatError(
                    f"has {len(stripped)} cells, "
                    + (f"{len(columns)} are named" if header else f"the header has {len(columns)}"),
                    path=path,
                    row=reader.line_num,
                    hint="use commas between cells and a point in numbers",
                )
            named = zip(columns, stripped, strict=True)
            kept = {name: cell for name, cell in named if only is None or name in only}
            rows.append(Row(reader.line_num, kept))
    except csv.Error as error:
        raise FileFormatError(
            f"is no valid CSV: {error}",
            path=path,
            row=reader.line_num,
            hint="look for a quotation mark or a line end that does not belong there",
        ) from error
    if len(set(columns)) != len(columns):
        double = next(c for c in columns if columns.count(c) > 1)
        raise FileFormatError("appears twice", path=path, column=double, hint="rename one")
    if not rows:
        raise FileFormatError("has no rows of data", path=path, hint="is it the right file?")
    if mark == ",":
        return Table(columns, rows, comments)
    rows, changed = _with_points(path, rows)
    note = f"{path}: {_SEPARATORS[mark]} stand between the cells"
    return Table(columns, rows, comments, (note + ", and commas in numbers" * changed,))


_SEPARATORS = {";": "semicolons", "\t": "tabs", " ": "spaces"}

_WITH_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?", re.ASCII)


def is_number(text: str) -> bool:
    """Whether a text is a number as tables have them, with a point or a comma."""
    return bool(_NUMBER.fullmatch(text) or _WITH_COMMA.fullmatch(text))


def number_of(text: str) -> float:
    """Return the number that a text is, as tables have them; NaN for none, or beyond the bound."""
    return usable(float(text.replace(",", "."))) if is_number(text) else math.nan


def separator_of(text: str) -> str:
    """What stands between the cells, by the first line that is no comment."""
    lines = (line.strip() for line in text.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    for mark in _SEPARATORS:
        parts = first.split(mark if mark != " " else None)
        # one that stands inside of a cell leaves commas that are of no number
        if len(parts) > 1 and all("," not in part or is_number(part.strip()) for part in parts):
            return mark
    return ","


def _with_points(path: Path, rows: list[Row]) -> tuple[list[Row], bool]:
    """Rows with a point in numbers that have a comma, and whether any has."""
    found: dict[bool, int] = {}
    for row in rows:
        for cell in row.cells.values():
            if is_number(cell) and ("." in cell or "," in cell):
                found.setdefault("," in cell, row.line)
    if len(found) > 1:
        raise FileFormatError(
            f"has numbers with a comma, and line {found[False]} has some with a point",
            path=path,
            row=found[True],
            hint="save it with a point in all numbers",
        )
    if True not in found:
        return rows, False
    return [
        Row(r.line, {k: c.replace(",", ".") if is_number(c) else c for k, c in r.cells.items()})
        for r in rows
    ], True


def _check_separator(path: Path, line: int, columns: Sequence[str]) -> None:
    found = next((c for c in ";\t" if len(columns) == 1 and c in columns[0]), None)
    if found:
        raise FileFormatError(
            f"{_SEPARATORS[found]} stand between the cells",
            path=path,
            row=line,
            hint="save it with commas between cells and a point in numbers",
        )


def mistyped(columns: Iterable[str], known: Iterable[str]) -> list[str]:
    """Columns that are kept and not read, and look like one that would be, in words."""
    free = [name for name in known if name not in columns]
    near = {c: difflib.get_close_matches(c.casefold(), free, n=1, cutoff=_ALIKE) for c in columns}
    return [
        f"the column {column[:LONGEST_SHOWN]} is not read: is it meant to be {meant[0]}?"
        for column, meant in near.items()
        if meant and column not in known
    ]


_ALIKE = 0.8
"""Similarity of names from which one looks like a slip of the other: a letter of five."""


def check_columns(
    path: Path, found: Sequence[str], needed: Sequence[str], *, joints: bool = False
) -> None:
    """Check that columns are there, in the unit that is expected.

    ``joints``: refuse columns of more joints than the robot has. Raises FileFormatError: naming the
    column, and the one that was probably meant.
    """
    for column in needed:
        if column in found:
            continue
        stem, _, unit = column.rpartition("_")
        other = [f for f in found if stem and f.rpartition("_")[0] == stem]
        if other:
            raise FileFormatError(
                f"is in another unit than {unit}",
                path=path,
                row=1,
                column=other[0],
                hint=f"convert the values and call the column {column}",
            )
        raise FileFormatError(
            f"there is no column {column}", path=path, row=1, hint=near_names(column, found)
        )
    if joints:
        shown = "pendant_" if needed[0].startswith("pendant_") else ""
        joint = re.compile(rf"{shown}(j\d+_deg|e\d+_(mm|deg))")
        extra = [c for c in found if joint.fullmatch(c) and c not in needed]
        if extra:
            kind = extra[0].removeprefix(shown)[0]
            turns = kind == "j"
            count = sum(c.removeprefix(shown)[0] == kind for c in needed)
            raise FileFormatError(
                f"the robot has {count} {'joints' if turns else 'external axes'} only",
                path=path,
                row=1,
                column=extra[0],
                hint="is this the file of another robot?",
            )


def numbers_of(path: Path, rows: Sequence[Row], columns: Sequence[str]) -> FloatArray:
    """Cells as numbers, ``(rows, columns)``."""
    out = np.empty((len(rows), len(columns)))
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            text = row.cells[column]
            out[i, j] = usable(float(text)) if _NUMBER.fullmatch(text) else math.nan
            if math.isnan(out[i, j]):
                shown = repr(text[:LONGEST_SHOWN]) if text else "an empty cell"
                raise FileFormatError(
                    f"{shown} is not a finite number"
                    + (f" within {LARGEST_NUMBER:g}" if _NUMBER.fullmatch(text) else ""),
                    path=path,
                    row=row.line,
                    column=column,
                    hint="correct the cell or remove the row",
                    value=text,
                )
    return out


def a_few(names: Sequence[str], what: str = "") -> str:
    """A few names, and how many more there are of what."""
    more = len(names) - MOST_LISTED
    shown = ", ".join(name[:LONGEST_SHOWN] for name in names[:MOST_LISTED])
    return shown + (f" and {more} more {what}".rstrip() if more > 0 else "")


def summed_up(lines: Sequence[str], what: str) -> list[str]:
    """A few lines, and in another one how many more there are of what."""
    more = len(lines) - MOST_LISTED
    return [*lines[:MOST_LISTED], *([f"and {more} more {what}"] if more > 0 else [])]


def first_like(keys: Iterable[Hashable]) -> list[int]:
    """Where each of the keys stands first: itself, or what it repeats."""
    first: dict[Hashable, int] = {}
    return [first.setdefault(key, i) for i, key in enumerate(keys)]


def comment_text(text: str) -> str:
    """A text as a comment before a table holds it: on one line, with nothing that ends a cell."""
    without = _BARE_COMMA.sub(" ", _NO_COMMENT.sub(" ", text)).replace(";", ",")
    return " ".join(without.split())


def _line(values: Iterable[object]) -> str:
    """One line of a table. ``csv.writer`` would leave cells with a # without quotation marks."""
    cells = [_cell(value) for value in values]
    if cells == [""]:
        return '""'  # an empty line would be no row
    return ",".join(
        '"' + cell.replace('"', '""') + '"' if _QUOTED.intersection(cell) else cell
        for cell in cells
    )


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, (float, np.floating)):
        if not math.isfinite(value):
            return "" if math.isnan(value) else ("inf" if value > 0 else "-inf")
        return f"{round(float(value), DECIMALS) + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".") or "0"
    text = _with_line_ends(str(value))
    if isinstance(value, AsItIs):
        return text
    return "'" + text if _is_escaped(text) else text


def _with_line_ends(text: str) -> str:
    """The same with one kind of line end: files have their own."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _is_escaped(text: str) -> bool:
    """Whether a text needs an apostrophe; spreadsheets look past spaces before a formula."""
    return text.startswith(_ESCAPED) or text.lstrip().startswith(_ESCAPED)


def _unescaped(text: str) -> str:
    text = _with_line_ends(text)
    return text[1:] if text[:1] == "'" and _is_escaped(text[1:]) else text


LARGEST_NUMBER = 1e12
"""Of all files and options, in mm, degrees or whatever their unit is: nothing that can be measured
is larger, and what is computed of such numbers stays far within what a float holds."""

LEAST_POSITIVE = 1e-12
"""Of numbers that have to be above zero: what is divided by them stays finite as well."""

_LARGEST_IN_JSON = 1e300
"""Results such as chi2 and condition numbers may be larger than what is measured."""

_MOST_DIGITS = 19
"""Of a whole number: seeds have as many, and more are none of pixels, moves or poses."""


def usable(value: object) -> float:
    """A number of a file or an option as a float; NaN where it is none, or beyond the bound."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    return float(value) if abs(value) <= LARGEST_NUMBER else math.nan


def load_json(data: bytes | str) -> Any:
    """The content of a JSON text.

    Raises ValueError: it is no JSON in UTF-8, is nested too deep, has a key twice, or holds a
    number that no result has.
    """
    try:
        text = data if isinstance(data, str) else data.decode("utf-8-sig")
        return json.loads(
            text,
            object_pairs_hook=_distinct,
            parse_int=_whole,
            parse_float=_decimal,
            parse_constant=_decimal,
        )
    except RecursionError as error:
        raise ValueError("nested too deep") from error


def _distinct(found: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(found)
    if len(content) < len(found):
        counts = Counter(key for key, _ in found)
        raise ValueError(f"the key {one_line(counts.most_common(1)[0][0])} stands twice")
    return content


def _decimal(text: str) -> float:
    value = float(text)
    if not abs(value) <= _LARGEST_IN_JSON:  # nor NaN
        raise ValueError(f"{text[:40]} is not a finite number within {_LARGEST_IN_JSON:g}")
    return value


def _whole(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"{text[:40]} is not a finite number within 2^63")
    return int(text)
