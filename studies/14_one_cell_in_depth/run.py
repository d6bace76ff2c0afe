"""Run the study: ``posedesign study run one_cell_in_depth``."""

from __future__ import annotations

from pathlib import Path

from posedesign.cell import Cell, cell_template
from posedesign.report.accuracy import accuracy_figure
from posedesign.simulation import IDENTIFIED_ARM, AccuracyStudy, Finding, accuracy_study, pick
from posedesign.study import Advance, Options
from studies import writing
from studies.writing import save, write_figures, write_rows

SETTINGS = writing.settings_of(__file__)
TABLE = "one_cell_in_depth.csv"
OFFSET = "zero_offset.joint_2"
PLATE = "plate distance worst"
X = "X translation"


def run(draws: int | None = None, advance: Advance | None = None) -> AccuracyStudy:
    """The study as its TOML describes it, with fewer draws where asked for."""
    cell = Cell.from_text(cell_template(SETTINGS["robot"], surroundings=False))
    return accuracy_study(
        cell, draws=draws or SETTINGS["draws"], seed=SETTINGS["seed"], progress=advance
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


def study(options: Options) -> list[dict[str, float]]:
    """What does a lower condition number buy on one cell? A trial is one draw of the noise."""
    done = run(options.trials, options.advance)
    write_rows(options.out, TABLE, [finding.__dict__ for finding in done.findings])
    figures = key_figures(done)
    write_figures(options.out, figures)
    return figures


def plot(folder: Path) -> list[Path]:
    """Draw what the table of a folder says."""
    import pandas as pd

    rows = pd.read_csv(folder / TABLE).to_dict("records")
    findings = [Finding(**{str(k): v for k, v in row.items()}) for row in rows]
    return save(accuracy_figure(findings, SETTINGS["robot"]), folder, "one_cell_in_depth")
