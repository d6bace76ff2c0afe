"""What is odd about a table of measurements, before anything is identified from it.

Whether readings of an instrument can be what they are said to be: a tracker, a camera or a wire
sees the arm move. Where the arm has moved by decimetres and what was read by a thousandth of that,
or where it has turned and the readings have turned otherwise, units or conventions are not those of
the table. Rows that are far from the others, that are there twice, or not there.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, apply, rotation_angle, rotation_exp, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.files.csv_tables import a_few, first_like
from posedesign.files.measurements import MeasurementTable

_PLACE = 3
"""Numbers of a reading that are a place."""

_PLANNED = re.compile(r"P(\d{2,4})", re.ASCII)
"""Names that plans give to poses."""

PLANNED_M = 1e-7
"""Distance of the nominal tool point from its target that no measured arm comes down to."""

FAR_M, MUCH_FARTHER = 0.1, 10.0
"""Distance of a nominal tool point from the middle of those of its target, and the same over the
median of all of them, beyond which a row is another thing than the others."""


def far_rows(cell: Cell, table: MeasurementTable) -> list[str]:
    """Touch-ups that the nominal arm sees far from all others of their target, with their lines.

    Rows in another unit, or of another target. They can be told before anything is identified, and
    keep the rest from being identified at all.
    """
    data, touched = table.data, table.of_kind("touch-up", "view-line")
    points = apply(cell.robot.fk(data.postures), cell.tool_m)
    said = []
    for k in range(len(data.targets)):
        own = touched[data.setup.target[touched] == k]
        if not own.size:
            continue
        off = np.linalg.norm(points[own] - np.median(points[own], axis=0), axis=1)
        usual = float(np.median(off))
        said += [
            f"line {table.lines[i]}: the tool point as described is {far * 1e3:.0f} mm from where "
            f"the others of {data.targets[k]} have it, which lie within {usual * 1e3:.0f} mm"
            for i, far in zip(own.tolist(), off.tolist(), strict=True)
            if far > FAR_M and far > MUCH_FARTHER * usual
        ]
    return said


def seen_once(data: Measurements) -> list[str]:
    """Targets of which there is a single measurement: it says nothing but where they are."""
    count = np.bincount(data.setup.target, minlength=len(data.targets))
    return [label for label, n in zip(data.targets, count, strict=True) if n == 1]


MOVED_M = 0.1
"""Way of the arm from which the scale of what was read can be judged."""

LEAST_SHARE = 1.0 / 20.0
"""Share of the arm's way that readings of places have to move by. Inches make it a 25th, metres a
thousandth; a reflector that sits elsewhere than the cell's tool point does not make it a 20th."""

NEAREST_M = 0.01
"""Distance that a wire or a camera has from what it sees, at least."""

FARTHEST_M = 100.0
"""Distance that an instrument has at most."""

TURNED_RAD = 0.3
"""Turn of the arm from which the turns of what was read can be judged."""

LARGEST_MISS_RAD = 0.05
"""Difference of turns, the median of many, that no error of an arm and no camera makes."""

_SAID = ", or correct the unit where the cell says that of an instrument's file"


def check_readings(cell: Cell, table: MeasurementTable) -> None:
    """Refuse places, distances and rotations that cannot be in the unit of their columns.

    Raises FileFormatError: naming file and columns, and the unit that they look like.
    """
    if table.data.observed is None:
        return
    setup, kinds = table.data.setup, table.kind_of_each
    keys = np.stack([setup.kind, setup.tool, setup.target], axis=1)
    for key in np.unique(keys, axis=0):
        rows = np.flatnonzero((keys == key).all(axis=1))
        T, kind = cell.robot.fk(table.data.postures[rows]), kinds[rows[0]]
        # a tool point that is held still while the arm turns about it is read as standing still
        way = min(_spread(apply(T, cell.tool_m)), _spread(T[:, :3, 3]))
        group = _Group(table.path, way, T[:, :3, :3], table.data.observed[rows])
        if kind in ("point", "pose"):
            group.check_places()
        elif kind == "camera-pose":
            group.check_lengths(3, "x_mm to z_mm")
        elif kind == "distance":
            group.check_lengths(1, "distance_mm")
        if kind in ("pose", "camera-pose"):
            group.check_turns()


@dataclass(frozen=True, eq=False)
class _Group:
    """Readings of one kind, tool and target."""

    path: Path
    way: float
    """How far apart [m] the arm was: its flange, or the nominal tool point where that moved
    less."""
    R_tip: FloatArray  # (K, 3, 3)
    read: FloatArray  # (K, m): [m, rad]

    def check_places(self) -> None:
        """Places that are read have to move as the arm does."""
        read = _spread(self.read[:, :3])
        if self.way > MOVED_M and read < LEAST_SHARE * self.way:
            unit, factor = _unit_of(self.way / max(read, 1e-9))
            raise FileFormatError(
                f"what was read moves by {read * 1e3:.3g} mm while the arm moves by "
                f"{self.way * 1e3:.3g} mm",
                path=self.path,
                column="x_mm to z_mm",
                hint=f"if these are {unit}, multiply them by {factor:g}{_SAID}; else pass "
                "`trust_units`",
                value=read,
                bound=self.way,
            )
        self._check_not_far(read, "x_mm to z_mm")

    def check_lengths(self, count: int, column: str) -> None:
        """Distances from an instrument are not next to nothing."""
        longest = float(np.linalg.norm(self.read[:, :count], axis=1).max())
        if self.way > MOVED_M and longest < NEAREST_M:
            raise FileFormatError(
                f"nothing that was read is farther than {longest * 1e3:.3g} mm from the instrument",
                path=self.path,
                column=column,
                hint="if these are metres, multiply them by 1000; else pass `trust_units`",
                value=longest,
                bound=NEAREST_M,
            )
        self._check_not_far(longest, column)

    def _check_not_far(self, length: float, column: str) -> None:
        if length > FARTHEST_M:
            raise FileFormatError(
                f"what was read spans {length:.3g} m",
                path=self.path,
                column=column,
                hint=f"if these are micrometres, divide them by 1000{_SAID}; else pass "
                "`trust_units`",
                value=length,
                bound=FARTHEST_M,
            )

    def check_turns(self) -> None:
        """Turns between readings have to be those of the arm, whatever tool and target are."""
        R_read, count = rotation_exp(self.read[:, 3:6]), len(self.read)
        # against several readings in turn: one of them alone may be the wrong one
        tried = [(_turns(self.R_tip, k), _turns(R_read, k)) for k in {0, count // 2, count - 1}]
        arm, read = min(tried, key=lambda turns: _miss(*turns))
        if _miss(arm, read) < LARGEST_MISS_RAD:
            return
        largest = float(np.abs(np.rad2deg(wpr_from_rotation(R_read))).max())
        looks = "W, P, R turn about fixed x, y, z in this order"
        if largest <= 2.0 * np.pi:
            looks = "they look like radians: multiply them by 57.29578"
        raise FileFormatError(
            f"what was read turns by up to {np.rad2deg(read.max()):.3g} deg, and otherwise than "
            f"the arm, which turns by up to {np.rad2deg(arm.max()):.3g} deg",
            path=self.path,
            column="w_deg to r_deg",
            hint=f"{looks}; else pass `trust_units`",
            value=float(read.max()),
            bound=float(arm.max()),
        )


def _spread(places: FloatArray) -> float:
    """Diagonal of the box around places ``(N, 3)`` [m]."""
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def _turns(R: FloatArray, k: int) -> FloatArray:
    """Angle ``(N,)`` [rad] of each rotation against one of them."""
    return rotation_angle(np.swapaxes(R[k], -1, -2) @ R)


def _miss(arm: FloatArray, read: FloatArray) -> float:
    """By how much [rad] readings turn otherwise than the arm; zero where that hardly turns."""
    off = np.abs(read - arm)[arm > TURNED_RAD]
    return float(np.median(off)) if off.size else 0.0


def _unit_of(ratio: float) -> tuple[str, float]:
    """Unit that makes readings so many times too small, and the factor to mm."""
    units = (("inches", 25.4), ("metres", 1000.0))
    return min(units, key=lambda unit: abs(np.log(ratio / unit[1])))


def without_repeats(table: MeasurementTable) -> tuple[MeasurementTable, list[str]]:
    """The table without rows that repeat another number by number, and what was left out.

    A measurement that was made twice differs in its last digits; a row that was pasted twice does
    not, and would count double. So would a place that was exported under two names of the tool: two
    marks are never at one place to the last digit.
    """
    data, setup, lines = table.data, table.data.setup, table.lines
    read = np.zeros((data.count, 0)) if data.observed is None else data.observed
    tool = np.where(np.count_nonzero(read, axis=1) >= _PLACE, -1, setup.tool)
    of = np.stack([setup.kind, tool, setup.target, setup.payload], axis=1)
    rows = zip(of.tolist(), data.postures, read, strict=True)
    first = np.array(first_like((*k, q.tobytes(), r.tobytes()) for k, q, r in rows))
    kept = np.flatnonzero(first == np.arange(data.count))
    if len(kept) == data.count:
        return table, []
    again = [
        f"line {lines[i]} as line {lines[first[i]]}"
        for i in np.flatnonzero(first != np.arange(data.count))
    ]
    said = [f"rows that repeat another number by number are left out: {a_few(again, 'rows')}"]
    some = table.some(kept)
    used = [label for k, label in enumerate(data.tools) if (some.data.setup.tool == k).any()]
    double = [label for label in data.tools if label not in used]
    if double:
        some = replace(some, data=some.data.with_labels(some.data.targets, used))
        said.append(f"{', '.join(double)}: the same places as another mark of the tool, left out")
    return some, said


def oddities(data: Measurements, nominal_rms_m: float) -> list[str]:
    """What is odd about measurements as a whole, in words.

    ``nominal_rms_m``: how far the tool point as described is from its targets [m]; NaN where that
    is not known.
    """
    said = missing_poses(data.names)
    if nominal_rms_m < PLANNED_M:
        said.append(
            "the tool point of the arm as described is exactly on its target: these postures were "
            "planned, not measured"
        )
    once = seen_once(data)
    if once:
        said.append(
            f"measured once, which says nothing but where they are: {a_few(once, 'targets')}"
        )
    return said


def missing_poses(names: Sequence[str]) -> list[str]:
    """What a numbered plan has between its first and its last pose, and the data have not."""
    found = [_PLANNED.fullmatch(name) for name in dict.fromkeys(names)]
    if not names or not all(found):
        return []
    numbers = {int(match[1]) for match in found if match}
    width = min(len(match[1]) for match in found if match)
    gaps = [k for k in range(1, max(numbers)) if k not in numbers]
    if not gaps:
        return []
    absent = a_few([f"P{k:0{width}d}" for k in gaps], "poses")
    return [f"of the poses up to P{max(numbers):0{width}d} there are no measurements of {absent}"]
