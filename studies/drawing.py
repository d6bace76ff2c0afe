"""What the figures of several studies share: colours, marks, and models one below the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from posedesign.report.drawing import BLACK, BLUE, GREEN, VERMILION, set_answer

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"), (BLACK, "D"))
"""A colour with a shape for each series."""


def rows_of_marks(
    axes: Axes, names: Sequence[str], series: Mapping[str, Sequence[float]], *, apart: float = 0.0
) -> None:
    """Draw a row for each name, the first on top, with a mark for each series.

    Parameters
    ----------
    names : sequence of str
        One a row.
    series : mapping of str to sequence of float
        What stands in the legend, and a number for each row.
    apart : float
        Distance of the series in a row, whose height is one.
    """
    height = np.arange(len(names))[::-1]
    for k, ((label, values), (colour, mark)) in enumerate(zip(series.items(), MARKS, strict=False)):
        at = height + apart * ((len(series) - 1) / 2.0 - k)
        axes.plot(values, at, mark, color=colour, ms=6, mfc="none", mew=1.5, label=label)
    axes.set_yticks(height, names)
    axes.grid(visible=True, axis="both", alpha=0.3)


def figure_of_marks(
    names: Sequence[str],
    series: Mapping[str, Sequence[float]],
    ticks: Sequence[float],
    what: str,
    answer: str,
    *,
    legend: str | None = None,
) -> Figure:
    """A panel of :func:`rows_of_marks` on a logarithmic axis, and what it tells."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2 if legend else 4.4), layout="constrained")
    axes = figure.subplots()
    rows_of_marks(axes, names, series)
    log_ticks(axes, ticks)
    axes.set_xlabel(f"{what} [mm], log scale")
    axes.legend(title=legend, frameon=False)
    set_answer(figure, answer)
    return figure


def rows_with_intervals(
    axes: Axes, rows: Sequence[Mapping[str, Any]], key: str, by: str, columns: Sequence[str]
) -> None:
    """Draw a row for each name in a column, a mark with its interval for each series in another.

    ``columns``: middle, low and high end; a row without one of them has no mark.
    """
    names = list(dict.fromkeys(row[key] for row in rows))
    series = list(dict.fromkeys(row[by] for row in rows))
    for k, (label, (colour, mark)) in enumerate(zip(series, MARKS, strict=False)):
        own = [row for row in rows if row[by] == label]
        shown = [row for row in own if all(isinstance(row[c], float) for c in columns)]
        middle, low, high = np.array([[row[c] for c in columns] for row in shown]).T
        at = np.array([len(names) - 1 - names.index(row[key]) for row in shown])
        axes.errorbar(
            middle, at + 0.22 * ((len(series) - 1) / 2.0 - k), xerr=[middle - low, high - middle],
            fmt=mark, color=colour, mfc="none", mew=1.5, ms=5, capsize=2.5, label=label,
        )  # fmt: skip
    for k in range(1, len(names), 2):
        axes.axhspan(k - 0.5, k + 0.5, color="#eeeeee", lw=0)
    axes.set_yticks(range(len(names)), names[::-1])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.grid(visible=True, axis="x", alpha=0.3)


def log_ticks(axes: Axes, ticks: Sequence[float]) -> None:
    """A logarithmic axis of x with these numbers alone, written as people write them."""
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
