"""Run the study: ``posedesign study run irb120_measuring_arm``, or this file as a script.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from arm_models import GEOMETRY, WITH_COMPLIANCE, other_models, rms_mm, row_of  # noqa: E402
from arm_recordings import POINTS, RECORDINGS, load, write_tables  # noqa: E402
from arm_recordings import SETTINGS as SETTINGS  # noqa: E402

from posedesign.cell import Cell  # noqa: E402
from posedesign.files.measurements import read_measurements  # noqa: E402
from posedesign.identification.comparison import identify_models  # noqa: E402
from posedesign.study.library import Advance, Options  # noqa: E402
from studies import drawing, writing  # noqa: E402
from studies.real_data import data_with, folder_for_recordings  # noqa: E402

TOLERANCE_MM = 0.002
"""Of the figures on another machine: fits end within a thousandth of what they are worth."""

TABLE, FIGURE = "irb120_measuring_arm.csv", "irb120_measuring_arm"
DIGITS = 6
"""Significant digits in the table."""

SHOWN = ("rms_mm", "max_mm", "leave_one_out_mm", "check_mm", "check_from_zero_mm")


def study(options: Options) -> dict[str, Any]:
    """What does a calibration of a small arm gain, and against what?

    The recordings are what they are and nothing is drawn at random: a number of trials is ignored.
    Beside the results stand ``cell.toml`` and ``measurements.csv``, which ``posedesign identify``
    takes, unless the results go to the study's own folder.
    """
    data = data_with(RECORDINGS)
    with folder_for_recordings(options.out, HERE) as tables:
        found = run(data, tables, options.advance)
    writing.write_rows(options.out, TABLE, found["models"], DIGITS)
    writing.write_figures(options.out, found)
    return found


def plot(folder: Path) -> list[Path]:
    """Leave-one-out and check points of each model."""
    from matplotlib.figure import Figure

    rows = writing.read_rows(folder, TABLE)
    figure = Figure(figsize=(8.0, 4.4), layout="constrained")
    axes = figure.subplots()
    off = {
        "the three points measured": [row["leave_one_out_mm"] for row in rows],
        "check points on the tool": [row["check_mm"] for row in rows],
    }
    names = [f"{row['model']} ({row['parameters']:g})" for row in rows]
    drawing.rows_of_marks(axes, names, off)
    drawing.log_ticks(axes, [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0])
    axes.set_xlabel("rms distance in configurations that took no part in the fit [mm]")
    axes.legend(frameon=False)
    return writing.save(figure, folder, FIGURE)


def run(data: Path, tables: Path, advance: Advance = lambda what, part: None) -> dict[str, Any]:
    """All figures of the study; the tables are written to a folder, and read from there."""
    advance("models of posedesign identify", 0.0)
    recorded = load(data)
    cell_file, measured = write_tables(data, tables)
    cell = Cell.load(cell_file)
    identified = identify_models(cell, read_measurements(measured, cell.robot.n))
    comparison = identified.comparison
    tried = other_models(identified, recorded)
    tried |= {t.name: (t.candidate.model, identified.table.data) for t in comparison.trials}
    found = {}
    for done, (name, of) in enumerate(tried.items()):
        advance(name, (1.0 + done) / (1.0 + len(tried)))  # the first part is the comparison
        found[name] = row_of(name, *of, recorded)
    gain = found[GEOMETRY][1] - found[WITH_COMPLIANCE][1]
    values, names = comparison.best.values, comparison.best.names
    places = np.array([[values[names.index(f"tool.{p}.{a}")] for a in "xyz"] for p in POINTS])
    at_zero = tried["nothing fitted"][0].parameters[0]
    return {
        "tolerance_mm": TOLERANCE_MM,
        "recommended": comparison.recommended,
        "reason": comparison.reason,
        "check_gain_mm2": float(gain.mean()),
        "check_gain_chance_mm2": float(gain.std(ddof=1) / np.sqrt(len(gain))),
        "points_off_mm": rms_mm(np.linalg.norm(places - at_zero.positions_m, axis=1)),
        "compliance_urad_per_nm": {
            name.rpartition(".")[2]: float(1e6 * value)
            for name, value in zip(names, values, strict=True)
            if name.startswith("compliance")
        },
        "models": sorted((row for row, _ in found.values()), key=lambda r: -r["leave_one_out_mm"]),
    }


def table(found: Mapping[str, Any]) -> str:
    """The table of the README."""
    head = ["model", "p", "rms [mm]", "max", "leave-one-out", "check points"]
    lines = []
    for row in found["models"]:
        digits = 3 if row["rms_mm"] < 1.0 else 2
        cells = [row["model"], str(row["parameters"])]
        lines.append(cells + [f"{row[name]:.{digits}f}" for name in SHOWN])
    return writing.table_of([*head, "from the zero posture"], lines)


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, table)


if __name__ == "__main__":
    main()
