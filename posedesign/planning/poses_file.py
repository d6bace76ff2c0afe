"""``poses.csv``: written from a plan or a list, and read.

Columns: see :mod:`posedesign.planning.tables`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError, near_names
from calib.robots import Controller, Robot
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.files import StrPath
from posedesign.files.csv_tables import (
    LONGEST_SHOWN,
    Row,
    Table,
    as_read,
    check_columns,
    read_table,
    write_table,
)
from posedesign.files.measurements import PLACE, TURN
from posedesign.files.postures import (
    JointForm,
    cells_of,
    columns_of,
    find_form,
    joint_columns,
    pendant_columns,
    postures_in_any_form,
    postures_of,
)
from posedesign.motion.route import Route
from posedesign.planning.pose_list import (
    ALL_CHECKED,
    NOT_CHECKED,
    STOPS_SHORT,
    DroppedPose,
    PoseList,
)
from posedesign.planning.pose_margins import MARGIN_COLUMNS, Margins
from posedesign.planning.pose_plan import PoseSet, PoseStatus
from posedesign.selection import Indices

POSE_AXES = (*PLACE, *TURN)

_LABELS = ("name", "order", "status", "reason")
_KNOWN = (*_LABELS, *POSE_AXES, "configuration", *MARGIN_COLUMNS)
"""Columns besides those of the joints that are written anew, and so are not kept from a file."""

_WRITTEN_ANEW = ("units", "poses measured", "origin")
"""Comments that are not kept from a file, either."""


def write_poses(
    path: StrPath,
    robot: Robot,
    poses: PoseSet,
    route: Route,
    tool_m: FloatArray,
    *,
    margins: Margins | None = None,
    indices: Indices | None = None,
    title: str = "measuring poses",
    not_checked: Sequence[str] | None = None,
    stop_short_mm: float = 0.0,
) -> Path:
    """Write ``poses.csv``: the stops of a route through the kept poses, then what was dropped.

    ``tool_m`` (3,): tool point in the tip frame [m]. ``margins``: of the stops of the route.
    ``indices``: of the poses, for the comments before the header. ``title``: what the poses are,
    for the same. ``not_checked``: what planning did not look at (:attr:`.Cell.not_checked`), for
    the same; None where nobody knows. ``stop_short_mm``: how far before the poses programs are to
    stop, for the same.
    """
    listed = PoseList.of_route(poses, route)
    comments = [f"posedesign: {title} of {robot.name}", f"fingerprint: {listed.fingerprint}"]
    if robot.controller is not None:
        comments.append(f"controller: {robot.controller.maker}")
    if indices is not None:
        values = indices.as_dict()
        del values["poses"]  # said already
        comments += [f"{name}: {value:.12g}" for name, value in values.items()]
    if stop_short_mm:
        comments.append(f"{STOPS_SHORT}: {stop_short_mm:g}")
    if not_checked is not None:
        comments += [f"{NOT_CHECKED}: {said}" for said in not_checked or (ALL_CHECKED,)]
    return _write(path, listed, robot, tool_m, JointForm.USUAL, margins, comments)


def write_pose_list(
    path: StrPath,
    poses: PoseList,
    robot: Robot,
    tool_m: FloatArray,
    *,
    margins: Margins | None = None,
    form: JointForm = JointForm.USUAL,
) -> Path:
    """Write a list of poses again, with the columns and comments that posedesign does not know.

    The fingerprint of the file that the list was read from is kept: where the postures are others
    by now, readers see it. What follows from the postures (x y z, W P R, configuration) is written
    anew, and margins only where they are given.

    ``tool_m`` (3,): tool point in the tip frame [m]. ``margins``: of the poses of the list.
    ``form``: for RoboDK there are neither comments nor dropped poses: other programs may take them
    for numbers.
    """
    comments = [c for c in poses.comments if c.partition(":")[0].strip() not in _WRITTEN_ANEW]
    if not comments:
        comments = [f"posedesign: poses of {robot.name}"]
    if not poses.fingerprint_written:
        comments.append(f"fingerprint: {poses.fingerprint}")
    return _write(path, poses, robot, tool_m, form, margins, comments)


def _write(
    path: StrPath,
    poses: PoseList,
    robot: Robot,
    tool_m: FloatArray,
    form: JointForm,
    margins: Margins | None,
    comments: Sequence[str],
) -> Path:
    shown = robot.controller if robot.controller and robot.controller.differs else None
    joints, words = columns_of(form, robot), _configurations(robot, poses.postures)
    pendant = pendant_columns(robot.n) if shown and form is JointForm.USUAL else []
    known = {} if margins is None else margins.columns
    columns = [*_LABELS, *joints, *POSE_AXES, "configuration", *pendant, *known]
    if form is JointForm.ROBODK:
        columns = [*joints, *(column for column in columns if column not in joints)]
    extra = [column for column in poses.extra if column not in columns]
    state = robot.state(poses.postures)
    wpr_deg = np.rad2deg(wpr_from_rotation(state.R_base_tip))
    numbers = np.hstack([1e3 * state.point(tool_m), wpr_deg])
    rows: list[dict[str, object]] = []
    for i, (name, posture) in enumerate(zip(poses.names, poses.postures, strict=True)):
        status = PoseStatus.VIA if poses.via[i] else PoseStatus.GRID
        row: dict[str, object] = {"name": name, "order": i + 1}
        row["status"] = (poses.status[i] if poses.status else "") or str(status)
        row["reason"] = poses.reasons[i] if poses.reasons else ""
        row |= dict(zip(joints, cells_of(form, robot, posture), strict=True))
        row |= dict(zip(POSE_AXES, numbers[i], strict=True))
        row["configuration"] = words[i]
        if shown and pendant:
            row |= dict(zip(pendant, shown.pendant(posture), strict=True))
        row |= {column: values[i] for column, values in known.items()}
        row |= {column: as_read(poses.extra[column][i]) for column in extra}
        rows.append(row)
    if form is JointForm.ROBODK:
        return write_table(path, [*columns, *extra], rows)
    for lost in poses.dropped:
        row = {"name": lost.name, "status": str(PoseStatus.DROPPED), "reason": lost.reason}
        rows.append(row | {column: as_read(lost.extra.get(column, "")) for column in extra})
    comments = [*comments, f"poses measured: {int((~poses.via).sum())}", f"units: {_UNITS[form]}"]
    return write_table(path, [*columns, *extra], rows, comments)


_UNITS = {
    JointForm.USUAL: "mm and deg and px as the names of columns end - base frame",
    JointForm.ROS: "rad and mm and deg and px as the names of columns end - base frame",
}


def _configurations(robot: Robot, postures: FloatArray) -> list[str]:
    """Arm positions in the words of the robot's controller; empty where there are none for it."""
    from posedesign.programs.configuration import words  # programs are read with these tables

    try:
        return words(robot, postures)
    except InputError:  # an arm of another kind than those that the maker has words for
        return [""] * len(postures)


def read_poses(
    path: Path, n: int | None, *, controller: Controller | None = None, trust_units: bool = False
) -> PoseList:
    """Read the postures of a ``poses.csv``.

    ``n``: number of joints of the robot; None takes what the file has. ``controller``: turns
    ``pendant_j1_deg ..`` into joint values; without it such columns alone are refused.
    ``trust_units``: do not refuse values that look like radians.
    """
    table = read_table(path)
    columns = table.columns
    _refuse_other_form(path, columns)
    count = n if n is not None else _count_joints(columns, path)
    joints = [*joint_columns(count), *pendant_columns(count)]
    return _listed(
        path,
        table,
        joints,
        lambda rows: postures_of(path, columns, rows, count, controller, trust_units),
    )


def read_robot_poses(path: Path, robot: Robot, *, trust_units: bool = False) -> PoseList:
    """Read the postures of a table of a known robot, in any :class:`JointForm`."""
    table = read_table(path)
    columns = table.columns
    joints = [*joint_columns(robot.n), *pendant_columns(robot.n), *find_form(columns, robot)[1]]
    return _listed(
        path,
        table,
        joints,
        lambda rows: postures_in_any_form(path, columns, rows, robot, trust_units),
    )


def _listed(
    path: Path,
    table: Table,
    joints: Sequence[str],
    postures_of_rows: Callable[[Sequence[Row]], FloatArray],
) -> PoseList:
    status = [_status(path, row) for row in table.rows]
    pairs = list(zip(table.rows, status, strict=True))
    rows = [row for row, s in pairs if s is not PoseStatus.DROPPED]
    via = np.array([s is PoseStatus.VIA for s in status if s is not PoseStatus.DROPPED], dtype=bool)
    postures = postures_of_rows(rows)
    if via.all():
        raise FileFormatError(
            "has no pose that is measured: all are via",
            path=path,
            column="status",
            hint="give at least one pose another status, or none",
        )
    extra = [column for column in table.columns if column not in {*_KNOWN, *joints}]
    return PoseList(
        names=tuple(row.cells.get("name") or f"P{i + 1:02d}" for i, row in enumerate(rows)),
        postures=postures,
        via=via,
        status=tuple(str(s) for s in status if s is not PoseStatus.DROPPED),
        reasons=tuple(row.cells.get("reason", "") for row in rows),
        extra={column: tuple(row.cells[column] for row in rows) for column in extra},
        dropped=tuple(_dropped(row.cells, extra) for row, s in pairs if s is PoseStatus.DROPPED),
        comments=tuple(table.comments),
    )


def _dropped(cells: Mapping[str, str], extra: Sequence[str]) -> DroppedPose:
    kept = {column: cells[column] for column in extra}
    return DroppedPose(cells.get("name", ""), cells.get("reason", ""), kept)


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


def _refuse_other_form(path: Path, columns: Sequence[str]) -> None:
    """Names of ROS and RoboDK say nothing without the robot that they are of."""
    if any(re.fullmatch(r"(pendant_)?j\d+_(deg|rad)", column) for column in columns):
        return
    other = next((c for c in columns if re.fullmatch(r"J\d+|.+_rad", c)), None)
    if other is not None:
        raise FileFormatError(
            "names a joint as ROS or RoboDK do: the robot must be known",
            path=path,
            row=1,
            column=other,
            hint="first run: posedesign convert FILE --cell cell.toml --to usual --out poses.csv",
        )


def _count_joints(columns: Sequence[str], path: Path) -> int:
    count = sum(bool(re.fullmatch(r"j\d+_deg", c)) for c in columns)
    if not count:
        check_columns(path, columns, ["j1_deg"])
    return count
