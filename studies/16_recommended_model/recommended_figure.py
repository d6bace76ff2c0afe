"""The figure: what is recommended beside the best of all models, arm by arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from recommended_table import Outcome

from studies.drawing import BLUE, GREY, VERMILION


def draw(found: Sequence[Outcome]) -> Figure:
    """A panel for each way to measure, a point for each arm; harm is marked."""
    ways = list(dict.fromkeys(one.way for one in found))
    figure = Figure(figsize=(4.2 * len(ways), 4.6), layout="constrained")
    panels = figure.subplots(1, len(ways), sharex=True, sharey=True, squeeze=False)[0]
    told = [one for one in found if one.best > 0]
    span = [min(one.best for one in told) / 1.3, 1.3 * max(one.recommended for one in told)]
    for panel, way in zip(panels, ways, strict=True):
        own = [one for one in told if one.way == way]
        panel.plot(span, span, color=GREY, lw=1.0)
        for harms, colour, mark, label in (
            (False, BLUE, "o", "better than the nominal arm"),
            (True, VERMILION, "X", "worse than the nominal arm"),
        ):
            some = np.array([(o.best, o.recommended) for o in own if o.harms == harms])
            x, y = some.reshape(-1, 2).T
            panel.plot(x, y, mark, color=colour, ms=4.0, alpha=0.6, lw=0, label=label)
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(way)
        panel.set_xlabel("error of the best model [mm]")
        panel.grid(visible=True, alpha=0.3)
    panels[0].set_ylabel("error of the recommended model [mm]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure
