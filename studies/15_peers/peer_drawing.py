"""Figures of the study: ratios of times, and what the answers are worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.drawing import BLACK, GREY, MARKS, log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rows = Sequence[Mapping[str, Any]]
HEIGHT = 0.3
"""Of a row [inches]."""

TICKS_MM = (0.3, 0.5, 1, 2, 3, 5)
APART = 0.22
"""Of the series in a row, whose height is one."""


def draw_times(times: Rows) -> Figure:
    """Their time over ours with the least and the largest of the turns, on logarithmic axes."""
    import matplotlib.pyplot as plt

    pairs = [r for r in times if r["job"] == "A X = Z B" and r["ours"] == "ml"]
    rest = [r for r in times if r["job"] != "A X = Z B"]
    names = [list(dict.fromkeys(r["peer"] for r in rows)) for rows in (pairs, rest)]
    heights = [len(each) for each in names]
    figure, axes = plt.subplots(
        2,
        1,
        figsize=(9.5, 2.0 + HEIGHT * sum(heights)),
        height_ratios=heights,
        layout="constrained",
    )
    sizes = list(dict.fromkeys(r["size"] for r in pairs))
    series = {f"{size:g} pairs": [r for r in pairs if r["size"] == size] for size in sizes}
    _intervals(axes[0], names[0], series, "peer", ("ratio", "ratio_low", "ratio_high"))
    axes[0].set_title("A X = Z B: time over that of the likeliest X and Z with their covariance")
    series = {r["job"]: [k for k in rest if k["job"] == r["job"]] for r in rest}
    _intervals(axes[1], names[1], series, "peer", ("ratio", "ratio_low", "ratio_high"))
    axes[1].set_title("time over that of identify, or of the exchange with its bound")
    for each in axes:
        each.set_xscale("log")
        each.axvline(1.0, color=BLACK, lw=1.0)
        each.set_xlabel("time over ours [-], median and range of the turns")
        each.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    return figure


def draw_accuracy(pairs: Rows, touch_ups: Rows, chosen: Rows) -> Figure:
    """Medians of errors with their 95 % intervals, and choices over the proven bound."""
    import matplotlib.pyplot as plt

    most = max(r["pairs"] for r in pairs)
    shown = [r for r in pairs if r["pairs"] == most]
    names = [
        list(dict.fromkeys(r[key] for r in rows))
        for rows, key in ((shown, "solver"), (touch_ups, "by"), (chosen, "by"))
    ]
    heights = [len(each) + 1 for each in names]
    figure, axes = plt.subplots(
        3,
        1,
        figsize=(9.5, 2.5 + HEIGHT * sum(heights)),
        height_ratios=heights,
        layout="constrained",
    )
    series = _by(shown, "setting")
    _intervals(axes[0], names[0], series, "solver", ("X_mm", "X_mm_low", "X_mm_high"))
    axes[0].set_title(f"A X = Z B from {most:g} pairs")
    axes[0].set_xlabel("X off [mm], median of the trials and its 95 % interval")
    columns = ("tool_error_mm", "tool_error_low_mm", "tool_error_high_mm")
    _intervals(axes[1], names[1], _by(touch_ups, "noise"), "by", columns)
    axes[1].set_title("ten parameters from touch-ups")
    axes[1].set_xlabel("tool point off in other postures [mm], median and its 95 % interval")
    for each in axes[:2]:
        log_ticks(each, TICKS_MM)
        each.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    rows = [r for r in chosen if isinstance(r["of_the_bound"], float)]
    values = [r["of_the_bound"] for r in rows]
    place = {name: len(names[2]) - 1 - k for k, name in enumerate(names[2])}
    axes[2].plot(
        values, [place[r["by"]] for r in rows], "o", color=MARKS[0][0], mfc="none", mew=1.5
    )
    axes[2].axvline(1.0, color=BLACK, lw=1.0)
    axes[2].set_yticks(list(place.values()), list(place))
    axes[2].set_title("choice of poses by D (line: more than any different poses have)")
    axes[2].set_xlabel("det(information)^(1/p) of a pose, over the proven bound [-]")
    axes[2].grid(visible=True, alpha=0.3)
    return figure


def _by(rows: Rows, key: str) -> dict[str, Rows]:
    names = dict.fromkeys(r[key] for r in rows)
    return {name: [r for r in rows if r[key] == name] for name in names}


def _intervals(
    axes: Axes,
    names: Sequence[str],
    series: Mapping[str, Rows],
    key: str,
    columns: tuple[str, str, str],
) -> None:
    """A row for each name, the first on top, with a mark and its interval for each series."""
    for k, ((label, rows), (colour, mark)) in enumerate(zip(series.items(), MARKS, strict=False)):
        shown = [r for r in rows if all(isinstance(r[column], float) for column in columns)]
        value, low, high = np.array([[r[c] for c in columns] for r in shown]).T
        at = [len(names) - 1 - names.index(r[key]) for r in shown]
        axes.errorbar(
            value,
            np.array(at) + APART * ((len(series) - 1) / 2.0 - k),
            xerr=[value - low, high - value],
            fmt=mark,
            color=colour,
            mfc="none",
            mew=1.5,
            ms=5,
            capsize=2.5,
            label=label,
        )
    axes.set_yticks(range(len(names)), names[::-1])
    axes.tick_params(axis="y", colors=GREY)
    axes.grid(visible=True, alpha=0.3)
