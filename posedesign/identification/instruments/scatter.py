"""Statistics of repeated readings: scatter, drift, and what goes with the temperature.

Arrays only. Each test says how probable chance alone is; where several are made at once, on axes,
places of a step or references, that is multiplied by their number (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.chance import chi2_below, chi2_tail, student_tail
from calib.se3 import BoolArray, FloatArray, IntArray

SIGNIFICANT = 0.01
"""Probability of chance, all tests together, below which something is said."""

FEWEST = 4
"""Readings that a drift is tested on: two parameters, and two left."""

_LEAST_ASIDE = 2


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of repeated readings about the mean of their group."""

    sigma: FloatArray  # (m,): pooled standard deviation of one reading along each axis
    freedom: int  # degrees of freedom of it

    def probability(self, stated: FloatArray) -> float:
        """How probable so large or so small a scatter is by chance, the stated one being true.

        ``f s²/σ²`` of normal readings is chi-squared with f degrees of freedom.
        """
        found = self.freedom * (self.sigma / stated) ** 2
        aside = np.minimum(chi2_below(found, self.freedom), chi2_tail(found, self.freedom))
        return float(min(1.0, 2.0 * len(self.sigma) * aside.min()))


def pooled(values: FloatArray, group: IntArray) -> tuple[FloatArray, IntArray, Scatter | None]:
    """Means ``(G, m)`` and counts ``(G,)`` of groups of readings ``(N, m)``, and their scatter.

    ``group`` (N,): index of each reading's group; every index up to the largest is there.
    """
    count = np.bincount(group)
    sums = np.zeros((len(count), values.shape[1]))
    # about the first of each group: squares of metres would leave no micrometres
    first = values[np.unique(group, return_index=True)[1]]
    off = values - first[group]
    np.add.at(sums, group, off)
    mean = sums / count[:, None]
    freedom = len(values) - len(count)
    if freedom == 0:
        return first + mean, count, None
    variance = ((off - mean[group]) ** 2).sum(axis=0) / freedom
    return first + mean, count, Scatter(np.sqrt(variance), freedom)


_WINDOW, _STRAY = 5, 20.0
"""Readings whose median says where a place is at a time, and the distance from it over the median
of all, of a reading that is of another place."""


def strays(places: FloatArray) -> BoolArray:
    """Mask ``(K,)`` of readings of another place: those before and after them agree on this one.

    ``places`` (K, 3): of one place, in order of time. One reading that is far off makes the scatter
    so large that no drift is seen.
    """
    if len(places) < _WINDOW:
        return np.zeros(len(places), dtype=bool)
    half = _WINDOW // 2
    padded = np.pad(places, ((half, half), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _WINDOW, axis=0)
    off = np.linalg.norm(places - np.median(windows, axis=-1), axis=1)
    exact = np.finfo(float).eps * (1.0 + np.abs(places).max())
    return np.asarray(off > _STRAY * max(float(np.median(off)), exact))


@dataclass(frozen=True)
class Drift:
    """What a reference did while it was read again and again.

    ``cause`` {"drift", "step"}. ``size``: length of the way from the first reading to the last, or
    of the step. ``at``: reading before which it stepped; zero of a drift. ``probability``: of
    chance: of a way or a step as clear in readings that only scatter.
    """

    cause: Literal["drift", "step"]
    size: float
    at: int
    probability: float


def drift_of(places: FloatArray, times: FloatArray) -> Drift | None:
    """The clearest drift or step in readings ``(K, 3)`` of one place, in order of time.

    Student's t of a slope, or of the difference of two means, axis by axis, the scatter estimated
    with it; of all axes and places of a step the least probable one counts. None of fewer than
    `FEWEST` readings.
    """
    count = len(places)
    if count < FEWEST or np.ptp(times) <= 0:
        return None
    after = np.arange(count)[:, None] >= np.arange(_LEAST_ASIDE, count - _LEAST_ASIDE + 1)
    courses = np.column_stack([times - times[0], after.astype(float)])
    courses = courses / np.ptp(courses, axis=0)
    centred = courses - courses.mean(axis=0)
    off = places - places.mean(axis=0)
    size = centred.T @ off / (centred**2).sum(axis=0)[:, None]  # of least squares (C, 3)
    left = ((off[None] - centred.T[:, :, None] * size[:, None]) ** 2).sum(axis=1)
    sigma = np.sqrt(left / (count - 2) / (centred**2).sum(axis=0)[:, None])
    exact = np.finfo(float).eps * (1.0 + np.abs(places).max())
    probability = 2.0 * student_tail(np.abs(size) / np.maximum(sigma, exact), count - 2)
    axes, steps = places.shape[1], courses.shape[1] - 1
    # a drift and all steps are two questions; of the steps each place is a try
    tries = 2.0 * axes * np.where(np.arange(steps + 1) == 0, 1, steps)
    each = np.minimum(1.0, tries * probability.min(axis=1))
    best = int(each.argmin())
    far = float(np.linalg.norm(size[best]))
    if best == 0:
        return Drift("drift", far, 0, float(each[0]))
    return Drift("step", far, best - 1 + _LEAST_ASIDE, float(each[best]))


@dataclass(frozen=True)
class Trend:
    """How residuals go with the temperature."""

    axis: int  # axis that goes with it most clearly
    slope: float  # change of the residual a degree
    correlation: float
    probability: float  # of chance, for all axes together


def trend_with(residuals: FloatArray, temperature: FloatArray) -> Trend | None:
    """The clearest correlation of residuals ``(N, m)`` with a temperature ``(N,)``, if any."""
    known = np.isfinite(temperature)
    T, rows = temperature[known], residuals[known]
    if len(T) < FEWEST or np.ptp(T) <= 0:
        return None
    T, rows = T - T.mean(), rows - rows.mean(axis=0)
    lengths = np.linalg.norm(T) * np.linalg.norm(rows, axis=0)
    r = (T @ rows) / np.where(lengths > 0, lengths, 1.0)
    axis, freedom = int(np.abs(r).argmax()), len(T) - 2
    t = abs(r[axis]) * np.sqrt(freedom / max(1.0 - r[axis] ** 2, 1e-300))
    probability = min(1.0, 2.0 * len(r) * float(student_tail(t, freedom)))
    slope = float(T @ rows[:, axis] / (T @ T))
    return Trend(axis, slope, float(r[axis]), probability)
