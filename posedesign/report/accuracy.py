"""The accuracy study for people: its figure, and a table with a row for each pose set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.identification import DISPLAY
from calib.robot_world import PAPER_METHODS
from posedesign.files import StrPath, write_bytes_atomic
from posedesign.report.answer import Answer, Table
from posedesign.report.drawing import STYLES, condition_axis, curve, label_ends, log_y, set_answer
from posedesign.report.figures import as_png
from posedesign.simulation import IDENTIFIED_ARM, AccuracyStudy, Finding, pick

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ESTIMATORS = ("touch-up weighted", "touch-up unweighted", "view line")
WORST = "plate distance worst"


def draw_accuracy(study: AccuracyStudy, path: StrPath) -> Path:
    """Draw the study into a PNG file; see :func:`accuracy_figure`."""
    figure = accuracy_figure(study.findings, study.plan.model.robot.name)
    return write_bytes_atomic(path, as_png(figure))


def accuracy_figure(findings: Sequence[Finding], arm: str) -> Figure:
    """Scatter, plate test, and X of every AX=ZB solver, from the findings of a study of an arm.

    Below, X stands by the arm of the controller, and by the one that was identified. The parameter
    whose scatter is shown is the first that has a prediction; the truth is that of the first
    finding. A solver that refuses most of its data is named where its line is missing.
    """
    from matplotlib.figure import Figure

    # built without pyplot: no global state, no window system
    figure = Figure(figsize=(11.0, 7.6), dpi=120, layout="constrained")
    drawers: tuple[Callable[[Axes], None], ...] = (
        lambda panel: _scatter(panel, findings),
        lambda panel: _plate(panel, findings),
        lambda panel: _robot_world(panel, findings, "", BY_CONTROLLER),
        lambda panel: _robot_world(panel, findings, IDENTIFIED_ARM, "A by the identified arm"),
    )
    trial = list(Figure().subplots(2, 2).flat)
    for draw, panel in zip(drawers, trial, strict=True):
        draw(panel)
    # a panel without data would be empty, and its logarithmic axis cannot be drawn
    filled = [draw for draw, panel in zip(drawers, trial, strict=True) if panel.lines]
    drawn = _panels_for(figure, len(filled))
    for draw, panel in zip(filled, drawn, strict=True):
        draw(panel)
    if len(filled) == len(drawers):
        drawn[3].sharey(drawn[2])
    for panel in drawn:
        condition_axis(panel)
        log_y(panel, panel.get_ylabel())
    for panel in drawn:
        label_ends(panel)
    note = f"{findings[0].draws} draws of the noise for each pose set"
    set_answer(figure, f"{arm}: {_answer_of_figure(findings)}", note)
    return figure


BY_CONTROLLER = "A as the controller computes it"


def _panels_for(figure: Figure, count: int) -> list[Axes]:
    """Panels in two columns; an odd one is as wide as both."""
    places = "ABCD"[:count]
    rows = [places[k : k + 2] for k in range(0, count, 2)]
    if count > 1 and count % 2:
        rows[-1] *= 2
    panels = figure.subplot_mosaic("\n".join(rows))
    return [panels[place] for place in places]


def _leading(findings: Sequence[Finding]) -> str:
    return next(f.quantity for f in findings if np.isfinite(f.predicted_sigma))


def _answer_of_figure(findings: Sequence[Finding]) -> str:
    """What the figure tells: scatter and plate error at the largest and at the smallest C_G."""
    truth, quantity = findings[0].truth, _leading(findings)
    (estimator, scatter), *_ = _found(findings, truth, ESTIMATORS, quantity)
    first, last = scatter[0], scatter[-1]
    said = (
        f"from C_G {first.c_g:.2g} to {last.c_g:.2g} the standard "
        f"deviation of {quantity} goes from "
        f"{first.spread:.2g} to {last.spread:.2g} {first.unit}"
    )
    plate = pick(findings, truth, estimator, WORST)
    if plate:
        best = min(plate, key=lambda f: f.error_median)
        said += (
            f", the plate's worst error from {plate[0].error_median:.2g} to "
            f"{plate[-1].error_median:.2g} {best.unit}; it is least, {best.error_median:.2g} "
            f"{best.unit}, at C_G {best.c_g:.2g}"
        )
    return said


def _found(
    findings: Sequence[Finding], truth: str, estimators: Sequence[str], quantity: str
) -> list[tuple[str, list[Finding]]]:
    """Findings of each estimator that has any."""
    every = ((name, pick(findings, truth, name, quantity)) for name in estimators)
    return [(name, found) for name, found in every if found]


def _scatter(panel: Axes, findings: Sequence[Finding]) -> None:
    """Scatter of one parameter over the draws with its interval, and the prediction as a line."""
    quantity = _leading(findings)
    for name, found in _found(findings, findings[0].truth, ESTIMATORS, quantity):
        style, c_g = STYLES[name], [f.c_g for f in found]
        ends = [f.spread_low for f in found], [f.spread_high for f in found]
        curve(panel, c_g, [f.spread for f in found], style._replace(line=""), name, ends=ends)
        panel.plot(c_g, [f.predicted_sigma for f in found], style.line, color=style.colour, lw=1.3)
        panel.set_ylabel(f"standard deviation of {quantity}\n[{found[0].unit}]")
    panel.set_title(
        "standard deviation with its 95 % interval; lines: predicted beforehand", fontsize=9
    )


def _plate(panel: Axes, findings: Sequence[Finding]) -> None:
    """Worst distance error on the plate before and after: median, and what 95 % stay below."""
    for truth, line in (("deflecting", "-"), ("rigid", ":")):
        after = _found(findings, truth, ESTIMATORS, WORST)[:1]
        before = _found(findings, truth, ("uncalibrated",), WORST)
        for name, found in after + before:
            label = f"{'calibrated' if name in ESTIMATORS else name}, {truth} arm"
            style = STYLES[name]._replace(line=line)
            errors = [f.error_median for f in found]
            ends = (errors, [f.error_p95 for f in found]) if name in ESTIMATORS else None
            curve(panel, [f.c_g for f in found], errors, style, label, ends=ends)
            by = f" by {after[0][0]}" if after else ""
            panel.set_title(f"5 x 5 plate{by}: median, bars to the 95 % quantile", fontsize=9)
    panel.set_ylabel("worst distance error on the plate\n[mm]")


def _robot_world(panel: Axes, findings: Sequence[Finding], suffix: str, title: str) -> None:
    """Median error of X by every solver, but for sets in which most draws were refused."""
    refused = []
    for solver in PAPER_METHODS:
        found = pick(findings, findings[0].truth, solver + suffix, "X translation")
        good = [f for f in found if f.failed < f.draws / 2]
        if good:
            c_g, errors = [f.c_g for f in good], [f.error_median for f in good]
            curve(panel, c_g, errors, STYLES[solver], solver)
        if len(good) < len(found):
            refused.append(f"{solver} in {len(found) - len(good)} of {len(found)} sets")
    if refused:
        title += "\nnot drawn, for most draws are refused as misfits: " + ", ".join(refused)
    panel.set_ylabel("error of X, translation, median\n[mm]")
    panel.set_title(f"AX = ZB, camera on the flange: {title}", fontsize=9)


LEGEND = (
    "sd: standard deviation over the draws; plate: worst distance error on a 5 x 5 plate, median, "
    "before and after; X: translation error of AX = ZB, median; -: most answers refused as misfits"
)


def answer_of_study(study: AccuracyStudy, files: Sequence[str] = ()) -> Answer:
    """The answer of the study: what falls with the condition number."""
    rows = accuracy_rows(study)
    name, worst, best = study.leading_parameter, rows[0], rows[-1]

    def change(title: str) -> str:
        before, after = (row.get(title) for row in (worst, best))
        if not (isinstance(before, float) and isinstance(after, float)):
            return ""
        return f"{before:.3g} to {after:.3g} {title.rpartition('[')[2].rstrip(']')}"

    spread = next(title for title in rows[0] if " sd weighted " in title)
    return Answer(
        f"from C_G {worst['C_G']:.3g} to {best['C_G']:.3g}: the scatter of {name} goes from "
        f"{change(spread)}",
        {
            "plate": change("after [mm]")
            and f"worst distance error after calibration {change('after [mm]')}, before it "
            f"{worst['plate before [mm]']:.3g} mm",
            "draws": f"{study.draws} a pose set, {len(rows)} pose sets",
        },
        notes=study.notes,
        details=[LEGEND],
        tables=[Table(f"Accuracy against condition number ({study.draws} draws a pose set)", rows)],
        files=files,
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
