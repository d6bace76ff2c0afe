"""The figure of the study: the error over the box of each way to measure, and its time."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

TITLES = {"r2000ic165f": "R-2000iC/165F", "ur10e": "UR10e"}
RIGID, PREDICTED, DEFLECTING = "#0072B2", "#000000", "#D55E00"


def draw(arms: dict[str, Any]) -> Figure:
    """Root mean square over box and trials, a line for each variant, a panel for each arm."""
    first = next(iter(arms.values()))["rows"]
    places = list(range(len(first)))[::-1]
    figure = Figure(figsize=(12.5, 0.27 * len(first) + 1.8), layout="constrained")
    panels = figure.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    for panel, (arm, part) in zip(panels, arms.items(), strict=True):
        for place, row in zip(places, part["rows"], strict=True):
            colour = "#eeeeee" if place % 2 else "#ffffff"
            panel.axhspan(place - 0.5, place + 0.5, color=colour, lw=0)
            interval = [row["rms_low_mm"], row["rms_high_mm"]]
            panel.plot(interval, [place, place], color=RIGID, lw=4, alpha=0.5)
            panel.plot(row["rms_mm"], place, "o", color=RIGID, ms=6)
            panel.plot(row["predicted_rms_mm"], place, "|", color=PREDICTED, ms=11, mew=1.5)
            if "deflecting_rms_mm" in row:
                bent = [row["deflecting_rms_low_mm"], row["deflecting_rms_high_mm"]]
                panel.plot(bent, [place, place], color=DEFLECTING, lw=4, alpha=0.5)
                panel.plot(row["deflecting_rms_mm"], place, "x", color=DEFLECTING, ms=6)
            panel.annotate(
                f"{row['minutes']:.0f} min",
                (1.01, place),
                xycoords=("axes fraction", "data"),
                fontsize=8,
                va="center",
            )
        for name, colour in (("rigid", RIGID), ("deflecting", DEFLECTING)):
            if f"{name}_mm" in part["before"]:
                panel.axvline(part["before"][f"{name}_mm"], color=colour, ls=":", lw=1.2)
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.grid(True, axis="x", which="both", alpha=0.3)
        panel.set_title(TITLES.get(arm, arm), fontsize=11)
        panel.set_xlabel("error of the tool point over the box, rms [mm]")
        panel.set_ylim(-0.6, len(first) - 0.4)
    panels[0].set_yticks(places, [row["says"] for row in first], fontsize=9)
    panels[0].plot([], [], "o-", color=RIGID, lw=4, alpha=0.7, label="simulated, 95 % interval")
    panels[0].plot([], [], "|", color=PREDICTED, ms=11, mew=1.5, ls="", label="predicted")
    panels[0].plot(
        [], [], "x-", color=DEFLECTING, lw=4, alpha=0.7, label="arm that deflects, 95 % interval"
    )
    panels[0].plot([], [], ":", color="#555555", label="before calibration")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure
