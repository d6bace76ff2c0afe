"""CSV files in and out: the one definition of every column.

======================  =========================================================================
``poses.csv``           ``name, status, reason, j1_deg .. jn_deg, x_mm, y_mm, z_mm, w_deg, p_deg,
                        r_deg``: joints in URDF signs; x, y, z of the tool point and W, P, R of
                        the tip in the base frame; in the order in which they are visited. A pose
                        with the status ``via`` is passed through and not measured. A dropped pose
                        has no numbers. Where the pendant shows other joint values, they follow
                        as ``pendant_j1_deg ..``.
``touchups.csv``        ``target, j1_deg .. jn_deg, pose``: one row a touch-up, joints as the
                        controller showed them, in URDF signs; ``pose`` may be left out. In place
                        of ``j1_deg ..`` there may be ``pendant_j1_deg ..``, as read off the
                        pendant.
``pairs.csv``           ``pose, a_x_mm .. a_r_deg, b_x_mm .. b_r_deg``: A = T_base_tip as the
                        controller shows it, B = T_target_camera, as x y z and W P R.
======================  =========================================================================

Files are hostile until read: size, encoding, header, every number, and degrees that are radians.
"""

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
from calib.measurement import TouchUps
from calib.robots import Controller, Robot
from calib.se3 import BoolArray, FloatArray, rotation_from_wpr, transform, wpr_from_rotation
from posedesign.files import read_bytes_bounded, write_text_atomic
from posedesign.pose_plan import PoseSet, PoseStatus, named_stops
from posedesign.route import Route

LARGEST_CSV_BYTES = 50_000_000
DECIMALS = 9
"""Of mm and degrees in a file: 1e-12 m and 2e-11 rad, so that nothing is lost by writing."""

POSE_AXES = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg")

_ESCAPED = ("=", "+", "-", "@", "\t", "\r", "#", "'")
"""First characters of a text that a spreadsheet would run, or that start a comment: such a text is
written with an apostrophe before it, as in a spreadsheet, and read without."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
"""``float()`` would take more: 1_0, nan, digits of other scripts."""

_LONGEST_SHOWN = 40


@dataclass(frozen=True)
class Row:
    """One row of a table: the line it stands on, and its cells by column."""

    line: int
    cells: dict[str, str]


@dataclass(frozen=True, eq=False)
class PoseList:
    """Poses read from a file.

    Attributes
    ----------
    names : tuple of str
    postures : array (N, n)
        [rad], URDF signs.
    via : array (N,) of bool
        Postures that the arm passes through without measuring.
    """

    names: tuple[str, ...]
    postures: FloatArray
    via: BoolArray

    @property
    def measured(self) -> PoseList:
        """The poses that are measured."""
        kept = ~self.via
        names = tuple(name for name, ok in zip(self.names, kept, strict=True) if ok)
        return PoseList(names, self.postures[kept], self.via[kept])


@dataclass(frozen=True, eq=False)
class Pairs:
    """Poses of the arm and of the camera, pair by pair: A X = Z B.

    Attributes
    ----------
    names : tuple of str
    A, B : array (N, 4, 4)
        ``T_base_tip`` and ``T_target_camera`` [m].
    """

    names: tuple[str, ...]
    A: FloatArray
    B: FloatArray


def joint_columns(n: int) -> list[str]:
    """``j1_deg`` to ``jn_deg``."""
    return [f"j{i + 1}_deg" for i in range(n)]


def pendant_columns(n: int) -> list[str]:
    """``pendant_j1_deg`` to ``pendant_jn_deg``."""
    return [f"pendant_{column}" for column in joint_columns(n)]


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> Path:
    """Write rows as CSV, whole or not at all; missing values are empty cells."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row.get(column)) for column in columns])
    return write_text_atomic(path, text.getvalue())


def write_poses(path: Path, robot: Robot, poses: PoseSet, route: Route, tool_m: FloatArray) -> Path:
    """Write ``poses.csv``: the stops of a route through the kept poses, then what was dropped."""
    shown = robot.controller if robot.controller and robot.controller.differs else None
    labels = {name: _labels(poses, i) for i, name in enumerate(poses.names)}
    rows: list[dict[str, object]] = []
    for name, posture, via in named_stops(poses, route):
        passed: dict[str, object] = {"name": name, "status": str(PoseStatus.VIA)}
        row = passed if via else labels.pop(name)
        row |= dict(zip(joint_columns(robot.n), np.rad2deg(posture), strict=True))
        state = robot.state(posture)
        wpr_deg = np.rad2deg(wpr_from_rotation(state.R_base_tip))
        numbers = np.concatenate([1e3 * state.point(tool_m), wpr_deg])
        row |= dict(zip(POSE_AXES, numbers, strict=True))
        if shown:
            row |= dict(zip(pendant_columns(robot.n), shown.pendant(posture), strict=True))
        rows.append(row)
    rows += labels.values()  # dropped: they are on no route
    columns = ["name", "status", "reason", *joint_columns(robot.n), *POSE_AXES]
    return write_table(path, columns + (pendant_columns(robot.n) if shown else []), rows)


def _labels(poses: PoseSet, i: int) -> dict[str, object]:
    return {
        "name": poses.names[i],
        "status": str(poses.status[i]),
        "reason": poses.reasons[i],
    }


def read_poses(path: Path, n: int | None, *, trust_units: bool = False) -> PoseList:
    """Read the postures of a ``poses.csv``; dropped poses are passed over.

    Parameters
    ----------
    path : Path
    n : int or None
        Number of joints of the robot; None takes what the file has.
    trust_units : bool
        Do not refuse values that look like radians.
    """
    columns, rows = read_rows(path)
    count = n if n is not None else _count_joints(columns, path)
    check_columns(path, columns, joint_columns(count), joints=True)
    status = [_status(path, row) for row in rows]
    via = np.array([s is PoseStatus.VIA for s in status if s is not PoseStatus.DROPPED], dtype=bool)
    rows = [row for row, s in zip(rows, status, strict=True) if s is not PoseStatus.DROPPED]
    postures = _postures(path, rows, joint_columns(count), trust_units)
    names = tuple(row.cells.get("name") or f"P{i + 1:02d}" for i, row in enumerate(rows))
    if via.all():
        raise FileFormatError(
            "has no pose that is measured: all are via",
            path=path,
            column="status",
            hint="give at least one pose another status, or none",
        )
    return PoseList(names, postures, via)


def _status(path: Path, row: Row) -> PoseStatus:
    """What stands in the column status; a pose of the grid where nothing does."""
    text = row.cells.get("status", "")
    try:
        return PoseStatus(text.casefold() or PoseStatus.GRID)
    except ValueError as error:
        raise FileFormatError(
            f"there is no status {text[:_LONGEST_SHOWN]!r}",
            path=path,
            row=row.line,
            column="status",
            hint=near_names(text, [str(s) for s in PoseStatus]),
            value=text,
        ) from error


def write_touch_ups(path: Path, touch_ups: TouchUps, names: Sequence[str] | None = None) -> Path:
    """Write ``touchups.csv``."""
    n = touch_ups.postures.shape[-1]
    rows = []
    for i, (q, target) in enumerate(zip(touch_ups.postures, touch_ups.target, strict=True)):
        row: dict[str, object] = {"target": touch_ups.labels[target]}
        row |= dict(zip(joint_columns(n), np.rad2deg(q), strict=True))
        row["pose"] = names[i] if names is not None else f"P{i + 1:02d}"
        rows.append(row)
    return write_table(path, ["target", *joint_columns(n), "pose"], rows)


def read_touch_ups(
    path: Path, n: int, *, controller: Controller | None = None, trust_units: bool = False
) -> TouchUps:
    """Read a ``touchups.csv`` of a robot with n joints; targets in the order of appearance.

    Parameters
    ----------
    path : Path
    n : int
    controller : Controller, optional
        Turns ``pendant_j1_deg ..`` into joint values; without it such columns are refused.
    trust_units : bool
        Do not refuse values that look like radians.
    """
    columns, rows = read_rows(path)
    on_pendant = pendant_columns(n)[0] in columns and joint_columns(n)[0] not in columns
    if on_pendant and controller is None:
        raise FileFormatError(
            "holds what a pendant shows, and the robot's controller is not known",
            path=path,
            column=pendant_columns(n)[0],
            hint="set robot.controller in the cell",
        )
    joints = pendant_columns(n) if on_pendant else joint_columns(n)
    check_columns(path, columns, ["target", *joints], joints=True)
    labels = list(dict.fromkeys(row.cells["target"] for row in rows))
    for row in rows:
        if not row.cells["target"]:
            raise FileFormatError(
                "the target has no name",
                path=path,
                row=row.line,
                column="target",
                hint="name the point that was touched",
            )
    index = {label: i for i, label in enumerate(labels)}
    target = np.array([index[row.cells["target"]] for row in rows], dtype=np.intp)
    values = _postures(path, rows, joints, trust_units)
    if on_pendant and controller is not None:
        values = controller.posture(np.rad2deg(values))
    return TouchUps(values, target, tuple(labels))


def write_pairs(path: Path, pairs: Pairs) -> Path:
    """Write ``pairs.csv``."""
    rows = []
    for name, A, B in zip(pairs.names, pairs.A, pairs.B, strict=True):
        row: dict[str, object] = {"pose": name}
        for letter, T in (("a", A), ("b", B)):
            numbers = [*(1e3 * T[:3, 3]), *np.rad2deg(wpr_from_rotation(T[:3, :3]))]
            row |= dict(zip(pair_columns(letter), numbers, strict=True))
        rows.append(row)
    return write_table(path, ["pose", *pair_columns("a"), *pair_columns("b")], rows)


def read_pairs(path: Path) -> Pairs:
    """Read a ``pairs.csv``."""
    columns, rows = read_rows(path)
    check_columns(path, columns, [*pair_columns("a"), *pair_columns("b")])
    matrices = []
    for letter in "ab":
        numbers = _numbers(path, rows, pair_columns(letter))
        rotation = rotation_from_wpr(np.deg2rad(numbers[:, 3:]))
        matrices.append(transform(rotation, numbers[:, :3] / 1e3))
    names = tuple(row.cells.get("pose") or f"P{i + 1:02d}" for i, row in enumerate(rows))
    return Pairs(names, *matrices)


def pair_columns(letter: str) -> list[str]:
    """``a_x_mm`` to ``a_r_deg``."""
    return [f"{letter}_{axis}" for axis in POSE_AXES]


def read_rows(path: Path) -> tuple[list[str], list[Row]]:
    """Header and rows of a CSV file with a header line; lines with # before it are passed over.

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
    columns: list[str] = []
    rows: list[Row] = []
    try:
        for cells in reader:
            if not any(cells) or (not columns and cells[0].startswith("#")):
                continue
            stripped = [_unescaped(cell.strip()) for cell in cells]
            if not columns:
                columns = stripped
                _check_separator(path, reader.line_num, columns)
                continue
            if len(stripped) != len(columns):
                raise FileFormatError(
                    f"has {len(stripped)} cells, the header has {len(columns)}",
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


def _count_joints(columns: Sequence[str], path: Path) -> int:
    count = sum(bool(re.fullmatch(r"j\d+_deg", c)) for c in columns)
    if not count:
        check_columns(path, columns, ["j1_deg"])
    return count


def _postures(
    path: Path, rows: Sequence[Row], columns: Sequence[str], trust_units: bool
) -> FloatArray:
    if not rows:
        raise FileFormatError("has no pose that was not dropped", path=path)
    degrees = _numbers(path, rows, columns)
    largest = float(np.abs(degrees).max())
    if not trust_units and len(rows) >= 3 and 0 < largest <= 2 * math.pi:
        raise FileFormatError(
            f"the joint values look like radians (the largest is {largest:.4g})",
            path=path,
            column=f"{columns[0]} to {columns[-1]}",
            hint="multiply them by 57.29578, or pass --trust-units if they really are degrees",
            value=largest,
            bound=2 * math.pi,
        )
    return np.deg2rad(degrees)


def _numbers(path: Path, rows: Sequence[Row], columns: Sequence[str]) -> FloatArray:
    """Cells as numbers, ``(rows, columns)``."""
    out = np.empty((len(rows), len(columns)))
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            text = row.cells[column]
            out[i, j] = float(text) if _NUMBER.fullmatch(text) else math.nan
            if not math.isfinite(out[i, j]):
                shown = repr(text[:_LONGEST_SHOWN]) if text else "an empty cell"
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
