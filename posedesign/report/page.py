"""A calibration on one page: an HTML file that needs no network, for the person who signs.

Made from the files of a folder alone, as far as they are there: the cell, the poses with their
checks, the measurements and the identification, X and Z, and where every file is from.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import CalibError, FileFormatError, InputError
from calib.identification import covariance_of
from calib.se3 import FloatArray
from posedesign.candidates import box_of_cell, functions_over_box
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
from posedesign.files.csv_tables import read_table
from posedesign.files.measurements import read_measurements
from posedesign.files.origin import checksum, read_whole
from posedesign.planning import off_target
from posedesign.planning.checks import ON_TARGET_M, check_poses
from posedesign.planning.poses_file import PoseList, read_poses
from posedesign.report import figures
from posedesign.report.answer import Answer, Table
from posedesign.report.plans import answer_of_check

PAGE = ("report.html", "report")
CELL, POSES, IDENTIFICATION = "cell.toml", "poses.csv", "identification.json"
MEASUREMENTS = ("touchups.csv", "measurements.csv")
ROBOT_WORLD = "robot_world.csv"
SCENE = "scene.html"
"""What `posedesign view` writes of a cell."""
MOST_BYTES = 50_000_000
"""Of a file that is named in the list of files; a larger one is listed without its checksum."""

SINGULAR = 1e12
"""Condition of the normalised information from which on poses do not suffice."""

_POSE_COLUMNS = (
    *("name", "order", "status", "reason", "configuration"),
    *("clearance_mm", "self_clearance_mm", "limit_margin_deg"),
)


@dataclass
class Section:
    """A part of the page: words first, then figures, then tables.

    ``figures`` are elements of SVG, each with what it shows; ``scene`` is a page of its own.
    """

    title: str
    lines: list[str] = field(default_factory=list)
    figures: list[tuple[str, str]] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    scene: str = ""


def write_report(folder: Path, out: Results) -> Path:
    """Write ``report.html`` of the files of a folder.

    Raises
    ------
    InputError
        There is nothing to report of.
    FileFormatError
        A file that cannot be read.
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
            listed = read_poses(folder / POSES, cell.robot.n, controller=cell.robot.controller)
            yield from _sections_of_poses(cell, listed, folder)
    for name, section_of in (
        (IDENTIFICATION, _section_of_identification),
        (ROBOT_WORLD, _section_of_pairs),
    ):
        if (folder / name).is_file():
            try:
                yield section_of(folder)
            except (KeyError, TypeError, AttributeError, ValueError) as error:
                raise FileFormatError(
                    f"does not have what a report needs: {error}"[:300],
                    path=folder / name,
                    hint="write it again",
                ) from error


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
    plan = Section("Poses", tables=[_pose_table(folder)])
    if listed.misfit:
        plan.lines.append(f"warning: {listed.misfit}")
    try:
        _promise(cell, listed.measured.postures, plan)
    except CalibError as error:
        plan.lines.append(f"no prediction: {error.message}")
    yield plan
    try:
        verdicts = check_poses(cell, listed)
    except CalibError as error:
        yield Section("Motions", [f"warning: not checked: {error}"])
        return
    measured = listed.measured
    off = off_target(cell, measured.names, measured.postures, ON_TARGET_M)
    yield _section_of_answer("Motions", answer_of_check(cell, verdicts, off))


def _section_of_answer(title: str, answer: Answer) -> Section:
    lines = [f"{line.what}: {line.text}" if line.what else line.text for line in answer.all_lines()]
    return Section(title, lines, tables=[table for table in answer.tables if table.rows])


def _promise(cell: Cell, q: FloatArray, section: Section) -> None:
    """Predicted error over the box, and against the number of poses."""
    model = cell.model()
    box, words = box_of_cell(cell)
    covariance = covariance_of(model, q, weighted=cell.config.measurement.weighted)
    found = predict_box(cell, model, covariance, box)
    section.lines += [
        f"tool point, predicted from the noise alone over {words}: {found.summary()}",
        found.reference,
    ]
    svg = figures.as_svg(figures.error_over_box(found.points_m, found.rms_m))
    section.figures.append((f"Predicted error of the tool point over {words}", svg))
    errors = _errors(model.linearise(q).white_jacobian, functions_over_box(cell, model)[0])
    figure = figures.error_by_poses(
        errors, ("the first poses of the tour", "the best of these poses")
    )
    section.figures.append(("What each further pose is worth", figures.as_svg(figure)))


def _errors(white: FloatArray, functions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Error of the tool point [m] of the first poses of a tour, and of the best of all of it.

    Parameters
    ----------
    white : array (N, m, p)
        Whitened blocks.
    functions : array (K, 3, p)
        How the tool point moves with the parameters.

    Returns
    -------
    first, best : array (N,)
        For 1, 2, .. N poses; NaN where they do not suffice. The best are found by leaving out, one
        after the other, the pose that is missed least.
    """
    blocks = np.einsum("nmp,nmq->npq", white, white)
    wanted = np.einsum("kip,kiq->pq", functions, functions) / len(functions)
    first = _error(np.cumsum(blocks, axis=0), wanted)
    best = np.full(len(white), np.nan)
    left = np.arange(len(white))
    best[-1] = first[-1]
    while len(left) > 1:
        error = _error(blocks[left].sum(axis=0) - blocks[left], wanted)
        if np.isnan(error).all():
            break
        left = np.delete(left, np.nanargmin(error))
        best[len(left) - 1] = np.nanmin(error)
    return first, best


def _error(information: FloatArray, wanted: FloatArray) -> FloatArray:
    """Root mean square error ``(N,)`` [m] by information ``(N, p, p)``; NaN where singular."""
    scale = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
    normal = information / (scale[:, :, None] * scale[:, None, :])
    known = np.linalg.cond(normal) < SINGULAR
    out = np.full(len(information), np.nan)
    weight = wanted / (scale[known][:, :, None] * scale[known][:, None, :])
    spread = np.linalg.inv(normal[known])
    out[known] = np.sqrt(np.einsum("npq,nqp->n", spread, weight))
    return out


def _pose_table(folder: Path) -> Table:
    table = read_table(folder / POSES)
    columns = [name for name in _POSE_COLUMNS if name in table.columns]
    return Table(
        "Poses in the order of the visit", [{c: r.cells[c] for c in columns} for r in table.rows]
    )


def _section_of_identification(folder: Path) -> Section:
    content: dict[str, Any] = load_json(
        read_bytes_bounded(folder / IDENTIFICATION, most_bytes=MOST_BYTES)
    )
    models = {model["name"]: model for model in content.get("models", [])}
    taken = content.get("recommended")
    section = Section(
        "Identification",
        [f"recommended: {taken or 'none'}", str(content.get("reason", ""))],
    )
    section.lines += [f"warning: {text}" for text in content.get("warnings", [])]
    section.lines += [f"warning: {each['text']}" for each in content.get("findings", [])]
    section.tables.append(Table("Models", [_model_row(model) for model in models.values()]))
    if taken not in models:
        return section
    chosen, before = models[taken], next(iter(models.values()))
    left = {
        model["name"]: np.array([row["mm"] for row in model["residuals"]], dtype=float)
        for model in (before, chosen)
    }
    outliers = np.array([bool(row.get("outlier")) for row in chosen["residuals"]])
    names = [str(row["pose"]) for row in chosen["residuals"]]
    if left and all(len(v) == len(names) and np.isfinite(v).all() for v in left.values()):
        by_pose = figures.residuals_by_pose(names, left, outliers)
        section.figures.append(("Left over at each pose", figures.as_svg(by_pose)))
        q = _measured_deg(folder, content)
        if q is not None and len(q) == len(names):
            by_joint = figures.residuals_by_joint(content["joints"], q, left)
            section.figures.append(("Left over against each joint", figures.as_svg(by_joint)))
    section.tables += [
        Table(f"Parameters of {taken}", [_parameter_row(row) for row in chosen["parameters"]]),
        Table(
            f"Left over at each pose, by {taken}", [_residual_row(r) for r in chosen["residuals"]]
        ),
    ]
    return section


def _model_row(model: Mapping[str, Any]) -> dict[str, object]:
    return {
        "model": model["name"],
        "parameters": len(model["parameters"]),
        "rms [mm]": model["rms_mm"],
        "leave-one-out [mm]": model["leave_one_out_rms_mm"],
        "expected error [mm]": model.get("expected_box_mm"),
        "residual / noise": model["noise_scale"],
        "said": model["message"],
    }


def _parameter_row(row: Mapping[str, Any]) -> dict[str, object]:
    return {
        "parameter": row["name"],
        "value": row["value"],
        "change": row.get("change"),
        "sigma": row["sigma"],
        "95 % from": row.get("low"),
        "to": row.get("high"),
        "unit": row["unit"],
    }


def _residual_row(row: Mapping[str, Any]) -> dict[str, object]:
    return {
        "pose": row["pose"],
        "target": row.get("target"),
        "left over [mm]": row["mm"],
        "when left out [mm]": row.get("leave_one_out_mm"),
        "weight": row.get("weight"),
        "outlier": row.get("outlier"),
    }


def _measured_deg(folder: Path, content: Mapping[str, Any]) -> FloatArray | None:
    """Joint values (N, n) [deg] of the measurements, where their table is there."""
    name = Path(str(content.get("data", {}).get("file", ""))).name
    path = folder / name
    if name not in MEASUREMENTS or not path.is_file():
        return None
    data = read_measurements(path, len(content["joints"])).data
    return np.rad2deg(data.postures)


def _section_of_pairs(folder: Path) -> Section:
    rows = [row.cells for row in read_table(folder / ROBOT_WORLD).rows]
    section = Section("A X = Z B")
    good = [row for row in rows if row["status"] == "ok"]
    if good:
        first = good[0]
        for letter in "xz":
            place, turn = (
                ", ".join(f"{float(first[f'{letter}_{axis}']):.3f}" for axis in axes)
                for axes in (("x_mm", "y_mm", "z_mm"), ("w_deg", "p_deg", "r_deg"))
            )
            section.lines.append(
                f"{letter.upper()} by {first['method']}: ({place}) mm, W P R ({turn}) deg"
            )
    section.lines += [f"{row['method']}: {row['message']}" for row in rows]
    keys = [key for key in rows[0] if key.startswith(("x_", "z_")) or key in ("method", "status")]
    section.tables.append(Table("X and Z", [{key: row[key] for key in keys} for row in rows]))
    return section


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
