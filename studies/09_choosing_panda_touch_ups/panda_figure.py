"""The figure: error at the site held out over that of all touch-ups, by lot and by criterion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

STYLES = {
    "I at the sockets": ("#D55E00", "o"),
    "I at the site": ("#E69F00", "s"),
    "D of the arm": ("#0072B2", "D"),
    "D": ("#56B4E9", "d"),
    "A": ("#009E73", "^"),
    "E": ("#CC79A7", "v"),
    "G at the site": ("#000000", "P"),
    "C_G": ("#999999", "X"),
    "cond_2": ("#F0E442", "*"),
}
"""Okabe and Ito's palette with a shape each."""


def draw(rows: Sequence[dict[str, Any]], places: Sequence[str], path: Path) -> None:
    """A panel for each model of the arm, a row for each site."""
    shown = [row for row in rows if len(row["sites"][places[0]]["chosen"]) > 1]
    figure = Figure(figsize=(11.0, 4.2), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, sharex=True)
    height = np.arange(len(places))[::-1]
    for panel, row in zip(panels, shown, strict=True):
        panel.axvline(1.0, color="#777777", lw=1.0)
        panel.axvline(1.1, color="#777777", lw=1.0, ls=":")
        for y, place in zip(height, places, strict=True):
            of = row["sites"][place]
            ratio = np.array(of["by_lot_mm"]["quantiles"]) / of["all_mm"]
            panel.plot(ratio[[0, 4]], [y, y], color="#BBBBBB", lw=2.0, zorder=1)
            panel.plot(ratio[[1, 3]], [y, y], color="#BBBBBB", lw=9.0, zorder=1)
            panel.plot(ratio[2], y, "|", color="black", ms=16, mew=2.0, zorder=2)
            for k, c in enumerate(of["chosen"]):
                colour, marker = STYLES[c["criterion"]]
                at = y + 0.3 - 0.6 * (k + 0.5) / len(of["chosen"])
                panel.plot(c["over_all"], at, marker, color=colour, ms=6, zorder=3)
        panel.set_title(f"{row['model']} ({row['parameters']})")
        panel.set_xlabel("error at the site, 10 a socket over all 30")
        panel.grid(visible=True, axis="x", alpha=0.3)
    panels[0].set_yticks(height, list(places))
    marks = [
        panels[0].plot([], [], m, color=c, ms=6, ls="", label=name)[0]
        for name, (c, m) in STYLES.items()
    ]
    marks += [
        panels[0].plot([], [], color="#BBBBBB", lw=6, label="lot: 5, 25, 75, 95 %")[0],
        panels[0].plot([], [], "|", color="black", ms=12, mew=2, label="lot: median")[0],
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=6, frameon=False)
    figure.savefig(path, metadata={"Software": None})
