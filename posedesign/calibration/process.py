"""The automatic calibration of section 2.5 of Watanabe et al. 2006: two steps, by sight.

1. From one taught pose, where camera and target are (:mod:`calib.visual.set_up`).
2. Measuring poses for them, a touch-up at each, and the robot from the touch-ups.

All measurements go through a :class:`~calib.visual.station.Station`: of a simulated arm, or of a
robot behind its adapter. Nothing here knows which.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm_view import Setup
from calib.errors import ConvergenceError, UnreachableError
from calib.measurement import Measurements
from calib.se3 import FloatArray, transform
from calib.visual.facing import TiltBias
from calib.visual.following import follow
from calib.visual.servo import Loop
from calib.visual.set_up import NoSetUp, SetUp, find_set_up
from calib.visual.station import Station
from posedesign.before_after import Identified
from posedesign.calibration.found_cell import found_cell
from posedesign.calibration.target_poses import TargetPoses
from posedesign.cell import Cell
from posedesign.cell_file import cell_text
from posedesign.files import Results, make_folder, write_text_atomic
from posedesign.pose_list import PoseList
from posedesign.pose_plan import PosePlan
from posedesign.tables import Pairs, write_pairs, write_touch_ups
from posedesign.workflow import identify_file, plan_poses

TOUCH_UPS, PAIRS = "touchups.csv", "pairs.csv"

Progress = Callable[[str, float], None]

_FIRST, _NOISE = 0.35, 0.45
"""Parts of the whole that have passed after the first step, and after the noise was measured: of
the touch-ups of a plan of 27 poses."""

_START_M = 3e-3
"""How far repeated touch-ups begin from where the first ended, along each axis: as far as an arm
that is not calibrated misses a planned pose."""

LEAST_SIGMA_M = 3e-6
"""Noise below which no joint stops: a few repeats may agree by chance, and would be weighted so."""


@dataclass(frozen=True, eq=False)
class Missed:
    """A planned pose that was not touched up."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a calibration has found.

    Attributes
    ----------
    set_up : SetUp
        Of the first step.
    cell : Cell
        With what the first step has found.
    sigma_m : array (3,)
        Noise of a touch-up along x, y, z of the camera [m], from repeats; NaN without repeats.
    plan : PosePlan
    touch_ups : Measurements
        Of the second step.
    missed : tuple of Missed
    identified : Identified
    """

    set_up: SetUp
    cell: Cell
    sigma_m: FloatArray
    plan: PosePlan
    touch_ups: Measurements
    missed: tuple[Missed, ...]
    identified: Identified


def loop_of(cell: Cell) -> Loop:
    """The loop that a cell asks for."""
    section = cell.config.touch_up
    return Loop(
        center_px=section.center_px,
        size_px=section.size_px,
        iterations=section.iterations,
        farthest_m=section.farthest_mm / 1e3,
        looks=section.looks,
    )


def calibrate(
    cell: Cell,
    station: Station,
    out: Path,
    *,
    source: Path = Path(),
    progress: Progress = lambda what, part: None,
    warn: Callable[[str], None] = lambda text: None,
) -> Calibration:
    """Calibrate the robot behind a station; write what is found into a folder.

    ``found_cell.toml``, ``poses.csv``, ``rounds.csv``, ``touchups.csv`` as it grows, where there
    are pictures ``pairs.csv``, and ``identification.json``.

    Parameters
    ----------
    cell : Cell
        Its base posture is the taught one, with the target in view. What it says of tool point,
        camera and target is not looked at.
    station : Station
    out : Path
    source : Path
        Folder that the paths in the cell are relative to.
    progress : callable
        Called with what is being done and the part of all work that is done.
    warn : callable
        Told of what is odd.

    Raises
    ------
    UnreachableError
        Camera and target were not found, or no poses can be planned for them.
    ConvergenceError
        Too few poses could be touched up.
    CalibError
        What the adapter of a robot raises.
    """
    make_folder(out)
    loop = loop_of(cell)
    set_up = find_set_up(
        station,
        cell.base_posture,
        loop,
        widest=float(np.deg2rad(cell.config.touch_up.inch_deg)),
        progress=lambda what, part: progress(f"finding camera and target: {what}", _FIRST * part),
    )
    if isinstance(set_up, NoSetUp):
        raise UnreachableError(set_up.reason, hint=set_up.hint, name="base_pose")
    for note in set_up.notes:
        warn(f"a turn around the target was left out: {note}")
    sigma = measure_noise(cell, station, set_up, loop, progress)
    known = found_cell(cell, set_up, station.image_px, sigma if np.isfinite(sigma).all() else None)
    write_text_atomic(out / "found_cell.toml", _found_text(known, source))
    progress("planning", _NOISE)
    results = Results(out, "calibrate", remakes=True)
    plan = plan_poses(known, results)
    touch_ups, missed = touch_up_plan(known, station, set_up, plan, out, loop, progress)
    for pose in missed:
        warn(f"{pose.name} was not touched up: {pose.reason}")
    progress("identifying", 1.0)
    identified = identify_file(known, out / TOUCH_UPS, results, warn=warn)
    return Calibration(set_up, known, sigma, plan, touch_ups, missed, identified)


def tilt_bias(cell: Cell, set_up: SetUp) -> TiltBias | None:
    """What is taken off what is seen of a tilted target; None where the cell asks for nothing."""
    if not cell.config.touch_up.correct_tilt:
        return None
    return TiltBias(cell.robot, set_up.jacobian, set_up.facing.normal)


def measure_noise(
    cell: Cell, station: Station, set_up: SetUp, loop: Loop, progress: Progress
) -> FloatArray:
    """Noise of a touch-up along x, y, z of the camera ``(3,)`` [m], from repeats at one pose.

    Each begins somewhere else, as touch-ups of a plan do, and ends in the orientation of the first.
    NaN where the cell asks for fewer than two.
    """
    repeats = cell.config.touch_up.repeats
    q = set_up.postures[0]
    bias = tilt_bias(cell, set_up)
    ends = []
    for k in range(repeats if repeats > 1 else 0):
        part = _FIRST + (_NOISE - _FIRST) * k / repeats
        progress(f"measuring the noise, {k + 1} of {repeats}", part)
        done = station.touch_up(
            f"N{k + 1:02d}", _start_near(cell, q, k), set_up.jacobian, loop, bias
        )
        if done.touched[0]:
            ends.append(done.q[0])
    if len(ends) < 2:
        return np.full(3, np.nan)
    state = cell.robot.state(np.array(ends))
    points = state.point(set_up.tool_m)
    in_camera = points @ (state.R_base_tip[0] @ set_up.jacobian.R_tip_camera)
    return np.asarray(np.maximum(in_camera.std(axis=0, ddof=1), LEAST_SIGMA_M))


def _start_near(cell: Cell, q: FloatArray, k: int) -> FloatArray:
    """The k-th posture ``(n,)`` to begin a repeat from: shifted, the orientation kept."""
    shift = np.random.default_rng(k).uniform(-_START_M, _START_M, 3)
    T = cell.robot.fk(q) @ transform(np.eye(3), shift)
    start, found = follow(cell.robot, q[None], T[None])
    return np.asarray(start[0] if found[0] else q)


def touch_up_plan(
    cell: Cell,
    station: Station,
    set_up: SetUp,
    plan: PosePlan,
    out: Path,
    loop: Loop,
    progress: Progress,
) -> tuple[Measurements, tuple[Missed, ...]]:
    """Touch up the poses of a plan along its route; ``touchups.csv`` grows with each.

    Raises
    ------
    ConvergenceError
        Hardly a pose could be touched up.
    """
    bias = tilt_bias(cell, set_up)
    stops = PoseList.of_route(plan.poses, plan.route)
    seen = TargetPoses(cell, station, set_up)
    names: list[str] = []
    postures: list[FloatArray] = []
    missed: list[Missed] = []
    for k, (name, q, via) in enumerate(zip(stops.names, stops.postures, stops.via, strict=True)):
        progress(f"touch-up {name}", _NOISE + (1.0 - _NOISE) * k / len(stops.names))
        if via:
            station.pass_through(name, q)
            continue
        done = station.touch_up(name, q, set_up.jacobian, loop, bias)
        if not done.touched[0]:
            missed.append(Missed(name, f"{done.status[0]}, {done.reasons[0]}"))
            continue
        names.append(name)
        postures.append(done.q[0])
        data = _measurements(cell, names, postures)
        write_touch_ups(out / TOUCH_UPS, data)
        seen.add(name, done.q[0])
    station.rest()
    if len(seen.names) > 1:
        pairs = Pairs(tuple(seen.names), np.array(seen.A), np.array(seen.B))
        write_pairs(out / PAIRS, pairs)
    elif (out / PAIRS).is_file():
        (out / PAIRS).unlink()  # of a run before this one
    if len(names) < 2:
        why = missed[0].reason if missed else "there are none"
        raise ConvergenceError(
            f"only {len(names)} of {len(names) + len(missed)} poses could be touched up: {why}",
            hint="give the arm and the camera a clear view of the target",
        )
    return data, tuple(missed)


def _measurements(cell: Cell, names: list[str], postures: list[FloatArray]) -> Measurements:
    q = np.array(postures)
    return Measurements(q, Setup.of(len(q)), (cell.config.target.name,), names=tuple(names))


def _found_text(cell: Cell, source: Path) -> str:
    bare = cell.config.model_copy(update={"truth": type(cell.config.truth)()})
    return cell_text(
        bare,
        source,
        "The cell with camera and target as posedesign calibrate found them.\n"
        "Lengths in mm, angles in degrees, joints in URDF signs.",
    )
