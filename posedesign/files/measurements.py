"""``measurements.csv``: any mixture of kinds of measurement in one table.

``touchups.csv`` is the same table with touch-ups alone. Columns:

======================  =========================================================================
``target``              what was measured from: the point touched, the tracker, the ball bar's foot
``j1_deg`` ..           joints as the controller showed them, URDF signs; or ``pendant_j1_deg ..``
``pose``                name of the pose; measurements of one pose share it. May be left out.
``kind``                touch-up, view-line, plane, point, pose, camera-pose or distance; where it
                        is left out or empty, the kind of the cell
``tool``                point or frame of the tool; ``tool`` where it is left out
``payload``             name of a ``[[payload]]`` of the cell, carried besides the tool; where it is
                        left out the tool alone
``x_mm, y_mm, z_mm``    what was read, for points and poses
``w_deg, p_deg, r_deg`` the same, for poses
``distance_mm``         the same, for distances
======================  =========================================================================

Columns of other names are kept: :attr:`MeasurementTable.extra`.

A camera-pose is the pose of the target in the axes of the camera, a pose that of the tool in the
axes of the target; W, P and R turn about fixed x, then y, then z.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import FileFormatError, InputError, near_names
from calib.model import Setup
from calib.model.measurements import KINDS, Measurement, Measurements
from calib.robots import NO_EXTERNAL_AXES, Controller, ExternalAxes, shown_of
from calib.se3 import (
    FloatArray,
    IntArray,
    rotation_exp,
    rotation_from_wpr,
    rotation_log,
    wpr_from_rotation,
)
from posedesign.files.csv_tables import (
    LONGEST_SHOWN,
    Row,
    as_read,
    check_columns,
    mistyped,
    numbers_of,
    read_rows,
    write_table,
)
from posedesign.files.postures import joint_columns, pendant_columns, postures_of
from posedesign.files.safe import StrPath

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")

TOOL = "tool"
OWN_PAYLOAD = ""
REPEATS = "readings"
"""Column with the number of readings that a measurement of an instrument is the mean of."""

PLACE = ("x_mm", "y_mm", "z_mm")
TURN = ("w_deg", "p_deg", "r_deg")
_READ = {
    "point": PLACE,
    "pose": (*PLACE, *TURN),
    "camera-pose": (*PLACE, *TURN),
    "distance": ("distance_mm",),
}
"""Columns that each kind is read from; the others are not read, they are met."""

_EVERY_READ = tuple(dict.fromkeys(column for columns in _READ.values() for column in columns))

_LABELS = ("target", "pose", "kind", "tool", "payload")

MOST_MEASUREMENTS = 50_000
"""Of one file: 20,000 take some 50 s and 0.8 GB to identify, and both grow linearly."""


@dataclass(frozen=True, eq=False)
class MeasurementTable:
    """Measurements of a file, with the names that their indices mean."""

    data: Measurements
    kinds: tuple[str, ...]  # names that ``data.setup.kind`` has indices into
    lines: tuple[int, ...]  # line of the file that each stands on
    path: Path = field(default=Path("measurements.csv"))  # the file
    notes: tuple[str, ...] = ()  # what is odd in it
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By name of the column, the cells of columns that posedesign does not know."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """What the file of an instrument has, in words by what it is about."""

    @property
    def kind_of_each(self) -> NDArray[np.object_]:
        """Name of the kind of each measurement, ``(N,)``."""
        return np.array(self.kinds, dtype=object)[self.data.setup.kind]

    def of_kind(self, *names: str) -> IntArray:
        """Rows of the data that are of these kinds."""
        wanted = [k for k, name in enumerate(self.kinds) if name in names]
        return np.flatnonzero(np.isin(self.data.setup.kind, wanted))

    def some(self, rows: IntArray) -> MeasurementTable:
        """Some of the measurements, with the names of all."""
        lines = tuple(self.lines[i] for i in rows)
        extra = {column: tuple(cells[i] for i in rows) for column, cells in self.extra.items()}
        return replace(self, data=self.data[rows], lines=lines, extra=extra)


def write_measurements(
    path: StrPath,
    data: Measurements,
    kinds: Sequence[str] = (),
    payloads: Sequence[str] = (),
    *,
    extra: Mapping[str, Sequence[str]] | None = None,
    external: ExternalAxes = NO_EXTERNAL_AXES,
) -> Path:
    """Write measurements so that :func:`read_measurements` reads them as they are.

    ``data``: one set, postures ``(N, n)``. ``kinds``: names that ``data.setup.kind`` has indices
    into. Without them there is no such column, and all are of the kind of the cell that they are
    read for. ``payloads``: names of payloads besides the tool's own, which is the first. ``extra``:
    cells of further columns, one for each measurement. ``external``: what the first joints
    are. Raises InputError: trials of a Monte Carlo
    run, or a kind or payload without a name.
    """
    setup = data.setup
    if data.postures.ndim != 2:
        raise InputError("a table holds one set of measurements", name="measurements")
    every = [OWN_PAYLOAD, *payloads]
    for index, names, what in (
        (setup.kind, kinds or [""], "kind"),
        (setup.payload, every, "payload"),
    ):
        if index.max(initial=0) >= len(names):
            raise InputError(f"a {what} of the measurements has no name", name=what)
    n = data.postures.shape[1]
    joints, columns, shown = joint_columns(n, external), ["target"], shown_of(n, external)
    columns += [*joints, "pose"]
    columns += ["kind"] if kinds else []
    columns += ["tool"] if data.tools != (TOOL,) else []
    columns += ["payload"] if setup.payload.any() else []
    rows: list[dict[str, object]] = []
    for i, q in enumerate(data.postures):
        row: dict[str, object] = dict(zip(joints, q * shown, strict=True))
        row |= {"target": data.targets[setup.target[i]], "tool": data.tools[setup.tool[i]]}
        row |= {"pose": data.names[i], "payload": every[setup.payload[i]]}
        if kinds:
            row |= {"kind": kinds[setup.kind[i]]}
            row |= _as_read(data, i, kinds[setup.kind[i]])
        rows.append(row)
    columns += [column for column in _EVERY_READ if any(column in row for row in rows)]
    for column, cells in (extra or {}).items():
        if column not in columns:
            columns.append(column)
            for row, cell in zip(rows, cells, strict=True):
                row[column] = as_read(cell)
    return write_table(path, columns, rows)


def _as_read(data: Measurements, i: int, kind: str) -> dict[str, float]:
    """Readings of a measurement as they stand in the columns of its kind [mm, deg]."""
    columns = _READ.get(kind)
    if columns is None or data.observed is None:
        return {}
    read = data.observed[i]
    numbers = 1e3 * read[: min(3, len(columns))]
    if len(columns) == 6:
        turned = np.rad2deg(wpr_from_rotation(rotation_exp(read[3:6])))
        numbers = np.concatenate([numbers, turned])
    return dict(zip(columns, numbers.tolist(), strict=True))


def read_measurements(
    path: Path,
    n: int,
    *,
    external: ExternalAxes = NO_EXTERNAL_AXES,
    kind: str = "touch-up",
    payloads: Sequence[str] = (),
    controller: Controller | None = None,
    trust_units: bool = False,
) -> MeasurementTable:
    """Read measurements of a robot with n joints; labels in the order of appearance.

    ``external``: what the first joints are. ``kind``: of rows that do not say
    theirs. ``payloads``: names of payloads besides the tool's own, which is the first.
    ``controller``: turns ``pendant_j1_deg ..`` into joint values; without it such columns alone are
    refused. ``trust_units``: do not refuse values that look like radians. Raises FileFormatError:
    naming file, line and column.
    """
    columns, rows = read_rows(path)
    if "target" not in columns and "status" in columns:
        raise FileFormatError(
            "holds planned poses, not measurements",
            path=path,
            row=1,
            hint="measure them, or rehearse that with: posedesign simulate",
        )
    if len(rows) > MOST_MEASUREMENTS:
        raise FileFormatError(
            f"holds {len(rows)} measurements, {MOST_MEASUREMENTS} are the most that are identified "
            "at once",
            path=path,
            hint="take one in so many: what more of them add is less than what the model leaves",
        )
    check_columns(path, columns, ["target"])
    _check_names(path, rows)
    kinds, of_kind = _labels(rows, "kind", kind)
    _check_kinds(path, columns, rows, kinds)
    targets, target = _labels(rows, "target", "")
    tools, tool = _labels(rows, "tool", TOOL)
    payload = _payloads(path, rows, payloads)
    postures = postures_of(path, columns, rows, n, controller, trust_units, external)
    setup = Setup.of(len(rows), kind=of_kind, tool=tool, target=target, payload=payload)
    observed = _readings(path, rows, [KINDS[name] for name in kinds], of_kind)
    names = tuple(row.cells.get("pose") or f"P{i + 1:02d}" for i, row in enumerate(rows))
    data = Measurements(postures, setup, targets, tools, observed, names)
    _check_poses(path, rows, data, external)
    _check_planes(path, rows, kinds, data)
    lines = tuple(row.line for row in rows)
    known = {*_LABELS, *_EVERY_READ, *joint_columns(n, external), *pendant_columns(n, external)}
    extra = {c: tuple(row.cells[c] for row in rows) for c in columns if c not in known}
    notes = (*mistyped(columns, known), *_not_read(rows, kinds, of_kind))
    return MeasurementTable(data, kinds, lines, path, notes, extra)


def _check_names(path: Path, rows: Sequence[Row]) -> None:
    """Targets need a name, and no name may steer the terminal that it is shown on."""
    for row in rows:
        if not row.cells["target"]:
            raise FileFormatError(
                "the target has no name",
                path=path,
                row=row.line,
                column="target",
                hint="name the point that was touched, or the instrument",
            )
        for column in _LABELS:
            check_label(path, row.line, row.cells.get(column, ""), column)


def check_label(path: Path, line: int, name: str, column: str | None = None) -> None:
    """Refuse a name that would steer the terminal that it is shown on."""
    if _CONTROL.search(name):
        raise FileFormatError(
            f"{name[:LONGEST_SHOWN]!r} has a character that cannot be shown",
            path=path,
            row=line,
            column=column,
            hint="name it with letters and digits",
        )


def _check_kinds(
    path: Path, columns: Sequence[str], rows: Sequence[Row], kinds: Sequence[str]
) -> None:
    """Kinds must be known, and what they are read from be there."""
    for name in kinds:
        row = next((row for row in rows if row.cells.get("kind", "") == name), rows[0])
        if name not in KINDS:
            raise FileFormatError(
                f"there is no kind of measurement {name[:LONGEST_SHOWN]!r}",
                path=path,
                row=row.line,
                column="kind",
                hint=near_names(name, KINDS),
                value=name,
            )
        wanted = _READ.get(name, ())
        missing = [column for column in wanted if column not in columns]
        fits = [k for k, read in _READ.items() if set(read) <= set(columns)]
        if missing and fits:
            raise FileFormatError(
                f"a {name} is read from {', '.join(wanted)}, and there is no {', '.join(missing)}",
                path=path,
                row=row.line,
                column="kind",
                hint=f"add what was read, or call it a {' or a '.join(fits)}",
            )
        check_columns(path, columns, wanted)


def _labels(rows: Sequence[Row], column: str, otherwise: str) -> tuple[tuple[str, ...], IntArray]:
    """Names in a column in the order of appearance, and the index of each row's."""
    names = [row.cells.get(column) or otherwise for row in rows]
    order = list(dict.fromkeys(names))
    index = {name: i for i, name in enumerate(order)}
    return tuple(order), np.array([index[name] for name in names], dtype=np.intp)


def _payloads(path: Path, rows: Sequence[Row], known: Sequence[str]) -> IntArray:
    every = [OWN_PAYLOAD, *known]
    found = []
    for row in rows:
        name = row.cells.get("payload", OWN_PAYLOAD)
        if name not in every:
            raise FileFormatError(
                f"the cell has no payload {name[:LONGEST_SHOWN]!r}",
                path=path,
                row=row.line,
                column="payload",
                hint=near_names(name, known) if known else "list it as [[payload]] in the cell",
                value=name,
            )
        found.append(every.index(name))
    return np.array(found, dtype=np.intp)


def _readings(
    path: Path, rows: Sequence[Row], kinds: Sequence[type[Measurement]], of_kind: IntArray
) -> FloatArray | None:
    """What was read ``(N, m)`` [m, rad]; None where every row is of a kind that is met."""
    width = max(kind.rows for kind in kinds)
    out = np.zeros((len(rows), width))
    for k, kind in enumerate(kinds):
        wanted = _READ.get(kind.name)
        if wanted is None:
            continue
        own = np.flatnonzero(of_kind == k).tolist()
        _check_read(path, [rows[i] for i in own], kind.name)
        numbers = numbers_of(path, [rows[i] for i in own], wanted)
        out[own, : min(3, len(wanted))] = numbers[:, :3] / 1e3
        if len(wanted) == 6:
            out[own, 3:6] = rotation_log(rotation_from_wpr(np.deg2rad(numbers[:, 3:])))
    return out if any(kind.reads for kind in kinds) else None


def _check_read(path: Path, rows: Sequence[Row], kind: str) -> None:
    """No cell that a kind is read from may be empty."""
    for row in rows:
        empty = next((column for column in _READ[kind] if not row.cells[column]), None)
        if empty is not None:
            others = [
                k
                for k, read in _READ.items()
                if k != kind and all(row.cells.get(column) for column in read)
            ]
            also = f", or call it a {' or a '.join(others)}" if others else ""
            raise FileFormatError(
                f"a {kind} needs {', '.join(_READ[kind])}: the cell is empty",
                path=path,
                row=row.line,
                column=empty,
                hint=f"fill it, remove the row{also}",
            )


def _not_read(rows: Sequence[Row], kinds: Sequence[str], of_kind: IntArray) -> list[str]:
    """Readings that stand in rows of kinds that they do not belong to."""
    said = []
    for k, name in enumerate(kinds):
        foreign = [column for column in _EVERY_READ if column not in _READ.get(name, ())]
        own = [rows[i] for i in np.flatnonzero(of_kind == k).tolist()]
        filled = [column for column in foreign if any(row.cells.get(column) for row in own)]
        if filled:
            what = "has no readings" if name not in _READ else f"has {', '.join(_READ[name])}"
            said.append(
                f"{', '.join(filled)} of {len(own)} rows are not read, because a {name} {what}: "
                "if they were measured, say so in the column kind"
            )
    return said


def _check_planes(
    path: Path, rows: Sequence[Row], kinds: Sequence[str], data: Measurements
) -> None:
    """What a plane contact meets is a plane, and nothing else."""
    if "plane" not in kinds:
        return
    flat = data.setup.kind == kinds.index("plane")
    for k, label in enumerate(data.targets):
        own = data.setup.target == k
        if (own & flat).any() and (own & ~flat).any():
            i, j = int(np.flatnonzero(own & ~flat)[0]), int(np.flatnonzero(own & flat)[0])
            raise FileFormatError(
                f"{label[:LONGEST_SHOWN]} is the target of a {kinds[data.setup.kind[i]]} here, and "
                f"a plane on line {rows[j].line}",
                path=path,
                row=rows[i].line,
                column="target",
                hint="give the plane a name of its own",
            )


def _check_poses(
    path: Path, rows: Sequence[Row], data: Measurements, external: ExternalAxes
) -> None:
    """Rows that share the name of a pose must share its joints."""
    first: dict[str, int] = {}
    n = data.postures.shape[-1]
    shown = shown_of(n, external)
    for i, name in enumerate(data.names):
        j = first.setdefault(name, i)
        off = shown * np.abs(data.postures[i] - data.postures[j])
        most = int(np.argmax(off))
        if off[most] > 1e-6:
            unit = "mm" if external.slides_of(n)[most] else "deg"
            raise FileFormatError(
                f"pose {name} has other joint values on line {rows[j].line} (by {off[most]:.3g} "
                f"{unit})",
                path=path,
                row=rows[i].line,
                column="pose",
                hint="give each pose a name of its own",
            )
