"""Noise as the residuals show it, and who is beyond it.

The noise of a kind that has none is estimated: what the squares of its residuals are over their
redundancy (variance components: Förstner, Z. Vermessungswesen 104, 1979), lengths and angles apart.

What a measurement far from the others may do: weights, and what they cost in certainty.

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

from calib.chance import chi2_quantile
from calib.errors import InputError
from calib.identification.least_squares import orthonormal
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

OUTLIER_CHANCE = 1e-4
"""Probability that noise alone takes a measurement as far off as one that is left out."""

LEAST_NOISE = 1e-10
"""Noise that is estimated is no smaller [m, rad]: where readings hold none, what a prediction is
rounded by (some 1e-14) would be taken for it, and no fit comes to rest in units of that."""

_AT_ONCE = 3000
"""Measurements of all trials that are predicted at once."""

_ROUNDS = 20
_TINY = np.finfo(float).tiny


def distances2(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    """Squares of the residuals over their noise, summed over a measurement: ``(..., N)``.

    Without a Jacobian, and of many trials ``(T, N, n)`` with ``(T, p)`` not all at once.
    """
    if x.ndim == 1:
        return _squares(model, data, x)
    step = max(_AT_ONCE // max(data.count, 1), 1)
    parts = [slice(start, start + step) for start in range(0, len(x), step)]
    return np.concatenate([_squares(model, data.trials(part), x[part]) for part in parts])


def _squares(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    white = model.white_residuals(data, x)
    return np.asarray(np.sum(white**2, axis=-1))


def redundancy(
    model: CalibrationModel, data: Measurements, x: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted residuals over their noise ``(N, m)``, and the redundancy of each ``(N, m)``."""
    linear = model.linearise_at(data, x).weighed(weights)
    rows = linear.white_rows
    Q = orthonormal(linear.stacked(x)[1])[: rows.size]
    free = 1.0 - np.sum(Q**2, axis=1).reshape(rows.shape)
    return rows, free if data.setup.seen is None else free * data.setup.seen


def noise_scales(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray,
    *,
    needed: bool = False,
) -> list[FloatArray]:
    """What the residuals of each kind are over its noise, ``(m,)`` each; redundancy considered.

    1 for a kind that nothing is measured with, or whose every measurement is needed. Where the
    noise is estimated, not so little that it would be below :data:`LEAST_NOISE`. Weights ``(N,)``
    are such that the weighted squares of Gaussian residuals are as large as the squares.

    Kinds of unknown noise that do not show it are refused where it is ``needed``.
    """
    rows, free = redundancy(model, data, x, weights)
    scales = []
    for k, kind in enumerate(model.measurements):
        own = (data.setup.kind == k) & (weights > 0)
        scale = np.ones(kind.rows)
        for part in (slice(0, kind.rows - kind.turns), slice(kind.rows - kind.turns, kind.rows)):
            spare = float(free[own][:, part].sum())
            squares = float(np.sum(rows[own][:, part] ** 2))
            if spare > 1.0 and squares > 0.0:
                scale[part] = np.sqrt(squares / spare)
            elif needed and spare <= 1.0 and kind.estimated and own.any() and scale[part].size:
                several = "" if (count := int(own.sum())) == 1 else "s"
                raise InputError(
                    f"the noise of the kind {kind.name} cannot be estimated from {count} "
                    f"measurement{several}: give it",
                    hint="name the sigma of the kind under [[noise]], or measure more poses",
                    name="noise",
                    value=count,
                )
        scales.append(np.maximum(scale, LEAST_NOISE / kind.sigma) if kind.estimated else scale)
    return scales


def _share(free: FloatArray) -> float:
    """Mean redundancy of rows; 1 of none."""
    return float(np.clip(free.mean(), 0.0, 1.0)) if free.size else 1.0


def costs_of(
    model: CalibrationModel, data: Measurements, x: FloatArray, weights: FloatArray, loss: Loss
) -> tuple[FloatArray, FloatArray]:
    """Consistency and variance factor of a loss for each measurement: ``(N,)`` and ``(N,)``."""
    usual, factor = np.ones(data.count), np.ones(data.count)
    if loss in ("least-squares", "graduated"):
        return usual, factor
    _, free = redundancy(model, data, x, weights)
    for k, kind in enumerate(model.measurements):
        own = data.setup.kind == k
        share = _share(free[own][:, : kind.rows])
        usual[own] = consistency(loss, kind.rows, share)
        factor[own] = variance_factor(loss, kind.rows, share)
    return usual, factor


def rescaled(model: CalibrationModel, scales: list[FloatArray]) -> CalibrationModel:
    """The model with the noise of kinds that are estimated times a factor."""
    kinds = [
        kind.with_noise(scale) if kind.estimated else kind
        for kind, scale in zip(model.measurements, scales, strict=True)
    ]
    return model.with_measurements(kinds)


def spread(model: CalibrationModel, data: Measurements, s2: FloatArray) -> FloatArray:
    """Variance over the noise given, by the median of a kind, of each measurement ``(N,)``."""
    found, rows = [], np.maximum(model.rows_read(data.setup), 1)
    for k in range(len(model.measurements)):
        own = data.setup.kind == k
        usual = chi2_quantile(0.5, rows[own])
        found.append(float(np.median(s2[own] / usual)) if own.any() else 1.0)
    return _at_least_given(model, found)[data.setup.kind]


def limits(
    model: CalibrationModel, data: Measurements, x: FloatArray, good: BoolArray
) -> tuple[FloatArray, list[FloatArray]]:
    """Squares ``(N,)`` beyond which a measurement is not noise, by the noise of the good ones.

    And what that noise is over the one given, see :func:`noise_scales`.
    """
    scales = noise_scales(model, data, x, good.astype(float))
    variances = _at_least_given(model, [float(np.mean(scale**2)) for scale in scales])
    return by_chance(model, data) * variances[data.setup.kind], scales


def by_chance(model: CalibrationModel, data: Measurements) -> FloatArray:
    """Squares ``(N,)`` of residuals over their noise that noise alone does not exceed."""
    return chi2_quantile(1.0 - OUTLIER_CHANCE, model.rows_read(data.setup))


def suspects(model: CalibrationModel, data: Measurements, x: FloatArray) -> BoolArray:
    """Measurements ``(N,)`` that are farther off than noise takes one, at parameters ``(p,)``.

    By the noise given, or that of the residuals of the others where this is larger.
    """
    s2 = distances2(model, data, x)
    good = s2 <= by_chance(model, data) * spread(model, data, s2)
    for _ in range(_ROUNDS):
        limit, _ = limits(model, data, x, good)
        before, good = good, s2 <= limit
        if (before == good).all():
            break
    return ~good


def _at_least_given(model: CalibrationModel, variances: list[float]) -> FloatArray:
    """Variances of the kinds, not below the noise given: good luck makes nothing an outlier."""
    floors = [0.0 if kind.estimated else 1.0 for kind in model.measurements]
    return np.maximum(variances, np.maximum(floors, _TINY))


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


_NODES = 4000
"""Quantiles by which an expectation is taken: good for four digits."""


def _least_squares(s2: FloatArray, rows: IntArray) -> FloatArray:
    return np.ones_like(s2)


def _huber(s2: FloatArray, rows: IntArray) -> FloatArray:
    s, knee = np.sqrt(s2), np.sqrt(chi2_quantile(_EFFICIENCY, rows))
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
    s2 = chi2_quantile((np.arange(_NODES) + 0.5) / _NODES, rows)
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
    from scipy.optimize import minimize_scalar
    from scipy.special import gammaln

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
