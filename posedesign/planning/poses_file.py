"""Lists of poses in CSV files, in and out: the one definition of every column.

Every name of a column ends with its unit; what has no unit has none. Tables are UTF-8 with commas
and points, as spreadsheets and ``pandas.read_csv(path, comment="#")`` read them.

``poses.csv``
-------------
One row a stop, in the order in which they are visited, then the poses that were dropped: these
have a name, a status, a reason and no numbers. J1 .. Jn are the joints from the base to the tip.

==============================  ====  ========================================================
column                          unit  meaning
==============================  ====  ========================================================
``name``                              of the pose: P01 ..; of what is passed through: V01 ..
``order``                             place in the visit, from 1; the rows stand in that order,
                                      and it is the rows that are followed
``status``                            ``grid``, ``repaired``, ``chosen`` out of a pool,
                                      ``dropped``; ``via``: passed through and not measured
``reason``                            why the pose is not that of the grid, or is passed through
``j1_deg ..``                   deg   joint values, zero and signs of the robot's description
``x_mm, y_mm, z_mm``            mm    tool point in the base frame
``w_deg, p_deg, r_deg``         deg   tip frame in the base frame: turned about fixed x by W,
                                      then y by P, then z by R
``target, tool, payload``             what is measured there, of what of the tool, with what load;
                                      only where a cell has several
``configuration``                     arm position in the words of the controller; empty where
                                      its maker has none
``pendant_j1_deg ..``           deg   joint values as the pendant shows them; only where it
                                      shows others
``clearance_mm``                mm    smallest distance between tool, obstacles and arm; from
                                      half a metre on, distances are not told apart
``self_clearance_mm``           mm    the same between links of the arm
``limit_margin_deg``            deg   from the nearest joint limit, or limit that joints have
                                      together
``view_margin_px``              px    of the target from the edge of the camera's image
``tilt_margin_deg``             deg   left until the target is turned away too far
``camera_distance_margin_mm``   mm    left until the target is too near to the lens, or too far
==============================  ====  ========================================================

The last six are there as far as the cell describes what they are about, negative where a bound is
broken, and empty where a pose has none: what is passed through sees no target.

The first line of every file that a command writes says where it is from, see
:mod:`posedesign.files.origin`: ``# origin: simulated touch-ups by simulate from cell.toml
(699b0640) poses.csv (b8b363e3) on 2026-05-31 digest 266059b4d3459982``.

Columns of other names are kept: :attr:`.PoseList.extra`, :func:`write_pose_list`. Before the header
stand lines with ``# name: value``: ``fingerprint`` of the measured postures, ``poses measured``,
the indices of the plan by the names of :class:`posedesign.selection.indices.Indices` (``c_g`` is
C_G), and ``units``. Joints may be named as ROS does, or RoboDK: :class:`.JointForm`.

Files are hostile until read: size, encoding, header, every number, and degrees that are radians.
Texts that a spreadsheet would run as a formula are written with an apostrophe before them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import FileFormatError, InputError, near_names, one_line
from calib.robots import NO_EXTERNAL_AXES, Controller, ExternalAxes, Robot
from calib.se3 import BoolArray, FloatArray, wpr_from_rotation
from posedesign.constraints import (
    Checker,
    Collision,
    Constraint,
    Distance,
    InImage,
    SelfCollision,
    Tilt,
)
from posedesign.constraints.checker import CoupledLimits, JointLimits
from posedesign.files import StrPath
from posedesign.files.csv_tables import (
    LONGEST_SHOWN,
    Row,
    Table,
    as_read,
    check_columns,
    comment_text,
    mistyped,
    read_table,
    write_table,
)
from posedesign.files.measurements import PLACE, TURN, check_label
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
from posedesign.motion.route import Passing, Route
from posedesign.planning.pose_plan import PoseSet, PoseStatus, fingerprint, named_stops
from posedesign.selection import Indices

if TYPE_CHECKING:
    from posedesign.cell import Cell

COLUMN_OF: dict[type[Constraint], str] = {
    Collision: "clearance_mm",
    SelfCollision: "self_clearance_mm",
    JointLimits: "limit_margin_deg",
    CoupledLimits: "limit_margin_deg",
    InImage: "view_margin_px",
    Tilt: "tilt_margin_deg",
    Distance: "camera_distance_margin_mm",
}
"""The column of each constraint; of those that share one, the smaller counts."""

MARGIN_COLUMNS = tuple(dict.fromkeys(COLUMN_OF.values()))

CLEARANCE_DECIMALS = 6
"""Of clearances in mm. They are found by iteration: what comes after that depends on what was
looked at before, and would be another after a stop."""

NOT_CHECKED = "not checked"
"""Begins the comments of a list that say what planning did not look at, one a comment."""

STOPS_SHORT = "stop short [mm]"
"""Begins the comment of a list that says how far before its poses programs are to stop."""

CORRECTED_BY = "corrected by"
"""Begins the comment of a list that says by which identification its commands are corrected: the
first digits of its SHA-256."""

ALL_CHECKED = "nothing that the cell asks for"
"""Said in their place where there are none, so that a list without any is one that nobody knows."""

_OF = " of "
"""Before the robot's name in the first comment of a list."""

POSE_AXES = (*PLACE, *TURN)

OBSERVED = ("target", "tool", "payload")
"""Columns that say what a pose is of, where a cell has several of them."""

_LABELS = ("name", "order", "status", "reason")

_KNOWN = (*_LABELS, *POSE_AXES, "configuration", *MARGIN_COLUMNS)
"""Columns besides those of the joints that are written anew, and so are not kept from a file."""

_WRITTEN_ANEW = ("units", "poses measured", "origin")
"""Comments that are not kept from a file, either."""

_UNITS = {
    JointForm.USUAL: "mm and deg and px as the names of columns end - base frame",
    JointForm.ROS: "rad and mm and deg and px as the names of columns end - base frame",
}


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of poses, by the column that they stand in."""

    columns: Mapping[str, FloatArray]
    """(S,): in the unit that the name ends with; NaN where a pose has none. Only columns that the
    cell knows of are there. Negative where a bound is broken."""

    @classmethod
    def of(cls, cell: Cell, poses: PoseList) -> Margins:
        """Margins of the poses of a list; those passed through have none of the view."""
        postures, via = poses.postures, poses.via
        found: dict[str, FloatArray] = {}
        measured, which = np.flatnonzero(~via), cell.which(poses.measured.labels)
        for checker, rows in (
            *((checker, measured[own]) for checker, own in cell.checkers(which)),
            (cell.passing, np.flatnonzero(via)),
        ):
            if not len(rows):
                continue
            verdicts = checker.check(postures[rows])
            for k, constraint in enumerate(verdicts.constraints):
                column = COLUMN_OF.get(type(constraint))
                if column is None:
                    continue
                margin = verdicts.margin[:, k] + _kept(cell, checker, constraint)
                # what has no limit has no margin
                margin = np.where(np.isposinf(margin), np.nan, margin * constraint.display)
                if isinstance(constraint, Collision):
                    margin = np.round(margin, CLEARANCE_DECIMALS)
                into = found.setdefault(column, np.full(len(postures), np.nan))
                into[rows] = np.fmin(into[rows], margin)
        return cls({column: found[column] for column in MARGIN_COLUMNS if column in found})

    @classmethod
    def of_route(cls, cell: Cell, poses: PoseSet, route: Route) -> Margins:
        return cls.of(cell, PoseList.of_route(poses, route))


def _kept(cell: Cell, checker: Checker, constraint: Constraint) -> float:
    """What a constraint keeps of the distance itself [SI]: its margin is what is left."""
    if isinstance(constraint, (JointLimits, CoupledLimits)):
        return checker.margin
    if isinstance(constraint, Collision):
        return constraint.keep_m
    if isinstance(constraint, InImage) and cell.config.camera is not None:
        return cell.config.camera.border_px
    return 0.0


@dataclass(frozen=True)
class DroppedPose:
    """A pose without numbers: one that cannot be taken."""

    name: str
    reason: str
    extra: Mapping[str, str] = field(default_factory=dict)
    """What stands in columns that posedesign does not know."""


@dataclass(frozen=True, eq=False)
class PoseList:
    """Poses in the order in which they are visited."""

    names: tuple[str, ...]
    postures: FloatArray  # (N, n) [rad], URDF signs
    via: BoolArray  # (N,): postures that the arm passes through without measuring
    status: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    """status, reasons: as in ``poses.csv``, one each; none at all for a list that was not read from
    a file."""
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By name of the column, the N cells of columns that posedesign does not know."""
    dropped: tuple[DroppedPose, ...] = ()  # poses that the list names, and that are not visited
    comments: tuple[str, ...] = ()  # lines before the header of the table, without #

    @classmethod
    def of_route(cls, poses: PoseSet, route: Route) -> PoseList:
        """The stops of a route through the kept poses; the others of the set are dropped."""
        reasons = dict(zip(poses.names, poses.reasons, strict=True))
        states = dict(zip(poses.names, poses.status, strict=True))
        stops = named_stops(poses, route)
        passing = [str(stop.passing) for stop in route.stops]
        visited = {name for name, _, via in stops if not via}
        kept = poses.kept_labels
        of: list[Mapping[str, str]] = [
            {} if stop.pose is None else kept[stop.pose] for stop in route.stops
        ]
        _tell_loads(of, route)
        columns = [column for column in OBSERVED if any(given.get(column) for given in of)]
        return cls(
            names=tuple(name for name, _, _ in stops),
            postures=np.reshape(
                [posture for _, posture, _ in stops], (-1, poses.postures.shape[1])
            ),
            via=np.array([via for _, _, via in stops], dtype=bool),
            status=tuple(str(PoseStatus.VIA if via else states[name]) for name, _, via in stops),
            reasons=tuple(
                why if via else reasons[name]
                for (name, _, via), why in zip(stops, passing, strict=True)
            ),
            extra={column: tuple(given.get(column, "") for given in of) for column in columns},
            dropped=tuple(
                DroppedPose(name, reasons[name], dict.fromkeys(columns, ""))
                for name in poses.names
                if name not in visited
            ),
        )

    @property
    def labels(self) -> list[dict[str, str]]:
        """What each pose is of: its target, tool and payload, as far as the list says it."""
        given = [(column, self.extra[column]) for column in OBSERVED if column in self.extra]
        return [{column: cells[i] for column, cells in given} for i in range(len(self.names))]

    @property
    def measured(self) -> PoseList:
        return self.some(np.flatnonzero(~self.via).tolist())

    def of_payload(self, name: str | None) -> PoseList:
        """The tour with one payload, or the whole list where there is only one.

        ``name``: of the payload; empty for the tool alone, None where it is not said.

        Raises
        ------
        InputError
            The list has several and none is named, or has not the one that is.
        """
        loads = self.extra.get("payload", ("",) * len(self.names))
        known = list(dict.fromkeys(loads))
        if name is None and len(known) == 1:
            return self
        if name is None or name not in known:
            listed = ", ".join(load or "the tool alone" for load in known)
            raise InputError(
                f"the list has poses with {listed}"
                + ("" if name is None else f", not with {name[:40]!r}"),
                hint="a program is of one load: name it with `payload`, none for the tool alone",
                name="payload",
            )
        part = self.some([i for i, load in enumerate(loads) if load == name])
        if self.misfit:
            return part
        own = f"fingerprint: {part.fingerprint}"  # as planned, though it is a part
        said = (own if line.startswith("fingerprint:") else line for line in self.comments)
        return replace(part, comments=tuple(said))

    def some(self, kept: Sequence[int]) -> PoseList:
        """The stops of these rows, with all that stands before the header."""
        return replace(
            self,
            names=tuple(self.names[i] for i in kept),
            postures=self.postures[list(kept)],
            via=self.via[list(kept)],
            status=tuple(self.status[i] for i in kept) if self.status else (),
            reasons=tuple(self.reasons[i] for i in kept) if self.reasons else (),
            extra={c: tuple(cells[i] for i in kept) for c, cells in self.extra.items()},
        )

    @property
    def header(self) -> dict[str, str]:
        """What the comments say by name: ``fingerprint``, ``c_g``, ..."""
        found: dict[str, str] = {}
        for comment in self.comments:
            name, colon, value = comment.partition(":")
            if colon:
                found.setdefault(name.strip(), value.strip())
        return found

    @property
    def not_checked(self) -> tuple[str, ...]:
        """What planning did not look at, as the comments say; nothing that they say is nothing."""
        pairs = (comment.partition(":") for comment in self.comments)
        said = tuple(value.strip() for key, _, value in pairs if key.strip() == NOT_CHECKED)
        if not said:
            return ("anything: the list of poses does not say what was",)
        if self.fingerprint_written not in ("", self.fingerprint):
            return ("anything: the list was changed after planning",)
        return said

    @property
    def fingerprint(self) -> str:
        """Short digest of the measured postures as they are, see :func:`.pose_plan.fingerprint`."""
        return fingerprint(self.postures[~self.via])

    @property
    def fingerprint_written(self) -> str:
        """The fingerprint that the file gives; empty where it gives none.

        Where it is another than :attr:`fingerprint`, the postures were changed after planning, and
        the indices beside it are not theirs.
        """
        return self.header.get("fingerprint", "")

    @property
    def corrected_by(self) -> str:
        """The identification that the postures are corrected by; empty for those of a plan."""
        return self.header.get(CORRECTED_BY, "")

    @property
    def corrected(self) -> str:
        """That the postures are corrected, in words; empty where they are not."""
        by = self.corrected_by
        return by and f"the poses are corrected by the identification {by}: not those of the plan"

    def other_robot(self, robot: Robot) -> str:
        """That the file says it is of another robot, in words; empty where it does not."""
        said = self.header.get("posedesign", "")
        if _OF not in said or said.endswith(_OF + comment_text(robot.name)):
            return ""
        name = said.partition(_OF)[2]
        return f"the poses are of the robot {one_line(name)}, not of {one_line(robot.name)}"

    @property
    def mistyped(self) -> list[str]:
        """Columns that are kept and not read, and look like one that would be, in words."""
        return mistyped(self.extra, [*_LABELS, *MARGIN_COLUMNS])

    @property
    def misfit(self) -> str:
        """That the fingerprint is not that of the postures, in words; empty where it is."""
        if self.fingerprint_written in ("", self.fingerprint):
            return ""
        return (
            f"the postures are others than those that were planned ({self.fingerprint}, not "
            f"{self.fingerprint_written}): what stands before the header is not of them"
        )


def _tell_loads(of: list[Mapping[str, str]], route: Route) -> None:
    """Say of stops that are passed what the arm carries: what it does at the next pose.

    On the way back to the base posture it is what it did at the last, and is changed there.
    """
    load = ""
    for i in reversed(range(len(of))):
        load = of[i].get("payload", load)
        of[i] = {**of[i], "payload": load}
    for i, stop in enumerate(route.stops):
        if i and stop.passing is Passing.RETURN:
            of[i] = {**of[i], "payload": of[i - 1]["payload"]}


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
    comments = [f"posedesign: {title}{_OF}{robot.name}", f"fingerprint: {listed.fingerprint}"]
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
        comments = [f"posedesign: poses{_OF}{robot.name}"]
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
    pendant = pendant_columns(robot.n, robot.external) if shown and form is JointForm.USUAL else []
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


def _configurations(robot: Robot, postures: FloatArray) -> list[str]:
    """Arm positions in the words of the robot's controller; empty where there are none for it."""
    from posedesign.programs.configurations import words  # programs are read with these tables

    try:
        return words(robot, postures)
    except InputError:  # an arm of another kind than those that the maker has words for
        return [""] * len(postures)


def read_poses(
    path: Path,
    n: int | None,
    *,
    external: ExternalAxes = NO_EXTERNAL_AXES,
    controller: Controller | None = None,
    trust_units: bool = False,
) -> PoseList:
    """Read the postures of a ``poses.csv``.

    ``n``: number of joints of the robot; None takes what the file has. ``external``: what the
    first of them are. ``controller``: turns ``pendant_j1_deg ..`` into joint values; without it
    such columns alone are refused. ``trust_units``: do not refuse values that look like radians.
    """
    table = read_table(path)
    columns = table.columns
    _refuse_other_form(path, columns)
    count = n if n is not None else _count_joints(columns, path)
    joints = [*joint_columns(count, external), *pendant_columns(count, external)]
    return _listed(
        path,
        table,
        joints,
        lambda rows: postures_of(path, columns, rows, count, controller, trust_units, external),
    )


def read_robot_poses(path: Path, robot: Robot, *, trust_units: bool = False) -> PoseList:
    """Read the postures of a table of a known robot, in any :class:`JointForm`."""
    table = read_table(path)
    columns = table.columns
    joints = [*joint_columns(robot.n, robot.external), *pendant_columns(robot.n, robot.external)]
    joints += find_form(columns, robot)[1]
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
    for row in table.rows:
        for column in ("name", "reason"):
            check_label(path, row.line, row.cells.get(column, ""), column)
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
