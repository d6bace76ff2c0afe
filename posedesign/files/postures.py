"""Joint columns of tables: ``j1_deg ..`` in URDF signs, or ``pendant_j1_deg ..``.

External axes stand before them, as ``e1_mm ..`` of slides and ``e1_deg ..`` of positioners.

Of a robot that is known, the columns may have other names, too: see :class:`JointForm`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.robots import NO_EXTERNAL_AXES, Controller, ExternalAxes, Robot, shown_of
from calib.se3 import FloatArray
from posedesign.files.csv_tables import AsItIs, Row, check_columns, numbers_of

PENDANT_AGREES_DEG = 0.01
"""Joint values and pendant values of one row may differ by as much: pendants show few decimals."""

LARGEST_RAD = 4.0 * math.pi
"""No joint of an arm turns further from its zero than two turns: beyond it, values are degrees."""

FLICKER_MM, LONGEST_RAIL_M = 0.05, 30.0
"""What is shown of a slide that stands changes by less, and stations along one are farther apart
than this number of millimetres; rails are shorter than as many metres."""

HELD_WITHIN = 0.1
"""A held axis stands as far from where the cell has it, in mm or degrees, at most."""

RADIAN_DECIMALS = 12
"""Of radians in a file: as fine as nine decimals of a degree."""


class JointForm(StrEnum):
    """How the joint columns of a table are named, and what stands in them.

    ==========  ====================================================================================
    ``usual``   ``j1_deg ..`` [deg], signs of the URDF
    ``ros``     ``<joint name>_rad ..`` [rad], signs of the URDF, names as in the robot's
                description and so in ``sensor_msgs/JointState``; ``<joint name>_deg`` is read, too
    ``robodk``  ``J1 ..`` [deg] as the controller shows them, before all other columns. Where no
                controller is known: signs of the URDF
    ==========  ====================================================================================

    How sure the form for RoboDK is: no public description of a CSV of joints that it imports was
    found, and the form was not tried with it. It follows its published sources: ``LoadList`` of
    ``robodk.robofileio`` takes a file as rows of cells at fixed places, without comments, and the
    post-processor for FANUC (``Fanuc_R30iA.py``) writes joint values into programs as they are, so
    that J3 is that of the pendant.
    """

    USUAL = "usual"
    ROS = "ros"
    ROBODK = "robodk"


def columns_of(form: JointForm, robot: Robot) -> list[str]:
    """Names of the joint columns of a robot in a form."""
    if form is JointForm.ROS:
        return _named(robot, "m", "rad")
    if form is JointForm.ROBODK:
        if robot.n_external:
            raise InputError(
                "how RoboDK lists external axes is not known here",
                hint="write the usual form",
                name=robot.joint_names[0],
            )
        return [f"J{i + 1}" for i in range(robot.n)]
    return joint_columns(robot.n, robot.external)


def _named(robot: Robot, sliding: str, turning: str) -> list[str]:
    """Joints of a description by their names, with the units of their values."""
    units = [sliding if slides else turning for slides in robot.sliding]
    return [f"{name}_{unit}" for name, unit in zip(robot.joint_names, units, strict=True)]


def cells_of(form: JointForm, robot: Robot, posture: FloatArray) -> list[object]:
    """Cells of the joint columns for a posture ``(n,)`` [rad, m]."""
    if form is JointForm.ROS:
        return [AsItIs(f"{value + 0.0:.{RADIAN_DECIMALS}f}") for value in posture.tolist()]
    if form is JointForm.ROBODK and robot.controller is not None:
        return list(robot.controller.pendant(posture).tolist())
    return list(robot.shown(posture).tolist())


def find_form(columns: Sequence[str], robot: Robot) -> tuple[JointForm, list[str]]:
    """The form that the columns of a table have, and the joint columns that it asks for.

    That with most of its columns there; where none is there, ROS if anything is in radians.
    """
    n, external = robot.n, robot.external
    wanted = [
        (JointForm.USUAL, joint_columns(n, external)),
        (JointForm.ROS, _named(robot, "m", "rad")),
        (JointForm.ROS, _named(robot, "mm", "deg")),
        *([] if external.count else [(JointForm.ROBODK, columns_of(JointForm.ROBODK, robot))]),
        (JointForm.USUAL, pendant_columns(n, external)),
    ]
    counts = [len(set(needed) & set(columns)) for _, needed in wanted]
    if not any(counts):
        return wanted[1 if any(column.endswith("_rad") for column in columns) else 0]
    return wanted[counts.index(max(counts))]


def postures_in_any_form(
    path: Path, columns: Sequence[str], rows: Sequence[Row], robot: Robot, trust_units: bool
) -> FloatArray:
    """Postures ``(rows, n)`` [rad] of a known robot, in whichever form its joints are named."""
    form, needed = find_form(columns, robot)
    if form is JointForm.USUAL:
        return postures_of(
            path, columns, rows, robot.n, robot.controller, trust_units, robot.external
        )
    check_columns(path, columns, needed)
    more = [c for c in columns if re.fullmatch(r"J\d+", c) and c not in needed]
    if form is JointForm.ROBODK and more:
        raise FileFormatError(
            f"the robot has {robot.n} joints only",
            path=path,
            row=1,
            column=more[0],
            hint="is this the file of another robot?",
        )
    if not rows:
        raise FileFormatError("has no pose that was not dropped", path=path)
    _check_held(path, columns, rows, robot)
    if form is JointForm.ROS and needed[-1].endswith("_rad"):
        return _values(path, rows, needed, trust_units, robot.external, "radians")
    shown = _values(path, rows, needed, trust_units, robot.external)
    if form is JointForm.ROBODK and robot.controller is not None:
        return robot.controller.posture(shown)
    return robot.of_shown(shown)


def check_at_rest(
    path: Path,
    axis: str,
    lines: Sequence[int],
    values: FloatArray,
    within: float = FLICKER_MM,
    held: float | None = None,
) -> None:
    """Refuse an axis that moves, or stands elsewhere than held: it may carry the arm or its target.

    ``values`` (R,): of an axis that no joint of the robot is, at these lines of the file [mm, deg].
    ``within``: what is shown of an axis at rest differs by as much. ``held``: where the description
    holds it; None: the description does not have it.
    """
    off = ~(np.abs(values - values[:1]) <= within)  # NaN among them
    if off.any():
        raise FileFormatError(
            f"{axis} moves, and "
            + ("the robot's description has no such axis" if held is None else "the cell holds it"),
            path=path,
            row=int(lines[int(off.argmax())]),
            hint="measure with the external axes at rest, or describe them in the URDF"
            if held is None
            else "measure with it at rest, or do not hold it: robot.held_mm, held_deg, lock",
        )
    if held is not None and len(values) and abs(values[0] - held) > HELD_WITHIN:
        raise FileFormatError(
            f"{axis} stands at {values[0]:.6g}, and the cell holds it at {held:.6g} (mm or deg)",
            path=path,
            row=int(lines[0]),
            hint="hold it where it stood: robot.held_mm, robot.held_deg",
        )


def _check_held(path: Path, columns: Sequence[str], rows: Sequence[Row], robot: Robot) -> None:
    """Refuse joints that the cell holds and a table has elsewhere."""
    lines = [row.line for row in rows]
    for joint in robot.held:
        units = {"m": 1e3, "mm": 1.0} if joint.slides else {"rad": joint.per_si, "deg": 1.0}
        for unit, factor in units.items():
            column = f"{joint.name}_{unit}"
            if column in columns:
                values = factor * numbers_of(path, rows, [column])[:, 0]
                check_at_rest(path, column, lines, values, held=joint.value * joint.per_si)


def joint_columns(n: int, external: ExternalAxes = NO_EXTERNAL_AXES) -> list[str]:
    """``e1_mm ..`` and ``e1_deg ..`` of external axes, then ``j1_deg ..``: n in all.

    In the order of the joints; external axes are counted as controllers do. ``j3_mm`` of a joint of
    the arm that slides.
    """
    units = np.where(external.slides_of(n), "mm", "deg").tolist()
    labels = [label.lower() for label in external.labels(n)]
    return [f"{label}_{unit}" for label, unit in zip(labels, units, strict=True)]


def external_as_dict(external: ExternalAxes) -> dict[str, int | tuple[int, ...]]:
    """Say for results which joints are external axes, and which of the arm slide, where any is."""
    return {key: value for key, value in asdict(external).items() if value}


def pendant_columns(n: int, external: ExternalAxes = NO_EXTERNAL_AXES) -> list[str]:
    """``pendant_j1_deg`` to ``pendant_jn_deg``, after those of external axes."""
    return [f"pendant_{column}" for column in joint_columns(n, external)]


def postures_of(
    path: Path,
    columns: Sequence[str],
    rows: Sequence[Row],
    n: int,
    controller: Controller | None,
    trust_units: bool,
    external: ExternalAxes = NO_EXTERNAL_AXES,
) -> FloatArray:
    """Postures ``(rows, n)`` [rad, m] of the joint columns, or else of the pendant's."""
    if not rows:
        raise FileFormatError("has no pose that was not dropped", path=path)
    own, shown = joint_columns(n, external), pendant_columns(n, external)
    if shown[0] in columns and own[0] not in columns:
        if controller is None:
            raise FileFormatError(
                "holds what a pendant shows, and the robot's controller is not known",
                path=path,
                column=shown[0],
                hint="set robot.controller in the cell",
            )
        check_columns(path, columns, shown, joints=True)
        return controller.posture(_values(path, rows, shown, trust_units, external))
    check_columns(path, columns, own, joints=True)
    postures = _values(path, rows, own, trust_units, external) / shown_of(n, external)
    there = [k for k, column in enumerate(shown) if column in columns]
    if controller is not None and there:
        shown = [shown[k] for k in there]
        off = controller.pendant(postures)[:, there] - numbers_of(path, rows, shown)
        worst = np.unravel_index(int(np.argmax(np.abs(off))), off.shape)
        if abs(off[worst]) > PENDANT_AGREES_DEG:
            unit = shown[int(worst[1])].rpartition("_")[2]
            raise FileFormatError(
                f"is {abs(off[worst]):.3g} {unit} off what {own[0]} to {own[-1]} make it",
                path=path,
                row=rows[int(worst[0])].line,
                column=shown[int(worst[1])],
                hint="leave out the columns that are not what the arm did",
            )
    return postures


def _check_external(path: Path, columns: Sequence[str], values: FloatArray) -> None:
    """Refuse external axes ``(rows, count)`` that move too little for millimetres or degrees."""
    for column, own in zip(columns, values.T, strict=False):
        largest = float(np.abs(own).max())
        slides = column.endswith("_mm")
        most = LONGEST_RAIL_M if slides else 2 * math.pi
        if float(np.ptp(own)) > FLICKER_MM and largest < most and (own % 1.0).any():
            other, wanted, factor = (
                ("metres", "millimetres", "1000") if slides else ("radians", "degrees", "57.29578")
            )
            raise FileFormatError(
                f"looks like {other} (the largest is {largest:.4g})",
                path=path,
                column=column,
                hint=f"multiply it by {factor}, or pass `trust_units` if it really is {wanted}",
                value=largest,
            )


def _check_external_in_si(
    path: Path, columns: Sequence[str], values: FloatArray, external: ExternalAxes
) -> None:
    """Refuse external axes ``(rows, count)`` that are too far for metres or radians."""
    sliding = external.slides_of(external.count).tolist()
    for column, own, slides in zip(columns, values.T, sliding, strict=False):
        largest = float(np.abs(own).max())
        if largest > (LONGEST_RAIL_M if slides else LARGEST_RAD):
            raise FileFormatError(
                f"looks like {'millimetres' if slides else 'degrees'} (the largest is "
                f"{largest:.4g})",
                path=path,
                column=column,
                hint="end the names of all joints' columns with _deg, of what slides with _mm",
                value=largest,
            )


def _values(
    path: Path,
    rows: Sequence[Row],
    columns: Sequence[str],
    trust_units: bool,
    external: ExternalAxes,
    unit: str = "degrees",
) -> FloatArray:
    """Joint values ``(rows, columns)``, refused where they look like those of another unit.

    Those of external axes stand first.
    """
    values = numbers_of(path, rows, columns)
    if unit == "degrees" and not trust_units:
        _check_external(path, columns, values[:, : external.count])
    elif not trust_units:
        _check_external_in_si(path, columns, values[:, : external.count], external)
    turning = ~external.slides_of(len(columns))
    turning[: external.count] = False
    columns = [column for column, turns in zip(columns, turning, strict=True) if turns]
    largest = float(np.abs(values[:, turning]).max(initial=0.0))
    small = len(rows) >= 3 and 0 < largest <= 2 * math.pi
    if trust_units or not (small if unit == "degrees" else largest > LARGEST_RAD):
        return values
    other, bound, remedy = {
        "degrees": ("radians", 2 * math.pi, "multiply them by 57.29578"),
        "radians": ("degrees", LARGEST_RAD, "end the names of the columns with _deg"),
    }[unit]
    raise FileFormatError(
        f"the joint values look like {other} (the largest is {largest:.4g})",
        path=path,
        column=f"{columns[0]} to {columns[-1]}",
        hint=f"{remedy}, or pass `trust_units` if they really are {unit}",
        value=largest,
        bound=bound,
    )
