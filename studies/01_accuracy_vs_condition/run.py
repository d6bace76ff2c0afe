"""Run the study: python studies/01_accuracy_vs_condition/run.py [--draws N] [--out DIR]."""

from __future__ import annotations

import argparse
import json
import tomllib
from pathlib import Path

from posedesign.accuracy_study import AccuracyStudy, accuracy_study, select
from posedesign.cell import Cell
from posedesign.cli.output import print_table, progress
from posedesign.report.accuracy_table import accuracy_rows
from posedesign.template import cell_template
from posedesign.workflow import write_study

HERE = Path(__file__).parent
OFFSET = "zero_offset.joint_2"
PLATE = "plate distance worst"


def run(draws: int | None = None) -> AccuracyStudy:
    """The study as its TOML describes it, with fewer draws where asked for."""
    settings = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
    cell = Cell.from_text(cell_template(settings["robot"]))
    with progress("accuracy against condition") as advance:
        return accuracy_study(
            cell, draws=draws or settings["draws"], seed=settings["seed"], progress=advance
        )


def key_figures(study: AccuracyStudy) -> list[dict[str, float]]:
    """What the answer rests on, a row for each pose set; degrees and millimetres."""
    rows = []
    for found in select(study.findings, "rigid", "touch-up weighted", OFFSET):
        row = {"d_deg": found.d_w_deg, "c_g": found.c_g, "scatter_deg": found.spread}

        def median(truth: str, estimator: str, quantity: str, c_g: float = found.c_g) -> float:
            return next(
                f.error_median
                for f in select(study.findings, truth, estimator, quantity)
                if f.c_g == c_g
            )

        row["plate_before_mm"] = median("deflecting", "uncalibrated", PLATE)
        row["plate_after_mm"] = median("deflecting", "touch-up weighted", PLATE)
        row["plate_after_rigid_mm"] = median("rigid", "touch-up weighted", PLATE)
        row["x_translation_mm"] = median("deflecting", "hirsh", "X translation")
        row["x_translation_identified_mm"] = median(
            "deflecting", "hirsh, identified arm", "X translation"
        )
        rows.append(row)
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
