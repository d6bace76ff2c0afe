"""The figures of the study: medians with their intervals, and the paper's own averages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from li_cases import (
    DUAL,
    DUAL_M,
    FLOOR,
    KRONECKER,
    KRONECKER_M,
    QUATERNION,
    SAFE,
    SCALED,
    SHOWN,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from studies.drawing import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION, log_ticks

STYLES = {
    QUATERNION: (VERMILION, "-", "o"),
    SAFE: (VERMILION, ":", ""),
    DUAL: (BLUE, "-", "s"),
    DUAL_M: (BLUE, ":", ""),
    KRONECKER: (GREEN, "-", "^"),
    KRONECKER_M: (GREEN, ":", ""),
    SCALED: (PURPLE, "-", "D"),
    FLOOR: (BLACK, "--", ""),
}
"""Dotted: the same method in another form."""

OF_THE_PAPER = (QUATERNION, DUAL, KRONECKER)
LABELS = {"rotation_deg": "rotation: X + Z [deg]", "translation_mm": "translation: X + Z [mm]"}
"""By the columns of the tables."""

CASES = {"A": "(a) only A noisy", "B": "(b) only B noisy", "both": "(c) A and B noisy"}


Row = Mapping[str, Any]


def draw_medians(rows: Iterable[Row]) -> Figure:
    """Median of each error against the number of poses, with the 95 % interval as a band."""
    found = _by_panel(rows)
    workspaces = list(dict.fromkeys(workspace for workspace, *_ in found))
    figure = Figure(figsize=(8.6, 9.8), layout="constrained")
    panels = np.atleast_2d(
        figure.subplots(2 * len(workspaces), len(CASES), sharex=True, sharey="row")
    )
    for row, axes in enumerate(panels):
        workspace, (title, label) = workspaces[row // 2], list(LABELS.items())[row % 2]
        for panel, (noisy, case) in zip(axes, CASES.items(), strict=True):
            for name in SHOWN:
                of = found[workspace, noisy, name]
                colour, line, marker = STYLES[name]
                _band(panel, of, title, colour)
                panel.plot(
                    of["poses"], of[f"{title}_median"], line, marker=marker, color=colour, ms=4,
                    lw=1.3, label=name,
                )  # fmt: skip
            _dress(panel, of["poses"])
            panel.set_title(f"{case}, {workspace}", fontsize=9)
        axes[0].set_ylabel(label)
    _legend(figure, panels, 4)
    return figure


def draw_averages(rows: Iterable[Row], of_ten: Iterable[Row]) -> Figure:
    """The paper's three curves: averages of few problems, and median and mean of many."""
    found, few = _by_panel(rows), _by_panel(of_ten)
    workspace = next(iter(found))[0]
    figure = Figure(figsize=(8.6, 5.8), layout="constrained")
    panels = figure.subplots(2, len(CASES), sharex=True, sharey="row")
    for (title, label), axes in zip(LABELS.items(), panels, strict=True):
        for panel, (noisy, case) in zip(axes, CASES.items(), strict=True):
            for name in OF_THE_PAPER:
                own, many = few[workspace, noisy, name], found[workspace, noisy, name]
                colour, _, marker = STYLES[name]
                panel.plot(
                    own["poses"], own[f"{title}_mean"], "-", marker=marker, color=colour, ms=5,
                    label=f"{name}: average of 10",
                )  # fmt: skip
                _band(panel, many, title, colour)
                panel.plot(many["poses"], many[f"{title}_median"], "--", color=colour, lw=1.2)
                panel.plot(many["poses"], many[f"{title}_mean"], ":", color=colour, lw=1.6)
            _dress(panel, many["poses"])
            panel.set_title(case, fontsize=9)
        axes[0].set_ylabel(label)
    panels[0, 0].plot([], [], "--", color=GREY, label="median of many, 95 % interval")
    panels[0, 0].plot([], [], ":", color=GREY, label="mean of many")
    figure.suptitle(f"Poses: {workspace}", fontsize=11)
    _legend(figure, panels, 3)
    return figure


def _by_panel(rows: Iterable[Row]) -> dict[tuple[str, str, str], dict[str, list[float]]]:
    """Columns by workspace, noisy side and method, in the order of the numbers of poses."""
    found: dict[tuple[str, str, str], dict[str, list[float]]] = {}
    for row in rows:
        columns = found.setdefault((row["workspace"], row["noisy"], row["method"]), {})
        for title, value in row.items():
            columns.setdefault(title, []).append(value)
    return found


def _band(panel: Axes, of: Mapping[str, list[float]], title: str, colour: str) -> None:
    low, high = of[f"{title}_median_low"], of[f"{title}_median_high"]
    panel.fill_between(of["poses"], low, high, color=colour, alpha=0.2, lw=0)


def _dress(panel: Axes, poses: Sequence[float]) -> None:
    log_ticks(panel, poses)
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.grid(visible=True, axis="y", alpha=0.25)


def _legend(figure: Figure, panels: np.ndarray, columns: int) -> None:
    for panel in panels[-1]:
        panel.set_xlabel("number of poses")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
