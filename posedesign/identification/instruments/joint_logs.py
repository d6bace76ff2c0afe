"""Joints as controllers log them, one row a pose or a record without end.

=============  ====================================================================================
RTDE           columns ``actual_q_0 ..`` [rad] and ``timestamp`` [s], with commas or spaces: the
               recorders of ur_rtde and of Universal Robots' RTDE client
EGM            ``R_FB_POS_RJ1 ..`` [deg] and ``TIMESTAMP`` [ms]: ``EGMLogger`` of ABB's
               abb_libegm, units as in its ``egm_wrapper.proto``; of axes that slide and carry the
               arm ``R_FB_POS_EJ1 ..`` [mm], as in ABB's ``egm.proto``
RSI            ``<AIPos A1="..">`` [deg] and ``<IPOC>`` [ms] of telegrams of a KUKA, or columns of
               these names: ``AIPos.A1 ..`` or ``A1 ..``, and ``IPOC``; of such axes
               ``<EIPos E1="..">`` [mm], ``EIPos.E1 ..`` or ``E1 ..``
rostopic       ``field.name0 ..``, ``field.position0 ..`` [rad] and ``%time`` [ns]:
               ``rostopic echo -p`` of a ``sensor_msgs/JointState``
ros2 topic     ``ros2 topic echo --csv``, without names of columns: seconds, nanoseconds, frame,
               names, positions [rad], then the rest
PlotJuggler    ``/topic/<joint>/position`` [rad] and ``__time`` [s]; what slides is in [m] in all
               three, as ``sensor_msgs/JointState`` has it
=============  ====================================================================================

The first three are in the signs of their controllers. Other tables have the columns of
:mod:`posedesign.files.postures` with ``time_s`` or ``pose``, or those that the cell names; robot
programs and lists for ROS or RoboDK have joints in order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.robots import HeldJoint, Robot
from calib.se3 import FloatArray, IntArray
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files.csv_tables import (
    LARGEST_NUMBER,
    LONGEST_SHOWN,
    Row,
    Table,
    is_number,
    number_of,
    numbers_of,
    parse_table,
)
from posedesign.files.postures import (
    check_at_rest,
    find_form,
    joint_columns,
    postures_in_any_form,
)
from posedesign.identification.instruments.readings import SECONDS, near, seconds_of, text_of
from posedesign.programs.reading import EXTERNAL_AT_REST

TABLES = (".csv", ".txt", ".tsv", ".dat", ".log", ".xml")
"""Endings of tables and logs; all others are of programs and lists."""

MOST_EXTERNAL = 6
"""External axes of a KUKA or an ABB."""

LARGEST_DEG = 1e3
"""No joint turns so far: such a number is damage."""


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of joints of a file.

    ``lines`` (R,). ``postures`` (R, n): [rad], signs of the description. ``times`` (R,): rising
    [s]. ``names``: of poses; none where the file does not say.
    """

    path: Path
    lines: IntArray
    postures: FloatArray
    times: FloatArray | None = None
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Log:
    """Columns of a controller's log; ``{}`` is the number of the joint.

    ``external``: of external axes [mm, deg]; empty where it has none.
    """

    name: str
    joint: str
    first: int
    unit: str
    time: str
    time_unit: str
    maker: str = ""
    external: str = ""


_LOGS = (
    Log("RTDE", "actual_q_{}", 0, "rad", "timestamp", "s", "ur"),
    Log("EGM", "R_FB_POS_RJ{}", 1, "deg", "TIMESTAMP", "ms", "abb", "R_FB_POS_EJ{}"),
    Log("RSI", "AIPos.A{}", 1, "deg", "IPOC", "ms", "kuka", "EIPos.E{}"),
    Log("RSI", "A{}", 1, "deg", "IPOC", "ms", "kuka", "E{}"),
    Log("rostopic", "field.position{}", 0, "rad", "%time", "ns"),
)

_TELEGRAM = re.compile(r"<([AE]IPos)\b([^<>]{0,2000})>|<IPOC>\s*(\d{1,15})\s*</IPOC>")
_AXIS = re.compile(r"\b([AE]\d)\s*=\s*[\"']([^\"'<>]{0,40})[\"']")


def read_joint_rows(
    path: Path, robot: Robot, section: InstrumentSection, *, trust_units: bool = False
) -> JointRows:
    """Read the joints of a file.

    Raises FileFormatError: naming file, line and column; joints of another maker's controller;
    times that go back.
    """
    if path.suffix.casefold() not in TABLES:
        return _of_program(path, robot, None)
    text = text_of(path)
    rows = _rows_of(path, text, robot, section, trust_units)
    if rows.times is not None:
        rows = _in_order(rows, rows.times)
    turned = np.rad2deg(np.abs(rows.postures[:, robot.n_external :]).max(axis=1))
    if turned.max() > LARGEST_DEG:
        raise FileFormatError(
            f"a joint value is {turned.max():.4g} deg",
            path=path,
            row=int(rows.lines[turned.argmax()]),
            hint="are the joints in another unit?",
        )
    return rows


def _rows_of(
    path: Path, text: str, robot: Robot, section: InstrumentSection, trust_units: bool
) -> JointRows:
    if "<AIPos" in text[:100_000]:
        return _of_telegrams(path, text, robot)
    first = next((line for line in text.split("\n") if line.strip()), "")
    cells = re.split(r"[,;\t ]", first.strip())
    if _is_ros2(cells):
        return _of_ros2(path, text, len(first.split(",")), robot)
    if section.joint_header:
        table = parse_table(path, text, section.joint_header, loose=True)
        return _of_columns(path, table, section, robot)
    if all(map(is_number, filter(None, cells))):
        return _of_program(path, robot, "robodk-csv")
    columns = re.split(r"[,;\t]", first) if re.search("[,;\t]", first) else first.split()
    log, needed = _log_of([c.strip() for c in columns], robot)
    if log is not None:
        named = {
            c.strip() for c in columns if re.fullmatch(r"field\.(name|position)\d+", c.strip())
        }
        kept = {*needed, log.time} | named
        beyond = _not_described(log, robot)
        table = parse_table(path, text, loose=True, only={*kept, *beyond})
        for axis in (c for c in beyond if c in table.columns):
            rows = [row for row in table.rows if is_number(row.cells[axis])]
            values = numbers_of(path, rows, [axis])[:, 0]
            check_at_rest(path, axis, [row.line for row in rows], values, EXTERNAL_AT_REST)
        return _of_log(path, table, log, needed, robot)
    table = parse_table(path, text, loose=True)
    if section.columns.joints:
        return _of_columns(path, table, section, robot)
    ros = _plotjuggler(table, robot)
    if ros:
        for joint in robot.held:
            topic = (c for c in table.columns if c.endswith(f"/{joint.name}/position"))
            _check_held(path, table, joint, next(topic, ""))
        return _with_times(path, table, table.rows, numbers_of(path, table.rows, ros), "__time")
    rows = [row for row in table.rows if row.cells.get("status") not in ("via", "dropped")]
    if not {*find_form(table.columns, robot)[1]} & {*table.columns}:
        raise FileFormatError(
            "has no joints under names that are known",
            path=path,
            row=1,
            hint="call them j1_deg .., or name them in instrument.columns.joints",
        )
    postures = postures_in_any_form(path, table.columns, rows, robot, trust_units)
    pose = "pose" if "pose" in table.columns else "name"  # as lists of poses call it
    return _with_times(path, table, rows, postures, "time_s", pose=pose)


def _with_times(
    path: Path,
    table: Table,
    rows: Sequence[Row],
    postures: FloatArray,
    time: str,
    factor: float = 1.0,
    pose: str = "",
) -> JointRows:
    """Rows with their times and names, where a table has these columns."""
    return JointRows(
        path,
        np.array([row.line for row in rows]),
        postures,
        seconds_of(path, rows, time, factor) if time in table.columns else None,
        tuple(row.cells[pose] for row in rows) if pose in table.columns else (),
    )


def _log_of(columns: Sequence[str], robot: Robot) -> tuple[Log | None, list[str]]:
    """The log that most columns of the joints are of, and all that it should have.

    Those of external axes come first, as in a posture; where they have names, all are joints.
    """
    for log in _LOGS:
        turning = robot.n - robot.n_external if log.maker else robot.n
        needed = [log.joint.format(k + log.first) for k in range(turning)]
        if 2 * len({*needed} & {*columns}) >= turning:
            external = [log.external.format(k + 1) for k in range(robot.n - turning)]
            return log, [*filter(None, external), *needed]
    return None, []


def _not_described(log: Log, robot: Robot) -> list[str]:
    """Columns of external axes that the robot's description does not have."""
    numbers = range(robot.n_external + 1, MOST_EXTERNAL + 1)
    return [log.external.format(k) for k in numbers] if log.external else []


def _of_log(path: Path, table: Table, log: Log, needed: list[str], robot: Robot) -> JointRows:
    for column in needed:
        if column not in table.columns:
            raise FileFormatError(
                f"is a log of {log.name} without the column {column}",
                path=path,
                row=1,
                hint=near(column, table.columns),
            )
    names = [c for c in table.columns if c.startswith("field.name")]
    if names:  # all joints of the message, of which the robot's are some
        needed = [name.replace("name", "position") for name in names]
        needed = [needed[k] for k in _order(path, table, names, needed, robot)]
    postures = _of_controller(path, numbers_of(path, table.rows, needed), log, robot)
    return _with_times(path, table, table.rows, postures, log.time, SECONDS[log.time_unit])


def _of_controller(path: Path, values: FloatArray, log: Log, robot: Robot) -> FloatArray:
    """Postures [rad, m] of what a controller logs, external axes first [mm]."""
    if values.shape[1] < robot.n or robot.external.positioner:
        turns = bool(robot.external.positioner)
        raise FileFormatError(
            f"is a log of {log.name}, which "
            + ("is not read beside a positioner" if turns else "has no external axes"),
            path=path,
            hint=f"give a table with {min(joint_columns(robot.n, robot.external))}, j1_deg ..",
        )
    if log.unit == "rad":
        largest = float(np.abs(values[:, robot.n_external :]).max())
        if largest > 4.0 * np.pi:
            raise FileFormatError(
                f"a log of {log.name} is in radians, and its largest value is {largest:.4g}",
                path=path,
                hint="was it converted to degrees? Give it as it was recorded, or as j1_deg ..",
            )
        if not log.maker:
            return values
        values = np.rad2deg(values)
    if robot.controller is None or robot.controller.maker != log.maker:
        here = "is not known" if robot.controller is None else f"is of {robot.controller.maker}"
        raise FileFormatError(
            f"is a log of {log.name}, of a controller of {log.maker}, and the robot's {here}",
            path=path,
            hint="is it the log of this robot? set robot.controller in the cell",
        )
    return robot.controller.posture(values)


def _check_held(path: Path, table: Table, joint: HeldJoint, column: str) -> None:
    """Refuse a joint that the cell holds, and that is elsewhere in its column [rad, m]."""
    if column:
        values = joint.per_si * numbers_of(path, table.rows, [column])[:, 0]
        held = joint.per_si * joint.value
        check_at_rest(path, joint.name, [row.line for row in table.rows], values, held=held)


def _order(
    path: Path, table: Table, columns: Sequence[str], values: Sequence[str], robot: Robot
) -> list[int]:
    """Places of the robot's joints among those that every row names in these columns.

    ``values``: columns of their values. Joints that the cell holds are checked.
    """
    said = [table.rows[0].cells[column] for column in columns]
    for row in table.rows:
        if [row.cells[column] for column in columns] != said:
            raise FileFormatError(
                "has the joints in another order than the first row",
                path=path,
                row=row.line,
                hint="give the states of one robot",
            )
    for joint in robot.joint_names:
        if joint not in said:
            raise FileFormatError(f"has no joint {joint}", path=path, row=1, hint=near(joint, said))
    for held in robot.held:
        if held.name in said:
            _check_held(path, table, held, values[said.index(held.name)])
    return [said.index(joint) for joint in robot.joint_names]


def _plotjuggler(table: Table, robot: Robot) -> list[str]:
    found = [
        next((c for c in table.columns if c.endswith(f"/{joint}/position")), "")
        for joint in robot.joint_names
    ]
    return found if all(found) else []


def _is_ros2(cells: Sequence[str]) -> bool:
    """Seconds of this century, nanoseconds, and no names of columns."""
    return len(cells) > 4 and re.fullmatch(r"\d{9,10}", cells[0]) is not None and cells[1].isdigit()


def _of_ros2(path: Path, text: str, width: int, robot: Robot) -> JointRows:
    header = [f"c{k}" for k in range(width)]
    table = parse_table(path, text, header)
    first = list(table.rows[0].cells.values())
    count = next((k for k, cell in enumerate(first[3:]) if is_number(cell)), 0)
    if width < 3 + 2 * count or count < robot.n:
        raise FileFormatError(
            f"names {count} joints, the robot has {robot.n}",
            path=path,
            row=table.rows[0].line,
            hint="record all of sensor_msgs/JointState: names, then positions",
        )
    order = _order(path, table, header[3 : 3 + count], header[3 + count :], robot)
    values = numbers_of(path, table.rows, header[3 + count : 3 + 2 * count])[:, order]
    clock = numbers_of(path, table.rows, header[:2])
    rows = _with_times(path, table, table.rows, values, "")
    return replace(rows, times=clock[:, 0] + 1e-9 * clock[:, 1])


def _of_telegrams(path: Path, text: str, robot: Robot) -> JointRows:
    """Telegrams of RSI: no XML parser is needed, and entities are not expanded."""
    values: list[list[float]] = []
    times: list[float] = []
    lines: list[int] = []
    external: list[list[float]] = []
    others: dict[str, list[tuple[int, float]]] = {}  # of axes that the description does not have
    line = at = 0
    for found in _TELEGRAM.finditer(text):
        line, at = line + text.count("\n", at, found.start()), found.start()
        if found[3] is not None:
            if times and np.isnan(times[-1]):
                times[-1] = float(found[3]) * SECONDS["ms"]
            continue
        carriers = found[1] == "EIPos"
        count = robot.n_external if carriers else robot.n - robot.n_external
        row = _axes_in(found, count, path, line + 1)
        if carriers:
            external.append(row)
            for axis, cell in _AXIS.findall(found[2]):
                if int(axis[1]) > count and is_number(cell):
                    value = number_of(cell)
                    others.setdefault(axis, []).append((line + 1, value))
            continue
        values.append(row)
        times.append(np.nan)
        lines.append(line + 1)
    for axis, cells in others.items():
        there = np.array([value for _, value in cells])
        check_at_rest(path, f"{axis} of EIPos", [row for row, _ in cells], there, EXTERNAL_AT_REST)
    if not values:
        raise FileFormatError("has no AIPos with values", path=path, hint="is it a log of RSI?")
    timed = np.isfinite(times)
    if timed.any() and not timed.all():
        raise FileFormatError(
            "has no IPOC with this AIPos, and others have",
            path=path,
            row=lines[int(timed.argmin())],
            hint="log both, or no IPOC",
        )
    if robot.n_external and len(external) != len(values):
        raise FileFormatError(
            f"has {len(external)} EIPos for {len(values)} AIPos, and axes carry the arm",
            path=path,
            hint="log EIPos in every telegram: DEF_EIPos",
        )
    shown = np.hstack([external, values]) if robot.n_external else np.array(values)
    postures = _of_controller(path, shown, _LOGS[2], robot)
    return JointRows(path, np.array(lines), postures, np.array(times) if timed.all() else None)


def _axes_in(found: re.Match[str], count: int, path: Path, row: int) -> list[float]:
    """The first so many values of an AIPos or EIPos."""
    axes, letter = dict(_AXIS.findall(found[2])), found[1][0]
    texts = [axes.get(f"{letter}{k + 1}", "") for k in range(count)]
    values = [number_of(cell) for cell in texts]
    if not np.isfinite(values).all():
        bad = int(np.isfinite(values).argmin())
        raise FileFormatError(
            f"{letter}{bad + 1} of {found[1]} is {texts[bad][:LONGEST_SHOWN]!r}, not a number "
            f"within {LARGEST_NUMBER:g}",
            path=path,
            row=row,
            hint=f"log {found[1]} with {letter}1 to {letter}{count}",
        )
    return values


def _of_columns(path: Path, table: Table, section: InstrumentSection, robot: Robot) -> JointRows:
    """Joints under the names that the cell gives."""
    needed = section.columns.joints or section.joint_header
    for column in needed:
        if column not in table.columns:
            raise FileFormatError(
                f"there is no column {column}",
                path=path,
                row=1,
                hint=f"{near(column, table.columns)}; instrument.columns.joints names them",
            )
    values = numbers_of(path, table.rows, needed)
    time = next((c for c in (section.columns.time, "time_s") if c in table.columns), "")
    pose = next((c for c in (section.columns.pose, "pose") if c in table.columns), "")
    factor = SECONDS[section.time_unit] if time == section.columns.time else 1.0
    postures = joints_of(path, values, section, robot)
    return _with_times(path, table, table.rows, postures, time, factor, pose)


def joints_of(
    path: Path, values: FloatArray, section: InstrumentSection, robot: Robot
) -> FloatArray:
    """Postures [rad] of columns that the cell names, in its unit and signs."""
    if values.shape[1] != robot.n:
        raise FileFormatError(
            f"{values.shape[1]} columns of joints are named, and the robot has {robot.n}",
            path=path,
            hint="name them from the base on in instrument.columns.joints",
        )
    if robot.n_external:
        raise FileFormatError(
            "has joints by columns of its own, and the arm stands on a slide",
            path=path,
            hint="give a table with e1_mm, j1_deg ..",
        )
    if section.joint_unit is None:
        raise FileFormatError(
            "the unit of its joints is not said",
            path=path,
            hint='say it in the cell: instrument.joint_unit = "deg" or "rad"',
        )
    degrees = np.rad2deg(values) if section.joint_unit == "rad" else values
    largest = float(np.abs(values).max(initial=0.0))
    limit = 4.0 * np.pi if section.joint_unit == "rad" else LARGEST_DEG
    small = section.joint_unit == "deg" and len(values) >= 3 and 0.0 < largest <= 2.0 * np.pi
    if small or largest > limit:
        raise FileFormatError(
            f"the largest joint value is {largest:.4g} {section.joint_unit}",
            path=path,
            hint="is instrument.joint_unit that of the file?",
        )
    if not section.pendant:
        return np.asarray(np.deg2rad(degrees))
    if robot.controller is None:
        raise FileFormatError(
            "holds what a pendant shows, and the robot's controller is not known",
            path=path,
            hint="set robot.controller in the cell",
        )
    return robot.controller.posture(degrees)


def _of_program(path: Path, robot: Robot, dialect: str | None) -> JointRows:
    from posedesign.programs.registry import read_joints  # all dialects: a tenth of a start

    postures, lines = read_joints(path, robot, dialect, hint="write it with joint positions")
    return JointRows(path, np.array(lines), postures)


def _in_order(rows: JointRows, times: FloatArray) -> JointRows:
    """The same with times that rise, rows that are there twice left out."""
    step = np.diff(times)
    twice = np.flatnonzero((step == 0) & (np.diff(rows.postures, axis=0) == 0).all(axis=1)) + 1
    notes = rows.notes
    if twice.size:
        notes += (f"{rows.path}: {twice.size} rows of joints are there twice, left out",)
    kept = np.setdiff1d(np.arange(len(times)), twice)
    times = times[kept]
    back = np.flatnonzero(np.diff(times) <= 0)
    if back.size:
        i = int(back[0]) + 1
        raise FileFormatError(
            f"the time goes from {times[i - 1]:.6g} to {times[i]:.6g} s: it has to rise",
            path=rows.path,
            row=int(rows.lines[kept[i]]),
            hint="give one recording, in the order that it was made",
        )
    names = tuple(rows.names[i] for i in kept) if rows.names else ()
    return JointRows(rows.path, rows.lines[kept], rows.postures[kept], times, names, notes)
