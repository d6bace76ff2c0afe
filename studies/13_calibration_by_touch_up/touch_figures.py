"""The figures of the study: variation (9 and 10 of the paper) and plate (11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from touch_plate import DISTANCES

from studies.drawing import BLUE, GREEN, GREY, PURPLE, VERMILION

STYLES = {
    "touch-up": (BLUE, "o"),
    "touch-up, weighted": (VERMILION, "s"),
    "view line": (GREEN, "^"),
    "touch-up, size left out": (PURPLE, "D"),
}
"""Colour and marker of each estimator: told apart without colours, too."""

PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
"""Numbers on an axis as people write them."""

ASIDE = 1.06
"""Factor by which marks at one C_G are moved aside."""

PANELS = (
    ("touch-up (Figure 9)", ("touch-up", "touch-up, weighted")),
    ("view line only (Figure 10)", ("view line", "touch-up, size left out")),
)


def draw_variation(rows: Sequence[Mapping[str, Any]], ten: Sequence[Mapping[str, Any]]) -> Figure:
    """Offsets of ten data sets about their mean, and their standard deviations, against C_G."""
    figure = Figure(figsize=(12.0, 8.4), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, (title, names) in enumerate(PANELS):
        above, below = axes[0, column], axes[1, column]
        above.set_title(title, fontsize=11)
        for k, name in enumerate(names):
            colour, mark = STYLES[name]
            aside = ASIDE if k else 1.0 / ASIDE
            own = [row for row in ten if row["estimator"] == name]
            x = [aside * row["c_g"] for row in own]
            above.plot(
                x, [row["about_mean_deg"] for row in own], mark, color=colour, ms=4, mfc="none"
            )
            _deviation(below, [row for row in rows if row["estimator"] == name], name, aside)
        above.axhline(0.0, color=GREY, lw=0.8)
        above.set_yscale("symlog", linthresh=0.01)
        above.grid(True, which="both", alpha=0.25)
        below.set_xlabel("condition number C_G of the pose set, 27 poses each")
    paper = [row for row in rows if row["estimator"] == "touch-up"]
    x, y = ([row[key] for row in paper] for key in ("c_g", "many_std_deg"))
    axes[1, 1].plot(x, y, color=BLUE, lw=1.2, ls="--", label="touch-up, from the left")
    axes[0, 0].set_ylabel("offset of joint 2, ten data sets, about their mean [deg]")
    axes[1, 0].set_ylabel("standard deviation of the offset of joint 2 [deg]")
    axes[1, 0].set_xscale("log")
    axes[1, 0].set_yscale("log")
    axes[1, 0].plot(
        [], [], color=GREY, lw=6, alpha=0.3, label=f"{rows[0]['data_sets']} data sets, 95 %"
    )
    axes[1, 0].plot([], [], color=GREY, ls=":", lw=1.3, label="predicted from the noise")
    for panel in axes[1]:
        panel.legend(fontsize=8, loc="upper left")
    axes[1, 0].yaxis.set_major_formatter(PLAIN)
    axes[0, 0].yaxis.set_major_formatter(PLAIN)
    return figure


def _deviation(panel: Axes, rows: Sequence[Mapping[str, Any]], name: str, aside: float) -> None:
    colour, mark = STYLES[name]
    x = np.array([row["c_g"] for row in rows])
    low, middle, high = (
        np.array([row[f"ten_{key}_deg"] for row in rows]) for key in ("low", "std", "high")
    )
    panel.errorbar(
        aside * x,
        middle,
        [middle - low, high - middle],
        fmt=mark,
        color=colour,
        ms=5,
        lw=1,
        capsize=2,
        label=f"{name}, ten data sets, 95 %",
    )
    ends = [[row[f"many_{key}_deg"] for row in rows] for key in ("low", "high")]
    panel.fill_between(x, *ends, color=colour, alpha=0.3, lw=0)
    panel.plot(x, [row["predicted_deg"] for row in rows], color=colour, ls=":", lw=1.3)
    panel.grid(True, which="both", alpha=0.25)


def draw_plate(arms: Mapping[str, Any], robots: Mapping[str, Any], estimator: str) -> Figure:
    """Worst distance errors of the arms shown, and of many arms in parts of those before."""
    figure = Figure(figsize=(15.0, 5.0), layout="constrained")
    left, middle, right = figure.subplots(1, 3, sharex=True)
    left.sharey(middle)
    for panel, (arm, part) in zip((left, middle), arms.items(), strict=True):
        _distances(panel, part["plate"], estimator)
        panel.set_title(f"{arm} arm, {estimator}", fontsize=11)
        panel.set_ylabel("worst error of a distance on the plate [mm]")
    for name in (key for key in robots if key in STYLES):
        colour, mark = STYLES[name]
        rows = robots[name]["rows"]
        x = [row["c_g"] for row in rows]
        ends = [[row[f"ratio_{key}"] for row in rows] for key in ("low", "high")]
        right.fill_between(x, *ends, color=colour, alpha=0.2, lw=0)
        median = [row["ratio"] for row in rows]
        right.plot(x, median, mark, ls="-", color=colour, label=f"{name}: median, 80 % of arms")
    right.axhline(0.5, color=GREY, ls="--", lw=1.2, label="half")
    right.set_title(f"{robots['count']} arms drawn at random, deflecting", fontsize=11)
    right.set_ylabel("worst error of a distance, after over before")
    for panel in (left, middle, right):
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlabel("condition number C_G of the pose set")
        panel.grid(True, which="both", alpha=0.25)
        panel.yaxis.set_major_formatter(PLAIN)
        panel.yaxis.set_minor_formatter(NullFormatter())
    left.legend(fontsize=8, ncols=2, loc="upper center")
    right.legend(fontsize=8)
    left.set_ylim(top=2.0)
    return figure


def _distances(panel: Axes, plate: Mapping[str, Any], estimator: str) -> None:
    rows = [row for row in plate["rows"] if row["estimator"] == estimator]
    x = [row["c_g"] for row in rows]
    for d, colour, mark in zip(DISTANCES, (BLUE, VERMILION, GREEN, PURPLE), "osv^", strict=True):
        ends = [[row[f"d{d}_{key}_mm"] for row in rows] for key in ("low", "high")]
        panel.fill_between(x, *ends, color=colour, alpha=0.2, lw=0)
        middle = [row[f"d{d}_mm"] for row in rows]
        panel.plot(x, middle, mark, ls="-", color=colour, ms=4, label=f"d = {d} mm, after")
        panel.axhline(plate["before"][f"d{d}_mm"], color=colour, ls="--", lw=1.1)
    panel.plot([], [], color=GREY, ls="--", lw=1.1, label="before")
