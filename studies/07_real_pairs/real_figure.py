"""The figure: what each method leaves of pairs that took no part, against maximum likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from studies.drawing import GREY, log_ticks, rows_of_marks

LABELS = {
    "deg": "rms rotation left of the pairs held out, in that of ml",
    "mm": "rms distance left of the pairs held out, in that of ml",
}
TICKS = (1, 2, 5, 10, 20)


def draw(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Ratios of every method to ml, in rotation and in translation, one mark a data set."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    sets = list(dict.fromkeys(row["data"] for row in rows))
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for panel, unit in zip(panels, LABELS, strict=True):
        of = {(row["data"], row["method"]): row for row in rows}
        ratios = {
            name: [of[name, method][f"half_rms_{unit}_ratio"] for method in methods]
            for name in sets
        }
        panel.axvline(1.0, color=GREY, lw=1.0)
        rows_of_marks(panel, methods, ratios, apart=0.16)
        log_ticks(panel, TICKS)
        panel.set_xlabel(f"{LABELS[unit]} [-]")
        by_ml = ", ".join(f"{of[name, 'ml'][f'half_rms_{unit}']:.3g}" for name in sets)
        panel.set_title(f"by ml, median of the splits: {by_ml} {unit}", fontsize=9.5)
    panels[0].set_ylim(-0.6, len(methods) - 0.4)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure
