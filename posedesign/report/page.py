"""A calibration on one page: an HTML file that needs no network, for the person who signs.

Made from the files of a folder alone, as far as they are there: the cell, the poses with their
checks, the measurements and the identification, X and Z, and where every file is from.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files as resources
from pathlib import Path

import numpy as np

from calib.errors import CalibError, FileFormatError, InputError
from calib.identification import check_identifiable
from calib.robots import shown_of
from calib.se3 import FloatArray
from posedesign.acceptance.file import RECHECK, RESULT, read_recheck, read_result
from posedesign.candidates import box_of_cell, functions_over_work
from posedesign.cell import Cell
from posedesign.cell.task_box import predict_box
from posedesign.files import (
    Results,
    load_json,
    origin_of,
    read_bytes_bounded,
    rehearsed,
    write_text_atomic,
)
from posedesign.files.csv_tables import numbers_of, read_table
from posedesign.files.json_files import ReadFromFile
from posedesign.files.measurements import read_measurements
from posedesign.files.origin import checksum, read_whole
from posedesign.identification.file import IdentificationFile, read_file
from posedesign.planning import POSE_AXES, displayed, off_target
from posedesign.planning.checks import ON_TARGET_M, check_poses
from posedesign.planning.loop import arms_told_by
from posedesign.planning.poses_file import PoseList, read_poses
from posedesign.report import figures
from posedesign.report.acceptance import (
    answer_of_recheck,
    answer_of_verdict,
    figure_of_acceptance,
    rule_lines,
)
from posedesign.report.answer import Answer, Table, expected_words
from posedesign.report.camera_poses import figure_of_poses
from posedesign.report.camera_sheets import CAMERA_SHEETS
from posedesign.report.hand_eye import CameraFile, figure_of_pictures, lines_of_camera
from posedesign.report.pairs import SIGMA_AXES, figure_of_pairs
from posedesign.report.plans import (
    answer_of_check,
    frame_notes,
    sigma_table,
)
from posedesign.report.plots import figure_of_identification, figure_of_plan

PAGE = ("report.html", "report")
CELL, POSES, IDENTIFICATION = "cell.toml", "poses.csv", "identification.json"
MEASUREMENTS = ("touchups.csv", "measurements.csv")
ROBOT_WORLD, ROBOT_WORLD_PAIRS = "robot_world.csv", "robot_world_pairs.csv"
CAMERA = "camera.json"
SCENE = "scene.html"
"""What `posedesign view` writes of a cell."""
MOST_BYTES = 50_000_000
"""Of a file that is named in the list of files; a larger one is listed without its checksum."""

_POSE_COLUMNS = (
    *("name", "order", "status", "reason", "configuration"),
    *("clearance_mm", "self_clearance_mm", "limit_margin_deg"),
)


@dataclass
class Section:
    """A part of the page: words first, then figures, then tables.

    ``figures`` are elements of SVG, each with what it shows; ``scene`` is a page of its own;
    ``link`` is the name of a file beside the page.
    """

    title: str
    lines: list[str] = field(default_factory=list)
    figures: list[tuple[str, str]] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    scene: str = ""
    link: str = ""


def write_report(folder: Path, out: Results) -> Path:
    """Write ``report.html`` of the files of a folder.

    Raises InputError: there is nothing to report of. FileFormatError: a file that cannot be read.
    """
    if not folder.is_dir():
        raise InputError(
            f"{folder} is no folder",
            hint="name the one that plan, identify or robot-world wrote into",
            name=str(folder),
        )
    (page,) = out.claim("computed", PAGE, inputs=list(_files_of(folder)))
    return write_text_atomic(page, render_page(folder))


def render_page(folder: Path) -> str:
    """The page of a folder."""
    from jinja2 import Environment

    sections = list(_sections(folder))
    if not sections:
        raise InputError(
            f"{folder} has nothing to report of: no {CELL}, {IDENTIFICATION} or {ROBOT_WORLD}",
            hint="name the folder that plan, identify or robot-world wrote into",
            name=str(folder),
        )
    # the answer first: what each part says at its beginning
    glance = [f"{part.title}: {part.lines[0]}" for part in sections if part.lines]
    glance += [text for part in sections for text in part.lines if text.startswith("warning")]
    glance += [f"warning: {said}" for said in _out_of_date(folder)]
    first = [Section("At a glance", glance)]
    scene = _scene_of(folder)
    if scene:
        first.append(Section("The cell in 3-D", scene=scene))
    sections = [*first, *sections, _section_of_files(folder)]
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["shown"] = _shown
    template = (resources("posedesign.report") / "page.html").read_text(encoding="utf-8")
    return environment.from_string(template).render(
        title=f"Calibration: {folder.resolve().name}",
        simulated=rehearsed(_files_of(folder)).partition(": from")[0],
        sections=sections,
    )


def _sections(folder: Path) -> Iterator[Section]:
    file = _cell_file(folder)
    if file is not None:
        cell = Cell.load(file)
        yield _section_of_cell(cell)
        if (folder / POSES).is_file():
            listed = read_poses(
                folder / POSES,
                cell.robot.n,
                external=cell.robot.external,
                controller=cell.robot.controller,
            )
            yield from _sections_of_poses(cell, listed, folder)
    for name, section_of in (
        (IDENTIFICATION, _section_of_identification),
        (RESULT, _section_of_acceptance),
        (RECHECK, _section_of_recheck),
        (ROBOT_WORLD, _section_of_pairs),
        (CAMERA, _section_of_camera),
    ):
        if (folder / name).is_file():
            yield section_of(folder)


def _out_of_date(folder: Path) -> Iterator[str]:
    """Files of the folder that were changed, or made from others than those that are there."""
    cell = _cell_file(folder)
    there = {path.name: path for path in _files_of(folder)}
    if cell is not None:
        there.setdefault(cell.name, cell)
    for path in list(_files_of(folder)):
        if path.stat().st_size >= MOST_BYTES:
            continue
        origin, intact = read_whole(path)
        if origin is None:
            continue
        if not intact:
            yield f"{path.name} was changed since {origin.command} wrote it"
        for name, mark in origin.inputs:
            if name in there and checksum(there[name]) != mark:
                yield f"{path.name} was made from another {name} than the one that is there"


def _scene_of(folder: Path) -> str:
    """The scene of the cell in the folder, as it was written from that; empty for none."""
    path, cell = folder / SCENE, _cell_file(folder)
    if not path.is_file() or path.stat().st_size >= MOST_BYTES or cell is None:
        return ""
    origin, intact = read_whole(path)
    if origin is None or not intact or origin.command != "view":
        return ""
    return path.read_text(encoding="utf-8") if (cell.name, checksum(cell)) in origin.inputs else ""


def _cell_file(folder: Path) -> Path | None:
    """The cell in the folder, or the one there or above that files of the folder are made from."""
    if (folder / CELL).is_file():
        return folder / CELL
    origins = (origin_of(path) for path in _files_of(folder))
    marks = {mark for origin in origins if origin is not None for mark in origin.inputs}
    return next(
        (
            place / name
            for name, mark in sorted(marks)
            for place in (folder, folder.resolve().parent)
            if name.endswith(".toml") and (place / name).is_file()
            if checksum(place / name) == mark
        ),
        None,
    )


def _section_of_cell(cell: Cell) -> Section:
    config = cell.config
    rows: list[dict[str, object]] = [
        {"what": "robot", "value": cell.robot.name},
        {
            "what": "controller",
            "value": (cell.robot.controller.maker if cell.robot.controller else "") or "not known",
        },
        {"what": "target", "value": cell.whereabouts.words},
        {"what": "measurement", "value": config.measurement.kind},
        {"what": "obstacles", "value": ", ".join(o.name for o in cell.obstacles) or "none"},
    ]
    said = [f"warning: {text}" for text in cell.doubts]
    said += [f"note: {text}" for text in cell.remarks]
    said += [f"not checked: {text}" for text in cell.not_checked]
    return Section("Cell", said, tables=[Table("", rows)])


def _sections_of_poses(cell: Cell, listed: PoseList, folder: Path) -> Iterator[Section]:
    """What the poses promise, and whether the robot can take them."""
    table = read_table(folder / POSES)
    columns = [name for name in _POSE_COLUMNS if name in table.columns]
    shown = [{column: row.cells[column] for column in columns} for row in table.rows]
    plan = Section("Poses", tables=[Table("Poses in the order of the visit", shown)])
    if listed.misfit:
        plan.lines.append(f"warning: {listed.misfit}")
    try:
        _promise(cell, listed.measured, plan)
    except CalibError as error:
        plan.lines.append(f"no prediction: {error.message}")
    yield plan
    try:
        verdicts = check_poses(cell, listed)
    except CalibError as error:
        yield Section("Motions", [f"warning: not checked: {error}"])
        return
    measured = listed.measured
    which = cell.which(measured.labels)
    off = off_target(cell, measured.names, measured.postures, ON_TARGET_M, which)
    yield _section_of_answer("Motions", answer_of_check(cell, verdicts, off))


def _section_of_answer(title: str, answer: Answer) -> Section:
    lines = [f"{line.what}: {line.text}" if line.what else line.text for line in answer.all_lines()]
    return Section(title, lines, tables=[table for table in answer.tables if table.rows])


def _promise(cell: Cell, measured: PoseList, section: Section) -> None:
    """Write the error to expect of an identification at these poses into a section."""
    q, which = measured.postures, cell.which(measured.labels)
    arms = arms_told_by(cell, q, which)
    setup = cell.setup(arms.model, q, which)
    blocks = arms.blocks(arms.model.linearise(q, setup=setup))
    told = np.vstack([blocks.reshape(-1, arms.model.p), arms.known_rows])
    check_identifiable(told, arms.model.names, arms.model.nuisance)
    covariance = arms.covariance(blocks)
    if not cell.is_hand_eye:  # X and Z are no errors of the arm
        functions, where = functions_over_work(cell, arms.model)
        box, words = box_of_cell(cell)
        found = predict_box(cell, arms, blocks, box)
        section.lines += [
            f"expected error: {expected_words(arms.expected_error(blocks, functions), where)}",
            f"over {words}: {found.summary()}",
            found.reference,
        ]
    figure = figure_of_plan(cell, arms, q, setup)
    if figure is not None:
        section.figures.append(("Expected before measuring", figures.as_svg(figure)))
    section.lines += frame_notes(arms.model)
    sigma = np.sqrt(np.diag(covariance))
    section.tables.append(sigma_table(displayed(arms.model, sigma)))


def _section_of_identification(folder: Path) -> Section:
    content = _read_identification(folder / IDENTIFICATION)
    chosen = content.chosen
    section = Section(
        "Identification", [f"recommended: {content.recommended or 'none'}", content.reason or ""]
    )
    section.lines += [f"warning: {text}" for text in content.warnings]
    section.lines += [f"warning: {each.text}" for each in content.findings]
    models = [
        _row(model, _OF_MODEL) | {"parameters": len(model.parameters)} for model in content.models
    ]
    section.tables.append(Table("Models", models))
    if chosen is None:
        return section
    figure = figure_of_identification(content, _measured_deg(folder, content))
    if figure is not None:
        svg = figures.as_svg(figure)
        section.figures.append(("Residuals by pose and by joint, before and after", svg))
    section.tables += [
        Table(f"Parameters of {chosen.name}", [_row(p, _OF_PARAMETER) for p in chosen.parameters]),
        Table(
            f"Residual at each pose, by {chosen.name}",
            [_row(residual, _OF_RESIDUAL) for residual in chosen.residuals],
        ),
    ]
    return section


def _read_identification(path: Path) -> IdentificationFile:
    """What an identification.json has of what is shown."""
    content = read_file(path)
    if content.recommended and not (content.chosen and content.chosen.residuals):
        raise FileFormatError(
            "does not have what a report needs: nothing is said of the recommended model "
            f"{content.recommended[:40]}",
            path=path,
            hint="write it again",
        )
    return content


_OF_MODEL = {
    "model": "name",
    "parameters": "parameters",
    "rms [mm]": "rms_mm",
    "leave-one-out [mm]": "leave_one_out_rms_mm",
    "expected error [mm]": "expected_box_mm",
    "residual / noise": "noise_scale",
    "said": "message",
}
_OF_PARAMETER = {"parameter": "name", "value": "value", "change": "change", "sigma": "sigma"}
_OF_PARAMETER |= {"95 % from": "low", "to": "high", "unit": "unit"}
_OF_RESIDUAL = {"pose": "pose", "target": "target", "residual [mm]": "mm"}
_OF_RESIDUAL |= {"when left out [mm]": "leave_one_out_mm", "weight": "weight", "outlier": "outlier"}
"""Columns of tables, and what of the file stands in them."""


def _row(read: ReadFromFile, columns: Mapping[str, str]) -> dict[str, object]:
    return {title: getattr(read, key) for title, key in columns.items()}


def _measured_deg(folder: Path, content: IdentificationFile) -> FloatArray | None:
    """Joint values (N, n) [deg] of the measurements, where their table is there."""
    path = folder / Path(content.data.file).name
    if path.name not in MEASUREMENTS or not path.is_file():
        return None
    n = len(content.joints)
    found = read_measurements(path, n, external=content.external).data.postures
    return np.asarray(found * shown_of(n, content.external))


def _section_of_acceptance(folder: Path) -> Section:
    found = read_result(folder / RESULT)
    section = _section_of_answer("Acceptance test", answer_of_verdict(found))
    section.lines += rule_lines(found.rule)
    svg = figures.as_svg(figure_of_acceptance(found))
    caption = "Error at each pose of the test, before and after, with the limit"
    section.figures.append((caption, svg))
    return section


def _section_of_recheck(folder: Path) -> Section:
    return _section_of_answer("Recheck", answer_of_recheck(read_recheck(folder / RECHECK)))


def _section_of_pairs(folder: Path) -> Section:
    answers = _rows_of(folder / ROBOT_WORLD, _ANSWER, _ANSWER[3:])
    section = Section("A X = Z B")
    first = answers[0]
    for letter in "xz" if first["status"] == "ok" else "":
        place, turn = (
            ", ".join(_shown(first[f"{letter}_{axis}"]) for axis in axes)
            for axes in (("x_mm", "y_mm", "z_mm"), ("w_deg", "p_deg", "r_deg"))
        )
        section.lines.append(
            f"{letter.upper()} by {first['method']}: ({place}) mm, W P R ({turn}) deg"
        )
    section.lines += [f"{row['method']}: {row['message']}" for row in answers]
    each = folder / ROBOT_WORLD_PAIRS
    figure = figure_of_pairs(answers, _rows_of(each, _PAIR, _PAIR[3:])) if each.is_file() else None
    if figure is not None:
        svg = figures.as_svg(figure)
        section.figures.append(("Residuals of the pairs, and how far methods differ", svg))
    keys = [*_ANSWER[:2], *(k for k in answers[0] if k.startswith(("x_", "z_", "sigma_")))]
    section.tables.append(Table("X and Z", [{key: row[key] for key in keys} for row in answers]))
    return section


def _section_of_camera(folder: Path) -> Section:
    path = folder / CAMERA
    try:
        file = CameraFile.model_validate(load_json(read_bytes_bounded(path, most_bytes=MOST_BYTES)))
        lines = lines_of_camera(file)
    except ValueError as error:  # of JSON, or of what is missing in it
        raise FileFormatError(
            "is no file that the command camera wrote", path=path, hint="calibrate again"
        ) from error
    section = Section("Camera and board", lines)
    if any(one.rms_px is not None for one in file.pictures):
        svg = figures.as_svg(figure_of_pictures(file.pictures))
        section.figures.append(("Residuals of the pictures", svg))
    placed = figure_of_poses(file)
    if placed is not None:
        caption = "Poses of camera and board, and the board as each picture shows it"
        section.figures.append((caption, figures.as_svg(placed)))
    if (folder / CAMERA_SHEETS[0]).is_file():
        section.link = CAMERA_SHEETS[0]
    section.tables.append(Table("Parameters", file.parameters))
    section.tables.append(Table("Pictures", [one.model_dump() for one in file.pictures]))
    return section


_ANSWER = (
    *("method", "status", "message"),
    *(f"{x}_{axis}" for x in "xz" for axis in POSE_AXES),
    *(f"sigma_x_{axis}_{unit}" for unit, axes in SIGMA_AXES for axis in axes),
)
_PAIR = ("method", "pose", "used", "residual_mm", "residual_deg")


def _rows_of(path: Path, columns: Sequence[str], numbers: Sequence[str]) -> list[dict[str, str]]:
    """Rows of a table that has to have some columns, with numbers or nothing in some of them.

    Raises FileFormatError: one is missing, there is no row, or something else is in a cell.
    """
    table = read_table(path)
    missing = [name for name in columns if name not in table.columns]
    if missing or not table.rows:
        raise FileFormatError(
            f"does not have what a report needs: {missing[0] if missing else 'rows'}",
            path=path,
            hint="write it again",
        )
    for name in numbers:
        numbers_of(path, [row for row in table.rows if row.cells[name]], (name,))
    return [row.cells for row in table.rows]


def _files_of(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_file() and path.name != PAGE[0] and not path.name.startswith("."):
            yield path


def _section_of_files(folder: Path) -> Section:
    rows: list[dict[str, object]] = []
    for path in _files_of(folder):
        size = path.stat().st_size
        origin, intact = read_whole(path) if size < MOST_BYTES else (origin_of(path), True)
        rows.append(
            {
                "file": path.name,
                "kB": round(size / 1e3, 1),
                "SHA-256 begins": checksum(path) if size < MOST_BYTES else "",
                "origin": str(origin or "does not say"),
                "changed since": "" if origin is None or intact else "yes",
            }
        )
    return Section("Files", tables=[Table("", rows)])


def _shown(value: object) -> str:
    """A cell of a table."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float):
        return f"{value:.5g}" if math.isfinite(value) else ""
    text = str(value)
    try:
        return f"{float(text):.6g}" if "." in text else text
    except ValueError:
        return text
