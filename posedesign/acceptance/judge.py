"""The verdict of an acceptance test: measured places against those where the arm was to be.

At each measurement the arm as described, and the arm as identified, say where the point of the tool
is in the base frame; the instrument says where it was, in its own. The frame of the instrument is
the one that fits best (least squares of the positions), for the arm before and after apart, or is
given. Places of a proof are each judged in the frame that the others give: one that had a part in
its own frame would look better than it is. By kind of measurement:

point, pose      what was read against the point of the tool
touch-up         where the cell says that the target is against the point of the tool; targets of a
                 plate share its frame, one alone has a place only
distance         what was read against the distance of the point of the tool from its foot

Distances between the poses of a test (ISO 9283, 7.3) need no frame at all. Orientations are judged
where poses were read, by rotation vectors in base axes: of turns below a degree these are the
differences of the three angles to a hundredth.

What was identified is judged by what was not: rows that the identification was made from are
refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from scipy.optimize import least_squares

from calib.errors import InputError
from calib.model import Setup
from calib.se3 import (
    FloatArray,
    IntArray,
    project_to_rotation,
    rotation_exp,
    rotation_log,
    transform,
)
from posedesign.acceptance.iso9283 import (
    CHANCE,
    DistanceCharacteristics,
    Figure,
    PoseCharacteristics,
    distance_characteristics,
    pose_characteristics,
)
from posedesign.acceptance.places import ISO, AcceptanceRequest, where_axes_stood
from posedesign.acceptance.sampling import content_proven
from posedesign.cell import Cell
from posedesign.cell.observations import instrument_frame, mark_named, place_of, target_named
from posedesign.files.measurements import REPEATS, MeasurementTable
from posedesign.identification.file import IdentifiedModel

BEFORE, AFTER = "as described", "as identified"

FEWEST_FOR_FRAME = 3

ONE_POINT_M = 1e-3
"""Extent of places that are one: touched up, they lie apart by what the touching scatters."""

_EVERY_DISTANCE = 30
"""Poses of a test up to which the distances between all of them are judged."""

_RESAMPLED = 2000


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors of one arm in a test."""

    arm: str
    frames: Mapping[str, FloatArray]
    """By target, pose ``(4, 4)`` of the instrument or plate in the base frame; of a foot, its
    place."""
    errors: FloatArray
    """(N, 3): measured less commanded position of each measurement, base axes [m]; of distances the
    first number is what was read less what it should be."""
    places: FloatArray
    """(K,): error of each pose of the test [m], the mean of its cycles; in a test of places by the
    frame that the others give."""
    poses: Mapping[str, PoseCharacteristics]  # by pose; empty where distances alone were read
    distances: Mapping[tuple[str, str], DistanceCharacteristics]
    """By pair of poses, or pose and foot."""
    rms: Figure  # root mean square of ``places`` [m]
    beyond: int  # how many places are beyond the limit, those that were not measured included

    @property
    def worst_m(self) -> float:
        return float(self.places.max())


@dataclass(frozen=True, eq=False)
class Verdict:
    """Outcome of an acceptance test."""

    request: AcceptanceRequest
    names: tuple[str, ...]  # of the poses
    points_m: FloatArray  # (K, 3): where the point of the tool was to be, in the base frame
    judged: tuple[Judged, ...]
    missing: tuple[str, ...]  # poses of the test that were not measured: they count as beyond
    frame: str
    notes: tuple[str, ...] = ()

    @property
    def final(self) -> Judged:
        """The arm that is judged: as identified, where it was."""
        return self.judged[-1]

    def passed(self, judged: Judged | None = None) -> bool:
        """Whether the test is passed by an arm; by the one that is judged."""
        found = self.final if judged is None else judged
        allowed = 0 if self.request.test == ISO else self.request.allowed
        return len(self.names) + len(self.missing) >= self.request.count and found.beyond <= allowed

    def proven(self, judged: Judged | None = None) -> float:
        """The part of all places that is within the limit, with the confidence asked for."""
        found = self.final if judged is None else judged
        count = len(self.names) + len(self.missing)
        return content_proven(count, found.beyond, self.request.confidence)


def judge(
    cell: Cell,
    table: MeasurementTable,
    request: AcceptanceRequest,
    *,
    planned: Sequence[str] = (),
    used: IdentifiedModel | None = None,
    before: IdentifiedModel | None = None,
    given_frame: bool = False,
) -> Verdict:
    """Judge an arm by the measurements of a test.

    ``planned``: names of the poses of the test. ``used``: what the arm is corrected by. ``before``:
    the arm as described with its tool as found; by default the tool is that of the cell.
    ``given_frame``: take the instrument where the cell says, in place of where it fits best. Raises
    InputError: measurements that do not tell where the tool is, or too few for a frame.
    """
    data, kinds = table.data, [table.kinds[k] for k in table.data.setup.kind]
    strange = next((k for k in kinds if k not in ("point", "pose", "touch-up", "distance")), None)
    if strange is not None:
        raise InputError(
            f"a {strange} does not tell where the tool is",
            hint="test by point, pose, touch-up or distance",
            name="kind",
        )
    arms = [(BEFORE, before)] if used is None else [(BEFORE, before), (AFTER, used)]
    names = tuple(dict.fromkeys(data.names))
    if planned:
        strange = next((name for name in names if name not in planned), None)
        if strange is not None:
            raise InputError(
                f"{strange[:40]} is no pose of the test",
                hint="give what was measured at its poses",
                name="pose",
            )
    missing = tuple(name for name in planned if name not in names)
    judged = [
        _judged(cell, table, request, label, arm, names, missing, given_frame)
        for label, arm in arms
    ]
    commanded = _tool_frames(cell, table, arms[-1][1])[:, :3, 3]
    points = np.array([commanded[[n == name for n in data.names]].mean(axis=0) for name in names])
    return Verdict(
        request,
        names,
        points,
        tuple(judged),
        missing,
        "given by the cell" if given_frame else "fitted to this test, before and after apart",
        (
            *where_axes_stood(cell.robot, data.postures),
            *(_without_repeatability(table, judged[-1]) if request.times > 1 else ()),
        ),
    )


def _without_repeatability(table: MeasurementTable, judged: Judged) -> tuple[str, ...]:
    """Why there is no RP: it is of visits, and what an instrument reads at one is its own noise."""
    if not judged.poses or any(found.cycles > 1 for found in judged.poses.values()):
        return ()
    read = max((int(n) for n in table.extra.get(REPEATS, ()) if n.isdecimal()), default=1)
    own = f": its {read} readings scatter as the instrument does" * (read > 1)
    return (f"RP needs several visits of a pose, each read by itself, and there is one{own}",)


def _tool_frames(cell: Cell, table: MeasurementTable, arm: IdentifiedModel | None) -> FloatArray:
    """Poses ``(N, 4, 4)`` of what was measured of the tool, in the base frame."""
    data = table.data
    if arm is None:
        points = np.array([mark_named(cell, label).point_m for label in data.tools])
        on_tip = np.tile(np.eye(4), (data.count, 1, 1))
        on_tip[:, :3, 3] = points[data.setup.tool]
        return np.asarray(cell.robot.fk(data.postures) @ on_tip)
    tools = data.with_labels(data.targets, arm.model.tools).setup.tool
    setup = Setup.of(data.count, tool=tools, payload=data.setup.payload)
    view = arm.model.view(data.postures, arm.x, setup)
    R = np.broadcast_to(view.tool.transpose(2, 1, 0), (data.count, 3, 3))
    return transform(R, view.tool_points)


def _judged(
    cell: Cell,
    table: MeasurementTable,
    request: AcceptanceRequest,
    label: str,
    arm: IdentifiedModel | None,
    names: Sequence[str],
    missing: Sequence[str],
    given_frame: bool,
) -> Judged:
    data = table.data
    T = _tool_frames(cell, table, arm)
    kinds = table.kind_of_each
    pose = data.pose
    errors, left = np.zeros((data.count, 3)), np.zeros((data.count, 3))
    turns: FloatArray | None = None
    frames: dict[str, FloatArray] = {}
    for who, rows, read in _sources(cell, table):
        at = T[rows, :3, 3]
        if kinds[rows[0]] == "distance":
            foot = _foot(cell, who, at, read[:, 0], given_frame)
            errors[rows, 0] = read[:, 0] - np.linalg.norm(at - foot, axis=1)
            left[rows] = errors[rows]
            frames[who] = transform(np.eye(3), foot)
            continue
        touched = kinds[rows[0]] == "touch-up"
        frame = _given(cell, who, touched) if given_frame else best_frame(read, at)
        frames[who] = frame
        errors[rows] = read @ frame[:3, :3].T + frame[:3, 3] - at
        left[rows] = errors[rows]
        if not given_frame and request.test != ISO:
            left[rows] = _by_others(read, at, pose[rows])
        if kinds[rows[0]] == "pose" and arm is not None and data.observed is not None:
            R = rotation_exp(data.observed[rows, 3:6])
            turned = rotation_log(frame[:3, :3] @ R @ np.swapaxes(T[rows, :3, :3], -1, -2))
            turns = np.full((data.count, 3), np.nan) if turns is None else turns
            turns[rows] = turned
    groups = _groups(table)
    far = {group: float(np.linalg.norm(left[rows].mean(axis=0))) for group, rows in groups.items()}
    poses: dict[str, PoseCharacteristics] = {}
    for (name, mark), rows in groups.items():
        if kinds[rows[0]] == "distance":
            continue  # no position: its own characteristics are below
        seen = None if turns is None or np.isnan(turns[rows]).any() else turns[rows]
        found = pose_characteristics(errors[rows], seen)
        poses[f"{name} {mark}".rstrip()] = found
        if request.test == ISO:
            far[name, mark] = found.accuracy.value
    # of several marks the one that is worst counts
    places = np.array([max(v for (own, _), v in far.items() if own == name) for name in names])
    beyond = int((places > request.limit_m).sum()) + len(missing)
    return Judged(
        label,
        frames,
        errors,
        places,
        poses,
        {**_from_feet(table, errors, groups), **_distances(table, T, groups)},
        _rms(places),
        beyond,
    )


def _groups(table: MeasurementTable) -> dict[tuple[str, str], IntArray]:
    """Rows of the cycles of each pose, and of each mark of the tool where there are several."""
    data, several = table.data, len(table.data.tools) > 1
    found: dict[tuple[str, str], list[int]] = {}
    for i, name in enumerate(data.names):
        mark = data.tools[data.setup.tool[i]] if several else ""
        found.setdefault((name, mark), []).append(i)
    return {group: np.array(rows) for group, rows in found.items()}


def _sources(cell: Cell, table: MeasurementTable) -> list[tuple[str, IntArray, FloatArray]]:
    """What shares a frame: its name, its rows, and what was read ``(k, 3)`` [m] in that frame.

    Touched targets that the cell places are points of one plate.
    """
    data = table.data
    touched = table.of_kind("touch-up")
    found: list[tuple[str, IntArray, FloatArray]] = []
    if len(touched):
        labels = [data.targets[k] for k in data.setup.target[touched]]
        known = {label: target_named(cell.config, label) for label in labels}
        if len(known) == 1:  # where it stands is fitted, whatever it is called
            places = np.zeros((len(touched), 3))
            if (only := known[labels[0]]) is not None:
                places += place_of(cell, only)
        else:
            lost = next((label for label, target in known.items() if target is None), None)
            if lost is not None:
                raise InputError(
                    f"the cell does not say where the target {lost[:40]!r} is",
                    hint="describe the targets of the plate as [[target]] with position_mm",
                    name="target",
                )
            places = np.array([place_of(cell, known[label]) for label in labels])  # type: ignore[arg-type]
        found.append(("touched targets", touched, places))
    for k, label in enumerate(data.targets):
        rows = np.flatnonzero((data.setup.target == k) & ~np.isin(np.arange(data.count), touched))
        if len(rows) and data.observed is not None:
            read = np.zeros((len(rows), 3))
            read[:, : data.observed.shape[1]] = data.observed[rows, :3]
            found.append((label, rows, read))
    return found


def best_frame(read: FloatArray, at: FloatArray) -> FloatArray:
    """Pose ``(4, 4)`` of the frame of readings ``(N, 3)`` [m] that lays them best on points [m].

    Of readings that are one place, its shift alone. (Arun, Huang and Blostein 1987, with the sign
    of Umeyama 1991.)

    Raises InputError: fewer than three places, or places on a line: a frame can turn about them.
    """
    a, b = read - read.mean(axis=0), at - at.mean(axis=0)
    if np.ptp(read, axis=0).max() < ONE_POINT_M:
        return transform(np.eye(3), at.mean(axis=0) - read.mean(axis=0))
    s = np.linalg.svd(a, compute_uv=False)
    if len(np.unique(np.round(read, 4), axis=0)) < FEWEST_FOR_FRAME or s[1] < 1e-3 * s[0]:
        raise InputError(
            "places on a line, or fewer than three, do not tell how the instrument is turned",
            hint="measure more places, or take the frame as given",
            name="frame",
        )
    R = project_to_rotation(b.T @ a)
    return transform(R, at.mean(axis=0) - R @ read.mean(axis=0))


def _by_others(read: FloatArray, at: FloatArray, pose: IntArray) -> FloatArray:
    """Errors ``(k, 3)`` [m] of each pose in the frame that the other poses give."""
    out = np.empty_like(at)
    for own in np.unique(pose):
        rows = pose == own
        if rows.all():
            raise InputError(
                "a single pose has no others to place the frame by",
                hint="measure more places, or take the frame as given",
                name="frame",
            )
        frame = best_frame(read[~rows], at[~rows])
        out[rows] = read[rows] @ frame[:3, :3].T + frame[:3, 3] - at[rows]
    return out


def _given(cell: Cell, label: str, touched: bool) -> FloatArray:
    if touched:  # places of targets are of the base frame already
        return np.eye(4)
    target = target_named(cell.config, label)
    if target is None:
        raise InputError(
            f"the cell does not say where {label[:40]!r} is",
            hint="describe it as [[target]] with position_mm and wpr_deg, or have its frame fitted",
            name="target",
        )
    return instrument_frame(cell, target)


def _foot(cell: Cell, label: str, at: FloatArray, read: FloatArray, given: bool) -> FloatArray:
    """Place of the foot ``(3,)`` [m] of distances: the one that fits best, or the given one."""
    target = target_named(cell.config, label)
    if given:
        return _given(cell, label, False)[:3, 3]
    if len(np.unique(np.round(at, 4), axis=0)) < 4:
        raise InputError(
            "distances from fewer than four places do not tell where their foot is",
            hint="measure more places, or take the frame as given",
            name="frame",
        )
    start = at.mean(axis=0) if target is None else place_of(cell, target)

    def off(foot: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(at - foot, axis=1) - read)

    fit = least_squares(off, start)
    return np.asarray(fit.x)


def _from_feet(
    table: MeasurementTable, errors: FloatArray, groups: Mapping[tuple[str, str], IntArray]
) -> dict[tuple[str, str], DistanceCharacteristics]:
    """Distances from a foot, as they were read."""
    data = table.data
    measured = set(table.of_kind("distance").tolist())
    found = {}
    for (name, mark), rows in groups.items():
        if data.observed is not None and measured.issuperset(rows.tolist()):
            read = data.observed[rows, 0]
            foot, commanded = data.targets[data.setup.target[rows[0]]], read - errors[rows, 0]
            found[f"{name} {mark}".rstrip(), foot] = distance_characteristics(
                read, float(commanded.mean())
            )
    return found


def _distances(
    table: MeasurementTable, T: FloatArray, groups: Mapping[tuple[str, str], IntArray]
) -> dict[tuple[str, str], DistanceCharacteristics]:
    """Distances between poses that one instrument read as often, cycle by cycle.

    Of many poses those from each to the next.
    """
    data = table.data
    read = set(table.of_kind("point", "pose").tolist())
    found: dict[tuple[str, str], DistanceCharacteristics] = {}
    items = list(groups.items())
    pairs = combinations(items, 2) if len(items) <= _EVERY_DISTANCE else pairwise(items)
    for ((first, mark), a), ((second, other), b) in pairs:
        together = np.concatenate([a, b])
        if mark != other or len(a) != len(b) or not read.issuperset(together.tolist()):
            continue
        if data.observed is None or len(np.unique(data.setup.target[together])) > 1:
            continue
        attained = np.linalg.norm(data.observed[a, :3] - data.observed[b, :3], axis=1)
        commanded = np.linalg.norm(T[a, :3, 3] - T[b, :3, 3], axis=1)
        pair = f"{first} {mark}".rstrip(), f"{second} {mark}".rstrip()
        found[pair] = distance_characteristics(attained, float(commanded.mean()))
    return found


def _rms(places: FloatArray) -> Figure:
    """Root mean square of places and its interval, by resampling them."""
    found = float(np.sqrt(np.mean(places**2)))
    if len(places) < 5:
        return Figure(found)
    rng = np.random.default_rng(0)
    drawn = rng.choice(places**2, (_RESAMPLED, len(places))).mean(axis=1)
    low, high = np.sqrt(np.quantile(drawn, [(1 - CHANCE) / 2, (1 + CHANCE) / 2]))
    return Figure(found, float(low), float(high))
