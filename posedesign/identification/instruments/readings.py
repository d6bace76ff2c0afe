"""What instruments read: places and orientations in SI, with their names, times, temperatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray, IntArray, rotation_log
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files.csv_tables import LONGEST_SHOWN, Row, is_number, numbers_of, parse_table
from posedesign.hand_eye.pairs.forms import Place, rotations_of
from posedesign.identification.instruments.layouts import (
    METRES,
    Layout,
    Thing,
    find_layout,
    near,
    text_of,
)

MISSING = frozenset({"", "-", "--", "nan", "na", "n/a", "#n/a", "null", "none", "invalid"})
"""Cells, in small letters, of what was not seen."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What an instrument read, one row for each reflector at a time."""

    path: Path
    lines: IntArray  # (N,): line of the file
    values: FloatArray  # (N, 3) or (N, 6): places [m], then rotation vectors [rad]
    reflectors: tuple[str, ...]  # of each; empty where the file does not say
    poses: tuple[str, ...] = ()  # name of each pose; none where the file does not say
    times: FloatArray | None = None  # (N,) [s]
    temperatures: FloatArray | None = None  # (N,) [deg C]; NaN where there is none
    joints: FloatArray | None = None  # (N, n): in the unit and signs of the file
    notes: tuple[str, ...] = ()


def read_readings(path: Path, section: InstrumentSection) -> Readings:
    """Read the file of an instrument.

    Raises FileFormatError: naming file, line and column: a column is missing, a unit is not said, a
    name is not known, a cell is no number.
    """
    text = text_of(path)
    lines = text.split("\n")
    layout = find_layout(path, lines, section)
    unit = _unit_of(path, layout, section)
    things = _chosen(path, layout, section)
    named = (layout.reflector, layout.pose, layout.time, layout.temperature, *layout.joints)
    only = {c for thing in things for c in (*thing.place, *thing.turn)} | {c for c in named if c}
    body = "\n".join([*[""] * layout.head, *lines[layout.head : layout.end]])
    del text, lines
    table = parse_table(path, body, layout.header, loose=True, only=only)
    _check_there(path, table.columns, only, layout.head + (not layout.header))
    found = [_of_thing(path, table.rows, thing, layout, METRES[unit]) for thing in things]
    values = np.concatenate([values for _, _, values in found])
    kept = [row for rows, _, _ in found for row in rows]
    if not kept:
        raise FileFormatError("has no reading", path=path, hint="was anything seen?")
    names = [
        row.cells[layout.reflector] if layout.reflector else thing.name
        for thing, (rows, _, _) in zip(things, found, strict=True)
        for row in rows
    ]
    at = np.array([row.line for row in kept])
    order = np.argsort(at, kind="stable")
    rows = [kept[i] for i in order]
    temperatures = None
    if column := layout.temperature:
        temperatures = np.full(len(rows), np.nan)
        known = [i for i, row in enumerate(rows) if row.cells[column].casefold() not in MISSING]
        temperatures[known] = numbers_of(path, [rows[i] for i in known], [column])[:, 0]
    hidden = sum(count for _, count, _ in found)
    seen = f"{path}: nothing was seen in {hidden} of {hidden + len(rows)} readings"
    return Readings(
        path,
        at[order],
        values[order],
        tuple(names[i] for i in order),
        tuple(row.cells[layout.pose] for row in rows) if layout.pose else (),
        seconds_of(path, rows, layout.time, layout.time_factor) if layout.time else None,
        temperatures,
        numbers_of(path, rows, layout.joints) if layout.joints else None,
        (seen,) if hidden else (),
    )


def _of_thing(
    path: Path, rows: Sequence[Row], thing: Thing, layout: Layout, metre: float
) -> tuple[list[Row], int, FloatArray]:
    """Rows in which a thing was seen, how many others there are, and its values [m, rad]."""
    columns = (*thing.place, *thing.turn)
    seen = [r for r in rows if not any(r.cells[c].casefold() in MISSING for c in columns)]
    values = numbers_of(path, seen, thing.place) * metre
    if thing.turn and seen:
        R = _rotations(path, seen, thing.turn, layout.turn)
        values = np.concatenate([values, rotation_log(R)], axis=1)
    elif thing.turn:
        values = np.zeros((0, 6))
    return seen, len(rows) - len(seen), values


def _rotations(path: Path, rows: Sequence[Row], columns: tuple[str, ...], form: str) -> FloatArray:
    """Rotations ``(N, 3, 3)`` from columns in a form."""
    numbers = numbers_of(path, rows, columns)
    kind, _, rest = form.partition("-")
    numbers = np.roll(numbers, 1, axis=1) if rest == "xyzw" else numbers
    numbers = np.deg2rad(numbers) if rest == "deg" else numbers
    return rotations_of(numbers, kind, Place(path, tuple(row.line for row in rows)), columns[0])[0]


def seconds_of(path: Path, rows: Sequence[Row], column: str, factor: float) -> FloatArray:
    """Times ``(N,)`` [s] from numbers in a unit, or from dates."""
    numbers, out = is_number(rows[0].cells[column]), np.empty(len(rows))
    for i, row in enumerate(rows):
        text = row.cells[column]
        try:
            if numbers:  # nanoseconds of this century are larger than other numbers may be
                out[i] = float(text.replace(",", ".")) * factor if is_number(text) else np.nan
            else:
                out[i] = _seconds_since_1970(datetime.fromisoformat(text))
        except ValueError:
            out[i] = np.nan
        if not abs(out[i]) < _LATEST_S:
            raise FileFormatError(
                f"{text[:LONGEST_SHOWN]!r} is no time",
                path=path,
                row=row.line,
                column=column,
                hint="give a number, or a date such as 2026-05-31 14:03:22",
            )
    return out


def _seconds_since_1970(when: datetime) -> float:
    """Without a zone, all dates are taken for one's."""
    zone = when.utcoffset()
    naive = (when.replace(tzinfo=None) - datetime(1970, 1, 1)).total_seconds()
    return naive - (zone.total_seconds() if zone is not None else 0.0)


_LATEST_S = 1e11
"""[s] After 1970, in three thousand years: of later times no milliseconds are left."""


def _unit_of(path: Path, layout: Layout, section: InstrumentSection) -> str:
    """The unit of lengths, which file or cell has to say, and both alike."""
    if layout.unit and section.unit and layout.unit != section.unit:
        raise FileFormatError(
            f"says that its lengths are in {layout.unit}, and the cell that they are in "
            f"{section.unit}",
            path=path,
            hint="take instrument.unit out of the cell, or correct the file",
        )
    unit = layout.unit or section.unit
    if not unit:
        raise FileFormatError(
            "does not say the unit of its lengths",
            path=path,
            hint='say it in the cell, for example instrument.unit = "mm"',
        )
    return unit


def _chosen(path: Path, layout: Layout, section: InstrumentSection) -> tuple[Thing, ...]:
    """Things of the tool and references; all of them where a column has their names."""
    if layout.reflector or layout.things[0].name == "":
        if section.kind == "pose" and not layout.things[0].turn:
            raise FileFormatError(
                "has no orientation",
                path=path,
                hint="name its columns in instrument.columns.turn, and its form in instrument.turn",
            )
        return layout.things
    usable = {t.name: t for t in layout.things if t.turn or section.kind == "point"}
    if not usable:
        raise FileFormatError(
            "has no orientation that can be read",
            path=path,
            hint="export rigid bodies, with rotations as quaternions",
        )
    wanted = [*section.reflectors, *section.references]
    if not section.reflectors:
        free = [name for name in usable if name not in section.references]
        if len(free) != 1:
            raise FileFormatError(
                f"has {len(usable)} things that were tracked: "
                + ", ".join(name[:LONGEST_SHOWN] for name in list(usable)[:5]),
                path=path,
                hint="name those on the tool in instrument.reflectors",
            )
        wanted += free
    for name in wanted:
        if name not in usable:
            raise FileFormatError(
                f"has no {name[:LONGEST_SHOWN]!r}", path=path, hint=near(name, usable)
            )
    return tuple(
        usable[name] if section.kind == "pose" else Thing(name, usable[name].place)
        for name in dict.fromkeys(wanted)
    )


def _check_there(path: Path, columns: Sequence[str], needed: set[str], row: int) -> None:
    for column in sorted(needed):
        if column not in columns:
            raise FileFormatError(
                f"there is no column {column}", path=path, row=row, hint=near(column, columns)
            )
