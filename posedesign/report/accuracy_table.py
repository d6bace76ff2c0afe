"""The accuracy study as a table for people: one row for each pose set."""

from __future__ import annotations

from posedesign.accuracy_study import SOLVERS, AccuracyStudy, Finding, select


def accuracy_rows(study: AccuracyStudy) -> list[dict[str, object]]:
    """Condition, scatter of the first offset, plate error and error of X, by falling C_G.

    Scatter and errors are those of the cell's own truth; degrees and millimetres.
    """
    truth = study.findings[0].truth
    offset = next(f.quantity for f in study.findings if f.quantity.startswith("zero_offset"))
    joint = offset.partition(".")[2]

    def column(estimator: str, quantity: str) -> dict[float, Finding]:
        return {f.c_g: f for f in select(study.findings, truth, estimator, quantity)}

    weighted = column("touch-up weighted", offset)
    unweighted = column("touch-up unweighted", offset)
    line = column("view line", offset)
    before = column("uncalibrated", "plate distance worst")
    after = column("touch-up weighted", "plate distance worst")
    solvers = {solver: column(solver, "X translation") for solver in SOLVERS}
    rows: list[dict[str, object]] = []
    for c_g, found in weighted.items():
        row: dict[str, object] = {
            "D [deg]": "/".join(f"{d:g}" for d in (found.d_w_deg, found.d_p_deg, found.d_r_deg)),
            "C_G": c_g,
            f"{joint}: predicted": found.predicted_sigma,
            "scatter": found.spread,
            "unweighted": unweighted[c_g].spread if c_g in unweighted else None,
            "view line": line[c_g].spread if c_g in line else None,
            "plate before [mm]": before[c_g].error_median if c_g in before else None,
            "after": after[c_g].error_median if c_g in after else None,
        }
        for solver, values in solvers.items():
            row[f"X {solver} [mm]"] = values[c_g].error_median if c_g in values else None
        rows.append(row)
    return rows
