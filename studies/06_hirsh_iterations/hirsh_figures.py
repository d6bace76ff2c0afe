"""The figures of the study: error against iteration, and what the counts say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from hirsh_claims import ENDS
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION

VIEWS = {3: (VERMILION, "o"), 4: (PURPLE, "D"), 5: (BLUE, "s"), 10: (GREEN, "^")}
PLACES = (BLUE, ORANGE, GREY)
LIGHT = "#CCCCCC"
LOWEST_RAD = 1e-7
"""Errors below are of no interest: the axis of noise-free runs ends here."""

Row = Mapping[str, Any]


def draw_iterations(rows: Sequence[Row], noise_deg: float) -> Figure:
    """Error against cycles: rows without and with noise, a column for each workspace."""
    workspaces = list(dict.fromkeys(row["workspace"] for row in rows))
    figure = Figure(figsize=(12.0, 7.6), layout="constrained")
    panels = figure.subplots(2, len(workspaces), sharex="col", sharey="row")
    for axes, data in zip(panels, ("exact", "noisy"), strict=True):
        for panel, workspace in zip(axes, workspaces, strict=True):
            own = [r for r in rows if (r["data"], r["workspace"]) == (data, workspace)]
            for (views, form), curve in groupby(own, lambda row: (row["views"], row["form"])):
                _curve(panel, list(curve), views, form)
            panel.set_yscale("log")
            panel.grid(True, alpha=0.25)
            what = "no noise" if data == "exact" else f"{noise_deg:g} deg of noise"
            panel.set_title(f"{workspace}, {what}", fontsize=10)
            if data == "noisy":
                line = np.radians(noise_deg) / 2.0
                panel.axhline(line, color=BLACK, lw=1.2, ls="--", label="line of the noise")
                panel.set_xlabel("cycles")
        axes[0].set_ylabel("angle between quaternions [rad]")
    panels[0, 0].set_ylim(LOWEST_RAD, 2.0)
    for panel in panels[0, 1:]:
        panel.set_xscale("log")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _curve(panel: Axes, rows: Sequence[Row], views: float, form: str) -> None:
    cycles, colour = [row["cycle"] for row in rows], VIEWS[int(views)][0]
    low, middle, high = (
        [max(row[f"{name}_rad"], 1e-16) for row in rows] for name in ("q25", "median", "q75")
    )
    label = f"{views:g} views"
    if form == "printed":
        panel.plot(cycles, middle, ":", color=colour, lw=1.6, label=f"{label}, as printed")
        return
    panel.fill_between(cycles, low, high, color=colour, alpha=0.2, lw=0)
    panel.plot(cycles, middle, "-", color=colour, lw=1.6, label=f"{label}, signs consistent")


def draw_counts(said: Mapping[str, Any], counts: Sequence[Row]) -> Figure:
    """Predicted against counted cycles, how the printed form ends, and runs below the line."""
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _predictions(left, list(said), counts)
    _outcomes(middle, said)
    _floors(right, said)
    for panel in (left, middle, right):
        panel.grid(True, alpha=0.25)
    return figure


def _predictions(panel: Axes, workspaces: Sequence[str], counts: Iterable[Row]) -> None:
    """A mark for each problem; in a vector graphic they are one picture."""
    last = 1.0
    for (place, views), rows in groupby(counts, lambda row: (row["workspace"], row["views"])):
        counted, predicted = np.transpose([(r["cycles"], r["predicted_cycles"]) for r in rows])
        last = max(last, float(counted.max()))
        panel.plot(
            counted, predicted, VIEWS[int(views)][1], color=PLACES[workspaces.index(place)], ms=3,
            alpha=0.4, mew=0, label=place if views == 3 else None, rasterized=True,
        )  # fmt: skip
    panel.plot([1.0, last], [1.0, last], color=BLACK, lw=1.0, label="predicted = counted")
    panel.set(xscale="log", yscale="log", xlabel="cycles counted", ylabel="cycles predicted")
    panel.set_title("Cycles to 1e-4 rad, by (σ2/σ1)²", fontsize=10)
    panel.legend(fontsize=8)


def _floors(panel: Axes, said: Mapping[str, Any]) -> None:
    """Shares of runs that end below the line of the noise, with their intervals."""
    for place, (workspace, every) in enumerate(said.items()):
        views = list(every["views"])
        rows = [every["views"][n]["floor"]["below_line"] for n in views]
        middles = np.array([row["share"] for row in rows])
        bars = [middles - [r["low"] for r in rows], [r["high"] for r in rows] - middles]
        panel.errorbar(
            [int(n) for n in views], 100 * middles, yerr=100 * np.array(bars), fmt="-o",
            color=PLACES[place], capsize=3, ms=4, label=workspace,
        )  # fmt: skip
    panel.set(xlabel="views", ylabel="runs below the line of the noise [%]", ylim=(-3, 103))
    panel.set_xticks(list(VIEWS))
    panel.set_title("1 deg of noise; bars: 95 % interval", fontsize=10)
    panel.legend(fontsize=8)


def _outcomes(panel: Axes, said: Mapping[str, Any]) -> None:
    """Stacked shares of the ends of the printed form, with the interval of the last one."""
    colours = dict(zip(ENDS, (GREEN, VERMILION, ORANGE, LIGHT), strict=True))
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
            panel.plot([at, at], [low, high], color=BLACK, lw=1.5)
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
