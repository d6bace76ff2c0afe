"""Figures of the study, from its two tables."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pandas as pd
from condition_trials import TOOL
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#000000")
"""Okabe and Ito's palette: told apart by people who do not see red and green alike."""

_X_LABEL = "condition number C_G; better poses to the right"

MARKERS = ("o", "s", "^", "D", "v", "x")


def draw_identification(rows: pd.DataFrame) -> Figure:
    """Spread of the offset and error of the tool point against C_G, a colour for each arm."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.6), layout="constrained")
    for (preset, part), colour, marker in zip(
        rows.groupby("preset", sort=False), COLOURS, MARKERS, strict=False
    ):
        c_g = part["c_g"]
        left.plot(c_g, part["predicted_deg"], "-", color=colour, lw=1)
        interval = [
            part["spread_deg"] - part["spread_low_deg"],
            part["spread_high_deg"] - part["spread_deg"],
        ]
        left.errorbar(
            c_g,
            part["spread_deg"],
            yerr=interval,
            fmt=marker,
            color=colour,
            ms=4,
            capsize=2,
            label=preset,
        )
        right.fill_between(
            c_g, part[f"{TOOL} p5"], part[f"{TOOL} p95"], color=colour, alpha=0.15, lw=0
        )
        right.plot(c_g, part[TOOL], marker=marker, color=colour, ms=4, lw=1, label=preset)
    left.set_ylabel("standard deviation of the J2 offset [deg]")
    left.set_title("Spread with its 95 % interval; lines: predicted", fontsize=10)
    right.set_ylabel("rms error of the tool point elsewhere [mm]")
    right.set_title("Median and 5 to 95 % of the trials", fontsize=10)
    for panel in (left, right):
        _logarithmic(panel)
        panel.invert_xaxis()
        panel.set_xlabel(_X_LABEL)
        panel.legend(fontsize=8)
    return figure


def draw_solvers(rows: pd.DataFrame, solvers: Sequence[str]) -> Figure:
    """Error of X against C_G, a panel for each arm, a colour for each solver."""
    presets = list(dict.fromkeys(rows["preset"]))
    figure, axes = plt.subplots(
        2,
        len(presets),
        figsize=(3.1 * len(presets), 6.2),
        layout="constrained",
        sharex="col",
        squeeze=False,
    )
    for column, preset in enumerate(presets):
        part = rows[rows["preset"] == preset]
        for panel, quantity, unit in (
            (axes[0, column], "x_mm", "mm"),
            (axes[1, column], "x_deg", "deg"),
        ):
            for solver, colour, marker in zip(solvers, COLOURS, MARKERS, strict=False):
                name = f"{quantity} {solver}"
                values = part[name].to_numpy(dtype=float)
                if solver == "ml":
                    band = (part[f"{name} p5"].to_numpy(float), part[f"{name} p95"].to_numpy(float))
                    panel.fill_between(part["c_g"], *band, color=colour, alpha=0.15, lw=0)
                size = 7 if solver == "dornaika-horaud" else 4
                face = "none" if solver == "dornaika-horaud" else colour  # seen under Hirsh's
                panel.plot(
                    part["c_g"],
                    values,
                    marker=marker,
                    ms=size,
                    mfc=face,
                    color=colour,
                    lw=1,
                    label=solver,
                )
            if column == 0:
                what = "translation" if unit == "mm" else "rotation"
                panel.set_ylabel(f"error of X, {what} [{unit}]")
        axes[0, column].set_title(preset, fontsize=10)
    for panel in axes.flat:
        _logarithmic(panel)
        panel.set_xlim(*sorted(panel.get_xlim(), reverse=True))
    figure.supxlabel(_X_LABEL, fontsize=10)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=6, fontsize=8)
    return figure


def _logarithmic(panel: Axes) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_minor_formatter(NullFormatter())  # none is shown, and all would be laid out
    panel.grid(True, which="major", alpha=0.3)
