"""The figure: error at the site held out over that of all touch-ups, by lot and by criterion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.choices import draw_legend, draw_row


def draw(rows: Sequence[dict[str, Any]], places: Sequence[str]) -> Figure:
    """A panel for each model of the arm, a row for each site."""
    shown = [row for row in rows if len(row["sites"][places[0]]["chosen"]) > 1]
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, sharex=True, squeeze=False)[0]
    height = np.arange(len(places))[::-1]
    names = set()
    for panel, row in zip(panels, shown, strict=True):
        panel.axvline(1.0, color="#777777", lw=1.0)
        panel.axvline(1.1, color="#777777", lw=1.0, ls=":")
        for y, place in zip(height, places, strict=True):
            of = row["sites"][place]
            chosen = [(c["criterion"], c["over_all"]) for c in of["chosen"]]
            names |= {name for name, _ in chosen}
            draw_row(panel, y, np.array(of["by_lot_mm"]["quantiles"]) / of["all_mm"], chosen)
        panel.set_title(f"{row['model']} ({row['parameters']})")
        panel.set_xlabel("error at the site, 10 a socket over all 30")
        panel.grid(visible=True, axis="x", alpha=0.3)
    panels[0].set_yticks(height, list(places))
    draw_legend(figure, panels[0], sorted(names))
    return figure
