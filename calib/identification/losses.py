"""What a measurement far from the others may do: weights, and what they cost in certainty.

The weights of a loss make the estimate one of Huber's M-estimates. Under Gaussian noise, which is
what the noise of a kind means, they take something from the good measurements, too: the sum of
their squares is smaller than that of the errors, and the inverse of the weighted information is not
the covariance (Huber, Ann. Math. Statist. 35, 1964; Ann. Statist. 1, 1973). By how much are
constants of the loss, known once and for all.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Literal

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import gammaln
from scipy.stats import chi2

from calib.se3 import FloatArray, IntArray

Loss = Literal["least-squares", "huber", "cauchy", "student-t", "graduated"]

WEIGHED_DOWN: tuple[Loss, ...] = ("huber", "cauchy", "student-t")
"""Losses that leave nothing out: what contradicts the others counts little."""

Weigh = Callable[[FloatArray, IntArray], FloatArray]
"""Weights ``(N,)`` of squared residuals ``(N,)`` over their noise, of so many rows ``(N,)``."""

STUDENT_FREEDOM = 4.0
"""Degrees of freedom of the Student loss: tails as of touches by hand."""

HEAVY_TAILS = 3.0
"""Gain of the logarithm of the likelihood from which Student's noise is taken instead of Gaussian
noise: twenty to one."""

_EFFICIENCY = 0.95
"""Share of good measurements that Huber's loss leaves at full weight."""

_TINY = np.finfo(float).tiny

_NODES = 4000
"""Quantiles by which an expectation is taken: good for four digits."""


def _least_squares(s2: FloatArray, rows: IntArray) -> FloatArray:
    return np.ones_like(s2)


def _huber(s2: FloatArray, rows: IntArray) -> FloatArray:
    s, knee = np.sqrt(s2), np.sqrt(chi2.ppf(_EFFICIENCY, rows))
    return np.asarray(np.where(s <= knee, 1.0, knee / np.maximum(s, _TINY)))


def _cauchy(s2: FloatArray, rows: IntArray) -> FloatArray:
    # 2.385: 95 % efficiency for one row (Holland and Welsch 1977); scaled alike for more
    return np.asarray(1.0 / (1.0 + s2 / (2.385**2 * rows)))


def _student(s2: FloatArray, rows: IntArray) -> FloatArray:
    return np.asarray((STUDENT_FREEDOM + rows) / (STUDENT_FREEDOM + s2))


WEIGHTS: dict[str, Weigh] = {
    "least-squares": _least_squares,
    "huber": _huber,
    "cauchy": _cauchy,
    "student-t": _student,
    "graduated": _least_squares,  # of what is not left out
}


def consistency(loss: Loss, rows: int, share: float = 1.0) -> float:
    """Weighted squares of Gaussian residuals over the squares themselves.

    A variance taken from weighted residuals is divided by it: Student's and Cauchy's loss find
    0.9 of the noise otherwise.

    Parameters
    ----------
    loss : Loss
    rows : int
        Of a measurement.
    share : float
        Redundancy of a row: what of the variance of an error is left in its residual.
    """
    return _expected(loss, rows, round(share, 3))[1]


def variance_factor(loss: Loss, rows: int, share: float = 1.0) -> float:
    """Variance of an estimate over that which the weighted measurements promise.

    ``E[w² s²] E[w] / (m a²)`` with ``a = E[w s²]/m``, which for Gaussian noise is the mean
    derivative of ``w r`` as well. The weights are those of residuals, which are smaller than the
    errors: see :func:`consistency` for the parameters.
    """
    _, a, b = _expected(loss, rows, 1.0)
    return b * _expected(loss, rows, round(share, 3))[0] / a**2


@cache
def _expected(loss: Loss, rows: int, share: float) -> tuple[float, float, float]:
    """Means of w, w s²/m and w² s²/m for s² of m Gaussian rows; w of ``share`` of the s²."""
    s2 = chi2.ppf((np.arange(_NODES) + 0.5) / _NODES, rows)
    w = WEIGHTS[loss](share * s2, np.full(_NODES, rows))
    return float(w.mean()), float(np.mean(w * s2)) / rows, float(np.mean(w**2 * s2)) / rows


def log_weights(weights: FloatArray) -> float:
    """How likely the weights ``(N,)`` of Student's loss are, logarithm but for a constant.

    Student's noise is Gaussian with precisions that are drawn, about one: with them the likelihood
    of weighted squares is that of Student's, at its likeliest weights.
    """
    return float(STUDENT_FREEDOM / 2.0 * np.sum(np.log(weights) - weights))


def gain_of_student(s2: FloatArray, rows: IntArray) -> float:
    """Logarithm of how much likelier Student's noise makes residuals than Gaussian noise does.

    Each with the scale that suits it best, of squared residuals ``(N,)`` over their noise, of so
    many rows ``(N,)``.
    """
    count = float(rows.sum())
    if count == 0 or not s2.any():
        return 0.0
    gauss = -0.5 * count * (np.log(float(s2.sum()) / count) + 1.0 + np.log(2.0 * np.pi))
    nu = STUDENT_FREEDOM
    shape = gammaln((nu + rows) / 2.0) - gammaln(nu / 2.0) - rows / 2.0 * np.log(nu * np.pi)

    def unlikely(log_scale: float) -> float:
        tails = (nu + rows) / 2.0 * np.log1p(s2 / (nu * np.exp(2.0 * log_scale)))
        return float(np.sum(rows * log_scale + tails - shape))

    middle = 0.5 * np.log(float(s2.sum()) / count)
    found = minimize_scalar(unlikely, bounds=(middle - 5.0, middle + 2.0), method="bounded")
    return float(-found.fun - gauss)
