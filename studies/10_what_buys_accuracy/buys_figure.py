"""The figure of the study: the error over the box of each way to measure, and its time."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from studies.drawing import BLACK, BLUE, VERMILION

TITLES = {"r2000ic165f": "R-2000iC/165F", "ur10e": "UR10e"}
RIGID, PREDICTED, DEFLECTING = BLUE, BLACK, VERMILION


def draw(arms: dict[str, Any]) -> Figure:
    """Root mean square over box and trials, a line for each variant, a panel for each arm."""
    first = next(iter(arms.values()))["rows"]
    places = list(range(len(first)))[::-1]
    figure = Figure(figsize=(12.5, 0.27 * len(first) + 1.8), layout="constrained")
    panels = figure.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    for panel, (arm, part) in zip(panels, arms.items(), strict=True):
        for place in places[::2]:
            panel.axhspan(place - 0.5, place + 0.5, color="#eeeeee", lw=0)
        columns = {key: [row.get(key) for row in part["rows"]] for key in part["rows"][0]}
        _intervals(panel, places, columns, "rms", RIGID, "o")
        panel.plot(columns["predicted_rms_mm"], places, "|", color=PREDICTED, ms=11, mew=1.5)
        if "deflecting_rms_mm" in columns:
            _intervals(panel, places, columns, "deflecting_rms", DEFLECTING, "x")
        for place, minutes in zip(places, columns["minutes"], strict=True):
            panel.annotate(
                f"{minutes:.0f} min",
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


def _intervals(
    panel: Axes,
    places: list[int],
    columns: dict[str, list[float]],
    name: str,
    colour: str,
    mark: str,
) -> None:
    """What was simulated, with its 95 % interval."""
    low, high = columns[f"{name}_low_mm"], columns[f"{name}_high_mm"]
    panel.hlines(places, low, high, color=colour, lw=6, alpha=0.4)
    panel.plot(columns[f"{name}_mm"], places, mark, color=colour, ms=3.5)
