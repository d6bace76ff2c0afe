"""The figures of the study: medians with their intervals, and the paper's own averages."""

from __future__ import annotations

from pathlib import Path

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
from li_claims import Found, median_interval
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

STYLES = {
    QUATERNION: ("#D55E00", "-", "o"),
    SAFE: ("#D55E00", ":", "o"),
    DUAL: ("#0072B2", "-", "s"),
    DUAL_M: ("#0072B2", ":", "s"),
    KRONECKER: ("#009E73", "-", "^"),
    KRONECKER_M: ("#009E73", ":", "^"),
    SCALED: ("#CC79A7", "-", "D"),
    FLOOR: ("#000000", "--", ""),
}
"""Okabe and Ito's palette, told apart by people who do not see red and green alike; dotted: the
same method in another form."""

LABELS = ("rotation: X + Z [deg]", "translation: X + Z [mm]")
CASES = {"A": "(a) only A noisy", "B": "(b) only B noisy", "both": "(c) A and B noisy"}


def draw_medians(found: Found, path: Path) -> None:
    """Median of each error against the number of poses, with the 95 % interval as a band."""
    workspaces = list(dict.fromkeys(workspace for workspace, _, _ in found))
    figure = Figure(figsize=(11.5, 13.0), dpi=90, layout="constrained")
    panels = np.atleast_2d(figure.subplots(2 * len(workspaces), len(CASES), sharex=True))
    for row, axes in enumerate(panels):
        workspace, measure = workspaces[row // 2], row % 2
        for panel, (noisy, title) in zip(axes, CASES.items(), strict=True):
            poses = sorted(n for w, s, n in found if (w, s) == (workspace, noisy))
            for name in SHOWN:
                colour, line, marker = STYLES[name]
                values = [found[workspace, noisy, n][name][:, measure] for n in poses]
                low, high = np.transpose([median_interval(v) for v in values])
                panel.fill_between(poses, low, high, color=colour, alpha=0.2, lw=0)
                middle = [np.median(v) for v in values]
                panel.plot(
                    poses, middle, line, marker=marker, color=colour, ms=4, lw=1.3, label=name
                )
            _dress(panel, poses)
            panel.set_title(f"{title}, {workspace}", fontsize=10)
        axes[0].set_ylabel(LABELS[measure])
        _same_range(axes)
    for panel in panels[-1]:
        panel.set_xlabel("number of poses")
    _legend(figure, panels[0, 0], 4)
    figure.savefig(path, metadata={"Software": None})


def draw_averages(found: Found, paper: Found, path: Path) -> None:
    """The paper's three curves: averages of few problems, and median and mean of many."""
    workspace = next(iter(found))[0]
    figure = Figure(figsize=(11.5, 7.0), dpi=90, layout="constrained")
    panels = figure.subplots(2, len(CASES), sharex=True)
    for measure, axes in enumerate(panels):
        for panel, (noisy, title) in zip(axes, CASES.items(), strict=True):
            poses = sorted(n for w, s, n in found if (w, s) == (workspace, noisy))
            for name in (QUATERNION, DUAL, KRONECKER):
                colour, _, marker = STYLES[name]
                many = [found[workspace, noisy, n][name][:, measure] for n in poses]
                few = [paper[workspace, noisy, n][name][:, measure].mean() for n in poses]
                panel.plot(poses, few, "-", marker=marker, color=colour, ms=5, label=_few(name))
                panel.plot(poses, [np.median(v) for v in many], "--", color=colour, lw=1.2)
                panel.plot(poses, [np.mean(v) for v in many], ":", color=colour, lw=1.6)
            _dress(panel, poses)
            panel.set_title(title, fontsize=10)
        axes[0].set_ylabel(LABELS[measure])
        _same_range(axes)
    for panel in panels[-1]:
        panel.set_xlabel("number of poses")
    panels[0, 0].plot([], [], "--", color="#555555", label="median of many")
    panels[0, 0].plot([], [], ":", color="#555555", label="mean of many")
    figure.suptitle(f"Poses: {workspace}", fontsize=11)
    _legend(figure, panels[0, 0], 3)
    figure.savefig(path, metadata={"Software": None})


def _few(name: str) -> str:
    return f"{name}: average of 10"


def _dress(panel: Axes, poses: list[int]) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xticks(poses, [str(n) for n in poses])
    panel.xaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    few = FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    panel.yaxis.set_minor_formatter(few)
    panel.grid(True, which="both", alpha=0.25)


def _same_range(axes: np.ndarray) -> None:
    """Panels side by side on one scale, so that they can be compared."""
    low, high = np.transpose([panel.get_ylim() for panel in axes])
    for panel in axes:
        panel.set_ylim(low.min(), high.max())


def _legend(figure: Figure, panel: Axes, columns: int) -> None:
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
