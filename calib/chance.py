"""Quantiles and tails of the distributions that tests of statistics rest on.

``scipy.stats`` wraps the same functions of ``scipy.special``, gives the same numbers, and takes as
long to import as everything else that a command needs; these are imported when first asked for.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from calib.se3 import FloatArray


@cache
def _special() -> ModuleType:
    from scipy import special

    return special


def normal_quantile(probability: float) -> float:
    """The number of standard deviations that a normal variate is below with this probability."""
    return float(_special().ndtri(probability))


def normal_below(value: ArrayLike) -> FloatArray:
    """Probability of a normal variate below a value, in standard deviations."""
    return np.asarray(_special().ndtr(value))


def chi2_quantile(probability: ArrayLike, freedom: ArrayLike) -> FloatArray:
    """What a χ² of so many degrees of freedom is below with this probability."""
    return np.asarray(2.0 * _special().gammaincinv(_array(freedom) / 2, _array(probability)))


def spread_interval(spread: float, count: int) -> tuple[float, float]:
    """95 % interval of a standard deviation that so many normal draws have; NaN of fewer than two.

    By the χ² of their squares: s sqrt(f / χ²_0.975) to s sqrt(f / χ²_0.025) of f = count - 1.
    """
    if not np.isfinite(spread) or count < 2:
        return np.nan, np.nan
    freedom = count - 1
    low, high = np.sqrt(freedom / chi2_quantile([0.975, 0.025], freedom)).tolist()
    return spread * low, spread * high


def chi2_below(value: ArrayLike, freedom: ArrayLike) -> FloatArray:
    """Probability of a χ² below a value, also where it is tiny."""
    return np.asarray(_special().chdtr(_array(freedom), _array(value)))


def chi2_tail(value: ArrayLike, freedom: ArrayLike) -> FloatArray:
    """Probability of a χ² above a value; NaN where there is no degree of freedom."""
    k = _array(freedom)
    return np.where(k > 0.0, _special().chdtrc(k, np.maximum(_array(value), 0.0)), np.nan)


def student_quantile(probability: float, freedom: float) -> float:
    """What a variate of Student's distribution is below with this probability."""
    return float(_special().stdtrit(freedom, probability))


def student_tail(value: ArrayLike, freedom: ArrayLike) -> FloatArray:
    """Probability of a variate of Student's distribution above a value."""
    return np.asarray(_special().stdtr(_array(freedom), -_array(value)))


def f_bound(probability: float, one: ArrayLike, other: ArrayLike) -> FloatArray:
    """What a variate of Fisher's F is above with this probability."""
    return np.asarray(_special().fdtri(_array(one), _array(other), 1.0 - probability), dtype=float)


def f_tail(value: float, one: float, other: float) -> float:
    """Probability of a variate of Fisher's F above a value."""
    return float(_special().fdtrc(one, other, max(value, 0.0)))


def _array(given: ArrayLike) -> FloatArray:
    return np.asarray(given, dtype=float)
