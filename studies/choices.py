"""What studies 08 and 09 share: choices from a pool of readings, held against choices by lot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray
from posedesign.report.drawing import STYLES, curve
from studies import writing
from studies.intervals import median_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
SHOWN = {"I": "I", "I at the sockets": "I", "D of the arm": "D of the arm", "C_G": "C_G"}
"""Criteria that are drawn, by their names in the table of styles; the tables have them all."""


TOLERANCE = 5e-3
"""Of the figures on another machine, relative."""

DIGITS = 6
"""Significant digits of what is written."""


def write(
    rows: list[dict[str, Any]], recommended: str, table: Path, flat: Callable[[Any], Any]
) -> dict[str, Any]:
    """Write a table and the key figures of all models, and return these."""
    content = {"tolerance": TOLERANCE, "recommended": recommended, "models": rows}
    tables = {table.name: flat(writing.rounded(rows, DIGITS))}
    return writing.write_rounded(table.parent, content, DIGITS, tables)


@dataclass(frozen=True, eq=False)
class Pool:
    """A model, and readings that some are chosen of."""

    model: CalibrationModel
    data: Measurements
    sizes: FloatArray  # (p,): what errors of each parameter may be [SI]

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


def range_text(name: str, digits: int = 3) -> str:
    """Format string of quantiles: the median, and 5 to 95 % in brackets."""
    return writing.span(f".{digits}f", f"{name}[2]", f"{name}[0]", f"{name}[4]")


def draw_choices(
    panel: Axes,
    names: Sequence[str],
    lots: Sequence[Sequence[float]],
    chosen: Sequence[Mapping[str, float]],
    *,
    joined: bool,
) -> None:
    """Draw what choices by lot leave, with 5 to 95 % of them, and what some criteria do.

    Parameters
    ----------
    names : sequence of str
        What stands side by side.
    lots : sequence of sequence of float
        Of each, the quantiles.
    chosen : sequence of mapping of str to float
        Of each, by criterion.
    """
    at = np.arange(len(names))
    low, _, middle, _, high = np.transpose(lots)
    curve(panel, at, middle, STYLES["by lot"]._replace(line=""), "by lot, median", ends=(low, high))
    drawn = [name for name in SHOWN if all(name in of for of in chosen)]
    for k, name in enumerate(drawn):
        style = STYLES[SHOWN[name]] if joined else STYLES[SHOWN[name]]._replace(line="")
        aside = 0.09 * (k + 1)
        curve(panel, at + aside, [of[name] for of in chosen], style, f"by {name}")
    panel.set_xticks(at, names)
    panel.set_xlim(-0.3, len(names) - 0.5)
    panel.grid(visible=True, axis="y", alpha=0.3)
