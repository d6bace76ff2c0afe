"""A calibration by sight from a cell's file to its results: with a simulated robot, or a real one.

What the command does, for Python: :func:`run_by_sight` for a file, :func:`calibrate_robot` for a
robot behind an adapter of one's own.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from calib.errors import CalibError, InputError, OutputError
from calib.se3 import FloatArray, wpr_from_rotation
from calib.vision.camera import Observer
from calib.vision.camera.observers import Kind
from calib.vision.touch_up import Arms, RobotAdapter
from calib.vision.touch_up.arms import OneArm
from posedesign.autonomous.folder_robot import FolderRobot, drive_of
from posedesign.autonomous.journal import Journal, KeptStation
from posedesign.autonomous.process import (
    COMMAND,
    LEAST_SIGMA_M,
    Calibration,
    Progress,
    SessionFiles,
    calibrate,
    loop_of,
)
from posedesign.autonomous.record import LOG, PICTURES, USUAL_MB, Record, RecordedArms
from posedesign.autonomous.video_camera import VideoCamera
from posedesign.cell import Cell
from posedesign.files import Results, held, identity_of, json_text, make_folder, origin_of
from posedesign.planning import check_plain
from posedesign.report.answer import Answer, Table
from posedesign.report.identification import answer_of_identification
from posedesign.simulation import PLATE_PITCH_M, PlateTest, target_of, true_cell, true_observer
from posedesign.simulation.rehearsal import simulated_arms
from posedesign.workflow import PAIRS, TOUCH_UPS

JOURNAL = "journal.jsonl"
_DOING = "calibrating"

_PLATES = 10
"""Times that the simulated plate is measured: the table has their median."""


@dataclass(frozen=True, eq=False)
class SightResult:
    """A calibration, and where the robot was simulated what it is worth on a plate."""

    calibration: Calibration
    plate: PlateTest | str | None
    """Or in words why the plate cannot be touched; None for a real robot."""

    def set_up_rows(self) -> list[dict[str, object]]:
        """What the first step has found, as rows of a table."""
        found = self.calibration.set_up
        T = found.T_tip_camera
        return [
            _row("lens on the tip", "mm", 1e3 * T[:3, 3]),
            _row("camera on the tip, W P R", "deg", np.rad2deg(wpr_from_rotation(T[:3, :3]))),
            _row("virtual pin tip on the tip", "mm", 1e3 * found.tool_m),
            _row("target in the base", "mm", 1e3 * found.target_m),
            _row("normal of the target", "", found.facing.normal, 4),
        ]

    def noise_in_words(self) -> str:
        """How the first step closed, what it saw, and the noise of a touch-up."""
        found = self.calibration.set_up
        jacobian = found.jacobian
        said = (
            f"from {len(found.postures)} touch-ups that miss each other by "
            f"{1e3 * found.rms_m:.2f} mm; a target of {1e3 * jacobian.diameter_m:.2f} mm at "
            f"{1e3 * jacobian.distance_m:.1f} mm, focal length {jacobian.focal_px:.0f} px"
        )
        sigma = self.calibration.sigma_m
        if np.isfinite(sigma).all():
            x, y, z = (
                f"{bound}{3e3 * s:.3f}" for bound, s in zip(self._bounds, sigma, strict=True)
            )
            said += f"\n3 sigma of a touch-up, from repeats: {x}, {y}, {z} mm along the camera's "
            said += "x, y and depth"
        return said

    @property
    def _bounds(self) -> list[str]:
        """In words, along which axes the repeats say no more than that the noise is small."""
        return ["at most " if s <= LEAST_SIGMA_M else "" for s in self.calibration.sigma_m]

    def plate_rows(self) -> list[dict[str, object]]:
        """Worst error of a distance [mm] by model, for 1 to 4 pitches; nothing without a plate."""
        if not isinstance(self.plate, PlateTest):
            return []
        rows = []
        for trial in self.calibration.identified.comparison.trials:
            if trial.result is None:
                continue
            worst = self.plate.worst_error(trial.candidate.model, trial.result.values)
            row: dict[str, object] = {"model": trial.name}
            for apart, value in enumerate(np.median(worst, axis=0).tolist(), start=1):
                row[f"over {1e3 * PLATE_PITCH_M * apart:.0f} mm"] = round(1e3 * value, 4)
            rows.append(row)
        return rows

    def answer(self, files: Sequence[str] = ()) -> Answer:
        """The answer for people: that of the identification, and how the robot got there."""
        found = self.calibration
        answer = answer_of_identification(found.identified, files)
        count = len(found.touch_ups.names)
        set_up = Table("Camera and target, found by inching around the target", self.set_up_rows())
        plate = Table(
            "Plate of 5 x 5 targets, 100 mm apart: worst error of a distance [mm]",
            self.plate_rows(),
        )
        no_plate = [f"no plate test: {self.plate}"] if isinstance(self.plate, str) else []
        return replace(
            answer,
            figures={
                "touched up": f"{count} of {count + len(found.missed)} poses",
                **answer.figures,
                "planned": found.plan.verdict,
            },
            not_checked=found.plan.not_checked,
            details=[*self.noise_in_words().splitlines(), *no_plate, *answer.details],
            tables=[set_up, *answer.tables, plate],
        )

    def as_dict(self) -> dict[str, Any]:
        """What a program would want to know; the identification is in its own file."""
        found = self.calibration
        return {
            "T_tip_camera": found.set_up.T_tip_camera,
            "tool_mm": 1e3 * found.set_up.tool_m,
            "target_mm": 1e3 * found.set_up.target_m,
            "target_normal": found.set_up.facing.normal,
            "focal_px": found.set_up.jacobian.focal_px,
            "target_diameter_mm": 1e3 * found.set_up.jacobian.diameter_m,
            "three_sigma_mm": 3e3 * found.sigma_m,
            "three_sigma_is_a_bound": [bool(bound) for bound in self._bounds],
            "plan": found.plan.message,
            "not_checked": found.plan.not_checked,
            "touched": list(found.touch_ups.names),
            "missed": {pose.name: pose.reason for pose in found.missed},
            "recommended": found.identified.comparison.recommended,
            "plate_mm": self.plate_rows(),
        }


def run_by_sight(
    path: Path,
    out: Path,
    *,
    folder: Path | None = None,
    dialect: str | None = None,
    camera: str | None = None,
    wait_s: float = 600.0,
    kind: Kind = "image",
    seed: int | None = None,
    pictures_mb: float | None = None,
    restart: bool = False,
    overwrite: bool = False,
    progress: Progress = lambda what, part: None,
    warn: Callable[[str], None] = lambda text: None,
) -> SightResult:
    """Calibrate the robot of a ``cell.toml``: a real one behind a folder, or the simulated one.

    ``path``: the cell. ``out``: folder for the results, and the journal that a stopped calibration
    goes on from. ``folder``: see :class:`~posedesign.autonomous.folder_robot.FolderRobot`.
    ``dialect``: of the programs in the folder; by default that of the robot's controller.
    ``camera``: that is connected to this computer: see
    :class:`~posedesign.autonomous.video_camera.VideoCamera`. By default pictures come through the
    folder. ``wait_s``: longest wait for a picture in the folder [s]. ``kind`` {"image", "fast"}:
    whether the simulated camera takes pictures. ``seed``: of the simulated noise; by default the
    cell's. ``pictures_mb``: disk that the pictures may take that are kept; by default 1000 MB of a
    real robot, and nothing of a rehearsal. ``restart``: put all files of what was measured before
    aside, together, and begin anew. ``overwrite``: replace files that no calibration wrote; they
    are kept under other names. ``progress``, ``warn``: see
    :func:`~posedesign.autonomous.process.calibrate`. Raises CalibError: what
    :func:`~posedesign.autonomous.process.calibrate` raises, a cell that is not one of touch-ups,
    options that contradict each other, a folder that is in use or has touch-ups of other origin.
    """
    _check_options(folder, dialect, camera, kind, seed)
    cell = Cell.load(path)
    _check_kind(cell)
    if folder is not None:
        live = None if camera is None else _opened(cell, camera)
        robot = FolderRobot(cell, folder, dialect, camera=live, timeout_s=wait_s)
        with held(folder, _DOING, "name another folder with `robot_folder`"):
            found = calibrate_robot(
                cell,
                robot,
                out,
                source=path.parent,
                pictures_mb=USUAL_MB if pictures_mb is None else pictures_mb,
                restart=restart,
                overwrite=overwrite,
                progress=progress,
                warn=warn,
            )
        return SightResult(found, None)
    if cell.config.camera is None:
        raise InputError(
            f"{path}: there is no [camera] that a simulated robot could look through",
            hint="describe the camera on the flange; without one, plan and simulate touch-ups",
            name="camera",
        )
    own = cell.config.truth.seed if seed is None else seed
    observer = true_observer(cell, kind)
    arms = simulated_arms(cell, observer, own)
    how = "pictures" if kind == "image" else "drawn noise"
    about = _about(cell, f"the simulated robot, {how}, seed {own}")
    about["[truth]"] = _digest(cell.config.truth.model_dump(mode="json"))
    session = _Session(
        about, own, pictures=kind == "image", simulated=True, pictures_mb=pictures_mb or 0.0
    )
    results = Results(out, COMMAND, overwrite=overwrite, say=warn, remakes=True)
    found = _calibrate(cell, arms, results, session, path.parent, restart, progress)
    fast = observer if kind == "fast" else true_observer(cell, "fast")
    return SightResult(found, _plate(cell, found, fast, own))


def calibrate_robot(
    cell: Cell,
    robot: RobotAdapter,
    out: Path,
    *,
    source: Path = Path(),
    pictures_mb: float = USUAL_MB,
    restart: bool = False,
    overwrite: bool = False,
    progress: Progress = lambda what, part: None,
    warn: Callable[[str], None] = lambda text: None,
) -> Calibration:
    """Calibrate a robot behind its adapter; see :func:`run_by_sight`."""
    arms = OneArm(robot, target_of(cell))
    session = _Session(_about(cell, _named(robot)), pictures_mb=pictures_mb)
    results = Results(out, COMMAND, overwrite=overwrite, say=warn, remakes=True)
    return _calibrate(cell, arms, results, session, source, restart, progress)


@dataclass(frozen=True)
class _Session:
    """What is measured with."""

    about: Mapping[str, str]  # see :class:`~posedesign.autonomous.journal.Journal`
    seed: int = 0
    pictures: bool = True
    simulated: bool = False
    pictures_mb: float = 0.0

    def files(self, results: Results, *, check: bool) -> SessionFiles:
        """Its files in a folder, under a name that no other session has."""
        name = f"session {_digest(self.about)[:8]}"
        return SessionFiles.of(results, name, self.simulated, self.pictures, check=check)


def _calibrate(
    cell: Cell,
    arms: Arms,
    results: Results,
    session: _Session,
    source: Path,
    restart: bool,
    progress: Progress,
) -> Calibration:
    _check_kind(cell)
    out, warn = make_folder(results.folder), results.say
    results = replace(results, place=identity_of(out))
    with held(out, _DOING):
        if restart:
            _put_aside(out, session.files(results, check=False), warn)
        elif not results.overwrite:
            _check_results(out)
        if not (out / JOURNAL).exists():
            session.files(results, check=True)  # before there is a journal of nothing
        with Journal(out / JOURNAL, session.about) as journal:
            files = session.files(results, check=True)
            if len(journal):
                count = f"{len(journal)} measurement" + "s" * (len(journal) > 1)
                warn(f"going on from {count} in {journal.path}; anew: `restart`")
            for notice in cell.notices:
                warn(notice)
            for said in cell.not_checked:
                warn(f"not checked: {said}")
            # it grows, and is never replaced: its own check is that of its columns
            (log,) = results.claim(
                "simulated" if session.simulated else "measured", LOG, check=False
            )
            with Record(log, cell.robot.n, session.pictures_mb, warn) as record:
                drive = drive_of(cell, cast(Arms, RecordedArms(arms, record)), warn)
                done = calibrate(
                    cell,
                    KeptStation(drive, journal, session.seed),
                    results,
                    source=source,
                    files=files,
                    progress=progress,
                    warn=warn,
                )
            journal.check_place()
            return done


def _opened(cell: Cell, source: str) -> VideoCamera:
    """A camera that has given its first picture: what is wrong with it is said before a move."""
    section = cell.config.camera
    told = section is not None and "image_px" in section.model_fields_set
    camera = VideoCamera(source, section.image_px if section is not None and told else None)
    camera.grab()
    return camera


def _check_options(
    folder: Path | None, dialect: str | None, camera: str | None, kind: Kind, seed: int | None
) -> None:
    """Refuse what would have no effect."""
    no_dialect = "a simulated robot reads no programs: there is no dialect to choose"
    for said, name, value in (
        ("a simulated robot has its own camera", "camera", camera),
        (no_dialect, "dialect", dialect),
    ):
        if folder is None and value is not None:
            hint = "name the folder of the real one with `robot_folder`"
            raise InputError(said, hint=hint, name=name, value=value)
    if folder is not None and (kind != "image" or seed is not None):
        raise InputError(
            "the pictures of a real robot are its own: neither their noise nor a seed is chosen",
            hint="leave out `no_images` and `seed`, or `robot_folder`",
            name="kind" if kind != "image" else "seed",
        )


def _check_kind(cell: Cell) -> None:
    if cell.config.measurement.kind != "touch-up":
        raise InputError(
            f"a calibration by sight touches up, this cell has {cell.config.measurement.kind}",
            hint='set measurement.kind = "touch-up"',
            name="measurement.kind",
        )
    check_plain(cell, "a calibration by sight")
    if cell.robot.floor:
        raise InputError(
            f"a positioner carries {cell.robot.base_frame}, and by sight only the arm is driven",
            hint="hold the positioner (robot.held_deg), or plan, program and identify",
            name="robot.base",
        )


def _check_results(out: Path) -> None:
    """Refuse to write over what was measured and no journal has."""
    for name, _ in (TOUCH_UPS, PAIRS):
        if (out / name).exists() and not (out / JOURNAL).exists() and _is_own(out / name):
            raise InputError(
                f"{out / name} is there, and no {JOURNAL} that it comes from: it would be "
                "overwritten",
                hint="choose another `out`, or `restart` to put it aside",
                name=str(out / name),
            )


def _is_own(path: Path) -> bool:
    """Whether a file was written by a calibration."""
    origin = origin_of(path)
    return origin is not None and origin.command == COMMAND


def _named(robot: RobotAdapter) -> str:
    """A robot by its adapter and its own name."""
    own: object = robot.identity
    own = own() if callable(own) else own  # a plain attribute says it as well
    if not isinstance(own, str):
        raise InputError(
            f"identity() of the robot's adapter gave a {type(own).__name__}",
            hint="give the name of the robot as text, empty where it is not known",
            name="identity",
        )
    return " ".join(f"{type(robot).__name__} {own}".split())


def _about(cell: Cell, robot: str) -> dict[str, str]:
    """What the measurements of a journal are of."""
    arm = cell.robot
    config = cell.config.model_dump(mode="json", exclude={"truth"})
    return {
        "robot": robot,
        "robot description": _digest(
            [arm.name, arm.chain.placements.round(9), arm.lower.round(9), arm.upper.round(9)]
        ),
        "cell": _digest(config),
    }


def _digest(content: object) -> str:
    return hashlib.sha256(json_text(content).encode()).hexdigest()[:16]


def _put_aside(out: Path, files: SessionFiles, warn: Callable[[str], None]) -> None:
    """Move all files of a session into a folder of their own: touch-ups on a robot took hours.

    What no calibration wrote stays, and is refused before anything is moved where it is in the way.
    The journal goes last, so that a stop in between leaves what it is gone on from.
    """
    there = [claim.path for claim in files.claims if claim.path.exists()]
    for claim in files.claims:
        if not _is_own(claim.path):
            claim.check()
    own = [path for path in (*there, out / PAIRS[0], out / LOG[0]) if _is_own(path)]
    if out / LOG[0] in own and (out / PICTURES).is_dir() and not (out / PICTURES).is_symlink():
        own.append(out / PICTURES)
    own += [out / JOURNAL] * (out / JOURNAL).exists()
    if not own:
        return
    number = 1
    while os.path.lexists(aside := out / f"session.{number}"):
        number += 1
    try:
        aside.mkdir()
        for path in dict.fromkeys(own):
            os.replace(path, aside / path.name)
    except OSError as error:
        raise OutputError(
            f"{aside}: what was measured before cannot be put aside: {error.strerror}",
            hint="choose another `out`",
            name=str(aside),
        ) from error
    warn(f"what was measured before is in {aside}")


def _plate(cell: Cell, found: Calibration, observer: Observer, seed: int) -> PlateTest | str:
    try:
        return PlateTest.by_sight(
            found.cell,
            true_cell(cell),
            observer,
            found.set_up.jacobian,
            loop_of(cell),
            np.random.default_rng([seed, 3]),
            _PLATES,
        )
    except CalibError as error:
        return error.message


def _row(what: str, unit: str, values: FloatArray, decimals: int = 2) -> dict[str, object]:
    shown = [f"{v + 0.0:.{decimals}f}" for v in np.round(values, decimals).tolist()]
    return {"": what, "unit": unit, **dict(zip("xyz", shown, strict=True))}
