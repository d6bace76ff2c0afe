"""What instruments read: places and orientations in SI, with their names, times, temperatures.

Layouts of tables that trackers, measuring arms and motion capture export, as far as public.

=========  ========================================================================================
points     one point a line, without names of columns: ``name x y z``, ``group name x y z`` or
           ``collection group name x y z ..``; lines that start with ``//`` are comments. So ASCII
           files of SpatialAnalyzer, which trackers of Leica, FARO and API export through. Their
           unit is chosen on export and not in the file. (SpatialAnalyzer, users manual, "Importing
           predefined ASCII formatted files"; comments as in files of others.)
motive     OptiTrack Motive, "Data Export: CSV": a line of keys and values, ``Length Units`` among
           them; lines Type, Name, ID; Rotation or Position; axes; a frame a line, blank where
           something was hidden. "Rigid Body Marker" are where markers are expected: not read.
           Euler angles are refused: their order of turning is not documented.
vicon      Vicon Nexus and Tracker, CSV: title and frame rate, names of objects, ``Frame,Sub
           Frame,RX ..``, units, frames. Three angles are a rotation vector (as in the
           ``RotationMatrixFromAngleAxis`` of Vicon's Nexus API), with ``RW`` a quaternion.
columns    any other table: the line that has the names of its columns is found below whatever
           stands above; places are ``x y z``, or as the cell says. So tables of CAM2 (FARO),
           VXelements (Creaform), PolyWorks: no public description of their columns was found.
=========  ========================================================================================

The unit of lengths stands in the file or in the cell, and is never taken for granted.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import MappingProxyType

import numpy as np

from calib.errors import FileFormatError, near_names
from calib.se3 import FloatArray, IntArray, rotation_log
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files import read_bytes_bounded
from posedesign.files.csv_tables import (
    LARGEST_CSV_BYTES,
    LONGEST_SHOWN,
    Row,
    is_number,
    number_of,
    numbers_of,
    parse_table,
    separator_of,
)
from posedesign.hand_eye.pairs.forms import READ_AS, Place, rotations_of

METRES: Mapping[str, float] = MappingProxyType(
    {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
)

SECONDS: Mapping[str, float] = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})

_UNITS = {
    **{unit: unit for unit in METRES},
    "meters": "m",
    "centimeters": "cm",
    "millimeters": "mm",
    "inches": "in",
    "inch": "in",
}

_BLANKS = re.compile(r"[\s_]+")

_WITH_UNIT = re.compile(r"(.+?)(?: | ?[\[(] ?)(um|mm|cm|m|in|inch) ?[\])]?", re.IGNORECASE)
"""A name of a column that ends with a unit: ``X [mm]``, ``x_mm``; blanks as one space each, so that
the time is linear in the length of the name."""


def _stem_and_unit(column: str) -> tuple[str, str]:
    """Return a name of a column without its unit, and the unit; "" where it has none."""
    name = _BLANKS.sub(" ", column).strip()
    match = _WITH_UNIT.fullmatch(name)
    return (match[1].strip(), match[2].casefold()) if match else (name, "")


_NOT_CARTESIAN = re.compile(r"coordinate\s+system\W+(cylindrical|spherical|polar)", re.IGNORECASE)
"""Comment of a file whose three numbers are no x, y, z."""

MOST_LINES = 1_000_000
"""An hour of motion capture at 240 frames a second."""

_HEAD = 100
"""Lines among which the names of the columns are looked for."""

_NOT_MEASURED = ("rigid body marker", "bone marker")
"""Types of Motive that are where a marker is expected."""


@dataclass(frozen=True)
class Thing:
    """What is tracked, and the columns that it is read from; no name where a column has it."""

    name: str
    place: tuple[str, ...]
    turn: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """Where a file has what."""

    things: tuple[Thing, ...]
    head: int = 0
    """Lines before the table; the names of its columns are among them where ``header`` has them."""
    end: int | None = None  # line after its last, counted from 0
    header: tuple[str, ...] = ()  # names of all columns, of a table without them
    unit: str = ""  # of lengths, one of :data:`METRES`; empty where the file does not say it
    turn: str = ""  # form of the orientation; see ``instrument.turn``
    reflector: str | None = None
    pose: str | None = None
    time: str | None = None
    time_factor: float = 1.0  # seconds that the unit of time is
    temperature: str | None = None
    joints: tuple[str, ...] = ()


def text_of(path: Path) -> str:
    """The text of a file of at most 50 MB and a million lines."""
    data = read_bytes_bounded(path, most_bytes=LARGEST_CSV_BYTES)
    if data.count(b"\n") > MOST_LINES:
        raise FileFormatError(
            f"has more than {MOST_LINES} lines",
            path=path,
            hint="record at a lower rate, or export the part in which it was measured",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            "is not UTF-8 text", path=path, hint="export it as text or CSV (UTF-8)"
        ) from error


def near(name: str, known: Iterable[str]) -> str:
    """Names that are near, of files whose names may be of any length."""
    return near_names(name, [one[:LONGEST_SHOWN] for one in known])


def is_known(text: str) -> bool:
    """Whether a text is the export of an instrument by what it begins with."""
    first = text[:4000].lstrip()
    return first.startswith(("Format Version,", "//")) or _frame_line(first.split("\n")) is not None


def find_layout(path: Path, lines: list[str], section: InstrumentSection) -> Layout:
    """The layout of a file by its lines, of which comments and lines of units are made empty."""
    frames = _frame_line(lines)
    if lines[0].startswith("Format Version"):
        if frames is None:
            raise FileFormatError(
                "has no line Frame, Time (Seconds), ..", path=path, hint="export it with its header"
            )
        return _motive(path, lines, frames)
    if frames is not None:
        return _vicon(path, lines, frames)
    for i, line in enumerate(lines):
        if line.lstrip().startswith("//"):
            if other := _NOT_CARTESIAN.search(line):
                raise FileFormatError(
                    f"says that its coordinates are {other[1].lower()}",
                    path=path,
                    row=i + 1,
                    hint="export it again in Cartesian coordinates",
                )
            lines[i] = ""  # keeps the numbers of lines
    first = next((i for i, line in enumerate(lines[:_HEAD]) if line.strip(" ,;\t\r")), None)
    if first is None:
        raise FileFormatError("has no rows of data", path=path, hint="is it the right file?")
    if section.header:
        return _columns(path, list(section.header), section, Layout((), header=section.header))
    cells = _cells(lines[first])
    at = min(len(cells) - 3, 3)
    if not section.columns.place and at > 0 and all(map(is_number, cells[at : at + 3])):
        return _points(cells, at, section)
    return _with_names(path, lines, first, section)


def _cells(line: str, mark: str = "") -> list[str]:
    """Cells of one line, whatever stands between them; none where it is no such line."""
    mark = mark or separator_of(line)
    if mark == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=mark), [])]
    except csv.Error:  # it is read again as a part of the table, and refused there
        return []


def _points(cells: Sequence[str], at: int, section: InstrumentSection) -> Layout:
    """Names, then x, y and z: a group is a pose where points are reflectors."""
    names = ("collection", "group", "name")[3 - at :]
    rest = tuple(f"column {k + 1}" for k in range(at + 3, len(cells)))
    group = "group" if at > 1 else None
    several = bool(section.reflectors)
    return Layout(
        (Thing("", ("x", "y", "z")),),
        header=(*names, "x", "y", "z", *rest),
        reflector="name" if several else None,
        pose=group if several else "name",
    )


def _with_names(path: Path, lines: list[str], first: int, section: InstrumentSection) -> Layout:
    """A table below the line that has the names of its columns."""
    wanted = section.columns.place
    heads = [
        (i, cells)
        for i in range(first, min(len(lines), first + _HEAD))
        if (cells := _cells(lines[i])) and not all(map(is_number, filter(None, cells)))
    ]
    for i, cells in heads:
        if (set(wanted) <= set(cells)) if wanted else len(_axes(cells)) == 3:
            at, columns = i, cells
            break
    else:
        _, columns = max(heads, key=lambda head: len(head[1]), default=(0, []))
        there = columns if wanted else _axes(columns)
        missing = next((c for c in wanted or "xyz" if c not in there), "x")
        raise FileFormatError(
            f"there is no column {missing}",
            path=path,
            hint=f"{near(missing, columns)}; instrument.columns.place of the cell names them",
        )
    layout = _columns(path, columns, section, Layout((), head=at))
    place = [columns.index(c) for c in layout.things[0].place]
    below = _cells(lines[at + 1]) if at + 1 < len(lines) else []
    below = [cell.strip("[]() ").casefold() for cell in below]
    if len(below) > max(place) and all(below[k] in _UNITS for k in place):
        lines[at + 1] = ""
        said = {_UNITS[below[k]] for k in place}
        if len(said) > 1 or layout.unit not in ("", *said):
            raise FileFormatError(
                "axes have several units", path=path, row=at + 2, hint="give x, y and z in one"
            )
        return Layout(**{**vars(layout), "unit": said.pop()})
    return layout


def _axes(columns: Sequence[str]) -> dict[str, str]:
    """Columns that are called x, y and z, with a unit or without."""
    found: dict[str, str] = {}
    for column in columns:
        stem = _stem_and_unit(column)[0].casefold()
        if stem in ("x", "y", "z"):
            found.setdefault(stem, column)
    return found


def _columns(
    path: Path, columns: Sequence[str], section: InstrumentSection, layout: Layout
) -> Layout:
    """The layout that names of columns and the cell make together."""
    given, axes = section.columns, _axes(columns)
    place = given.place or tuple(axes.get(axis, axis) for axis in "xyz")
    units = {unit for c in place if (unit := _stem_and_unit(c)[1])}
    if len(units) > 1:
        raise FileFormatError(
            f"axes have several units: {', '.join(place)}",
            path=path,
            row=layout.head + 1,
            hint="give x, y and z in one",
        )
    known = {"reflector": "tool", "pose": "pose", "time": "time_s", "temperature": "temperature_c"}
    roles = {
        role: getattr(given, role) or (usual if usual in columns else None)
        for role, usual in known.items()
    }
    here = bool(given.joints) and set(given.joints) <= set(columns)
    turn = given.turn if section.kind == "pose" else ()
    return Layout(
        **{
            **vars(layout),
            **roles,
            "things": (Thing("", place, turn),),
            "unit": _UNITS[units.pop()] if units else "",
            "turn": section.turn or "",
            "time_factor": SECONDS[section.time_unit] if given.time else 1.0,
            "joints": given.joints if here else (),
        }
    )


def _frame_line(lines: Sequence[str]) -> int | None:
    """The line of motion capture that has the axes."""
    for i, line in enumerate(lines[:_HEAD]):
        cells = [cell.strip().casefold() for cell in re.split("[,;\t]", line[:200])]
        if cells[0] == "frame" and len(cells) > 2 and cells[1][:4] in ("sub ", "time"):
            return i
    return None


def _motive(path: Path, lines: list[str], at: int) -> Layout:
    rows = [_cells(line, ",") for line in lines[: at + 1]]
    keys = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    by_head = {row[1].casefold(): row for row in rows[1:] if len(row) > 1}
    names, types, axes = by_head.get("name"), by_head.get("type", []), rows[at]
    if names is None or not len(names) == len(axes) == len(rows[at - 1]):
        raise FileFormatError(
            "its lines Name, Rotation or Position, and Frame do not go together",
            path=path,
            row=at + 1,
            hint="export it again with its header",
        )
    if keys.get("Coordinate Space", "Global") != "Global":
        raise FileFormatError(
            f"is in the coordinate space {keys['Coordinate Space'][:LONGEST_SHOWN]!r}",
            path=path,
            row=1,
            hint="export it in global coordinates",
        )
    labels = [f"{what} {axis}".strip() for what, axis in zip(rows[at - 1], axes, strict=True)]
    for k, kind in enumerate(types):
        if kind.casefold() in _NOT_MEASURED:
            labels[k] = ""
    header, things = _wide(names, labels, ("Position X", "Position Y", "Position Z"), "Rotation {}")
    _check_things(path, things, at)
    return Layout(
        things,
        head=at + 1,
        header=("frame", "time", *header[2:]),
        unit=_UNITS.get(keys.get("Length Units", "").casefold(), ""),
        turn="quaternion-wxyz",
        time="time",
    )


def _vicon(path: Path, lines: list[str], at: int) -> Layout:
    mark = separator_of(lines[at])
    names, axes, units = (
        _cells(lines[i], mark) if 0 <= i < len(lines) else [] for i in (at - 1, at, at + 1)
    )
    rate = lines[at - 2].strip(" ,;\t\r").replace(",", ".") if at > 1 else ""
    if not number_of(rate) > 0 or len(units) < len(axes):
        raise FileFormatError(
            "has no frame rate, names and units around its line Frame, Sub Frame, ..",
            path=path,
            row=at + 1,
            hint="export it again as it comes out of Nexus or Tracker",
        )
    filled = list(names) + [""] * (len(axes) - len(names))
    for k in range(3, len(axes)):
        filled[k] = filled[k] or filled[k - 1]
    place = ("TX", "TY", "TZ") if "TX" in axes else ("X", "Y", "Z")
    header, things = _wide(filled, axes, place, "R{}")
    _check_things(path, things, at)
    said = {_UNITS.get(u) for u, axis in zip(units, axes, strict=False) if axis in place}
    angles = {u for u, axis in zip(units, axes, strict=False) if axis in ("RX", "RY", "RZ")}
    form = "quaternion-wxyz" if "RW" in axes else "vector-" + "".join(angles or {"deg"})
    if len(said) > 1 or form not in ("quaternion-wxyz", "vector-deg", "vector-rad"):
        raise FileFormatError(
            "its axes have several units, or unknown ones",
            path=path,
            row=at + 2,
            hint="export lengths in mm or m, and angles in deg or rad",
        )
    blank = (i for i in range(at + 2, len(lines)) if not lines[i].strip(" ,;\t\r"))
    return Layout(
        things,
        head=at + 2,
        end=next(blank, None),
        header=("frame", "sub frame", *header[2:]),
        unit=said.pop() or "",
        turn=form,
        time="frame",
        time_factor=1.0 / float(rate),
    )


def _wide(
    names: Sequence[str], labels: Sequence[str], place: tuple[str, ...], turn: str
) -> tuple[list[str], tuple[Thing, ...]]:
    """Names for all columns of a table that has things side by side, and the things."""
    header = [f"column {k + 1}" for k in range(len(labels))]
    used = {place, *[(turn.format(axis),) for axis in "WXYZ"]}
    wanted = {label for labels in used for label in labels}
    by_name: dict[str, dict[str, str]] = {}
    for k, (name, label) in enumerate(zip(names, labels, strict=False)):
        own = by_name.setdefault(name, {})
        if k > 1 and label in wanted and label not in own:
            header[k] = own[label] = f"{name} {label}"
    things = []
    for name, own in by_name.items():
        if all(label in own for label in place):
            turns = [own[t] for axis in "WXYZ" if (t := turn.format(axis)) in own]
            whole = len(turns) == 4 or (turn == "R{}" and len(turns) == 3)
            things.append(Thing(name, tuple(own[p] for p in place), tuple(turns) * whole))
    return header, tuple(things)


def _check_things(path: Path, things: tuple[Thing, ...], at: int) -> None:
    if not things:
        raise FileFormatError(
            "has nothing with all of x, y and z",
            path=path,
            row=at + 1,
            hint="export positions of markers or rigid bodies",
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
    place = Place(path, tuple(row.line for row in rows))
    return rotations_of(numbers, READ_AS[kind], place, columns[0])[0]


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
