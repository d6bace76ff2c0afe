"""The accuracy study as a table for people: one row for each pose set."""

from __future__ import annotations

from calib.identification import DISPLAY
from calib.robot_world import PAPER_METHODS
from posedesign.simulation import AccuracyStudy, Finding, pick

LEGEND = (
    "sd: standard deviation over the draws; plate: worst distance error on a 5 x 5 plate, median, "
    "before and after; X: translation error of AX = ZB, median; -: most answers refused as misfits"
)


def accuracy_rows(study: AccuracyStudy) -> list[dict[str, object]]:
    """Condition, scatter of the first parameter, plate error and error of X, by falling C_G.

    Scatter and errors are those of the cell's own truth; degrees and millimetres.
    """
    name, unit = study.leading_parameter, DISPLAY[study.plan.model.units[0]][0]
    short = name.rpartition(".")[2]

    def column(estimator: str, quantity: str) -> dict[float, Finding]:
        return {f.c_g: f for f in pick(study.findings, study.truth, estimator, quantity)}

    columns = {
        f"{short} sd weighted [{unit}]": (column("touch-up weighted", name), "spread"),
        f"sd unweighted [{unit}]": (column("touch-up unweighted", name), "spread"),
        f"sd view line [{unit}]": (column("view line", name), "spread"),
        "plate before [mm]": (column("uncalibrated", "plate distance worst"), "error_median"),
        "after [mm]": (column("touch-up weighted", "plate distance worst"), "error_median"),
        **{
            f"X {solver} [mm]": (column(solver, "X translation"), "error_median")
            for solver in PAPER_METHODS
        },
    }
    rows: list[dict[str, object]] = []
    for c_g, found in column("touch-up weighted", name).items():
        angles = dict.fromkeys((found.d_w_deg, found.d_p_deg, found.d_r_deg))
        row: dict[str, object] = {
            "D [deg]": "/".join(f"{d:g}" for d in angles),
            "C_G": c_g,
            f"predicted [{unit}]": found.predicted_sigma,
        }
        for title, (values, attribute) in columns.items():
            row[title] = getattr(values[c_g], attribute) if c_g in values else None
        rows.append(row)
    return rows
