"""Layouts of tables that trackers, measuring arms and motion capture export, as far as public.

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
from pathlib import Path
from types import MappingProxyType

from calib.errors import FileFormatError, near_names
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files import read_bytes_bounded
from posedesign.files.csv_tables import LARGEST_CSV_BYTES, LONGEST_SHOWN, is_number, separator_of

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

_WITH_UNIT = re.compile(r"(.+?)(?:[ _]+|\s*[\[(]\s*)(um|mm|cm|m|in|inch)\s*[\])]?", re.IGNORECASE)
"""A name of a column that ends with a unit: ``X [mm]``, ``x_mm``."""

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
        match = _WITH_UNIT.fullmatch(column.strip())
        stem = (match[1] if match else column).strip().casefold()
        if stem in ("x", "y", "z"):
            found.setdefault(stem, column)
    return found


def _columns(
    path: Path, columns: Sequence[str], section: InstrumentSection, layout: Layout
) -> Layout:
    """The layout that names of columns and the cell make together."""
    given, axes = section.columns, _axes(columns)
    place = given.place or tuple(axes.get(axis, axis) for axis in "xyz")
    units = {match[2].casefold() for c in place if (match := _WITH_UNIT.fullmatch(c))}
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
    if not is_number(rate) or not float(rate) > 0 or len(units) < len(axes):
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
