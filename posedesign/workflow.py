"""The steps of a calibration, each reading and writing the files of the next.

``cell.toml`` -> plan -> ``poses.csv`` -> program, and touch-up (or simulate) -> ``touchups.csv``
-> identify -> ``identification.json``; ``pairs.csv`` -> robot-world -> ``robot_world.csv``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import CalibError, InputError
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.cell.reference import reference_of
from posedesign.files import (
    MEASURED,
    Claim,
    Results,
    head_of,
    origin_of,
    write_json_atomic,
    write_text_atomic,
)
from posedesign.files.csv_tables import summed_up, write_table
from posedesign.files.measurements import write_measurements
from posedesign.files.origin import checksum
from posedesign.motion.route import Route
from posedesign.planning import Margins, PosePlan, check_fit, optimal, outside_limits, plan
from posedesign.planning.loop import Progress
from posedesign.planning.optimal.choose import Advance
from posedesign.planning.optimal.sequential import check_touch_up_cell
from posedesign.planning.pose_plan import PoseSet
from posedesign.planning.poses_file import PoseList, read_poses, write_poses
from posedesign.report.figures import draw
from posedesign.report.plots import figure_of_identification, figure_of_plan
from posedesign.selection import Indices

# what only one step needs is loaded there: most commands take one, and all of it takes a second
if TYPE_CHECKING:
    from calib.robot_world import PairNoise
    from posedesign.acceptance import AcceptancePlan, AcceptanceRequest, RecheckPlan, Watch
    from posedesign.acceptance.drift import Recheck
    from posedesign.acceptance.file import AcceptanceFile
    from posedesign.hand_eye import Asked, Calibrated, Sightings
    from posedesign.hand_eye.pairs.transforms import FrameNames
    from posedesign.hand_eye.pictures import PictureSet
    from posedesign.identification import Identified
    from posedesign.identification.instruments import Measured
    from posedesign.simulation import AccuracyStudy, SimulatedRobot

POSES = ("poses.csv", "measuring poses")
NEXT_POSES = ("poses.csv", "next measuring poses")
VALIDATION = ("validation.csv", "validation poses")
ROUNDS = ("rounds.csv", "rounds of a plan")
TOUCH_UPS = ("touchups.csv", "touch-ups")
MEASUREMENTS = ("measurements.csv", "measurements")
PAIRS = ("pairs.csv", "pairs")
IDENTIFICATION = ("identification.json", "identification")
JOINED = ("joined.csv", "measurements with their joints")
RESIDUALS = ("residuals.csv", "residuals of measurements")
ACCEPTANCE_POSES = ("poses.csv", "acceptance poses")
ACCEPTANCE_RULE = ("acceptance_test.json", "acceptance test")
ACCEPTANCE = ("acceptance.json", "acceptance verdict")
RECHECK_POSES = ("poses.csv", "recheck poses")
RECHECK = ("recheck.json", "recheck")
PLANNED, IDENTIFIED, CAMERA_DRAWN, CAMERA_POSES_DRAWN, ACCEPTANCE_DRAWN = (
    ((f"{stem}.png", purpose), (f"{stem}.svg", purpose))
    for stem, purpose in (
        ("plan", "figure of a plan"),
        ("identification", "figure of an identification"),
        ("camera", "figure of a calibrated camera"),
        ("camera_poses", "figure of poses of camera and board"),
        ("acceptance", "figure of an acceptance test"),
    )
)
"""Figures, as picture and as drawing."""

STUDY = (
    ("accuracy_vs_condition.csv", "accuracy study"),
    ("accuracy_vs_condition.png", "accuracy study"),
)
"""Names of the files of the steps, and what they say that they are."""

Warn = Callable[[str], None]
"""Is told what is odd, line by line."""

_FINGERPRINT = re.compile(rb"# fingerprint: ([0-9a-f]{4,16})")
_MOST_NAMED = 3


def _silent(text: str) -> None:
    """Tell nobody."""


def claim_plan(out: Results, *files: tuple[str, str], inputs: Sequence[Path] = ()) -> list[Claim]:
    """Claim ``poses.csv``, the first, and what goes with it.

    Raises OutputError: a file is not the command's own, or there is what was measured or written
    from the plan that is there.
    """
    needed = "" if out.remakes else depending(out.folder / files[0][0])
    return out.claim("planned", *files, inputs=inputs, needed_by={files[0][0]: needed})


def depending(poses: Path) -> str:
    """Files beside a list of poses that were measured at them, or hold their program, in words."""
    found, own = _FINGERPRINT.search(head_of(poses)), checksum(poses)
    if found is None:
        return ""
    from posedesign.programs import DIALECTS
    from posedesign.programs.sets import content_of

    names = [
        path.name
        for path in map(poses.with_name, MEASURED)
        if path.is_file()
        and ((there := origin_of(path)) is None or there.kind == "measured")
        and (there is None or dict(there.inputs).get(poses.name, own) == own)
    ]
    for dialect in DIALECTS.values():
        endings = {*dialect.suffixes, *dialect.companions} - {".csv"}
        files = poses.parent.glob("*/*" if dialect.in_folder else "*")
        names += [
            path.name
            for path in sorted(path for path in files if path.suffix.lower() in endings)
            if found[1] in content_of(path)
        ]
    return ", ".join(list(dict.fromkeys(names))[:_MOST_NAMED])


def plan_poses(cell: Cell, out: Path | Results, progress: Progress | None = None) -> PosePlan:
    """Plan, and write ``poses.csv`` and ``rounds.csv`` into a folder."""
    results = Results.of(out, "plan")
    poses, rounds, *drawn = claim_plan(results, POSES, ROUNDS, *PLANNED)
    result = plan(cell, progress)
    _write_poses(poses, cell, result.poses, result.route, result.indices)
    rows = result.round_rows()
    write_table(rounds, list(rows[0]), rows)
    results.remove(VALIDATION)
    arms = reference_of(cell.parts[0])
    draw(results, drawn, lambda: figure_of_plan(cell, arms, result.postures, result.setup))
    return result


def plan_optimal_poses(
    cell: Cell,
    out: Path | Results,
    request: optimal.Request,
    advance: Advance = lambda what, part: None,
    keep: PoseList | None = None,
) -> optimal.OptimalPlan:
    """Choose the best poses; write ``poses.csv`` and ``validation.csv`` where there are any.

    ``keep``: poses that are to be among the chosen, as they are. ``advance`` is called with what is
    being done and the part of all work that is done.
    """
    wanted = (POSES, VALIDATION) if request.validation else (POSES,)
    results = Results.of(out, "plan")
    *claims, png, svg = claim_plan(results, *wanted, *PLANNED)
    kept, of = None, None
    if keep is not None:
        check_fit(cell, keep)
        kept, of = keep.measured.postures, cell.which(keep.measured.labels)
    result = optimal.plan_optimal(cell, request, advance, keep=kept, keep_of=of)
    for path, poses, route, indices in zip(
        claims,
        (result.poses, result.validation),
        (result.route, result.validation_route),
        (result.indices, None),
        strict=False,
    ):
        if poses is not None and route is not None:
            _write_poses(path, cell, poses, route, indices)
            results.remove(ROUNDS, *({VALIDATION} - {*wanted}))
    if result.route is not None:
        draw(
            results,
            (png, svg),
            lambda: figure_of_plan(cell, result.arms, result.postures, result.setup),
        )
    return result


def plan_next_poses(
    cell: Cell,
    measurements: Path,
    out: Path | Results,
    count: int,
    *,
    criterion: str,
    least_gain: float,
    accuracy_m: float | None,
    joints: Path | None = None,
    trust_units: bool = False,
    warn: Warn = _silent,
) -> optimal.NextPoses:
    """Choose what to measure next, after what :func:`identify_file` takes; write ``poses.csv``.

    Of a cell that takes pictures of a board, where to take the next, after those of a list of
    poses, or of a ``camera.json``: with camera, board, lens and noise as they were found then.
    """
    if not cell.sees_board:  # the file of another kind would be found wrong in other words
        check_touch_up_cell(cell)
    inputs = [path for path in (measurements, joints) if path is not None]
    (poses,) = claim_plan(Results.of(out, "next"), NEXT_POSES, inputs=inputs)
    if cell.sees_board:
        cell, postures = _pictured(cell, measurements, trust_units)
        result = optimal.plan_next_views(
            cell, postures, count, criterion=criterion, least_gain=least_gain, accuracy_m=accuracy_m
        )
    else:
        found = _checked(cell, measurements, joints, warn=warn, trust_units=trust_units)
        cell, table = found.cell, found.table
        result = optimal.plan_next(
            cell,
            table.data,
            count,
            kinds=table.kinds,
            criterion=criterion,
            least_gain=least_gain,
            accuracy_m=accuracy_m,
        )
    _write_poses(poses, cell, result.poses, result.route)
    return result


def _pictured(cell: Cell, taken: Path, trust_units: bool) -> tuple[Cell, FloatArray]:
    """A cell as far as it is calibrated, and the postures ``(N, n)`` of pictures [rad]."""
    from posedesign.hand_eye import as_calibrated

    if taken.suffix == ".json":
        return as_calibrated(cell, taken)
    listed = read_poses(
        taken,
        cell.robot.n,
        external=cell.robot.external,
        controller=cell.robot.controller,
        trust_units=trust_units,
    )
    check_fit(cell, listed)
    return cell, listed.measured.postures


def _write_poses(
    path: Claim, cell: Cell, poses: PoseSet, route: Route, indices: Indices | None = None
) -> Path:
    return write_poses(
        path,
        cell.robot,
        poses,
        route,
        cell.tool_m,
        margins=Margins.of_route(cell, poses, route),
        indices=indices,
        title=path.origin.purpose,
        not_checked=cell.not_checked,
        stop_short_mm=cell.config.plan.stop_short_mm,
    )


def simulated_files(cell: Cell) -> list[tuple[str, str]]:
    """Files that a rehearsal writes, and what they say that they are: measurements, and pairs."""
    if cell.is_hand_eye:
        return [PAIRS]
    reads = any(seen.reads for seen in cell.observations)
    return [MEASUREMENTS if reads else TOUCH_UPS, *([PAIRS] * cell.has_camera)]


def simulate(
    cell: Cell, poses: PoseList, out: Path | Results, seed: int | None = None, cycles: int = 1
) -> SimulatedRobot:
    """Measure a pose list with the robot of ``[truth]``; write ``touchups.csv``, ``pairs.csv``.

    What instruments read goes to ``measurements.csv``. In a cell of hand-eye calibration nothing is
    touched, and there are pairs only; without a camera there are none. The noise depends on the
    seed alone: the one of the cell, unless another is given. ``cycles``: how often an instrument
    reads all poses, one after another.

    Raises InputError: several cycles of what is touched: each touch has joint values of its own,
    and so a name.
    """
    from posedesign.hand_eye.pairs import Pairs, write_pairs
    from posedesign.simulation import SimulatedRobot

    claims = Results.of(out, "simulate").claim("simulated", *simulated_files(cell))
    check_fit(cell, poses)
    rng = np.random.default_rng(cell.config.truth.seed if seed is None else seed)
    robot = SimulatedRobot.of(cell)
    poses = poses.measured
    postures, external = poses.postures, cell.robot.external
    if cycles > 1 and not all(seen.reads for seen in cell.observations):
        raise InputError(
            f"{cycles} cycles of poses that are touched",
            hint="only what an instrument reads is repeated at the same joint values",
            name="cycles",
        )
    if not cell.is_hand_eye and cell.is_plain:
        touched = robot.touch_up(postures, rng)
        write_measurements(claims[0], replace(touched, names=poses.names), external=external)
        postures = touched.postures
    elif not cell.is_hand_eye:
        which = np.tile(cell.which(poses.labels), cycles)
        data = robot.measure(np.tile(postures, (cycles, 1)), which, poses.names * cycles, rng)
        kinds = [kind.name for kind in robot.model.measurements]
        write_measurements(
            claims[0], data, kinds, [load.name for load in cell.config.payload], external=external
        )
    if cell.has_camera:
        A, B = robot.camera_poses(postures, rng)
        write_pairs(claims[-1], Pairs(poses.names, A, B))
    return robot


def identify_file(
    cell: Cell,
    measurements: Path,
    out: Path | Results,
    *,
    joints: Path | None = None,
    trust_units: bool = False,
    warn: Warn = _silent,
) -> Identified:
    """Identify from a ``touchups.csv`` or ``measurements.csv``; write ``identification.json``.

    From the file of an instrument with the ``joints`` of its poses, too, which are joined in
    ``joined.csv``; what is left of its readings is in ``residuals.csv``.

    ``warn`` is told of what is odd: measurements outside the joint limits, rows that are there
    twice, poses that are not there.
    """
    from posedesign.identification import identify_models, results_as_dict
    from posedesign.identification.checks import check_readings, far_rows, without_repeats
    from posedesign.identification.file import IdentificationFile, residual_rows
    from posedesign.identification.instruments import is_of_instrument, read_measured

    results = Results.of(out, "identify")
    inputs = [measurements] if joints is None else [measurements, joints]
    foreign = joints is not None or is_of_instrument(cell, measurements)
    own = (IDENTIFICATION, *IDENTIFIED, *((JOINED, RESIDUALS) if foreign else ()))
    file, png, svg, *more = results.claim("computed", *own, inputs=inputs)
    found = read_measured(cell, measurements, joints, trust_units=trust_units)
    cell, table, postures = found.cell, found.table, found.table.data.postures
    if foreign:
        write_measurements(
            more[0], table.data, table.kinds, extra=table.extra, external=cell.robot.external
        )
    if not trust_units:
        check_readings(cell, table)
    outside = outside_limits(cell, [f"line {line}" for line in table.lines], postures)
    odd = summed_up(outside, "rows outside the joint limits")
    odd += summed_up(far_rows(cell, table), "rows far from the others")
    table, repeated = without_repeats(table)
    _warn_all(warn, measurements, [*odd, *repeated])
    identified = identify_models(cell, table)
    if foreign:
        rows = residual_rows(identified)
        write_table(more[1], list(rows[0]), rows)
    _warn_all(warn, measurements, identified.warnings)
    source = origin_of(measurements)
    data = {"file": measurements.name, "origin": None if source is None else str(source)}
    content = {"data": data, **results_as_dict(cell, identified)}
    write_json_atomic(file, content)
    shown, q_deg = IdentificationFile.model_validate(content), cell.robot.shown(table.data.postures)
    draw(results, (png, svg), lambda: figure_of_identification(shown, q_deg))
    return identified


def _warn_all(warn: Warn, path: Path, said: Sequence[str]) -> None:
    """Tell what is odd about a file, line by line."""
    for line in said:
        warn(f"{path}: {line}")


def calibrate_from_pictures(
    cell: Cell,
    pictures: Mapping[str, PictureSet],
    asked: Asked,
    out: Path | Results,
    advance: Advance = lambda what, part: None,
    *,
    transforms: bool = False,
    frames: FrameNames | None = None,
) -> tuple[Calibrated, list[Path]]:
    """Calibrate a camera as :func:`calibrate_camera` does, and draw pictures, poses and residuals.

    Where the calibration fails, the pictures are drawn with what was found in them.
    ``transforms``: write camera, board and lens for other tools, too, where nothing looks wrong.
    ``frames``: names of the frames in them. Returns the files that were written with it.
    """
    from posedesign.hand_eye import CAMERA_FILES, board_of, calibrate_camera
    from posedesign.hand_eye.lens_files import LENS_FILES, camera_info, opencv_lens
    from posedesign.hand_eye.pairs.transforms import TRANSFORMS, claim_transforms, write_transforms
    from posedesign.report.camera_poses import figure_of_poses
    from posedesign.report.camera_sheets import CAMERA_SHEETS, write_sheets
    from posedesign.report.hand_eye import figure_of_camera, shown_camera

    results = Results.of(out, "camera")
    drawn = results.claim("computed", *CAMERA_DRAWN)
    drawn_poses = results.claim("computed", *CAMERA_POSES_DRAWN)
    (sheets,) = results.claim("computed", CAMERA_SHEETS)
    for_others = results.claim("computed", *LENS_FILES) if transforms else []
    placed = claim_transforms(results) if transforms else []
    looked: dict[str, Sightings] = {}
    try:
        found = calibrate_camera(cell, pictures, asked, results, advance, looked.__setitem__)
    except CalibError as error:
        if looked:
            board = asked.board or board_of(cell)
            write_sheets(sheets, pictures, looked, board, error)
            shown = f"{sheets.path} shows what was found in each picture"
            error.hint = f"{error.hint}; {shown}" if error.hint else shown
        raise
    draw(results, drawn, lambda: figure_of_camera(found.result))
    draw(results, drawn_poses, lambda: figure_of_poses(shown_camera(found)))
    write_sheets(sheets, pictures, looked, found.board, found)
    own = (*CAMERA_FILES, CAMERA_DRAWN[0], CAMERA_POSES_DRAWN[0], CAMERA_SHEETS)
    files = [results.folder / name for name, _ in own]
    if transforms and found.result.is_ok and len(pictures) == 1:
        info, opencv = for_others
        write_text_atomic(info, camera_info(found.result.lens))
        write_json_atomic(opencv, opencv_lens(found.result.lens))
        write_transforms(placed, found.result, asked.camera, frames)
        files += [claim.path for claim in (*for_others, *placed)]
    else:
        results.remove(*LENS_FILES, *TRANSFORMS)
    return found, files


def plan_acceptance_test(
    cell: Cell,
    request: AcceptanceRequest,
    out: Path | Results,
    identification: Path | None = None,
    model: str | None = None,
) -> AcceptancePlan:
    """Plan an acceptance test; write ``poses.csv`` and the rule, ``acceptance_test.json``.

    ``identification``: what the arm is corrected by, a ``model`` of it; gives the chance to pass.
    """
    from posedesign.acceptance import plan_acceptance
    from posedesign.acceptance.file import rule_as_dict
    from posedesign.identification.file import read_file as read_identification_file
    from posedesign.identification.file import read_identification

    results = Results.of(out, "prove")
    poses, rule = claim_plan(results, ACCEPTANCE_POSES, ACCEPTANCE_RULE)
    used = known = None
    expected_mm: dict[str, float | None] = {}
    if identification is not None:
        used = read_identification(identification, cell, model)
        known = read_identification(identification, cell, reference=True)
        content = read_identification_file(identification)
        expected_mm = {each.name: each.expected_box_mm for each in content.models}
    found = plan_acceptance(cell, request, used=used, known=known)
    over_work_mm = None if used is None else expected_mm.get(used.name)
    if over_work_mm is not None:
        found = replace(found, expected_elsewhere_m=over_work_mm / 1e3)
    _write_poses(poses, cell, found.poses, found.route)
    write_json_atomic(rule, rule_as_dict(found))
    results.remove(ACCEPTANCE, *ACCEPTANCE_DRAWN)
    return found


def judge_acceptance_test(
    cell: Cell,
    measurements: Path,
    out: Path | Results,
    identification: Path | None = None,
    model: str | None = None,
    rule: Path | None = None,
    *,
    joints: Path | None = None,
    given_frame: bool = False,
    trust_units: bool = False,
) -> AcceptanceFile:
    """Judge an arm by what was measured at the poses of a test; write ``acceptance.json``.

    ``rule``: of the test; by default the one beside the measurements. ``joints``: of the poses,
    where an instrument measured them.
    """
    from posedesign.acceptance import judge
    from posedesign.acceptance.file import (
        AcceptanceFile,
        check_not_fitted,
        read_rule,
        verdict_as_dict,
    )
    from posedesign.identification.file import read_file as read_identification_file
    from posedesign.identification.file import read_identification
    from posedesign.identification.instruments import is_of_instrument, read_measured
    from posedesign.identification.models import FRAMES_ONLY
    from posedesign.report.acceptance import figure_of_acceptance

    planned = measurements.with_name(ACCEPTANCE_RULE[0]) if rule is None else rule
    if measurements.is_file() and not planned.exists():
        raise InputError(
            f"{planned}: there is no such file, and the test is judged by its rule",
            hint=f"name the {ACCEPTANCE_RULE[0]} of the planned test with `rule`",
            name="rule",
        )
    given = (measurements, planned, identification, joints)
    read = [path for path in given if path is not None]
    file, *drawn = Results.of(out, "prove").claim(
        "computed", ACCEPTANCE, *ACCEPTANCE_DRAWN, inputs=read
    )
    asked, used, before = read_rule(planned), None, None
    notes: list[str] = []
    table = _checked(
        cell, measurements, joints, warn=notes.append, each_visit=True, trust_units=trust_units
    ).table
    if identification is not None:
        used = read_identification(identification, cell, model)
        content = read_identification_file(identification)
        fitted = identification.with_name(Path(content.data.file).name)
        if fitted.is_file() and is_of_instrument(cell, fitted):
            fitted = identification.with_name(JOINED[0])
        there = fitted.is_file() and bool(content.data.file)
        notes += check_not_fitted(
            measurements,
            table,
            identification,
            read_measured(cell, fitted, trust_units=trust_units).table if there else None,
        )
        if any(each.name == FRAMES_ONLY and each.parameters for each in content.models):
            before = read_identification(identification, cell, FRAMES_ONLY)
    verdict = judge(
        cell,
        table,
        asked.request,
        planned=asked.poses,
        used=used,
        before=before,
        given_frame=given_frame,
    )
    content_of = verdict_as_dict(asked, replace(verdict, notes=(*notes, *verdict.notes)))
    write_json_atomic(file, content_of)
    found = AcceptanceFile.model_validate(content_of)
    draw(Results.of(out, "prove"), drawn, lambda: figure_of_acceptance(found))
    return found


def _checked(
    cell: Cell,
    path: Path,
    joints: Path | None,
    *,
    warn: Warn,
    each_visit: bool = False,
    trust_units: bool,
) -> Measured:
    """What was measured, refused where readings cannot be in the unit of their columns."""
    from posedesign.identification.checks import check_readings
    from posedesign.identification.instruments import read_measured

    found = read_measured(cell, path, joints, each_visit=each_visit, trust_units=trust_units)
    for line in found.table.notes:
        warn(line)
    if not trust_units:
        check_readings(found.cell, found.table)
    return found


def plan_recheck_poses(
    cell: Cell, identification: Path, out: Path | Results, count: int, *, set_up_anew: bool = False
) -> RecheckPlan:
    """Choose the poses that tell best whether the arm is still the one identified; write them."""
    from posedesign.acceptance import plan_recheck

    (poses,) = claim_plan(Results.of(out, "recheck"), RECHECK_POSES, inputs=[identification])
    kinds = list(dict.fromkeys(seen.kind for seen in cell.observations))
    found = plan_recheck(cell, _watch(cell, identification, kinds, set_up_anew), count)
    _write_poses(poses, cell, found.poses, found.route)
    return found


def recheck_file(
    cell: Cell,
    measurements: Path,
    identification: Path,
    out: Path | Results,
    *,
    joints: Path | None = None,
    set_up_anew: bool = False,
    trust_units: bool = False,
    warn: Warn = _silent,
) -> Recheck:
    """Test by what was measured whether the arm is still the one identified: ``recheck.json``."""
    from posedesign.acceptance.file import check_not_fitted, recheck_as_dict

    read = [path for path in (measurements, identification, joints) if path is not None]
    (file,) = Results.of(out, "recheck").claim("computed", RECHECK, inputs=read)
    table = _checked(cell, measurements, joints, warn=warn, trust_units=trust_units).table
    check_not_fitted(measurements, table, identification, None)
    found = _watch(cell, identification, table.kinds, set_up_anew).test(table)
    write_json_atomic(file, recheck_as_dict(found))
    return found


def _watch(cell: Cell, identification: Path, kinds: Sequence[str], set_up_anew: bool) -> Watch:
    from posedesign.acceptance import Watch
    from posedesign.identification.file import read_file as read_identification_file
    from posedesign.identification.file import read_identification

    known = read_identification(identification, cell, reference=True)
    models = read_identification_file(identification).models
    noise = {n.kind: n for model in models if model.name == known.name for n in model.noise}
    return Watch.of(cell, known, noise, kinds, set_up_anew=set_up_anew)


def camera_noise(cell: Cell) -> PairNoise:
    """Noise of the simulated camera, for the covariance of X and Z."""
    from calib.robot_world import PairNoise

    section = cell.config.measurement
    return PairNoise(
        rotation_rad=float(np.deg2rad(section.camera_three_sigma_deg) / 3.0),
        translation_m=section.camera_three_sigma_mm / 3e3,
        on="B",
    )


def write_study(study: AccuracyStudy, out: Path | Results) -> tuple[Path, Path]:
    """Write ``accuracy_vs_condition.csv`` and its figure."""
    from posedesign.report.accuracy import draw_accuracy

    file, figure = Results.of(out, "study accuracy").claim("simulated", *STUDY)
    rows = [finding.__dict__ for finding in study.findings]
    return write_table(file, list(rows[0]), rows), draw_accuracy(study, figure)
