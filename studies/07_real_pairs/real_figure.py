"""The figure: what each method leaves of pairs that took no part, against maximum likelihood."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

STYLES = (("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#000000", "D"))
"""Okabe and Ito's palette with a shape each, told apart by people who do not see red and green
alike."""

LABELS = {
    "deg": "rms rotation left of the pairs held out, in that of ml",
    "mm": "rms distance left of the pairs held out, in that of ml",
}
TICKS = (1, 2, 5, 10, 20)


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Ratios of every method to ml, in rotation and in translation, one mark a data set."""
    data = found["data"]
    methods = list(next(iter(data.values()))["splits"]["methods"])
    figure = Figure(figsize=(11.0, 6.4), dpi=110, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    height = np.arange(len(methods))[::-1]
    for panel, unit in zip(panels, LABELS, strict=True):
        panel.axvline(1.0, color="#777777", lw=1.0)
        for k, ((name, of), (colour, marker)) in enumerate(zip(data.items(), STYLES, strict=True)):
            rows = of["splits"]["methods"]
            ratio = [rows[method][f"rms_{unit}_ratio"] for method in methods]
            at = height + 0.16 * (1.5 - k)
            panel.plot(ratio, at, marker, color=colour, ms=5, mfc="none", mew=1.4, label=name)
        panel.set_xscale("log")
        panel.set_xticks(TICKS, [str(t) for t in TICKS])
        panel.xaxis.set_minor_locator(NullLocator())
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.set_xlabel(f"{LABELS[unit]} [-]")
        panel.grid(True, alpha=0.3)
        by_ml = [of["splits"]["methods"]["ml"][f"rms_{unit}"] for of in data.values()]
        said = ", ".join(f"{value:.3g}" for value in by_ml)
        panel.set_title(f"by ml, median of the splits: {said} {unit}", fontsize=9.5)
    panels[0].set_yticks(height, methods)
    panels[0].set_ylim(-0.6, len(methods) - 0.4)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(path, metadata={"Software": None})
