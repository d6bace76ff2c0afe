"""Joint columns of tables: ``j1_deg ..`` in URDF signs, or ``pendant_j1_deg ..``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.robots import Controller
from calib.se3 import FloatArray
from posedesign.csv_tables import Row, check_columns, numbers_of

PENDANT_AGREES_DEG = 0.01
"""Joint values and pendant values of one row may differ by as much: pendants show few decimals."""


def joint_columns(n: int) -> list[str]:
    """``j1_deg`` to ``jn_deg``."""
    return [f"j{i + 1}_deg" for i in range(n)]


def pendant_columns(n: int) -> list[str]:
    """``pendant_j1_deg`` to ``pendant_jn_deg``."""
    return [f"pendant_{column}" for column in joint_columns(n)]


def postures_of(
    path: Path,
    columns: Sequence[str],
    rows: Sequence[Row],
    n: int,
    controller: Controller | None,
    trust_units: bool,
) -> FloatArray:
    """Postures ``(rows, n)`` [rad] of the joint columns, or else of the pendant's."""
    if not rows:
        raise FileFormatError("has no pose that was not dropped", path=path)
    own, shown = joint_columns(n), pendant_columns(n)
    if shown[0] in columns and own[0] not in columns:
        if controller is None:
            raise FileFormatError(
                "holds what a pendant shows, and the robot's controller is not known",
                path=path,
                column=shown[0],
                hint="set robot.controller in the cell",
            )
        check_columns(path, columns, shown)
        return controller.posture(_degrees(path, rows, shown, trust_units))
    check_columns(path, columns, own, joints=True)
    postures = np.deg2rad(_degrees(path, rows, own, trust_units))
    there = [k for k, column in enumerate(shown) if column in columns]
    if controller is not None and there:
        shown = [shown[k] for k in there]
        off = controller.pendant(postures)[:, there] - numbers_of(path, rows, shown)
        worst = np.unravel_index(int(np.argmax(np.abs(off))), off.shape)
        if abs(off[worst]) > PENDANT_AGREES_DEG:
            raise FileFormatError(
                f"is {abs(off[worst]):.3g} deg off what {own[0]} to {own[-1]} make it",
                path=path,
                row=rows[int(worst[0])].line,
                column=shown[int(worst[1])],
                hint="leave out the columns that are not what the arm did",
            )
    return postures


def _degrees(
    path: Path, rows: Sequence[Row], columns: Sequence[str], trust_units: bool
) -> FloatArray:
    degrees = numbers_of(path, rows, columns)
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
    return degrees
