"""Shares, medians and rank correlations: nothing is assumed of how values are distributed."""

from __future__ import annotations

import numpy as np
from scipy.stats import beta, binom, norm, rankdata

from calib.se3 import BoolArray, FloatArray

LEVEL = 0.95


def share(of: BoolArray, level: float = LEVEL) -> dict[str, float]:
    """Share of the true among ``(T,)``, with its interval (Clopper and Pearson 1934)."""
    wins, trials, tail = int(of.sum()), len(of), (1.0 - level) / 2.0
    low = beta.ppf(tail, wins, trials - wins + 1) if wins else 0.0
    high = beta.isf(tail, wins + 1, trials - wins) if wins < trials else 1.0
    return {"share": wins / trials, "low": float(low), "high": float(high)}


def wilson(of: BoolArray, level: float = LEVEL) -> dict[str, float]:
    """The same with the interval of Wilson 1927: right on average, where that one is at least."""
    trials = len(of)
    if not trials:
        return {"share": float("nan"), "low": 0.0, "high": 1.0}
    share, z = float(np.mean(of)), float(norm.isf((1.0 - level) / 2.0))
    middle = (share + z**2 / (2 * trials)) / (1 + z**2 / trials)
    reach = z * np.sqrt(share * (1 - share) / trials + (z / (2 * trials)) ** 2)
    reach /= 1 + z**2 / trials
    return {
        "share": share,
        "low": float(max(middle - reach, 0.0)),
        "high": float(min(middle + reach, 1.0)),
    }


def median_interval(values: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """Interval of the median ``(T,)``, from the order of the values alone."""
    count = len(values)
    rank = int(binom.ppf((1.0 - level) / 2.0, count, 0.5))
    ordered = np.sort(values)
    return float(ordered[max(rank - 1, 0)]), float(ordered[min(count - rank, count - 1)])


def rank_correlation(x: FloatArray, y: FloatArray) -> FloatArray:
    """Spearman's, of rows ``(..., S)``."""
    a, b = (rankdata(values, axis=-1) for values in (x, y))
    a, b = (ranks - ranks.mean(axis=-1, keepdims=True) for ranks in (a, b))
    size = np.sqrt((a * a).sum(axis=-1) * (b * b).sum(axis=-1))
    return np.asarray((a * b).sum(axis=-1) / size)
