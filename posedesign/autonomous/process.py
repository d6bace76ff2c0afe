"""The automatic calibration of section 2.5 of Watanabe et al. 2006: two steps, by sight.

1. From one taught pose, where camera and target are (:mod:`calib.vision.touch_up.set_up`).
2. Measuring poses for them, a touch-up at each, and the robot from the touch-ups.

All measurements go through a :class:`~calib.vision.touch_up.servo.Station`: of a simulated arm,
or of a robot behind its adapter. Nothing here knows which.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import ConvergenceError, UnreachableError
from calib.model import Setup
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, inverse, rotation_exp, transform, wpr_from_rotation
from calib.vision.touch_up import Loop, NoSetUp, SetUp, Station, TiltBias, find_set_up, follow
from calib.vision.touch_up.sighting import camera_of
from posedesign.cell import CameraSection, Cell
from posedesign.cell.board_set_up import FOUND_WHOLE
from posedesign.cell.file import cell_text
from posedesign.files import Claim, Results, identity_of, make_folder, write_text_atomic
from posedesign.files.measurements import write_measurements
from posedesign.files.origin import Kind
from posedesign.hand_eye.pairs import Pairs, write_pairs
from posedesign.identification import Identified
from posedesign.planning import PoseList, PosePlan
from posedesign.simulation import target_of
from posedesign.workflow import (
    IDENTIFICATION,
    IDENTIFIED,
    PAIRS,
    PLANNED,
    POSES,
    ROUNDS,
    TOUCH_UPS,
    identify_file,
    plan_poses,
)

COMMAND = "calibrate"
"""What its files say that they were written by."""

FOUND_CELL = ("found_cell.toml", "cell as it was found")

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
    """What a calibration has found."""

    set_up: SetUp  # of the first step
    cell: Cell  # with what the first step has found
    sigma_m: FloatArray
    """(3,): noise of a touch-up along x, y, z of the camera [m], from repeats; NaN without
    repeats."""
    plan: PosePlan
    touch_ups: Measurements  # of the second step
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


@dataclass(frozen=True)
class SessionFiles:
    """Files of one calibration, claimed before the arm moves."""

    found_cell: Claim
    touch_ups: Claim
    pairs: Claim | None  # None where there are no pictures
    planned: tuple[Claim, ...]  # what planning and identification will write, and claim once more

    @classmethod
    def of(
        cls,
        results: Results,
        session: str = "a calibration",
        simulated: bool = False,
        pictures: bool = True,
        *,
        check: bool = True,
    ) -> SessionFiles:
        """Files in a folder.

        ``session``: what they are of: files of another session are not replaced. ``simulated``:
        whether the robot is. ``pictures``: whether there are any, to have pairs from. ``check``:
        refuse what must not be replaced, at once. Raises OutputError: there is a file of somebody
        else's.
        """
        kind: Kind = "simulated" if simulated else "measured"
        made: Kind = "simulated" if simulated else "computed"
        measured = [(name, f"{purpose} of {session}") for name, purpose in (TOUCH_UPS, PAIRS)]
        (found,) = results.claim(made, FOUND_CELL, check=check)
        touch_ups, *pairs = results.claim(kind, *measured[: 1 + pictures], check=check)
        known = [found.path]
        planned = results.claim("planned", POSES, ROUNDS, *PLANNED, inputs=known, check=check)
        identified = results.claim(
            "computed", IDENTIFICATION, *IDENTIFIED, inputs=[*known, touch_ups.path], check=check
        )
        return cls(found, touch_ups, pairs[0] if pairs else None, (*planned, *identified))

    @property
    def claims(self) -> tuple[Claim, ...]:
        """All of them."""
        pairs = () if self.pairs is None else (self.pairs,)
        return self.found_cell, self.touch_ups, *pairs, *self.planned


def calibrate(
    cell: Cell,
    station: Station,
    out: Path | Results,
    *,
    source: Path = Path(),
    files: SessionFiles | None = None,
    progress: Progress = lambda what, part: None,
    warn: Callable[[str], None] = lambda text: None,
) -> Calibration:
    """Calibrate the robot behind a station; write what is found into a folder.

    ``found_cell.toml``, ``poses.csv``, ``rounds.csv``, ``touchups.csv`` as it grows, where there
    are pictures ``pairs.csv``, and ``identification.json``.

    ``cell``: its base posture is the taught one, with the target in view. What it says of tool
    point, camera and target is not looked at. ``source``: folder that the paths in the cell are
    relative to. ``files``: as they were claimed; by default those of a real robot with pictures.
    ``progress``: called with what is being done and the part of all work that is done. ``warn``:
    told of what is odd. Raises UnreachableError: camera and target were not found, or no poses can
    be planned for them. ConvergenceError: too few poses could be touched up. OutputError: there is
    a file of somebody else's, or the folder was replaced meanwhile. CalibError: what the adapter of
    a robot raises.
    """
    results = results_of(out)
    if results.place is None:
        results = replace(results, place=identity_of(make_folder(results.folder)))
    files = files or SessionFiles.of(results)
    loop = loop_of(cell)
    set_up = find_set_up(
        station,
        cell.base_posture,
        loop,
        widest=float(np.deg2rad(cell.config.touch_up.inch_deg)),
        target=target_of(cell),
        progress=lambda what, part: progress(f"finding camera and target: {what}", _FIRST * part),
    )
    if isinstance(set_up, NoSetUp):
        raise UnreachableError(set_up.reason, hint=set_up.hint, name="base_pose")
    for note in set_up.notes:
        warn(f"a turn around the target was left out: {note}")
    sigma = measure_noise(cell, station, set_up, loop, progress)
    known = found_cell(cell, set_up, station.image_px, sigma if np.isfinite(sigma).all() else None)
    bare = known.config.model_copy(update={"truth": type(cell.config.truth)()})
    said = "The cell with camera and target as posedesign calibrate found them.\n"
    said += "Lengths in mm, angles in degrees, joints in URDF signs."
    write_text_atomic(files.found_cell, cell_text(bare, source, said))
    progress("planning", _NOISE)
    later = replace(results, inputs=(*results.inputs, files.found_cell.path))
    plan = plan_poses(known, later)
    touch_ups, missed = touch_up_plan(known, station, set_up, plan, files, loop, progress)
    for pose in missed:
        warn(f"{pose.name} was not touched up: {pose.reason}")
    progress("identifying", 1.0)
    identified = identify_file(known, files.touch_ups.path, later, warn=warn)
    return Calibration(set_up, known, sigma, plan, touch_ups, missed, identified)


def results_of(out: Path | Results) -> Results:
    """The folder of a calibration, which makes its own plan anew."""
    return out if isinstance(out, Results) else Results(out, COMMAND, remakes=True)


def tilt_bias(cell: Cell, set_up: SetUp) -> TiltBias | None:
    """What is taken off what is seen of a tilted circle; None where the cell asks for nothing."""
    if cell.board is not None or not cell.config.touch_up.correct_tilt:
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
    files: SessionFiles,
    loop: Loop,
    progress: Progress,
) -> tuple[Measurements, tuple[Missed, ...]]:
    """Touch up the poses of a plan along its route; ``touchups.csv`` grows with each.

    Raises ConvergenceError: hardly a pose could be touched up.
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
        setup, target = Setup.of(len(names)), (cell.config.target.name,)
        data = Measurements(np.array(postures), setup, target, names=tuple(names))
        write_measurements(files.touch_ups, data)
        seen.add(name, done.q[0])
    station.rest()
    if files.pairs is not None and len(seen.names) > 1:
        pairs = Pairs(tuple(seen.names), np.array(seen.A), np.array(seen.B))
        write_pairs(files.pairs, pairs)
    if len(names) < 2:
        why = missed[0].reason if missed else "there are none"
        raise ConvergenceError(
            f"only {len(names)} of {len(names) + len(missed)} poses could be touched up: {why}",
            hint="give the arm and the camera a clear view of the target",
        )
    return data, tuple(missed)


_NEAREST, _FARTHEST = 0.5, 2.0
"""Distances of the target, in parts of the designated one, that a cell without a camera section is
given: the loop brings the target to the designated one, whatever happens on the way."""

_DECIMALS_MM, _DECIMALS_DEG = 4, 6
"""Far below what is known, and short enough to be read."""


def found_cell(
    cell: Cell, set_up: SetUp, image_px: tuple[int, int], sigma_m: FloatArray | None
) -> Cell:
    """A cell with what was found in place of what its file says of tool point, camera and target.

    ``image_px``: width and height of the pictures. ``sigma_m`` (3,): noise of a touch-up along x,
    y, z of the camera [m], where it was measured.
    """
    config = cell.config
    T = set_up.T_tip_camera
    place = {
        "position_mm": _mm(T[:3, 3]),
        "wpr_deg": _deg(wpr_from_rotation(T[:3, :3])),
        "image_px": image_px,
        "focal_px": round(set_up.jacobian.focal_px, 3),
    }
    distance_mm = 1e3 * set_up.jacobian.distance_m
    given = config.camera or CameraSection(
        nearest_mm=_NEAREST * distance_mm, farthest_mm=_FARTHEST * distance_mm
    )
    measured: dict[str, object] = {}
    if sigma_m is not None:
        three = tuple(round(3e3 * s, 6) for s in sigma_m.tolist())
        measured = {"three_sigma_mm": three, "noise_axes": "camera"}
    tool = {"point_mm": _mm(set_up.tool_m)}
    target = {
        "position_mm": _mm(set_up.target_m),
        "normal": tuple(round(v, 6) for v in set_up.facing.normal.tolist()),
    }
    changed = config.model_copy(update={"camera": given}).changed(
        tool=tool | {"camera_stand_off_mm": round(distance_mm, _DECIMALS_MM)},
        base_pose={"posture_deg": _deg(set_up.postures[0])},
        target=target | _in_view(cell),
        camera=place,
        measurement=measured,
    )
    return replace(
        cell,
        config=changed,
        base_posture=np.deg2rad(changed.base_pose.posture_deg),
        tool_m=np.array(changed.tool.point_mm) / 1e3,
        target_m=np.array(changed.target.position_mm) / 1e3,
    )


def _in_view(cell: Cell) -> dict[str, float]:
    """Radius about the middle of a board of what has to be seen of it; nothing for a circle.

    All of it, or the shorter side of boards that are found in part.
    """
    if cell.board is None:
        return {}
    whole = cell.board.name in FOUND_WHOLE
    across_m = float(np.hypot(*cell.board.size_m)) if whole else min(cell.board.size_m)
    return {"radius_mm": round(1e3 * across_m / 2.0, _DECIMALS_MM)}


def _mm(vector: FloatArray) -> tuple[float, ...]:
    return tuple(round(1e3 * v, _DECIMALS_MM) + 0.0 for v in vector.tolist())


def _deg(angles: FloatArray) -> tuple[float, ...]:
    return tuple(round(v, _DECIMALS_DEG) + 0.0 for v in np.rad2deg(angles).tolist())


_ROLL_STEP = np.deg2rad(5.0)
"""Turns of the pattern about its normal that are tried: its edges are found from that far off."""

_QUARTER = np.pi / 2.0
"""In which the pattern, a cross, looks the same."""


class TargetPoses:
    """Collects A = T_base_tip and B = T_target_camera at touched-up postures.

    ``cell``: with camera and target as they were found.
    """

    def __init__(self, cell: Cell, station: Station, set_up: SetUp) -> None:
        self._robot = cell.robot
        self._station = station
        self._set_up = set_up
        self._target = target_of(cell)
        self._camera = camera_of(set_up.jacobian)
        self._T_base_target: FloatArray | None = None
        self.names: list[str] = []
        self.A: list[FloatArray] = []
        self.B: list[FloatArray] = []

    def add(self, name: str, q: FloatArray) -> None:
        """Take the pose of the target from where the arm stands, touched up at ``(n,)`` [rad]."""
        T_base_tip = self._robot.fk(q)
        T_base_camera = T_base_tip @ self._set_up.T_tip_camera
        found = self._station.target_pose(
            f"{name} pose", self._camera, self._target, inverse(T_base_camera) @ self._guesses()
        )
        if found is None:
            return
        if self._T_base_target is None:
            self._T_base_target = T_base_camera @ found
        self.names.append(name)
        self.A.append(T_base_tip)
        self.B.append(inverse(found))

    def _guesses(self) -> FloatArray:
        """Where the target may be, ``(K, 4, 4)`` [m]: at first turned anyhow about its normal."""
        if self._T_base_target is not None:
            return self._T_base_target[None]
        normal = self._set_up.facing.normal
        aside = np.eye(3)[int(np.argmin(np.abs(normal)))]
        x = np.cross(aside, normal)
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(normal, x), normal])
        rolls = np.arange(0.0, _QUARTER, _ROLL_STEP)
        turned = rotation_exp(rolls[:, None] * np.array([0.0, 0.0, 1.0]))
        return transform(R @ turned, np.tile(self._set_up.target_m, (len(rolls), 1)))
