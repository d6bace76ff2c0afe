"""What the figures of several studies share: colours, marks, and models one below the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from posedesign.report.drawing import BLACK, BLUE, GREEN, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"), (BLACK, "D"))
"""A colour with a shape for each series."""


def rows_of_marks(
    axes: Axes,
    names: Sequence[str],
    series: Mapping[str, Sequence[float]],
    *,
    apart: float = 0.0,
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


def log_ticks(axes: Axes, ticks: Sequence[float]) -> None:
    """A logarithmic axis of x with these numbers alone, written as people write them."""
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
