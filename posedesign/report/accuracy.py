"""The accuracy study for people: its figure, and a table with a row for each pose set."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.identification import DISPLAY
from calib.robot_world import PAPER_METHODS
from posedesign.files import StrPath, write_bytes_atomic
from posedesign.report.answer import Answer, Table
from posedesign.report.figures import COLOURS, GREY, MARKS, plain_numbers
from posedesign.simulation import IDENTIFIED_ARM, AccuracyStudy, Finding, pick

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ESTIMATORS = ("touch-up weighted", "touch-up unweighted", "view line")


def draw_accuracy(study: AccuracyStudy, path: StrPath) -> Path:
    """Draw the study into a PNG file; see :func:`accuracy_figure`."""
    figure = accuracy_figure(study.findings, study.plan.model.robot.name)
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return write_bytes_atomic(path, data.getvalue())


def accuracy_figure(findings: Sequence[Finding], arm: str) -> Figure:
    """Scatter, plate test, and X of every AX=ZB solver, from the findings of a study of an arm.

    The C_G axis runs from poor sets on the left to good ones on the right. The parameter whose
    scatter is shown is the first that has a prediction; the truth is that of the first finding.
    """
    from matplotlib.figure import Figure

    # built without pyplot: no global state, no window system
    figure = Figure(figsize=(11.0, 9.6), dpi=120, layout="constrained")
    panels = figure.subplots(2, 2)
    _scatter(panels[0, 0], findings)
    _plate(panels[0, 1], findings)
    _robot_world(panels[1, 0], findings, "X rotation", "deg")
    _robot_world(panels[1, 1], findings, "X translation", "mm")
    for panel in panels.flat:
        panel.set_xlabel("condition number C_G (Eq. 9-12); better poses to the right")
        if not panel.lines:  # a logarithmic axis cannot be drawn without data
            panel.text(0.5, 0.5, "no data: see the notes", ha="center", transform=panel.transAxes)
            continue
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.invert_xaxis()
        plain_numbers(panel)
        panel.grid(True, which="both", alpha=0.25)
    draws = f"{findings[0].draws} noise draws for each pose set"
    title = f"Accuracy against condition number: {arm}, {draws}"
    figure.suptitle(title, parse_math=False)  # a name from a file may hold anything
    return figure


def _scatter(panel: Axes, findings: Sequence[Finding]) -> None:
    """Scatter of one parameter over the draws with its interval, and the prediction as a line."""
    leading = next(f for f in findings if np.isfinite(f.predicted_sigma))
    for estimator, colour, marker in zip(ESTIMATORS, COLOURS, MARKS, strict=False):
        found = pick(findings, findings[0].truth, estimator, leading.quantity)
        if not found:
            continue
        c_g = [f.c_g for f in found]
        spread = np.array([f.spread for f in found])
        interval = [
            spread - [f.spread_low for f in found],
            [f.spread_high for f in found] - spread,
        ]
        marks = {"color": colour, "capsize": 2, **_drawn(marker)}
        panel.errorbar(c_g, spread, yerr=interval, fmt=marker, **marks)
        panel.plot(c_g, [f.predicted_sigma for f in found], "-", color=colour, lw=1)
    panel.set_ylabel(f"standard deviation of {leading.quantity} [{leading.unit}]")
    panel.set_title("Scatter, with its 95 % interval; lines: predicted beforehand", fontsize=10)
    _legend(panel, ESTIMATORS, COLOURS, (("predicted", "-"),))


def _plate(panel: Axes, findings: Sequence[Finding]) -> None:
    """Worst distance error on the plate: median over the draws."""
    estimators, colours = (*ESTIMATORS, "uncalibrated"), (*COLOURS[:3], GREY)
    styles = (("deflecting arm", "-"), ("rigid arm", ":"))
    for estimator, colour, marker in zip(estimators, colours, MARKS[:4], strict=True):
        for truth, style in styles:
            found = pick(findings, truth.split()[0], estimator, "plate distance worst")
            _line(panel, found, style, colour, marker)
    panel.set_ylabel("worst distance error on the plate [mm]")
    panel.set_title("5 x 5 plate, 100 mm pitch: worst distance error, median", fontsize=10)
    _legend(panel, estimators, colours, styles)


def _robot_world(panel: Axes, findings: Sequence[Finding], quantity: str, unit: str) -> None:
    """Median error of every solver, with the controller's arm and with the identified one."""
    styles = (("A from the controller", "-"), ("A from the identified arm", ":"))
    refused = []
    # none of the colours of the estimators, which the panels above have
    colours = ("black", COLOURS[3], COLOURS[4], COLOURS[5])
    for solver, colour, marker in zip(PAPER_METHODS, colours, MARKS[:4], strict=True):
        for suffix, (words, style) in zip(("", IDENTIFIED_ARM), styles, strict=True):
            found = pick(findings, findings[0].truth, solver + suffix, quantity)
            missing = len(found) - _line(panel, found, style, colour, marker)
            if missing:
                refused.append(f"{solver}, {words}: {missing} of {len(found)} sets")
    if refused:
        said = "not drawn, since most draws are refused:\n" + "\n".join(refused)
        panel.text(0.02, 0.02, said, fontsize=7, transform=panel.transAxes)
    panel.set_ylabel(f"error of {quantity} [{unit}]")
    panel.set_title(f"AX = ZB: {quantity} of the camera on the flange, median", fontsize=10)
    _legend(panel, PAPER_METHODS, colours, styles)


def _line(panel: Axes, found: list[Finding], style: str, colour: str, marker: str) -> int:
    """Draw median errors against C_G but for sets in which most draws failed: how many it drew."""
    good = [f for f in found if f.failed < f.draws / 2]
    c_g, error = [f.c_g for f in good], [f.error_median for f in good]
    if good:
        panel.plot(c_g, error, style + marker, color=colour, lw=1.2, **_drawn(marker))
    return len(good)


def _drawn(marker: str) -> dict[str, Any]:
    """How a mark is drawn: the third is hollow and large, to be seen under others."""
    return {"mfc": "none", "ms": 7} if marker == MARKS[2] else {"ms": 4}


def _legend(
    panel: Axes,
    names: Sequence[str],
    colours: Sequence[str],
    styles: Sequence[tuple[str, str]],
) -> None:
    """Colours for what was compared, line styles for the conditions, below the panel."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, marker=marker, lw=0, label=name, **_drawn(marker))
        for name, colour, marker in zip(names, colours, MARKS, strict=False)
    ]
    handles += [Line2D([], [], color=GREY, ls=style, label=name) for name, style in styles]
    panel.legend(
        handles=handles, fontsize=8, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.12)
    )


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
