"""Measurements out of the file of an instrument, and the joints that go with them.

Readings of one reflector at one stop of the arm are averaged; their scatter is that of a single
reading, and their number is kept. What was read of reflectors that stand still around the arm tells
whether the instrument has moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError, near_names
from calib.model import Setup
from calib.model.measurements import KINDS, Measurements
from calib.model.measurements.data import same_posture
from calib.se3 import FloatArray, IntArray, rotation_exp, rotation_log
from posedesign.cell import Cell
from posedesign.cell.models import noise_sigma
from posedesign.cell.observations import kind_of
from posedesign.cell.schema_sections import InstrumentSection, NoiseSection
from posedesign.files import head_of
from posedesign.files.csv_tables import LONGEST_SHOWN, MOST_LISTED, a_few, first_like, number_of
from posedesign.files.measurements import (
    MOST_MEASUREMENTS,
    REPEATS,
    TOOL,
    MeasurementTable,
    check_label,
    read_measurements,
)
from posedesign.identification.instruments.joining import (
    Joined,
    in_ranges,
    in_same_file,
    with_joints,
)
from posedesign.identification.instruments.joint_logs import read_joint_rows
from posedesign.identification.instruments.readings import Readings, is_known, read_readings
from posedesign.identification.instruments.scatter import (
    SIGNIFICANT,
    Scatter,
    drift_of,
    pooled,
    strays,
    trend_with,
)

TEMPERATURE, TIME = "temperature_c", "time_s"
"""Columns that are kept beside measurements, as :data:`REPEATS` is: temperature, and time of the
first reading."""

STREAM = 20
"""Readings of a reflector at a stop from which they are taken without end: neighbours are alike,
and their scatter is no noise of their mean."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured, for the cell that it is to be identified with."""

    cell: Cell  # with the noise of repeated readings, where they were to give it
    table: MeasurementTable


def is_of_instrument(cell: Cell, path: Path) -> bool:
    """Whether a file of measurements is an instrument's, and not a table with joints."""
    head = head_of(path, 20_000).decode("utf-8-sig", errors="replace")
    if is_known(head):
        return True
    lines = (line for line in head.splitlines() if line.strip() and not line.startswith("#"))
    columns = [cell.strip() for cell in next(lines, "").split(",")]
    own = "target" in columns and ("j1_deg" in columns or "pendant_j1_deg" in columns)
    return not own and cell.config.instrument != InstrumentSection()


def read_measured(
    cell: Cell,
    path: Path,
    joints: Path | None = None,
    *,
    each_visit: bool = False,
    trust_units: bool = False,
) -> Measured:
    """Read a table of measurements, or the file of an instrument with the joints of its poses.

    ``joints``: file of the joints; without it they stand in columns of the same file.
    ``each_visit``: what was read of a pose is averaged visit by visit, and not over all of them.
    Raises FileFormatError: naming file, line and column of what cannot be read, or is not known.
    InputError: there are no joints.
    """
    try:
        return _read(cell, path, joints, each_visit, trust_units)
    except FileFormatError as error:
        from posedesign.programs.registry import said_of_program  # all languages: slow to load

        if error.path != path:
            raise
        raise said_of_program(error) from None


def _read(
    cell: Cell, path: Path, joints: Path | None, each_visit: bool, trust_units: bool
) -> Measured:
    if joints is None and not is_of_instrument(cell, path):
        table = read_measurements(
            path,
            cell.robot.n,
            external=cell.robot.external,
            kind=cell.config.measurement.kind,
            payloads=[payload.name for payload in cell.config.payload],
            controller=cell.robot.controller,
            trust_units=trust_units,
        )
        return Measured(cell, table)
    section = _as_planned(cell)
    readings, notes = _once(read_readings(path, section))
    names, is_reference = _names_of(readings, section)
    own = np.flatnonzero(~is_reference)
    if not own.size:
        raise FileFormatError(
            "has readings of references only", path=path, hint="were reflectors on the tool read?"
        )
    labels = tuple(section.reflectors) or (TOOL,)
    tool = np.array([labels.index(names[i]) for i in own])
    of_tool = _some(readings, own)
    if joints is None:
        stops = in_same_file(of_tool, section, cell.robot)
    else:
        rows = read_joint_rows(joints, cell.robot, section, trust_units=trust_units)
        notes += rows.notes
        stops = with_joints(of_tool, tool, rows, section)
    notes += stops.notes
    found = stops.match.is_found
    if not found.any():
        why = next(iter(stops.match.unmatched(of_tool.lines.tolist())))
        raise FileFormatError(
            f"no reading belongs to a pose of {joints}: {why}",
            path=path,
            hint="is it the recording of these? instrument.match and clock_offset_s say how they "
            "go together",
        )
    for line, name in zip(readings.lines.tolist(), readings.poses, strict=False):
        check_label(path, line, name)
    for name in stops.names:
        check_label(path if joints is None else joints, 1, name, "pose")
    lost = stops.match.unmatched(of_tool.lines.tolist())
    notes += tuple(f"{path}: {said}, left out" for said in lost[:MOST_LISTED])
    grouped = _averaged(
        *(_some(of_tool, np.flatnonzero(found)), tool[found], labels, stops, section),
        each_visit=each_visit,
    )
    facts = {
        "measured": f"{len(of_tool.lines)} readings of {a_few(labels)} at "
        f"{len(set(stops.match.stop[found].tolist()))} poses, joints {stops.match.how}"
    }
    cell, said, odd = _judged(cell, section, grouped)
    facts |= said
    drifts = _references(readings, names, is_reference, grouped, section)
    facts |= {"drift": drifts[0]} if drifts[0] else {}
    notes += (*odd, *drifts[1])
    if readings.temperatures is not None and np.isfinite(readings.temperatures).any():
        low, high = np.nanmin(readings.temperatures), np.nanmax(readings.temperatures)
        facts["temperature"] = f"{low:.1f} to {high:.1f} deg C"
    return Measured(cell, replace(grouped.table, notes=(*readings.notes, *notes), facts=facts))


def _some(readings: Readings, rows: IntArray) -> Readings:
    """Some of the readings."""
    times, temperatures, joints = (
        None if values is None else values[rows]
        for values in (readings.times, readings.temperatures, readings.joints)
    )
    return replace(
        readings,
        lines=readings.lines[rows],
        values=readings.values[rows],
        reflectors=tuple(readings.reflectors[i] for i in rows),
        poses=tuple(readings.poses[i] for i in rows) if readings.poses else (),
        times=times,
        temperatures=temperatures,
        joints=joints,
    )


def _once(readings: Readings) -> tuple[Readings, tuple[str, ...]]:
    """Readings without those that are there twice, number by number."""
    given = (readings.times, readings.joints)
    keys = [
        (
            readings.values[i].tobytes(),
            readings.reflectors[i],
            readings.poses[i] if readings.poses else "",
            *(values[i].tobytes() for values in given if values is not None),
        )
        for i in range(len(readings.lines))
    ]
    first = np.array(first_like(keys))
    kept = first == np.arange(len(first))
    if kept.all():
        return readings, ()
    twice = in_ranges(readings.lines[~kept].tolist())
    said = f"{readings.path}: {twice} repeat others number by number, left out"
    return _some(readings, np.flatnonzero(kept)), (said,)


def _as_planned(cell: Cell) -> InstrumentSection:
    """The section of the file, its frame and reflectors those of the plan where it names none."""
    section, config = cell.config.instrument, cell.config
    given = section.model_fields_set
    planned = next((t for t in config.targets if kind_of(config, t) == section.kind), None)
    known: dict[str, object] = {}
    if planned is not None and "frame" not in given:
        known["frame"] = planned.name
    if planned is not None and section.kind == "point" and "reflectors" not in given:
        known["reflectors"] = tuple(mark.name for mark in config.tool.mark)
    return section.model_copy(update=known)


def _names_of(
    readings: Readings, section: InstrumentSection
) -> tuple[list[str], np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """The reflector of each reading, and whether that stands still around the arm."""
    names = list(readings.reflectors)
    said = any(names)
    if not said and readings.poses:  # names of points are of poses, but for references
        names = [pose if pose in section.references else "" for pose in readings.poses]
    reference = np.array([name in section.references for name in names])
    if not section.reflectors:
        others = {name for name, fixed in zip(names, reference, strict=True) if not fixed}
        if len(others) > 1:
            raise FileFormatError(
                f"has readings of {len(others)} reflectors: {a_few(sorted(others))}",
                path=readings.path,
                hint="name those on the tool in instrument.reflectors",
            )
        return [n if f else TOOL for n, f in zip(names, reference, strict=True)], reference
    if not said:
        count = len(section.reflectors)
        return [section.reflectors[i % count] for i in range(len(names))], reference
    known = [*section.reflectors, *section.references]
    for i, name in enumerate(names):
        if name not in known:
            raise FileFormatError(
                f"there is no reflector {name[:LONGEST_SHOWN]!r}",
                path=readings.path,
                row=int(readings.lines[i]),
                hint=f"{near_names(name, known)}; instrument.reflectors and references name them",
            )
    return names, reference


@dataclass(frozen=True, eq=False)
class _Averaged:
    """Means of the readings of one reflector at one stop, in the order of the readings."""

    table: MeasurementTable  # of G measurements, with what is kept beside them
    values: FloatArray  # (G, 3) or (G, 6): their places [m], rotation vectors [rad]
    count: IntArray  # (G,): readings of each
    times: FloatArray  # (G,): of the first [s], or the order where there are no times
    scatter: Scatter | None


def _averaged(
    readings: Readings,
    tool: IntArray,
    labels: tuple[str, ...],
    stops: Joined,
    section: InstrumentSection,
    *,
    each_visit: bool,
) -> _Averaged:
    stop = stops.match.stop[stops.match.is_found]
    # what was read one after another at a pose is of one visit
    visit = np.append(0, np.cumsum(np.diff(stop) != 0)) if each_visit else stop
    _, first, index = np.unique(
        np.stack([visit, tool], axis=1), axis=0, return_index=True, return_inverse=True
    )
    groups, index = len(first), index.ravel()
    if groups > MOST_MEASUREMENTS:
        raise FileFormatError(
            f"holds {groups} measurements, {MOST_MEASUREMENTS} are the most that are identified "
            "at once",
            path=readings.path,
            hint="give one reading a pose",
        )
    values = readings.values
    if section.kind == "pose":  # about the first of each group, whose turns differ by little
        R = rotation_exp(values[:, 3:])
        off = rotation_log(R @ np.swapaxes(R[first][index], -1, -2))
        mean, count, scatter = pooled(np.concatenate([values[:, :3], off], axis=1), index)
        turned = rotation_log(rotation_exp(mean[:, 3:]) @ R[first])
        mean = np.concatenate([mean[:, :3], turned], axis=1)
    else:
        mean, count, scatter = pooled(values, index)
    kept: dict[str, FloatArray] = {}
    if readings.times is not None:
        kept[TIME] = readings.times[first]
    if readings.temperatures is not None:
        known = np.isfinite(readings.temperatures)
        size = np.bincount(index[known], minlength=groups)
        total = np.bincount(index[known], readings.temperatures[known], minlength=groups)
        kept[TEMPERATURE] = np.where(size > 0, total / np.maximum(size, 1), np.nan)
    extra = {REPEATS: tuple(str(n) for n in count.tolist())}
    for column, numbers in kept.items():
        extra[column] = tuple(f"{v:.6f}" if np.isfinite(v) else "" for v in numbers.tolist())
    names = stops.names or tuple(f"P{k + 1:02d}" for k in range(len(stops.postures)))
    data = Measurements(
        stops.postures[stop[first]],
        Setup.of(groups, tool=tool[first]),
        (section.frame,),
        labels,
        mean,
        tuple(names[k] for k in stop[first]),
    )
    lines = tuple(readings.lines[first].tolist())
    table = MeasurementTable(data, (section.kind,), lines, readings.path, (), extra)
    return _Averaged(table, mean, count, kept.get(TIME, np.arange(groups, dtype=float)), scatter)


def _judged(
    cell: Cell, section: InstrumentSection, grouped: _Averaged
) -> tuple[Cell, dict[str, str], list[str]]:
    """The cell with its noise, and what is to be said of the scatter of repeated readings."""
    scatter = grouped.scatter
    if scatter is None or not (scatter.sigma[:3] > 0).all():
        if section.noise == "repeats":
            raise InputError(
                "the noise was to be that of repeated readings, and there are none that differ",
                hint='take instrument.noise = "stated"',
                name="noise",
            )
        return cell, {}, []
    shown = ", ".join(f"{1e3 * s:.3g}" for s in scatter.sigma[:3])
    words = f"a reading scatters by {shown} mm along x, y, z ({scatter.freedom} degrees of freedom)"
    many = int(grouped.count.max()) > STREAM
    odd: list[str] = []
    given = next((noise for noise in cell.config.noise if noise.kind == section.kind), None)
    if given is not None and not many and section.noise == "stated":
        stated = noise_sigma(given)
        chance = scatter.probability(stated)
        if chance < SIGNIFICANT:
            was = ", ".join(f"{1e3 * s:.3g}" for s in stated[:3])
            odd.append(
                f"{words}: that is another noise than the {was} mm of [[noise]] (p = {chance:.1g})"
            )
        else:
            words += ", as [[noise]] says"
    if section.noise == "repeats":
        # the mean of a few is better than one; of a stream, whose neighbours are alike, it is not
        mean = scatter.sigma if many else scatter.sigma * np.sqrt(np.mean(1.0 / grouped.count))
        angles = tuple(3.0 * np.rad2deg(mean[3:])) if KINDS[section.kind].turns else None
        noise = NoiseSection(
            kind=section.kind, three_sigma_mm=tuple(3e3 * mean[:3]), three_sigma_deg=angles
        )
        others = tuple(n for n in cell.config.noise if n.kind != section.kind)
        cell = replace(cell, config=cell.config.model_copy(update={"noise": (*others, noise)}))
        words += ", which is the noise"
    return cell, {"repeats": words}, odd


def goes_with_temperature(table: MeasurementTable, residuals: FloatArray) -> list[str]:
    """What is to be said of residuals ``(N, m)`` [m] that go with the temperature; else nothing."""
    cells = table.extra.get(TEMPERATURE, ())
    known = np.array([number_of(cell) for cell in cells])
    found = trend_with(residuals[:, :3], known) if len(known) else None
    if found is None or found.probability >= SIGNIFICANT:
        return []
    axis = "xyz"[found.axis]
    return [
        f"residuals along {axis} go with the temperature, by {1e3 * found.slope:.3g} mm/K "
        f"(correlation {found.correlation:.2f}, p = {found.probability:.1g}): let arm and "
        "instrument warm up, or measure in less time"
    ]


def _references(
    readings: Readings,
    names: Sequence[str],
    is_reference: np.ndarray[tuple[int], np.dtype[np.bool_]],
    grouped: _Averaged,
    section: InstrumentSection,
) -> tuple[str, list[str]]:
    """What is to be said of references, and of postures that the arm went back to."""
    series: list[tuple[str, FloatArray, FloatArray, tuple[str, ...]]] = []
    said: list[str] = []
    for name in section.references:
        own = np.flatnonzero(is_reference & (np.array(names) == name))
        when = own.astype(float) if readings.times is None else readings.times[own]
        own, when = own[np.argsort(when, kind="stable")], np.sort(when)
        stray = strays(readings.values[own, :3])
        if stray.any():
            lines = [f"line {line}" for line in readings.lines[own[stray]]]
            said.append(
                f"{readings.path}: readings of the reference {name} are of another place: "
                f"{a_few(lines, 'readings')}, left out of the look for drift"
            )
        own, when = own[~stray], when[~stray]
        where = tuple(f"line {line}" for line in readings.lines[own])
        series.append((name, readings.values[own, :3], when, where))
    data = grouped.table.data
    postures, tools = same_posture(data.postures), data.setup.tool
    for key in np.unique(np.stack([postures, tools], axis=1), axis=0).tolist():
        own = np.flatnonzero((postures == key[0]) & (tools == key[1]))
        own = own[np.argsort(grouped.times[own])]
        where = tuple(data.names[i] for i in own)
        name = f"{data.tools[key[1]]} at the posture of {where[0]}"
        series.append((name, grouped.values[own, :3], grouped.times[own], where))
    found = [(s, d) for s in series if (d := drift_of(s[1], s[2])) is not None]
    if not found:
        return "", said
    notes = []
    for (name, _, _, where), drift in found:
        chance = min(1.0, drift.probability * len(found))
        if chance < SIGNIFICANT:
            moved = f"steps by {1e3 * drift.size:.3g} mm before {where[drift.at]}"
            if drift.cause == "drift":
                moved = f"drifts by {1e3 * drift.size:.3g} mm from {where[0]} to {where[-1]}"
            notes.append(
                f"{readings.path}: the reference {name} {moved} (p = {chance:.1g}): the instrument "
                "or what it stands on has moved"
            )
    if notes:
        return "", [*said, *notes]
    largest = max(1e3 * drift.size for _, drift in found)
    what = f"{len(found)} references" if len(found) > 1 else f"the reference {found[0][0][0]}"
    return f"none seen by {what}, {largest:.2g} mm at most", said
