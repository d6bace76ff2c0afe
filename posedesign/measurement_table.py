"""``measurements.csv``: any mixture of kinds of measurement in one table.

``touchups.csv`` is the same table with touch-ups alone. Columns:

======================  =========================================================================
``target``              what was measured from: the point touched, the tracker, the ball bar's foot
``j1_deg`` ..           joints as the controller showed them, URDF signs; or ``pendant_j1_deg ..``
``pose``                name of the pose; measurements of one pose share it. May be left out.
``kind``                touch-up, view-line, plane, point, pose, camera-pose or distance; where it
                        is left out or empty, the kind of the cell
``tool``                point or frame of the tool; ``tool`` where it is left out
``payload``             name of a ``[[payload]]`` of the cell; the tool's own where it is left out
``x_mm, y_mm, z_mm``    what was read, for points and poses
``w_deg, p_deg, r_deg`` the same, for poses
``distance_mm``         the same, for distances
======================  =========================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm_view import Setup
from calib.errors import FileFormatError, near_names
from calib.measurement import KINDS, Measurement, Measurements
from calib.robots import Controller
from calib.se3 import FloatArray, IntArray, rotation_from_wpr, rotation_log
from posedesign.csv_tables import Row, check_columns, numbers_of, read_rows
from posedesign.postures_table import postures_of

TOOL = "tool"
OWN_PAYLOAD = ""

_PLACE = ("x_mm", "y_mm", "z_mm")
_TURN = ("w_deg", "p_deg", "r_deg")
_READ = {
    "point": _PLACE,
    "pose": (*_PLACE, *_TURN),
    "camera-pose": (*_PLACE, *_TURN),
    "distance": ("distance_mm",),
}
"""Columns that each kind is read from; the others are not read, they are met."""


@dataclass(frozen=True, eq=False)
class MeasurementTable:
    """Measurements of a file, with the names that their indices mean.

    Attributes
    ----------
    data : Measurements
    kinds : tuple of str
        Names that ``data.setup.kind`` has indices into.
    lines : tuple of int
        Line of the file that each stands on.
    """

    data: Measurements
    kinds: tuple[str, ...]
    lines: tuple[int, ...]


def read_measurements(
    path: Path,
    n: int,
    *,
    kind: str = "touch-up",
    payloads: Sequence[str] = (),
    controller: Controller | None = None,
    trust_units: bool = False,
) -> MeasurementTable:
    """Read measurements of a robot with n joints; labels in the order of appearance.

    Parameters
    ----------
    path : Path
    n : int
    kind : str
        Of rows that do not say theirs.
    payloads : sequence of str
        Names of payloads besides the tool's own, which is the first.
    controller : Controller, optional
        Turns ``pendant_j1_deg ..`` into joint values; without it such columns alone are refused.
    trust_units : bool
        Do not refuse values that look like radians.

    Raises
    ------
    FileFormatError
        Naming file, line and column.
    """
    columns, rows = read_rows(path)
    check_columns(path, columns, ["target"])
    for row in rows:
        if not row.cells["target"]:
            raise FileFormatError(
                "the target has no name",
                path=path,
                row=row.line,
                column="target",
                hint="name the point that was touched",
            )
    kinds, of_kind = _labels(rows, "kind", kind)
    strange = next((name for name in kinds if name not in KINDS), None)
    if strange is not None:
        row = next(row for row in rows if row.cells.get("kind", "") == strange)
        raise FileFormatError(
            f"there is no kind of measurement {strange[:40]!r}",
            path=path,
            row=row.line,
            column="kind",
            hint=near_names(strange, KINDS),
            value=strange,
        )
    targets, target = _labels(rows, "target", "")
    tools, tool = _labels(rows, "tool", TOOL)
    payload = _payloads(path, rows, payloads)
    postures = postures_of(path, columns, rows, n, controller, trust_units)
    setup = Setup.of(len(rows), kind=of_kind, tool=tool, target=target, payload=payload)
    observed = _readings(path, columns, rows, [KINDS[name] for name in kinds], of_kind)
    names = tuple(row.cells.get("pose") or f"P{i + 1:02d}" for i, row in enumerate(rows))
    data = Measurements(postures, setup, targets, tools, observed, names)
    _check_poses(path, rows, data)
    return MeasurementTable(data, kinds, tuple(row.line for row in rows))


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
                f"the cell has no payload {name[:40]!r}",
                path=path,
                row=row.line,
                column="payload",
                hint=near_names(name, known) if known else "list it as [[payload]] in the cell",
                value=name,
            )
        found.append(every.index(name))
    return np.array(found, dtype=np.intp)


def _readings(
    path: Path,
    columns: Sequence[str],
    rows: Sequence[Row],
    kinds: Sequence[type[Measurement]],
    of_kind: IntArray,
) -> FloatArray | None:
    """What was read ``(N, m)`` [m, rad]; None where every row is of a kind that is met."""
    width = max(kind.rows for kind in kinds)
    out = np.zeros((len(rows), width))
    for k, kind in enumerate(kinds):
        wanted = _READ.get(kind.name)
        if wanted is None:
            continue
        check_columns(path, columns, wanted)
        own = np.flatnonzero(of_kind == k).tolist()
        numbers = numbers_of(path, [rows[i] for i in own], wanted)
        out[own, : min(3, len(wanted))] = numbers[:, :3] / 1e3
        if len(wanted) == 6:
            out[own, 3:6] = rotation_log(rotation_from_wpr(np.deg2rad(numbers[:, 3:])))
    return out if any(kind.reads for kind in kinds) else None


def _check_poses(path: Path, rows: Sequence[Row], data: Measurements) -> None:
    """Rows that share the name of a pose must share its joints."""
    first: dict[str, int] = {}
    for i, name in enumerate(data.names):
        j = first.setdefault(name, i)
        off = float(np.rad2deg(np.abs(data.postures[i] - data.postures[j]).max()))
        if off > 1e-6:
            raise FileFormatError(
                f"pose {name} has other joint values on line {rows[j].line} (by {off:.3g} deg)",
                path=path,
                row=rows[i].line,
                column="pose",
                hint="give each pose a name of its own",
            )
