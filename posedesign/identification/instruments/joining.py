"""Readings and the poses that they were taken at: by the names of poses, by time, or in order.

An arm that is recorded without end stands still at its poses: there the mean is taken, and what was
read while it moved belongs to no pose. Rows of joints that were written one a pose are such stops
themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.model.measurements.data import SAME_POSTURE_RAD
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_exp
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files.csv_tables import LONGEST_SHOWN, a_few
from posedesign.identification.instruments.joint_logs import JointRows, joints_of
from posedesign.identification.instruments.readings import Readings

GAP = 5.0
"""Times the usual time between two rows of a record from which it has a gap."""

CREEP = 3.0
"""Times the range of a standstill that one stop may have over all its time."""

_MOST_SHOWN = 3


@dataclass(frozen=True, eq=False)
class Stops:
    """Where something stood still."""

    first: IntArray
    last: IntArray  # first, last (K,): rows of the record that each is the mean of
    creeping: tuple[int, ...] = ()
    """Those that were no standstill: too slow to be seen in a short time."""

    @property
    def middle(self) -> Stops:
        """The middle half of each: at its ends an arm still moves, within the range."""
        quarter = (self.last - self.first) // 4
        return Stops(self.first + quarter, self.last - quarter)

    def mean(self, values: FloatArray) -> FloatArray:
        """Means ``(K, m)`` of rows ``(N, m)`` over each stop."""
        return np.array(
            [values[a : b + 1].mean(axis=0) for a, b in zip(self.first, self.last, strict=True)]
        ).reshape(len(self.first), values.shape[1])


def stops_of(times: FloatArray, values: FloatArray, still_s: float, bound: float) -> Stops:
    """Where rows ``(N, m)`` of a record stay within a range for a time.

    ``times`` (N,): rising [s]. ``still_s``: least time. ``bound``: largest range of each column in
    this time.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    usual = float(np.median(np.diff(times)))
    width = max(2, round(still_s / usual) + 1)
    if width > len(times):
        return Stops(*np.zeros((2, 0), dtype=np.intp))
    to_first = -(width // 2)  # the range of each window stands at its first row
    span = maximum_filter1d(values, width, axis=0, origin=to_first) - minimum_filter1d(
        values, width, axis=0, origin=to_first
    )
    count = len(times) - width + 1
    steady = (span[:count] <= bound).all(axis=1)
    whole = times[width - 1 :] - times[:count] <= (width - 1) * usual + GAP * usual
    begins = np.flatnonzero(steady & whole)
    inside = np.zeros(len(times) + 1, dtype=int)
    np.add.at(inside, begins, 1)
    np.add.at(inside, begins + width, -1)
    still = np.cumsum(inside)[:-1] > 0
    broken = np.append(np.diff(times) > GAP * usual, True)
    ends = np.flatnonzero(still & (~np.append(still[1:], False) | broken))
    firsts = np.flatnonzero(still & (~np.append(False, still[:-1]) | np.append(True, broken[:-1])))
    creeping = [
        k
        for k, (a, b) in enumerate(zip(firsts.tolist(), ends.tolist(), strict=True))
        if (np.ptp(values[a : b + 1], axis=0) > CREEP * bound).any()
    ]
    kept = np.setdiff1d(np.arange(len(firsts)), creeping)
    return Stops(firsts[kept], ends[kept], tuple(firsts[creeping].tolist()))


def is_record(times: FloatArray, still_s: float) -> bool:
    """Whether rows are many a standstill, and not one a pose."""
    return len(times) > 2 and float(np.median(np.diff(times))) < 0.5 * still_s


@dataclass(frozen=True, eq=False)
class Matched:
    """Which stop each reading belongs to."""

    stop: IntArray  # (N,): below zero for none
    reason: tuple[str, ...]  # why there is none; empty for those that have one
    how: str  # in words

    @property
    def is_found(self) -> BoolArray:
        return np.asarray(self.stop >= 0)

    def unmatched(self, lines: Sequence[int]) -> list[str]:
        """What belongs to no stop, in words: lines by their reason."""
        by_reason: dict[str, list[int]] = {}
        for i in np.flatnonzero(~self.is_found).tolist():
            by_reason.setdefault(self.reason[i], []).append(lines[i])
        return [f"{in_ranges(rows)}: {reason}" for reason, rows in by_reason.items()]


def in_ranges(lines: Sequence[int]) -> str:
    """Lines in words, neighbours as a range: ``lines 4 to 9 and 12``."""
    numbers = np.unique(np.asarray(lines))
    cut = np.flatnonzero(np.diff(numbers) > 1)
    starts, ends = numbers[np.append(0, cut + 1)], numbers[np.append(cut, len(numbers) - 1)]
    shown = [
        f"{a}" if a == b else f"{a} to {b}"
        for a, b in zip(starts[:_MOST_SHOWN].tolist(), ends[:_MOST_SHOWN].tolist(), strict=True)
    ]
    more = int((ends[_MOST_SHOWN:] - starts[_MOST_SHOWN:] + 1).sum())
    which = ", ".join(shown) + (f" and {more} more" if more else "")
    return f"line{'s' if len(numbers) > 1 else ''} {which}"


def match_names(wanted: Sequence[str], known: Sequence[str]) -> Matched:
    """By the names of poses."""
    index = {name: k for k, name in enumerate(known)}
    stop = np.array([index.get(name, -1) for name in wanted], dtype=np.intp)
    reason = tuple("" if name in index else f"there are no joints of {name}" for name in wanted)
    return Matched(stop, reason, "by name")


def match_times(
    times: FloatArray, start: FloatArray, end: FloatArray, record: FloatArray, tolerance_s: float
) -> Matched:
    """By time: the stop that a reading falls into, or the nearest one within a tolerance.

    ``times`` (N,): of the readings, on the clock of the joints [s]. ``start``, ``end`` (K,): of
    each stop, rising. ``record`` (R,): times of all rows of joints: empty where each is a stop.
    Within a record there is no tolerance: joints are known at any time, and an arm that moves
    stands at no pose.
    """
    k = np.searchsorted(start, times, side="right") - 1
    before, after = np.maximum(k, 0), np.minimum(k + 1, len(start) - 1)
    late = np.where(k < 0, np.inf, np.maximum(times - end[before], 0.0))
    early = np.where(k + 1 > len(start) - 1, np.inf, start[after] - times)
    stop, off = np.where(late <= early, before, after), np.minimum(late, early)
    stop = np.where(off <= (0.0 if record.size else tolerance_s), stop, -1)
    reason = [""] * len(times)
    for i in np.flatnonzero(stop < 0).tolist():
        reason[i] = _why(float(times[i]), float(off[i]), record, tolerance_s)
    return Matched(stop, tuple(reason), "by time")


def _why(time: float, off: float, record: FloatArray, tolerance_s: float) -> str:
    """Why no stop is at a time."""
    if not np.isfinite(time):
        return "it has no time"
    if not record.size:
        return f"no joints within {tolerance_s:g} s"
    if time < record[0]:
        return "read before the record of joints begins"
    if time > record[-1]:
        return "read after the record of joints ends"
    i = int(np.searchsorted(record, time))
    gap = float(record[min(i, len(record) - 1)] - record[max(i - 1, 0)])
    if gap > GAP * float(np.median(np.diff(record))):
        return "in a gap of the record of joints"
    return "the arm was not at rest"


_LEVER_M = 0.1
"""Distance from its origin at which a body has to stand still, too."""


@dataclass(frozen=True, eq=False)
class Joined:
    """Where the arm stood, and which of it each reading is of."""

    postures: FloatArray
    names: tuple[str, ...]
    match: Matched
    notes: tuple[str, ...] = ()


def in_same_file(readings: Readings, section: InstrumentSection, robot: Robot) -> Joined:
    """Stops of joints that stand in the file of the readings: a new one where they are others."""
    if readings.joints is None:
        raise InputError(
            f"{readings.path} has no joints",
            hint="give the file of the `joints`, or name their columns in "
            "instrument.columns.joints of the cell",
            name="joints",
        )
    postures = joints_of(readings.path, readings.joints, section, robot)
    moved = np.abs(np.diff(postures, axis=0)).max(axis=1) > SAME_POSTURE_RAD
    if readings.poses:
        said = np.array(readings.poses)
        moved |= said[1:] != said[:-1]
    stop = np.append(0, np.cumsum(moved))
    first = np.unique(stop, return_index=True)[1]
    names = tuple(readings.poses[i] for i in first) if readings.poses else ()
    match = Matched(stop, ("",) * len(stop), "in the same file")
    return Joined(postures[first], names, match)


def with_joints(
    readings: Readings, tool: IntArray, rows: JointRows, section: InstrumentSection
) -> Joined:
    """Stops of a file of joints, and the readings that are of each."""
    notes: tuple[str, ...] = ()
    postures, start, end = rows.postures, rows.times, rows.times
    names, record = rows.names, np.zeros(0)
    if rows.times is not None and is_record(rows.times, section.still_s):
        # of what slides the same number: the way of a point a metre from a joint
        still = stops_of(rows.times, postures, section.still_s, np.deg2rad(section.still_deg))
        if still.creeping:
            lines = [int(rows.lines[i]) for i in still.creeping]
            notes += (f"{rows.path}: from {in_ranges(lines)} on the arm creeps: no stop",)
        if not len(still.first):
            raise FileFormatError(
                f"the arm stands still nowhere, for {section.still_s:g} s within "
                f"{section.still_deg:g} deg",
                path=rows.path,
                hint="set instrument.still_s and still_deg to how it stood",
            )
        record, names = rows.times, ()
        postures = still.middle.mean(postures)
        if readings.times is not None and _is_stream(readings, tool, section):
            still = still.middle
        start, end = rows.times[still.first], rows.times[still.last]
    times = None if readings.times is None else readings.times + section.clock_offset_s
    how = section.match
    if how == "auto" and set(names) & set(readings.poses):
        how = "pose"
    elif how == "auto":
        how = "time" if _meet(times, start, end, section) else "order"
    if how == "pose":
        _check_has("names of poses", bool(names), rows.path, bool(readings.poses), readings.path)
        _check_names(rows, names)
        match = match_names(readings.poses, names)
    elif how == "time":
        here = start is not None and end is not None
        _check_has("times", here, rows.path, times is not None, readings.path)
        match = match_times(
            np.zeros(0) if times is None else times,
            np.zeros(0) if start is None else start,
            np.zeros(0) if end is None else end,
            record,
            section.tolerance_s,
        )
        if _is_stream(readings, tool, section):
            _check_still(readings, _main(tool), match, section)
    else:
        match = _in_order(readings, tool, len(postures), rows.path, section)
    if not names:
        names = _names_by(readings, match, len(postures))
    missing = [names[k] for k in sorted(set(range(len(postures))) - set(match.stop.tolist()))]
    if missing:
        notes += (f"{rows.path}: of {len(missing)} poses nothing was read: {a_few(missing)}",)
    return Joined(postures, names, match, notes)


def _check_still(
    readings: Readings, main: IntArray, match: Matched, section: InstrumentSection
) -> None:
    """What is read without end stands still where the arm does, or the clocks are not one."""
    stop = match.stop[main]
    places, stop = readings.values[main[stop >= 0], :3], stop[stop >= 0]
    most, least = (np.full((stop.max(initial=0) + 1, 3), bound) for bound in (-np.inf, np.inf))
    np.maximum.at(most, stop, places)
    np.minimum.at(least, stop, places)
    seen = np.isfinite(most[:, 0])
    moved = (most[seen] - least[seen]).max(axis=1) > section.still_mm / 1e3
    if 2 * moved.sum() > len(moved):
        raise FileFormatError(
            f"what was read moves at {moved.sum()} of {len(moved)} poses while the arm stands "
            "still: the clocks differ",
            path=readings.path,
            hint='set instrument.clock_offset_s, or match = "order"',
        )


def _names_by(readings: Readings, match: Matched, count: int) -> tuple[str, ...]:
    """Names of stops: those that the readings have, where they are one's each; else numbers."""
    named = dict(zip(match.stop.tolist(), readings.poses, strict=False))
    if len(set(named.values())) < len(named):
        named = {}
    return tuple(named.get(k, f"P{k + 1:02d}") for k in range(count))


def _main(tool: IntArray) -> IntArray:
    """Readings of the reflector that was seen most."""
    return np.flatnonzero(tool == np.bincount(tool).argmax())


def _is_stream(readings: Readings, tool: IntArray, section: InstrumentSection) -> bool:
    """Whether readings were taken without end, and not one a pose."""
    return readings.times is not None and is_record(readings.times[_main(tool)], section.still_s)


def _meet(
    times: FloatArray | None,
    start: FloatArray | None,
    end: FloatArray | None,
    section: InstrumentSection,
) -> bool:
    """Whether clocks of readings and joints show the same hours."""
    if times is None or start is None or end is None:
        return False
    within = section.tolerance_s
    return bool(times.max() >= start[0] - within and times.min() <= end[-1] + within)


def _check_has(what: str, joints: bool, path: Path, readings: bool, other: Path) -> None:
    for there, where in ((joints, path), (readings, other)):
        if not there:
            raise FileFormatError(
                f"has no {what} to match by",
                path=where,
                hint="name their column in instrument.columns, or take another instrument.match",
            )


def _check_names(rows: JointRows, names: Sequence[str]) -> None:
    """Joints of one pose stand in one row."""
    first: dict[str, int] = {}
    for k, name in enumerate(names):
        j = first.setdefault(name, k)
        if np.abs(rows.postures[k] - rows.postures[j]).max() > SAME_POSTURE_RAD:
            raise FileFormatError(
                f"pose {name[:LONGEST_SHOWN]} has other joints on line {rows.lines[j]}",
                path=rows.path,
                row=int(rows.lines[k]),
                hint="give each pose a name of its own",
            )


def _in_order(
    readings: Readings, tool: IntArray, count: int, path: Path, section: InstrumentSection
) -> Matched:
    """Readings at so many stops in order: by names, by standstills, or reflector by reflector."""
    stop = np.zeros(len(readings.lines), dtype=np.intp)
    reason = [""] * len(stop)
    main = _main(tool)
    times = readings.times
    if times is not None and _is_stream(readings, tool, section):
        if (np.diff(times[main]) <= 0).any():
            raise FileFormatError(
                "the time of its readings does not rise",
                path=readings.path,
                row=int(readings.lines[main[np.diff(times[main]).argmin() + 1]]),
                hint="give one recording, in the order that it was made",
            )
        places = readings.values[main, :3]
        if section.kind == "pose":  # a body may turn about its own origin
            R = rotation_exp(readings.values[main, 3:])
            places = np.concatenate([places, _LEVER_M * R.reshape(-1, 9)], axis=1)
        still = stops_of(times[main], places, section.still_s, section.still_mm / 1e3)
        still, what = still.middle, "standstills"
        found = len(still.first)
        start, end = times[main][still.first], times[main][still.last]
        k = np.searchsorted(start, times, side="right") - 1
        inside = (k >= 0) & (times <= end[np.maximum(k, 0)]) if found else k > 0
        stop = np.where(inside, k, -1)
        reason = ["" if ok else "it was not at rest" for ok in inside.tolist()]
    elif readings.poses:
        order = {name: k for k, name in enumerate(dict.fromkeys(readings.poses))}
        stop = np.array([order[name] for name in readings.poses])
        found, what = len(order), "poses by name"
    else:
        for label in np.unique(tool).tolist():
            own = np.flatnonzero(tool == label)
            stop[own] = np.arange(len(own))
        each = np.bincount(tool)
        found, what = int(each.max()), "readings of a reflector"
        if len(set(each.tolist())) > 1 and count == found:
            found = int(each.min())
    if found != count:
        span = 1e3 * float(np.linalg.norm(np.ptp(readings.values[:, :3], axis=0)))
        raise FileFormatError(
            f"has {found} {what}, and {path} {count} poses",
            path=readings.path,
            hint=f"what was read moves by {span:.3g} mm in all: is its unit right? Else leave out "
            "what does not belong, or match them by names of poses or by time",
            value=found,
            bound=count,
        )
    return Matched(stop, tuple(reason), "in order")
