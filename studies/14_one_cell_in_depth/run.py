"""Run the study: python studies/01_accuracy_vs_condition/run.py [--draws N] [--out DIR]."""

from __future__ import annotations

import argparse
import json
import tomllib
from pathlib import Path

from posedesign.accuracy_study import IDENTIFIED_ARM, AccuracyStudy, accuracy_study, pick
from posedesign.cell import Cell
from posedesign.cli.output import print_table, progress
from posedesign.report.accuracy_table import accuracy_rows
from posedesign.template import cell_template
from posedesign.workflow import write_study

HERE = Path(__file__).parent
OFFSET = "zero_offset.joint_2"
PLATE = "plate distance worst"
X = "X translation"


def run(draws: int | None = None) -> AccuracyStudy:
    """The study as its TOML describes it, with fewer draws where asked for."""
    settings = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
    cell = Cell.from_text(cell_template(settings["robot"], surroundings=False))
    with progress("accuracy against condition") as advance:
        return accuracy_study(
            cell, draws=draws or settings["draws"], seed=settings["seed"], progress=advance
        )


def key_figures(study: AccuracyStudy) -> list[dict[str, float]]:
    """What the answer rests on, a row for each pose set; degrees and millimetres.

    Medians and scatter of the deflecting arm, except where ``rigid`` stands in the name.
    """
    columns = {
        "predicted_deg": ("deflecting", "touch-up weighted", OFFSET, "predicted_sigma"),
        "scatter_deg": ("deflecting", "touch-up weighted", OFFSET, "spread"),
        "scatter_unweighted_deg": ("deflecting", "touch-up unweighted", OFFSET, "spread"),
        "scatter_view_line_deg": ("deflecting", "view line", OFFSET, "spread"),
        "error_deg": ("deflecting", "touch-up weighted", OFFSET, "error_median"),
        "error_rigid_deg": ("rigid", "touch-up weighted", OFFSET, "error_median"),
        "plate_before_mm": ("deflecting", "uncalibrated", PLATE, "error_median"),
        "plate_after_mm": ("deflecting", "touch-up weighted", PLATE, "error_median"),
        "plate_after_rigid_mm": ("rigid", "touch-up weighted", PLATE, "error_median"),
    }
    for solver in ("hirsh", "li-dual-quaternion", "li-kronecker"):
        short = solver.rpartition("-")[2]
        columns[f"x_{short}_mm"] = ("deflecting", solver, X, "error_median")
        identified = solver + IDENTIFIED_ARM
        columns[f"x_{short}_identified_mm"] = ("deflecting", identified, X, "error_median")
        columns[f"x_{short}_identified_refused"] = ("deflecting", identified, X, "failed")
    sets = pick(study.findings, "deflecting", "touch-up weighted", OFFSET)
    rows: list[dict[str, float]] = [{"d_deg": f.d_w_deg, "c_g": f.c_g} for f in sets]
    for title, (truth, estimator, quantity, attribute) in columns.items():
        for row, found in zip(rows, pick(study.findings, truth, estimator, quantity), strict=True):
            value = getattr(found, attribute)
            row[title] = value if value == value else None  # NaN has no place in JSON
    return rows


def main() -> None:
    """Run, print, and write table, figure and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, help="noise draws for each pose set")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    study = run(arguments.draws)
    write_study(study, arguments.out)
    figures = key_figures(study)
    (arguments.out / "expected.json").write_text(json.dumps(figures, indent=1) + "\n")
    print_table("Accuracy against condition number", accuracy_rows(study))
    print_table("Key figures", figures)


if __name__ == "__main__":
    main()
