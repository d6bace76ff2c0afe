"""The figures of the study: error against iteration, and what the counts say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from hirsh_claims import ENDS
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.se3 import FloatArray

VIEWS = {3: ("#D55E00", "o"), 4: ("#CC79A7", "D"), 5: ("#0072B2", "s"), 10: ("#009E73", "^")}
"""Okabe and Ito's palette, told apart by people who do not see red and green alike."""

PLACES = ("#0072B2", "#E69F00", "#555555")
LOWEST_RAD = 1e-7
"""Errors below are of no interest: the axis of noise-free runs ends here."""

Curve = tuple[FloatArray, FloatArray]
"""Cycles ``(K,)`` and errors ``(K, T)``."""


def draw_iterations(
    curves: Mapping[tuple[str, str, int, str], Curve], noise_deg: float, path: Path
) -> None:
    """Error against cycles: rows without and with noise, a column for each workspace.

    Keys of the curves: ``exact`` or ``noisy``, workspace, views, ``consistent`` or ``printed``.
    """
    workspaces = list(dict.fromkeys(key[1] for key in curves))
    figure = Figure(figsize=(12.0, 7.6), dpi=100, layout="constrained")
    panels = figure.subplots(2, len(workspaces), sharex="col", sharey="row")
    for axes, data in zip(panels, ("exact", "noisy"), strict=True):
        for panel, workspace in zip(axes, workspaces, strict=True):
            for (kind, place, views, form), curve in curves.items():
                if (kind, place) == (data, workspace):
                    _curve(panel, curve, views, form)
            panel.set_yscale("log")
            panel.grid(True, alpha=0.25)
            what = "no noise" if data == "exact" else f"{noise_deg:g} deg of noise"
            panel.set_title(f"{workspace}, {what}", fontsize=10)
            if data == "noisy":
                line = np.radians(noise_deg) / 2.0
                panel.axhline(line, color="black", lw=1.2, ls="--", label="line of the noise")
                panel.set_xlabel("cycles")
        axes[0].set_ylabel("angle between quaternions [rad]")
    panels[0, 0].set_ylim(LOWEST_RAD, 2.0)
    for panel in panels[0, 1:]:
        panel.set_xscale("log")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path, metadata={"Software": None})


def _curve(panel: Axes, curve: Curve, views: int, form: str) -> None:
    cycles, errors = curve
    colour = VIEWS[views][0]
    low, middle, high = np.quantile(np.maximum(errors, 1e-16), [0.25, 0.5, 0.75], axis=1)
    if form == "printed":
        panel.plot(cycles, middle, ":", color=colour, lw=1.6, label=f"{views} views, as printed")
        return
    panel.fill_between(cycles, low, high, color=colour, alpha=0.2, lw=0)
    panel.plot(cycles, middle, "-", color=colour, lw=1.6, label=f"{views} views, signs consistent")


def draw_counts(
    said: dict[str, Any], counts: Mapping[tuple[str, int], tuple[Any, Any]], path: Path
) -> None:
    """Predicted against counted cycles, how the printed form ends, and runs below the line."""
    workspaces = list(said)
    figure = Figure(figsize=(13.0, 4.6), dpi=100, layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for (workspace, views), (counted, predicted) in counts.items():
        place = workspaces.index(workspace)
        left.plot(
            counted, predicted, VIEWS[views][1], color=PLACES[place], ms=3, alpha=0.4, mew=0,
            label=workspace if views == 3 else None,
        )  # fmt: skip
    ends = [1.0, max(float(np.max(c)) for c, _ in counts.values())]
    left.plot(ends, ends, color="black", lw=1.0, label="predicted = counted")
    left.set(xscale="log", yscale="log", xlabel="cycles counted", ylabel="cycles predicted")
    left.set_title("Cycles to 1e-4 rad, by (σ2/σ1)²", fontsize=10)
    left.legend(fontsize=8)
    _outcomes(middle, said)
    for place, (workspace, every) in enumerate(said.items()):
        views = list(every["views"])
        rows = [every["views"][n]["floor"]["below_line"] for n in views]
        middles = np.array([row["share"] for row in rows])
        bars = [middles - [r["low"] for r in rows], [r["high"] for r in rows] - middles]
        right.errorbar(
            [int(n) for n in views], 100 * middles, yerr=100 * np.array(bars), fmt="-o",
            color=PLACES[place], capsize=3, ms=4, label=workspace,
        )  # fmt: skip
    right.set(xlabel="views", ylabel="runs below the line of the noise [%]", ylim=(-3, 103))
    right.set_xticks([3, 4, 5, 10])
    right.set_title("1 deg of noise; bars: 95 % interval", fontsize=10)
    right.legend(fontsize=8)
    for panel in (left, middle, right):
        panel.grid(True, alpha=0.25)
    figure.savefig(path, metadata={"Software": None})


def _outcomes(panel: Axes, said: dict[str, Any]) -> None:
    """Stacked shares of the ends of the printed form, with the interval of the last one."""
    colours = dict(zip(ENDS, ("#009E73", "#D55E00", "#E69F00", "#CCCCCC"), strict=True))
    at, labels = 0.0, []
    for workspace, every in said.items():
        for views, row in every["views"].items():
            base = 0.0
            for end, colour in colours.items():
                height = 100 * row["printed"][end]["share"]
                label = None if labels else end
                panel.bar(at, height, bottom=base, color=colour, label=label)
                base += height
            low, high = (100 * row["printed"]["arrived"][k] for k in ("low", "high"))
            panel.plot([at, at], [low, high], color="black", lw=1.5)
            labels.append((at, f"{views}"))
            at += 1.0
        panel.text(at - 2.5, 101.5, workspace, ha="center", fontsize=8)
        at += 0.7
    panel.set_xticks([x for x, _ in labels], [text for _, text in labels])
    panel.set(xlabel="views", ylabel="runs [%]", ylim=(0, 100))
    panel.set_title("As printed, no noise, from the identity", fontsize=10, pad=16)
    panel.legend(
        fontsize=8,
        ncols=4,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
        handlelength=1.0,
        columnspacing=1.0,
        frameon=False,
    )
