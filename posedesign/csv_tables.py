"""CSV files: hostile until read. Size, encoding, header, every cell that should be a number."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, near_names
from calib.se3 import FloatArray
from posedesign.files import read_bytes_bounded, write_text_atomic

LARGEST_CSV_BYTES = 50_000_000
DECIMALS = 9
"""Of mm and degrees in a file: 1e-12 m and 2e-11 rad, so that nothing is lost by writing."""

_ESCAPED = ("=", "+", "-", "@", "\t", "\r", "#", "'")
"""First characters of a text that a spreadsheet would run, or that start a comment: such a text is
written with an apostrophe before it, as in a spreadsheet, and read without."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
"""``float()`` would take more: 1_0, nan, digits of other scripts."""

LONGEST_SHOWN = 40
"""Characters of a cell that an error shows."""


@dataclass(frozen=True)
class Row:
    """One row of a table: the line it stands on, and its cells by column."""

    line: int
    cells: dict[str, str]


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> Path:
    """Write rows as CSV, whole or not at all; missing values are empty cells."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row.get(column)) for column in columns])
    return write_text_atomic(path, text.getvalue())


def read_rows(path: Path, header: Sequence[str] = ()) -> tuple[list[str], list[Row]]:
    """Header and rows of a CSV file; lines with # before them are passed over.

    Parameters
    ----------
    path : Path
    header : sequence of str
        Names of the columns, for a file without a header line.

    Raises
    ------
    FileFormatError
        The file is missing, too large, not text, without rows, or a row has too few or too many
        cells.
    """
    data = read_bytes_bounded(path, most_bytes=LARGEST_CSV_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            "is not UTF-8 text", path=path, hint="save it as CSV (UTF-8)"
        ) from error
    reader = csv.reader(io.StringIO(text), strict=True)
    columns = list(header)
    rows: list[Row] = []
    try:
        for cells in reader:
            at_start = not rows if header else not columns
            if not any(cells) or (at_start and cells[0].startswith("#")):
                continue
            stripped = [_unescaped(cell.strip()) for cell in cells]
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
            rows.append(Row(reader.line_num, dict(zip(columns, stripped, strict=True))))
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
    return columns, rows


def _check_separator(path: Path, line: int, columns: Sequence[str]) -> None:
    found = next((c for c in (";", "\t") if len(columns) == 1 and c in columns[0]), None)
    if found:
        name = {";": "semicolons", "\t": "tabs"}[found]
        raise FileFormatError(
            f"{name} stand between the cells",
            path=path,
            row=line,
            hint="save it with commas between cells and a point in numbers",
        )


def check_columns(
    path: Path, found: Sequence[str], needed: Sequence[str], *, joints: bool = False
) -> None:
    """Check that columns are there, in the unit that is expected.

    Parameters
    ----------
    path : Path
    found, needed : sequence of str
    joints : bool
        Refuse columns of more joints than the robot has.

    Raises
    ------
    FileFormatError
        Naming the column, and the one that was probably meant.
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
        extra = [c for c in found if re.fullmatch(r"j\d+_deg", c) and c not in needed]
        if extra:
            count = sum(c.startswith("j") for c in needed)
            raise FileFormatError(
                f"the robot has {count} joints only",
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
            out[i, j] = float(text) if _NUMBER.fullmatch(text) else math.nan
            if not math.isfinite(out[i, j]):
                shown = repr(text[:LONGEST_SHOWN]) if text else "an empty cell"
                raise FileFormatError(
                    f"{shown} is not a finite number",
                    path=path,
                    row=row.line,
                    column=column,
                    hint="correct the cell or remove the row",
                    value=text,
                )
    return out


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, (float, np.floating)):
        if not math.isfinite(value):
            return "" if math.isnan(value) else ("inf" if value > 0 else "-inf")
        return f"{round(float(value), DECIMALS) + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".") or "0"
    text = str(value)
    return "'" + text if text.startswith(_ESCAPED) else text


def _unescaped(text: str) -> str:
    return text[1:] if text[:1] == "'" and text[1:].startswith(_ESCAPED) else text
