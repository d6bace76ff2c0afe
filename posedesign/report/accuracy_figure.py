"""The figure of the accuracy study: what a lower condition number buys."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from posedesign.accuracy_study import SOLVERS, AccuracyStudy, Finding, select
from posedesign.files import write_bytes_atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Okabe and Ito's palette: told apart by people who do not see red and green alike."""

MARKERS = ("o", "s", "^", "D")

ESTIMATORS = ("touch-up weighted", "touch-up unweighted", "view line")


def draw_accuracy(study: AccuracyStudy, path: Path) -> Path:
    """Draw the study into a PNG file: scatter, plate test, and X of every AX=ZB solver.

    The C_G axis runs from poor sets on the left to good ones on the right.
    """
    import matplotlib.figure

    # built without pyplot: no global state, no window system
    figure = matplotlib.figure.Figure(figsize=(11.0, 8.2), dpi=130, layout="constrained")
    panels = figure.subplots(2, 2)
    offset = next(f.quantity for f in study.findings if f.quantity.startswith("zero_offset"))
    _scatter(panels[0, 0], study, offset)
    _plate(panels[0, 1], study)
    _robot_world(panels[1, 0], study, "X rotation", "deg")
    _robot_world(panels[1, 1], study, "X translation", "mm")
    for panel in panels.flat:
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.invert_xaxis()
        panel.set_xlabel("condition number C_G (Eq. 9-12), better to the right")
        panel.grid(True, which="both", alpha=0.25)
        panel.legend(fontsize=8)
    figure.suptitle(
        f"Accuracy against condition number: {study.plan.model.robot.name}, {study.draws} noise "
        "draws for each pose set",
        fontsize=12,
    )
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return write_bytes_atomic(path, data.getvalue())


def _scatter(panel: Axes, study: AccuracyStudy, quantity: str) -> None:
    """Scatter of one offset over the draws with its interval, and the prediction as a line."""
    for estimator, colour, marker in zip(ESTIMATORS, COLOURS, MARKERS, strict=False):
        found = select(study.findings, _truth(study), estimator, quantity)
        if not found:
            continue
        c_g = [f.c_g for f in found]
        spread = np.array([f.spread for f in found])
        interval = [
            spread - [f.spread_low for f in found],
            [f.spread_high for f in found] - spread,
        ]
        panel.errorbar(
            c_g, spread, yerr=interval, fmt=marker, color=colour, capsize=2, ms=4, label=estimator
        )
        panel.plot(c_g, [f.predicted_sigma for f in found], "-", color=colour, lw=1)
    joint = quantity.partition(".")[2]
    panel.set_ylabel(f"standard deviation of the {joint} offset [deg]")
    panel.set_title("Scatter (95 % interval); lines: predicted from the covariance", fontsize=10)


def _plate(panel: Axes, study: AccuracyStudy) -> None:
    """Worst distance error on the plate: median over the draws."""
    for estimator, colour, marker in zip(
        ("uncalibrated", *ESTIMATORS), ("#555555", *COLOURS), ("x", *MARKERS), strict=False
    ):
        for truth, style in (("deflecting", "-"), ("rigid", ":")):
            found = select(study.findings, truth, estimator, "plate distance worst")
            if found:
                panel.plot(
                    [f.c_g for f in found],
                    [f.error_median for f in found],
                    style + marker,
                    color=colour,
                    ms=4,
                    lw=1.2,
                    label=f"{estimator}, {truth}",
                )
    panel.set_ylabel("worst distance error on the plate [mm]")
    panel.set_title("5 x 5 plate, 100 mm pitch: median of the worst error", fontsize=10)


def _robot_world(panel: Axes, study: AccuracyStudy, quantity: str, unit: str) -> None:
    """Error of every solver: median, and a bar up to the 95th percentile."""
    for solver, colour, marker in zip(SOLVERS, COLOURS, MARKERS, strict=True):
        found = [
            f
            for f in select(study.findings, _truth(study), solver, quantity)
            if np.isfinite(f.error_median)
        ]
        if not found:
            continue
        median = np.array([f.error_median for f in found])
        above = np.array([f.error_p95 for f in found]) - median
        panel.errorbar(
            [f.c_g for f in found],
            median,
            yerr=[np.zeros(len(found)), above],
            fmt="-" + marker,
            color=colour,
            capsize=2,
            ms=4,
            lw=1,
            label=solver,
        )
    panel.set_ylabel(f"error of {quantity} [{unit}]")
    panel.set_title(f"AX = ZB, camera on flange: {quantity} (median, 95th percentile)", fontsize=10)


def _truth(study: AccuracyStudy) -> str:
    """The truth that the cell describes: the one studied first."""
    first: Finding = study.findings[0]
    return first.truth
