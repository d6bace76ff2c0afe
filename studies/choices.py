"""What studies 08 and 09 share: choices from a pool of readings, held against choices by lot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray
from studies import writing
from studies.drawing import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION
from studies.intervals import median_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
LOT = "#BBBBBB"
STYLES = {
    "I": (VERMILION, "o"),
    "I at the sockets": (VERMILION, "o"),
    "I at the site": (ORANGE, "s"),
    "D of the arm": (BLUE, "D"),
    "D": ("#56B4E9", "d"),
    "A": (GREEN, "^"),
    "E": (PURPLE, "v"),
    "G": (BLACK, "P"),
    "G at the site": (BLACK, "P"),
    "C_G": ("#999999", "X"),
    "cond_2": ("#F0E442", "*"),
}
"""Okabe and Ito's palette with a shape for each criterion."""


TOLERANCE = 5e-3
"""Of the figures on another machine, relative."""

DIGITS = 6
"""Significant digits of what is written."""


def write(
    rows: list[dict[str, Any]], recommended: str, table: Path, flat: Callable[[Any], Any]
) -> dict[str, Any]:
    """Write a table and the key figures of all models, and return these."""
    content = {"tolerance": TOLERANCE, "recommended": recommended, "models": rows}
    figures: dict[str, Any] = writing.rounded(content, DIGITS)
    writing.write_rows(table.parent, table.name, flat(figures["models"]), DIGITS)
    writing.write_figures(table.parent, figures)
    return figures


@dataclass(frozen=True, eq=False)
class Pool:
    """A model, and readings that some are chosen of.

    Attributes
    ----------
    sizes : array (p,)
        What errors of each parameter may be [SI].
    """

    model: CalibrationModel
    data: Measurements
    sizes: FloatArray

    @property
    def arm(self) -> list[int]:
        """Columns of the arm's own parameters: frames and points are nuisances."""
        return [int(k) for k in np.flatnonzero(~self.model.nuisance)]

    @cached_property
    def known(self) -> FloatArray:
        """Rows ``(K, p)`` of the priors, in ``sizes``."""
        return np.asarray(self.model.known(self.model.nominal[None])[1][0] * self.sizes)


def by_lot(count: int, n: int, draws: int, rng: np.random.Generator) -> BoolArray:
    """Choices ``(draws, count)`` of n each."""
    return np.argsort(np.argsort(rng.random((draws, count)), axis=1), axis=1) < n


def spread(values: FloatArray) -> dict[str, list[float]]:
    """Quantiles of choices by lot ``(draws,)``, and the interval of the median."""
    return {
        "quantiles": [float(q) for q in np.quantile(values, QUANTILES)],
        "median_interval": list(median_interval(values)),
    }


def range_text(quantiles: Sequence[float], digits: int = 3) -> str:
    """The median, and 5 to 95 % in brackets."""
    low, _, middle, _, high = (f"{q:.{digits}f}" for q in quantiles)
    return f"{middle} ({low} to {high})"


def draw_row(
    panel: Axes, y: float, quantiles: Sequence[float], chosen: Sequence[tuple[str, float]]
) -> None:
    """A row of a figure: what choices by lot leave, and what each criterion does."""
    low, first, middle, third, high = quantiles
    panel.plot([low, high], [y, y], color=LOT, lw=2.0, zorder=1)
    panel.plot([first, third], [y, y], color=LOT, lw=9.0, zorder=1)
    panel.plot(middle, y, "|", color=BLACK, ms=16, mew=2.0, zorder=2)
    for k, (criterion, value) in enumerate(chosen):
        colour, marker = STYLES[criterion]
        at = y + 0.3 - 0.6 * (k + 0.5) / len(chosen)
        panel.plot(value, at, marker, color=colour, ms=6, zorder=3)


def draw_legend(figure: Figure, panel: Axes, names: Sequence[str], *others: Any) -> None:
    """Below all panels: criteria, the lot, and other marks."""
    marks = [
        panel.plot([], [], STYLES[name][1], color=STYLES[name][0], ms=6, label=name)[0]
        for name in STYLES
        if name in names
    ]
    marks += [
        panel.plot([], [], color=LOT, lw=6, label="lot: 5, 25, 75, 95 %")[0],
        panel.plot([], [], "|", color=BLACK, ms=12, mew=2, label="lot: median")[0],
        *others,
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=6, frameon=False)
