"""The figure: error at the poses not chosen, by lot and by criterion, a panel for each count."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.choices import draw_legend, draw_row
from studies.drawing import BLUE, log_ticks


def draw(rows: Sequence[dict[str, Any]]) -> Figure:
    """Models of the arm, without the baseline, which is a scale of its own."""
    shown = [row for row in rows if row["left_out_of_all_mm"] < 1.0]
    counts = [of["n"] for of in shown[0]["counts"]]
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    panels = figure.subplots(1, len(counts), sharey=True, sharex=True, squeeze=False)[0]
    height = np.arange(len(shown))[::-1]
    names = set()
    for k, (panel, n) in enumerate(zip(panels, counts, strict=True)):
        for y, row in zip(height, shown, strict=True):
            of = row["counts"][k]
            chosen = [(c["criterion"], c["error_mm"]) for c in of["chosen"]]
            names |= {name for name, _ in chosen}
            draw_row(panel, y, of["by_lot"]["error_mm"]["quantiles"], chosen)
            panel.plot(row["left_out_of_all_mm"], y, "|", color=BLUE, ms=22, mew=1.5, zorder=2)
        log_ticks(panel, [0.15, 0.2, 0.3, 0.5, 1.0])
        panel.set_title(f"{n} of 36 poses")
        panel.grid(visible=True, axis="x", alpha=0.3)
    panels[len(panels) // 2].set_xlabel("rms distance at the poses not chosen [mm]")
    panels[0].set_yticks(height, [f"{row['model']} ({row['parameters']})" for row in shown])
    panels[0].set_ylim(-0.6, len(shown) - 0.4)
    every = panels[0].plot([], [], "|", color=BLUE, ms=14, label="all 36, each left out")
    draw_legend(figure, panels[0], sorted(names), *every)
    return figure
