"""The figure: error at the poses not chosen, by lot and by criterion, a panel for each count."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

STYLES = {
    "I": ("#D55E00", "o"),
    "D of the arm": ("#0072B2", "s"),
    "D": ("#56B4E9", "D"),
    "A": ("#009E73", "^"),
    "E": ("#CC79A7", "v"),
    "G": ("#000000", "P"),
    "C_G": ("#999999", "X"),
    "cond_2": ("#E69F00", "*"),
}
"""Okabe and Ito's palette with a shape each."""


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Models of the arm, without the baseline, which is a scale of its own."""
    shown = [row for row in rows if row["left_out_of_all_mm"] < 1.0]
    counts = [of["n"] for of in shown[0]["counts"]]
    figure = Figure(figsize=(11.0, 4.6), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(counts), sharey=True, sharex=True)
    height = np.arange(len(shown))[::-1]
    for k, (panel, n) in enumerate(zip(panels, counts, strict=True)):
        for y, row in zip(height, shown, strict=True):
            of = row["counts"][k]
            low, first, middle, third, high = of["by_lot"]["error_mm"]["quantiles"]
            panel.plot([low, high], [y, y], color="#BBBBBB", lw=2.0, zorder=1)
            panel.plot([first, third], [y, y], color="#BBBBBB", lw=9.0, zorder=1)
            panel.plot(middle, y, "|", color="black", ms=16, mew=2.0, zorder=2)
            panel.plot(row["left_out_of_all_mm"], y, "|", color="#0072B2", ms=22, mew=1.5, zorder=2)
            names = [c["criterion"] for c in of["chosen"]]
            for c, name in zip(of["chosen"], names, strict=True):
                colour, marker = STYLES[name]
                at = y + 0.3 * (0.5 - (names.index(name) + 0.5) / len(names)) * 2.0
                panel.plot(c["error_mm"], at, marker, color=colour, ms=6, zorder=3)
        panel.set_xscale("log")
        ticks = [0.15, 0.2, 0.3, 0.5, 1.0]
        panel.set_xticks(ticks, [f"{t:g}" for t in ticks])
        panel.minorticks_off()
        panel.set_title(f"{n} of 36 poses")
        panel.grid(visible=True, axis="x", alpha=0.3)
    panels[len(panels) // 2].set_xlabel("rms distance at the poses not chosen [mm]")
    panels[0].set_yticks(height, [f"{row['model']} ({row['parameters']})" for row in shown])
    panels[0].set_ylim(-0.6, len(shown) - 0.4)
    marks = [
        panels[0].plot([], [], m, color=c, ms=6, label=name)[0] for name, (c, m) in STYLES.items()
    ]
    marks += [
        panels[0].plot([], [], color="#BBBBBB", lw=6, label="lot: 5, 25, 75, 95 %")[0],
        panels[0].plot([], [], "|", color="black", ms=12, mew=2, label="lot: median")[0],
        panels[0].plot([], [], "|", color="#0072B2", ms=14, label="all 36, each left out")[0],
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=6, frameon=False)
    figure.savefig(path, metadata={"Software": None})
