"""Readings and the poses that they were taken at: where the arm stood, and what was read there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.model.measurements.data import SAME_POSTURE_RAD
from calib.robots import Robot
from calib.se3 import FloatArray, IntArray, rotation_exp
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files.csv_tables import LONGEST_SHOWN, a_few
from posedesign.identification.instruments.joint_logs import JointRows, joints_of
from posedesign.identification.instruments.matching import (
    Matched,
    in_ranges,
    is_record,
    match_names,
    match_times,
    stops_of,
)
from posedesign.identification.instruments.readings import Readings

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
