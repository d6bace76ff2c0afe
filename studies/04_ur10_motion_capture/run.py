"""Run the study: ``posedesign study run ur10_motion_capture``.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from calib import IdentificationResult
from calib.identification import Trial
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, rotation_exp, rotation_from_wpr, rotation_log, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.files import make_folder
from posedesign.files.csv_tables import write_table
from posedesign.files.measurements import read_measurements
from posedesign.identification import identify_models
from posedesign.report.drawing import set_answer
from posedesign.study import Advance, Options
from studies import drawing, writing
from studies.real_data import data_with, folder_for_recordings, refitted

HERE = Path(__file__).parent
SETTINGS = writing.settings_of(__file__)
NOMINAL, FRAMES_ONLY, GEOMETRY = "nothing fitted", "frames only", "geometry with priors"
TOLERANCE_MM = 0.005
"""Of the figures on another machine, in mm and mrad: fits end within a thousandth of what they
are worth, the noise that is estimated with them included."""

RECORDINGS = "identification/ur10"
TABLE, FIGURE = "ur10_motion_capture.csv", "ur10_motion_capture"
CELLS = {"estimated": "cell.toml", "given": "cell_given_noise.toml"}
"""File of each cell, by what its noise is."""

DIGITS = 6
"""Significant digits in the table."""

SHOWN = ("rms_mm", "leave_one_out_mm", "rms_mrad", "leave_one_out_mrad")

CELL = """# The cell of the UR10, as far as an identification needs one.
[robot]
urdf = {urdf}
tip = {tip}
[tool]
point_mm = [0.0, 0.0, 0.0] # the markers' frame on the tool is found by every fit
[base_pose]
posture_deg = [0.0, -90.0, 90.0, 0.0, 90.0, 0.0]
[parameters]
models = {models}
loss = "least-squares"     # all poses count alike in what is compared
"""

NOISE = """[[noise]]
kind = "pose"
three_sigma_mm = {mm}
three_sigma_deg = {deg}
"""


def study(options: Options) -> dict[str, Any]:
    """Is there anything to gain on this arm?

    The recordings are what they are and nothing is drawn at random: a number of trials is ignored.
    Beside the results stand two cells and ``measurements.csv``, which ``posedesign identify``
    takes, unless the results go to the study's own folder.
    """
    data = data_with(RECORDINGS)
    with folder_for_recordings(options.out, HERE) as tables:
        found = run(data, tables, options.advance)
    rows = [{"noise": name} | row for name in CELLS for row in found[name]["models"]]
    writing.write_rows(options.out, TABLE, rows, DIGITS)
    writing.write_figures(options.out, found)
    return found


def plot(folder: Path) -> list[Path]:
    """Leave-one-out and in-sample rms of each model that was fitted: position, and orientation."""
    from matplotlib.figure import Figure

    every = [row for row in writing.read_rows(folder, TABLE) if row["noise"] == "estimated"]
    rows = [row for row in every if row["model"] != NOMINAL]
    names = [f"{row['model']} ({row['parameters']:g})" for row in rows]
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, unit in zip(panels, ("mm", "mrad"), strict=True):
        out = [row[f"leave_one_out_{unit}"] for row in rows]
        left = {"in the fit": [row[f"rms_{unit}"] for row in rows], "left out of it": out}
        drawing.rows_of_marks(axes, names, left)
        axes.set_xlim(0.0, 1.15 * max(out))
        what = "distance" if unit == "mm" else "turn"
        axes.set_xlabel(f"rms {what} left at the tool [{unit}]")
    panels[0].legend(frameon=False, loc="lower left")
    best = min(rows, key=lambda row: row["leave_one_out_mm"])
    before = next(row for row in rows if row["model"] == FRAMES_ONLY)
    told = [
        f"{r['leave_one_out_mm']:.2f} mm and {r['leave_one_out_mrad']:.1f} mrad"
        for r in (best, before)
    ]
    set_answer(
        figure,
        f"By {best['model']} a pose left out is off by {told[0]}, by {FRAMES_ONLY} {told[1]}",
    )
    return writing.save(figure, folder, FIGURE)


def write_tables(data: Path, out: Path) -> tuple[list[Path], Path]:
    """Write what ``posedesign identify`` takes: two cells, and ``measurements.csv``.

    ``cell.toml`` leaves the noise to the residuals, ``cell_given_noise.toml`` gives it.
    """
    folder = data / RECORDINGS
    with (folder / "calibration.csv").open(encoding="utf-8") as file:
        columns = next(csv.reader(file))
    numbers = np.loadtxt(folder / "calibration.csv", delimiter=",", skiprows=1)
    raw = dict(zip(columns, numbers.T, strict=True))
    turned = rotation_from_wpr(np.column_stack([raw["phix1"], raw["phiy1"], raw["phiz1"]]))
    wpr = np.rad2deg(wpr_from_rotation(turned))
    table = {
        "x_mm": 1e3 * raw["x1"],
        "y_mm": 1e3 * raw["y1"],
        "z_mm": 1e3 * raw["z1"],
        **dict(zip(("w_deg", "p_deg", "r_deg"), wpr.T, strict=True)),
    }
    joints = [name for name in columns if name.endswith("_joint")]  # from base to tip
    table |= {f"j{k + 1}_deg": np.rad2deg(raw[name]) for k, name in enumerate(joints)}
    rows = [
        {"target": "cameras", "kind": "pose", **dict(zip(table, values, strict=True))}
        for values in zip(*table.values(), strict=True)
    ]
    text = CELL.format(
        urdf=json.dumps(str((folder / "ur10_nomesh.urdf").resolve())),
        tip=json.dumps(SETTINGS["tip"]),
        models=json.dumps(SETTINGS["models"]),
    )
    given = SETTINGS["given_noise"]
    noise = NOISE.format(mm=3.0 * given["mm"], deg=float(3.0 * np.rad2deg(1e-3 * given["mrad"])))
    make_folder(out)
    cells = [out / name for name in CELLS.values()]
    for path, content in zip(cells, (text, text + noise), strict=True):
        path.write_text(content, encoding="utf-8")
    return cells, write_table(out / "measurements.csv", list(rows[0]), rows)


def refitted_mm(trial: Trial, result: IdentificationResult, data: Measurements) -> float:
    """Leave-one-out [mm] by a refit without each pose, in place of the closed form."""
    model, count = trial.candidate.model, data.count
    x = refitted(model, data, result, 1.0 - np.eye(count))
    rows = model.linearise(data.postures, x, data.setup, data.observed).rows
    return _rms_mm(np.linalg.norm(rows[np.arange(count), np.arange(count), :3], axis=-1))


def _rms_mm(far: FloatArray) -> float:
    return float(1e3 * np.sqrt(np.mean(far**2)))


def nominal_row(cell: Cell, data: Measurements) -> dict[str, Any]:
    """What is left where the cameras are taken to stand in the base, and the tip to be seen."""
    T = cell.robot.fk(data.postures)
    read = data.observed
    turns = np.swapaxes(rotation_exp(read[:, 3:6]), -1, -2) @ T[:, :3, :3]
    far = np.linalg.norm(T[:, :3, 3] - read[:, :3], axis=1)
    angle = np.linalg.norm(rotation_log(turns), axis=1)
    return {
        "model": NOMINAL,
        "parameters": 0,
        "rms_mm": _rms_mm(far),
        "leave_one_out_mm": _rms_mm(far),
        "refitted_mm": _rms_mm(far),
        "rms_mrad": _rms_mm(angle),
        "leave_one_out_mrad": _rms_mm(angle),
        "sigma_mm": None,
        "sigma_mrad": None,
    }


def row_of(trial: Trial, data: Measurements) -> dict[str, Any]:
    """The figures of a model."""
    result = trial.result
    if result is None:
        raise RuntimeError(f"{trial.name} was refused: {trial.error}")
    return {
        "model": trial.name,
        "parameters": trial.candidate.model.p,
        "rms_mm": 1e3 * result.rms_m,
        "leave_one_out_mm": 1e3 * result.leave_one_out_rms_m,
        "refitted_mm": refitted_mm(trial, result, data),
        "rms_mrad": 1e3 * result.rms_rad,
        "leave_one_out_mrad": 1e3 * result.leave_one_out_rms_rad,
        "sigma_mm": float(1e3 * result.noise[0].sigma[0]),
        "sigma_mrad": float(1e3 * result.noise[0].sigma[3]),
    }


def paired(a: FloatArray, b: FloatArray) -> dict[str, float]:
    """Mean gain in the square from a to b [mm², mrad²], and its standard error."""
    gain = 1e6 * (a**2 - b**2)
    chance = float(gain.std(ddof=1) / np.sqrt(len(gain)))
    return {"gain": float(gain.mean()), "chance": chance}


def run(data: Path, tables: Path, advance: Advance = lambda what, part: None) -> dict[str, Any]:
    """All figures of the study; the tables are written to a folder, and read from there."""
    cells, measured = write_tables(data, tables)
    found: dict[str, Any] = {"tolerance_mm": TOLERANCE_MM}
    for done, (name, path) in enumerate(zip(CELLS, cells, strict=True)):
        advance(f"noise {name}", done / len(CELLS))
        cell = Cell.load(path)
        table = read_measurements(measured, cell.robot.n)
        comparison = identify_models(cell, table).comparison
        rows = [nominal_row(cell, table.data)]
        rows += [row_of(trial, table.data) for trial in comparison.trials]
        of = {result.model: result for result in comparison.results}
        few, many = of[FRAMES_ONLY], of[GEOMETRY]
        found[name] = {
            "recommended": comparison.recommended,
            "reason": comparison.reason,
            "geometry_gains_mm2": paired(few.leave_one_out_m, many.leave_one_out_m),
            "geometry_gains_mrad2": paired(few.leave_one_out_rad, many.leave_one_out_rad),
            "models": rows,
        }
    return found


def markdown(found: Mapping[str, Any]) -> str:
    """The table of the README: in each cell with noise from the residuals, and with noise given."""

    def both(name: str, how: str) -> writing.Cell:
        return lambda pair: " / ".join(dict.fromkeys(format(row[name], how) for row in pair))

    def left(name: str) -> writing.Cell:
        return lambda pair: both(name, ".1f" if pair[0]["model"] == NOMINAL else ".3f")(pair)

    pairs = zip(*(found[name]["models"] for name in CELLS), strict=True)
    heads = ["model", "p", "rms [mm]", "leave-one-out", "rms [mrad]", "leave-one-out"]
    cells = [lambda pair: pair[0]["model"], both("parameters", ""), *map(left, SHOWN)]
    return writing.table(pairs, cells, heads)
