"""CSV files in and out: the one definition of every column.

======================  =========================================================================
``poses.csv``           ``name, status, reason, j1_deg .. jn_deg, x_mm, y_mm, z_mm, w_deg, p_deg,
                        r_deg``: joints in URDF signs; x, y, z of the tool point and W, P, R of
                        the tip in the base frame; in the order in which they are visited. A pose
                        is of the ``grid``, ``repaired``, ``chosen`` out of a pool, or
                        ``dropped``, and then has no numbers; with the status ``via`` it is passed
                        through and not measured. Where the pendant shows other joint values,
                        they follow as ``pendant_j1_deg ..``.
``touchups.csv``        ``target, j1_deg .. jn_deg, pose``: one row a touch-up, joints as the
                        controller showed them, in URDF signs; ``pose`` may be left out. In place
                        of ``j1_deg ..`` there may be ``pendant_j1_deg ..``, as read off the
                        pendant. See :mod:`posedesign.measurement_table` for other kinds.
``pairs.csv``           ``pose, a_x_mm .. a_r_deg, b_x_mm .. b_r_deg``: A = T_base_tip as the
                        controller shows it, B = T_target_camera, as x y z and W P R. See
                        :mod:`posedesign.pairs_file` for other forms.
======================  =========================================================================

Files are hostile until read: size, encoding, header, every number, and degrees that are radians.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, near_names
from calib.measurement import Measurements
from calib.robots import Controller, Robot
from calib.se3 import BoolArray, FloatArray, wpr_from_rotation
from posedesign.csv_tables import LONGEST_SHOWN, Row, check_columns, read_rows, write_table
from posedesign.measurement_table import PLACE, TURN, read_measurements, write_measurements
from posedesign.pairs_file import Pairs, pair_columns, read_pairs, write_pairs
from posedesign.pose_plan import PoseSet, PoseStatus, named_stops
from posedesign.postures_table import joint_columns, pendant_columns, postures_of
from posedesign.route import Route

__all__ = [
    "POSE_AXES",
    "Pairs",
    "PoseList",
    "pair_columns",
    "read_pairs",
    "read_poses",
    "read_touch_ups",
    "write_pairs",
    "write_poses",
    "write_touch_ups",
]

POSE_AXES = (*PLACE, *TURN)


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


def write_poses(path: Path, robot: Robot, poses: PoseSet, route: Route, tool_m: FloatArray) -> Path:
    """Write ``poses.csv``: the stops of a route through the kept poses, then what was dropped."""
    shown = robot.controller if robot.controller and robot.controller.differs else None
    labels = {name: _labels(poses, i) for i, name in enumerate(poses.names)}
    rows: list[dict[str, object]] = []
    for (name, posture, via), stop in zip(named_stops(poses, route), route.stops, strict=True):
        passed: dict[str, object] = {"name": name, "status": str(PoseStatus.VIA)}
        row = passed | {"reason": str(stop.passing)} if via else labels.pop(name)
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


def read_poses(
    path: Path,
    n: int | None,
    *,
    controller: Controller | None = None,
    trust_units: bool = False,
) -> PoseList:
    """Read the postures of a ``poses.csv``; dropped poses are passed over.

    Parameters
    ----------
    path : Path
    n : int or None
        Number of joints of the robot; None takes what the file has.
    controller : Controller, optional
        Turns ``pendant_j1_deg ..`` into joint values; without it such columns alone are refused.
    trust_units : bool
        Do not refuse values that look like radians.
    """
    columns, rows = read_rows(path)
    count = n if n is not None else _count_joints(columns, path)
    status = [_status(path, row) for row in rows]
    via = np.array([s is PoseStatus.VIA for s in status if s is not PoseStatus.DROPPED], dtype=bool)
    rows = [row for row, s in zip(rows, status, strict=True) if s is not PoseStatus.DROPPED]
    postures = postures_of(path, columns, rows, count, controller, trust_units)
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
            f"there is no status {text[:LONGEST_SHOWN]!r}",
            path=path,
            row=row.line,
            column="status",
            hint=near_names(text, [str(s) for s in PoseStatus]),
            value=text,
        ) from error


def write_touch_ups(path: Path, data: Measurements, names: Sequence[str] | None = None) -> Path:
    """Write ``touchups.csv``: all of the kind of the cell that they are read for."""
    return write_measurements(path, data if names is None else replace(data, names=tuple(names)))


def read_touch_ups(
    path: Path, n: int, *, controller: Controller | None = None, trust_units: bool = False
) -> Measurements:
    """Read a ``touchups.csv`` of a robot with n joints; targets in the order of appearance.

    Parameters
    ----------
    path : Path
    n : int
    controller : Controller, optional
        Turns ``pendant_j1_deg ..`` into joint values; without it such columns alone are refused.
    trust_units : bool
        Do not refuse values that look like radians.
    """
    table = read_measurements(path, n, controller=controller, trust_units=trust_units)
    if table.kinds != ("touch-up",):
        raise FileFormatError(
            f"holds measurements of the kinds {', '.join(table.kinds)}",
            path=path,
            column="kind",
            hint="read it with posedesign.measurement_table.read_measurements",
        )
    return table.data


def _count_joints(columns: Sequence[str], path: Path) -> int:
    count = sum(bool(re.fullmatch(r"j\d+_deg", c)) for c in columns)
    if not count:
        check_columns(path, columns, ["j1_deg"])
    return count
