"""Touched-up positions back from a controller: files in, measurements out.

A position that still stands where the plan put it was not touched up, and planned poses imported as
measurements would make any robot look perfect: such positions are left out, and files of nothing
else are refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.model import Setup
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray
from posedesign.cell import Cell
from posedesign.files import read_bytes_bounded
from posedesign.files.csv_tables import summed_up
from posedesign.planning import NEAR_TARGET_M, fingerprint, off_target, outside_limits
from posedesign.planning.poses_file import PoseList, read_poses
from posedesign.pose_programs.from_plan import (
    arm_of,
    check_names_differ,
    check_recorded_frames,
    stopping_short,
)
from posedesign.programs import (
    DIALECTS,
    Dialect,
    RecordedPosition,
    RecordedProgram,
    find_dialect,
    postures_of,
)
from posedesign.programs.reading import EXTERNAL_AT_REST, MOST_BYTES
from posedesign.programs.recorded import CORRECTED, corrected_by
from posedesign.programs.registry import dialect_of
from posedesign.programs.sets import content_of, set_mark

WORTH_A_WORD = 0.3
"""Part of the noise of touching up from which that of rounding is worth a word: it adds 4 %."""

MUCH_NEARER = 0.5
"""Part of the distance to its own pose of the plan, in the joint that is farthest off, at which
another one is: touching up moves joints by far less than poses are apart."""

UNMOVED_DEG = 2e-3
"""Joints all within this of the plan are those of the plan, rounded: programs are rounded to 0.0005
deg, and FANUC's J3 is the difference of two joints. A touch-up moves some joint by more."""

UNMOVED_CARTESIAN_DEG = 2e-2
"""The same where the file has poses of the tool: 0.0005 mm and deg are more in the joints, near a
singularity above all."""

UNMOVED_M = EXTERNAL_AT_REST / 1e3
"""The same of what slides: what is shown of an axis at rest flickers by as much. Programs round it
to 0.0005 mm, and half a pulse of a base axis is some micrometres."""


def tool_moved_m(cell: Cell, q: FloatArray, planned: FloatArray) -> FloatArray:
    """How far the tool point of the nominal arm is apart at postures ``(N, n)``, ``(N,)`` [m]."""
    here, there = (cell.robot.state(at).point(cell.tool_m) for at in (q, planned))
    return np.asarray(np.linalg.norm(here - there, axis=1))


def near_others(names: Sequence[str], q: FloatArray, plan: PoseList) -> tuple[list[int], list[str]]:
    """Positions ``(N, n)`` [rad] that are nearer to another pose of the plan than to their own.

    All touch the same target, so that only the joints tell poses apart. Their rows, and the poses.
    """
    from scipy.spatial import cKDTree

    planned, known = plan.measured.postures, plan.measured.names
    row_of = {name: k for k, name in enumerate(known)}
    own = planned[[row_of[name] for name in names]]
    found = cKDTree(planned).query(q, p=np.inf)
    apart, nearest = (np.atleast_1d(of_all) for of_all in found)
    rows = np.flatnonzero(apart < MUCH_NEARER * np.abs(q - own).max(axis=1)).tolist()
    return rows, [known[int(nearest[i])] for i in rows]


def exchanged(names: Sequence[str], q: FloatArray, plan: PoseList) -> list[str]:
    """Positions ``(N, n)`` [rad] of :func:`near_others` in words.

    Raises InputError: most are: the numbers are those of another program.
    """
    rows, others = near_others(names, q, plan)
    if 2 * len(rows) > len(q):
        raise InputError(
            f"{len(rows)} of {len(q)} positions stand at other poses of the plan than their "
            f"numbers say: {names[rows[0]]} at {others[0]}",
            hint="is it another program, or is program.first_register wrong?",
            name="poses",
        )
    return [f"{names[i]}: stands nearer to {k}" for i, k in zip(rows, others, strict=True)]


def check_near_plan(
    cell: Cell, names: Sequence[str], q: FloatArray, near: FloatArray, path: Path
) -> None:
    """Refuse what does not say which plan it is of, and is far from this one."""
    moved = tool_moved_m(cell, q, near)
    worst = int(np.argmax(moved))
    if moved[worst] > NEAR_TARGET_M:
        raise InputError(
            f"{path}: position {worst + 1} is {1e3 * moved[worst]:.0f} mm from where the plan has "
            f"{names[worst]}, and the file does not say which plan it is of",
            hint="is it the program of another plan? Without `poses` it is read as it is",
            name=str(path),
        )


def rounding_words(cell: Cell, q: FloatArray, step_rad: float) -> list[str]:
    """What the controller's rounding of joints adds to the noise, where that is worth a word."""
    robot, controller, kind = cell.robot, cell.robot.controller, cell.measurement
    if not step_rad or controller is None or kind.estimated:
        return []
    state = robot.state(q)
    tip = robot.jacobian(q)  # shape (N, 6, n)
    lever = state.R_base_tip @ cell.tool_m  # shape (N, 3)
    place = tip[:, :3] + np.cross(tip[:, 3:], lever[:, :, None], axis=1)
    shown = place @ np.linalg.inv(controller.pendant_from_joints)
    # of what slides the same number, of millimetres
    shown[..., robot.sliding] *= np.rad2deg(1.0) / 1e3
    added_m = float(np.sqrt((shown**2).sum(axis=(1, 2)).mean() * step_rad**2 / 12.0))
    noise_m = float(np.linalg.norm(kind.sigma[: kind.rows - kind.turns]))
    if added_m < WORTH_A_WORD * noise_m:
        return []
    return [
        f"joints are stored to {np.rad2deg(step_rad):g} deg: that moves the tool point by "
        f"{1e3 * added_m:.2g} mm rms, beside the {1e3 * noise_m:.2g} mm of touching up; raise "
        "measurement.three_sigma_mm, or let measurement.estimate_noise find both"
    ]


@dataclass(frozen=True, eq=False)
class Imported:
    """Touch-ups that came back."""

    touch_ups: Measurements  # named after the poses of the plan
    moved_mm: FloatArray
    """(N,): how far the touch-up moved the tool point of the nominal arm; NaN without a plan."""
    untouched: tuple[str, ...]  # poses that stand as planned
    missing: tuple[str, ...]  # poses of the plan that the files do not have
    warnings: tuple[str, ...]
    doubtful: bool
    """Whether something in it can hardly be right: a posture outside the limits, a tool point far
    from the target, a pose that stands nearer to another one of the plan."""


@dataclass(frozen=True, eq=False)
class _Positions:
    """Measured positions of one file: names ``(N,)``, postures ``(N, n)``, and their rounding.

    ``step_rad`` is that of joint values as they are shown; 0 where it does not matter.
    """

    names: tuple[str, ...]
    postures: FloatArray
    unmoved_rad: FloatArray
    step_rad: float = 0.0


def import_touch_ups(
    cell: Cell,
    files: Sequence[Path],
    plan: PoseList | None = None,
    dialect: str | None = None,
    *,
    keep_untouched: bool = False,
) -> Imported:
    """Positions of programs or backups as touch-ups.

    ``cell``: its robot, nominal, brings poses of the tool back to joints. ``files``: all parts of a
    program, or backups of it; also lists of poses in CSV. ``plan``: the poses that were to be
    touched up, in the order of the program. Without it nothing is known of what was touched up and
    what was not. ``dialect``: of the files; by default their endings and contents tell.
    ``keep_untouched``: take positions that stand as planned for touch-ups, too. Raises
    FileFormatError: A file cannot be read. InputError: A file is of another plan, or nothing in it
    was touched up. UnreachableError: A pose that the robot cannot take.
    """
    warnings: list[str] = []
    parts: list[_Positions] = []
    if plan is not None:
        check_names_differ(plan.measured)
    _check_together(files, dialect)
    for path in _with_positions(files):
        part = _positions(cell, path, plan, dialect, warnings, keep_untouched=keep_untouched)
        before = {name for other in parts for name in other.names}
        twice = next((name for name in part.names if name in before), None)
        if twice is not None:
            raise InputError(
                f"{path}: pose {twice} is in a file before it, too",
                hint="name each file once",
                name=str(path),
            )
        parts.append(part)
    names = tuple(name for part in parts for name in part.names)
    q = np.concatenate([part.postures for part in parts])
    planned = _planned(names, q, plan)
    unmoved_rad = np.concatenate([part.unmoved_rad for part in parts])
    unmoved = np.zeros(len(q), dtype=bool)
    if plan is not None:  # a list has the poses themselves, a program where it stops before them
        for own in (planned, _planned(names, q, stopping_short(cell, plan))):
            unmoved |= is_unmoved(q, own, unmoved_rad, cell.robot.sliding)
    kept = np.flatnonzero(~unmoved | keep_untouched)
    if not len(kept):
        raise InputError(
            f"{files[0]}: no position differs from the plan: none was touched up",
            hint="save the program from the controller after the touch-up",
            name=str(files[0]),
        )
    labels, q = tuple(names[i] for i in kept), q[kept]
    implausible = summed_up(outside_limits(cell, labels, q), "positions outside the joint limits")
    implausible += summed_up(
        off_target(cell, labels, q, NEAR_TARGET_M), "positions far off the target"
    )
    if plan is not None:
        implausible += summed_up(exchanged(labels, q, plan), "positions near other poses")
    warnings += implausible
    step = max(part.step_rad for part in parts)
    warnings += rounding_words(cell, q, step)
    return Imported(
        _as_measured(cell, q, labels, plan),
        1e3 * tool_moved_m(cell, q, planned[kept]) * (1.0 if plan else np.nan),
        tuple(names[i] for i in np.flatnonzero(unmoved)),
        tuple(n for n in (plan.measured.names if plan else ()) if n not in names),
        tuple(warnings),
        bool(implausible),
    )


def _as_measured(
    cell: Cell, q: FloatArray, names: Sequence[str], plan: PoseList | None
) -> Measurements:
    """Touch-ups at postures ``(N, n)`` [rad], each of what the plan says by its name."""
    if cell.is_hand_eye or len(cell.observations) == 1:
        return Measurements(q, Setup.of(len(q)), names=tuple(names))
    if plan is None:
        raise InputError(
            "a program does not say which of several targets a position is of",
            hint="give the list that it was written from: `poses`",
            name="poses",
        )
    said = dict(zip(plan.names, plan.labels, strict=True))
    model = cell.model()
    _, setup = cell.one_by_one(model, q, cell.which([said[name] for name in names]))
    return Measurements(q, setup, model.targets, model.tools, names=tuple(names))


def _check_together(files: Sequence[Path], dialect: str | None) -> None:
    """Refuse files of programs that do not belong together, or to what stands beside them."""
    marks = {path: set_mark(content_of(path)) for path in files}
    for path in files:
        for d in DIALECTS.values() if dialect is None else [find_dialect(dialect)]:
            said = d.strangers(path) if path.suffix.lower() in d.suffixes else []
            mixed = next(iter(said), None)
            if mixed is not None:
                raise InputError(
                    f"{path.parent}: {mixed}", hint="save all files of one program", name=str(path)
                )
        own = marks[path]
        for other, mark in marks.items():
            same = (
                own
                and mark
                and (own == mark or (path.stem != other.stem and own.plan == mark.plan))
            )
            if own and mark and not same:
                raise InputError(
                    f"{path} is of {own}, {other} of {mark}: they do not belong together",
                    hint="name the files of one program",
                    name=str(path),
                )


def _with_positions(files: Sequence[Path]) -> list[Path]:
    """The files without companions that hold no positions, where what holds them is there, too."""
    kept = []
    for path in files:
        held = next((d for d in DIALECTS.values() if path.suffix.lower() in d.companions), None)
        beside = {
            (other.parent if held and held.in_folder else other.parent / other.stem)
            for other in files
            if held and other.suffix.lower() == held.suffixes[0]
        }
        own = path.parent if held and held.in_folder else path.parent / path.stem
        if own not in beside:
            kept.append(path)
    return kept


def _positions(
    cell: Cell,
    path: Path,
    plan: PoseList | None,
    dialect: str | None,
    warnings: list[str],
    *,
    keep_untouched: bool,
) -> _Positions:
    """Measured positions of one file, under the names of the plan."""
    chosen = _dialect(cell, path, dialect)
    if chosen is None:
        listed = read_poses(
            path, cell.robot.n, external=cell.robot.external, controller=cell.robot.controller
        )
        by = corrected_by(CORRECTED.format(listed.corrected_by).encode())
        written = listed.fingerprint_written
        _check_plan(path, written, by, plan, warnings, keep_untouched=keep_untouched)
        measured = listed.measured
        if plan is not None:
            strange = next((n for n in measured.names if n not in plan.measured.names), None)
            if strange is not None:
                raise InputError(
                    f"{path}: pose {strange} is not in the plan",
                    hint="is it the list of another plan?",
                    name=str(path),
                )
        unmoved = np.full(len(measured.names), np.deg2rad(UNMOVED_DEG))
        return _Positions(measured.names, measured.postures, unmoved)
    program = chosen.read(path).whole()
    if program.empty_registers:
        raise InputError(
            f"{path}: no register holds a touched-up position",
            hint="run the program, touch up, then save the backup",
            name=str(path),
        )
    by = chosen.corrected_by(path)
    _check_plan(path, program.fingerprint, by, plan, warnings, keep_untouched=keep_untouched)
    return _of_program(cell, chosen, program, path, plan, warnings)


def _dialect(cell: Cell, path: Path, name: str | None) -> Dialect | None:
    """The dialect of a file, as the cell's program has it; None: a list of poses of our own."""
    if name is None and path.suffix.lower() == ".csv":
        head = read_bytes_bounded(path, most_bytes=MOST_BYTES)[:100_000].lower()
        columns = b"".join(line for line in head.splitlines() if not line.startswith(b"#"))
        if b"target" in columns.split(b"j1_", 1)[0]:
            raise InputError(
                f"{path} is a list of touch-ups already",
                hint="pass it to posedesign identify",
                name=str(path),
            )
        if b"_deg" in head or b"_rad" in head:
            return None
    return dialect_of(path, name).reading(*cell.config.program.pulses)


def _check_plan(
    path: Path,
    written: str,
    by: str,
    plan: PoseList | None,
    warnings: list[str],
    *,
    keep_untouched: bool,
) -> None:
    """Refuse a file of another plan, or that nobody can tell the touch-ups of; warn of an odd one.

    ``written``: the plan that it says it is of. ``by``: what its positions are corrected by.
    """
    known = "" if plan is None else corrected_by(CORRECTED.format(plan.corrected_by).encode())
    if by and by != known and not keep_untouched:
        raise InputError(
            f"{path}: its positions are {by}: nobody can say which were touched up",
            hint="pass the corrected_poses.csv that it was written from with `poses`, or "
            "`keep_untouched` to take all as they are",
            name=str(path),
        )
    if by:
        warnings.append(f"{path.name}: its positions are {by}")
    if plan is None:
        if written and not keep_untouched:
            raise InputError(
                f"{path} was written from the plan {written}: without it nobody can say what was "
                "touched up",
                hint="pass its poses.csv with `poses`, or `keep_untouched` to take all as they are",
                name=str(path),
            )
        return
    own = fingerprint(plan.measured.postures)
    if not written:
        warnings.append(f"{path}: does not say which plan it was written from")
    elif written != own:
        raise InputError(
            f"{path} was written from the plan {written}, the poses are the plan {own}",
            hint="name the poses.csv that the program was written from",
            name=str(path),
            value=written,
            bound=own,
        )


def _of_program(
    cell: Cell,
    dialect: Dialect,
    program: RecordedProgram,
    path: Path,
    plan: PoseList | None,
    warnings: list[str],
) -> _Positions:
    first = cell.config.program.first_register - 1 if program.in_registers else 0
    measured = plan.measured if plan is not None else None
    count = len(measured.names) if measured is not None else None
    positions = tuple(
        p for p in program.measured if p.number > first and (not count or p.number - first <= count)
    )
    if not positions:
        raise InputError(
            f"{path}: has no position of the plan's {count} poses",
            hint="are program.first_register and the poses right?",
            name=str(path),
        )
    warnings += check_recorded_frames(cell, dialect, positions, path)
    near = None
    if measured is not None:
        near = measured.postures[[p.number - first - 1 for p in positions]]
        names = tuple(measured.names[p.number - first - 1] for p in positions)
    else:
        names = _own_names(positions, first)
    q = postures_of(positions, dialect.seen(arm_of(cell)), near)
    if near is not None and not program.fingerprint:
        check_near_plan(cell, names, q, near, path)
    warnings += _not_described(positions, cell.robot.n_external, path)
    joint = np.array([p.shown_deg is not None for p in positions])
    unmoved = np.deg2rad(np.where(joint, UNMOVED_DEG, UNMOVED_CARTESIAN_DEG))
    step = float(np.deg2rad(dialect.joint_step_deg)) if joint.any() else 0.0
    return _Positions(names, q, unmoved, step)


def _not_described(positions: Sequence[RecordedPosition], known: int, path: Path) -> list[str]:
    """Which external axes stand where in all positions, and are not in the description."""
    values, units = positions[0].external_shown, positions[0].external_units or ("",) * 99
    return [
        f"{path}: E{k + 1} stands at {values[k]:g} {units[k]}".rstrip()
        + " in all positions and is not in the robot's description: taken to have stood there in "
        "all that was measured"
        for k in range(known, len(values))
        if abs(values[k]) > EXTERNAL_AT_REST
    ]


def _own_names(positions: Sequence[RecordedPosition], first: int) -> tuple[str, ...]:
    """Names as the file has them, with the number where several have the same."""
    names = [p.name or f"P{p.number - first:02d}" for p in positions]
    times = Counter(names)
    return tuple(
        f"{name}_{p.number}" if times[name] > 1 else name
        for name, p in zip(names, positions, strict=True)
    )


def _planned(names: Sequence[str], q: FloatArray, plan: PoseList | None) -> FloatArray:
    """Where the plan has the poses ``(N, n)`` [rad]; where they are without one."""
    if plan is None:
        return q
    known = dict(zip(plan.measured.names, plan.measured.postures, strict=True))
    return np.stack([known[name] for name in names])


def is_unmoved(
    q: FloatArray, planned: FloatArray, within_rad: FloatArray | float, sliding: BoolArray
) -> BoolArray:
    """Whether postures ``(N, n)`` are those of the plan but for rounding ``(N,)`` [rad], ``(N,)``.

    ``sliding`` (n,): which joints slide.
    """
    off = np.abs(q - planned)
    turning = off[:, ~sliding].max(axis=1) <= within_rad
    return np.asarray(turning & (off[:, sliding] <= UNMOVED_M).all(axis=1))
