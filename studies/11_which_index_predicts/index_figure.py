"""The figure of the study: what choosing by each criterion costs, and how each index ranks sets."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.drawing import BLUE, GREEN, VERMILION

STYLES = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"))
"""Colour and mark of each problem."""

TITLES = {"same": "random sets of 27 poses", "mixed": "random sets of 8 to 60 poses, 15 to 60 deg"}


def draw(said: dict[str, Any]) -> Figure:
    """Above the error against that of I; below rank correlations of indices with the error."""
    problems = list(dict.fromkeys(row["problem"] for row in said["chosen"]))
    figure = Figure(figsize=(12.5, 10.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.0, 1.15])
    counts = list(dict.fromkeys(row["poses"] for row in said["chosen"]))
    for column, poses in enumerate(counts[:2]):
        panel = figure.add_subplot(grid[0, column])
        rows = [row for row in said["chosen"] if row["poses"] == poses]
        _lines(panel, rows, problems, "criterion", ("times_I", "times_I_low", "times_I_high"))
        panel.axvline(1.0, color="#555555", lw=1.0)
        panel.set_title(f"{poses} poses chosen by each criterion", fontsize=11)
        panel.set_xlabel("error over the box, times that of the choice by I")
    for column, (kind, title) in enumerate(TITLES.items()):
        panel = figure.add_subplot(grid[1, column])
        rows = [row for row in said["ranked"] if row["sets"] == kind]
        _lines(panel, rows, problems, "index", ("rho", "low", "high"))
        panel.set_title(title, fontsize=11)
        panel.set_xlabel("rank correlation with the error over the box")
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(problems), frameon=False)
    return figure


def _lines(
    panel: Axes,
    rows: list[dict[str, Any]],
    problems: list[str],
    key: str,
    columns: tuple[str, str, str],
) -> None:
    """A line for each criterion or index, a point with its interval for each problem."""
    names = list(dict.fromkeys(row[key] for row in rows))
    place = {name: len(names) - 1 - k for k, name in enumerate(names)}
    for k in range(len(names)):
        panel.axhspan(k - 0.5, k + 0.5, color="#eeeeee" if k % 2 else "#ffffff", lw=0)
    for p, (problem, (colour, mark)) in enumerate(zip(problems, STYLES, strict=False)):
        own = [row for row in rows if row["problem"] == problem]
        heights = [place[row[key]] + 0.22 * (1 - p) for row in own]
        middle, low, high = ([row[c] for row in own] for c in columns)
        panel.hlines(heights, low, high, color=colour, lw=2.5, alpha=0.5)
        panel.plot(middle, heights, mark, color=colour, ms=4.5, label=problem)
    panel.set_yticks(list(place.values()), list(place), fontsize=9)
    panel.set_ylim(-0.6, len(names) - 0.4)
    panel.grid(True, axis="x", alpha=0.3)
