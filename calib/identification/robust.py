"""Measurements that contradict the others, and noise that nobody has given.

``huber``, ``cauchy`` and ``student-t`` weigh a measurement down by how far it is off. ``graduated``
decides which measurements to leave out: from the best of many fits to a few measurements each, so
that no gross error has a say in where it starts (Rousseeuw and Van Driessen, Data Min. Knowl.
Discov. 12, 2006), it goes in steps from a problem with one minimum to that of truncated least
squares (graduated non-convexity: Yang et al., IEEE RA-L 5(2), 2020).

The noise of a kind that has none is estimated: what the squares of its residuals are over their
redundancy (variance components: Förstner, Z. Vermessungswesen 104, 1979), lengths and angles apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2

from calib.errors import ConvergenceError, InputError
from calib.identification.least_squares import ITERATIONS, minimise
from calib.linearisation import Linearisation
from calib.measurement.data import Measurements
from calib.model import CalibrationModel
from calib.se3 import BoolArray, FloatArray, IntArray

Loss = Literal["least-squares", "huber", "cauchy", "student-t", "graduated"]

STUDENT_FREEDOM = 4.0
"""Degrees of freedom of the Student loss: tails as of touches by hand."""

_EFFICIENCY = 0.95
"""Share of good measurements that Huber's loss leaves at full weight."""

OUTLIER_CHANCE = 1e-4
"""Probability that noise alone takes a measurement as far off as one that is left out."""

DISAGREEMENT = 30.0
"""Residuals of what was not left out, over the noise given, beyond which nothing can be said to
contradict it: what a model leaves out of a real arm is below that, what half of the measurements
would have to agree upon if the other half were wrong as well."""

_ROUNDS = 60
_SETTLED = 1e-4
"""Change of weights and of the logarithm of the noise below which they have settled."""

_STARTS, _LINEARISED_AT_MOST, _BEST = 400, 40_000, 5
_GRADUATION = 1.4
"""Growth of the shape of the loss from step to step (Yang et al.)."""

_TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit with the noise and the weights that belong to it.

    Attributes
    ----------
    model : CalibrationModel
        With the noise of its kinds as given or as estimated.
    x : array (p,)
        [SI]
    weights : array (N,)
        Of the squares of each measurement.
    outliers : array (N,) of bool
        Left out.
    iterations : int
    """

    model: CalibrationModel
    x: FloatArray
    weights: FloatArray
    outliers: BoolArray
    iterations: int


def fit_robustly(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    *,
    loss: Loss = "least-squares",
    weighted: bool = True,
) -> Solved:
    """Fit from parameters ``(p,)``, with the weights of a loss and the noise that is not known.

    Raises
    ------
    InputError
        More than half of the measurements would have to be left out.
    ConvergenceError
        No minimum within the iterations allowed.
    """
    if loss == "graduated":
        return _graduated(model, data, x)
    weigh = WEIGHTS[loss]
    return _alternate(model, data, x, np.ones(data.count), weigh, weighted=weighted)


def _alternate(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray,
    weigh: Callable[[FloatArray, IntArray], FloatArray],
    *,
    weighted: bool = True,
) -> Solved:
    """Fit, weigh and estimate the noise in turns, until nothing moves."""
    rows = _rows_of(model, data)
    estimated = any(kind.estimated for kind in model.measurements)
    total = 0
    for _ in range(_ROUNDS):
        fit = minimise(model, data.trials(None), x[None], weights=weights[None], weighted=weighted)
        if not np.isfinite(fit.x).all():
            break
        x, total = fit.x[0], total + fit.iterations
        if weigh is _least_squares and not estimated:
            break
        moved = 0.0
        if estimated:
            scales = noise_scales(model, data, x, weights)
            model = _rescaled(model, scales)
            moved = max(
                float(np.abs(np.log(scale)).max())
                for kind, scale in zip(model.measurements, scales, strict=True)
                if kind.estimated
            )
        new = np.where(weights > 0, weigh(distances2(model, data, x), rows), 0.0)
        moved = max(moved, float(np.abs(new - weights).max(initial=0.0)))
        weights = new
        if moved < _SETTLED:
            break
    if not fit.converged[0]:  # on the way there weights and noise may make it slow
        raise not_converged(float(fit.change[0]))
    return Solved(model, x, weights, weights == 0, total)


def distances2(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    """Squares of the residuals over their noise, summed over a measurement: ``(..., N)``."""
    linear = model.linearise(data.postures, x, data.setup, data.observed)
    white = linear.white_rows
    return np.asarray(np.sum(white**2, axis=-1))


def noise_scales(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray,
    linear: Linearisation | None = None,
) -> list[FloatArray]:
    """What the residuals of each kind are over its noise, ``(m,)`` each; redundancy considered.

    1 for a kind that nothing is measured with, or whose every measurement is needed. ``linear`` is
    the linearisation at x where it is there already.
    """
    if linear is None:
        linear = model.linearise(data.postures, x, data.setup, data.observed)
    root = np.sqrt(weights)[:, None]
    rows, J = linear.white_rows * root, linear.white_jacobian * root[..., None]
    known = model.known(x[None])[1][0]
    stacked = np.concatenate([J.reshape(-1, model.p), known])
    length = np.linalg.norm(stacked, axis=0)
    Q = np.linalg.qr(stacked / np.where(length > 0, length, 1.0))[0][: rows.size]
    free = 1.0 - np.sum(Q**2, axis=1).reshape(rows.shape)  # redundancy of each row
    scales = []
    for k, kind in enumerate(model.measurements):
        own = (data.setup.kind == k) & (weights > 0)
        scale = np.ones(kind.rows)
        for part in (slice(0, kind.rows - kind.turns), slice(kind.rows - kind.turns, kind.rows)):
            redundancy = float(free[own][:, part].sum())
            squares = float(np.sum(rows[own][:, part] ** 2))
            if redundancy > 1.0 and squares > 0.0:
                scale[part] = np.sqrt(squares / redundancy)
        scales.append(scale)
    return scales


def _rescaled(model: CalibrationModel, scales: list[FloatArray]) -> CalibrationModel:
    kinds = [
        kind.with_noise(scale) if kind.estimated else kind
        for kind, scale in zip(model.measurements, scales, strict=True)
    ]
    return model.with_measurements(kinds)


def _rows_of(model: CalibrationModel, data: Measurements) -> IntArray:
    return np.array([kind.rows for kind in model.measurements])[data.setup.kind]


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


WEIGHTS: dict[str, Callable[[FloatArray, IntArray], FloatArray]] = {
    "least-squares": _least_squares,
    "huber": _huber,
    "cauchy": _cauchy,
    "student-t": _student,
}


def _graduated(model: CalibrationModel, data: Measurements, x: FloatArray) -> Solved:
    """Leave out what contradicts the rest; then least squares of the others."""
    rows = _rows_of(model, data)
    chance = chi2.ppf(1.0 - OUTLIER_CHANCE, rows)
    x = _best_of_many(model, data, x, rows)
    s2 = distances2(model, data, x)
    limit = chance * _spread(model, data, s2)
    shape = 1.0 / max(float(np.max(2.0 * s2 / limit)) - 1.0, 1e-3)
    for _ in range(_ROUNDS):
        weights = _truncated(s2, limit, shape)
        x = minimise(model, data.trials(None), x[None], weights=weights[None]).x[0]
        s2 = distances2(model, data, x)
        limit = chance * _spread(model, data, s2)
        shape *= _GRADUATION
        if ((weights == 0) | (weights == 1)).all() and shape > 1.0:
            break
    good = s2 <= limit
    for _ in range(_ROUNDS):  # the median has chosen; now with the noise that the good ones have
        _refuse_most(good, data)
        x = minimise(model, data.trials(None), x[None], weights=good[None].astype(float)).x[0]
        s2 = distances2(model, data, x)
        scales = noise_scales(model, data, x, good.astype(float))
        limit = (
            chance * _at_least_given(model, [float(np.mean(s**2)) for s in scales])[data.setup.kind]
        )
        before, good = good, s2 <= limit
        if (before == good).all():
            break
    _refuse_disagreement(model, scales, good)
    return _alternate(model, data, x, good.astype(float), _least_squares)


def _truncated(s2: FloatArray, limit: FloatArray, shape: float) -> FloatArray:
    """Weights of truncated least squares made smooth: sharp where ``shape`` is large."""
    between = np.sqrt(limit * shape * (shape + 1.0) / np.maximum(s2, _TINY)) - shape
    low, high = limit * shape / (shape + 1.0), limit * (shape + 1.0) / shape
    return np.where(s2 <= low, 1.0, np.where(s2 >= high, 0.0, np.clip(between, 0.0, 1.0)))


def _spread(model: CalibrationModel, data: Measurements, s2: FloatArray) -> FloatArray:
    """Variance over the noise given, by the median of a kind, of each measurement ``(N,)``."""
    found = []
    for k, kind in enumerate(model.measurements):
        own = s2[data.setup.kind == k]
        found.append(float(np.median(own) / chi2.median(kind.rows)) if own.size else 1.0)
    return _at_least_given(model, found)[data.setup.kind]


def _at_least_given(model: CalibrationModel, variances: list[float]) -> FloatArray:
    """Variances of the kinds, not below the noise given: good luck makes nothing an outlier."""
    floors = [0.0 if kind.estimated else 1.0 for kind in model.measurements]
    return np.maximum(variances, np.maximum(floors, _TINY))


def _best_of_many(
    model: CalibrationModel, data: Measurements, x: FloatArray, rows: IntArray
) -> FloatArray:
    """The fit with the smallest sum over the better half, of many that start from few.

    Least trimmed squares: half of the measurements, and as many more as there are parameters for.
    The draws are always the same ones, so that a result can be had again.
    """
    rng = np.random.default_rng(0)
    count = data.count
    needed = int(np.ceil(model.p / float(np.mean(rows))))
    starts = int(np.clip(_LINEARISED_AT_MOST // count, 20, _STARTS))
    few, half = min(needed + 2, count), min((count + needed + 1) // 2, count)
    order = np.argsort(rng.random((starts, count)), axis=1)
    chosen = _ones_at(order[:, :few], count)
    chosen[0] = 1.0  # and the fit to all
    fits = np.tile(x, (starts, 1))
    for kept, steps in ((starts, 6), (starts, 4), (_BEST, 12), (_BEST, 12), (_BEST, 12)):
        fits = minimise(model, data.repeated(len(fits)), fits, weights=chosen, iterations=steps).x
        s2 = np.nan_to_num(distances2(model, data.repeated(len(fits)), fits), nan=np.inf)
        value = np.sort(s2, axis=1)[:, :half].sum(axis=1)
        best = np.argsort(value)[:kept]
        fits, s2 = fits[best], s2[best]
        chosen = _ones_at(np.argsort(s2, axis=1)[:, :half], count)
    return np.asarray(fits[0])


def _ones_at(index: IntArray, count: int) -> FloatArray:
    out = np.zeros((len(index), count))
    np.put_along_axis(out, index, 1.0, axis=1)
    return out


def _refuse_most(good: BoolArray, data: Measurements) -> None:
    bad = int((~good).sum())
    if 2 * bad > data.count:
        raise InputError(
            f"{bad} of {data.count} measurements contradict the others: which of them are right "
            "cannot be told",
            hint="are all of them of this robot, this tool and these targets?",
            name="measurements",
            value=bad,
            bound=data.count // 2,
        )


def _refuse_disagreement(
    model: CalibrationModel, scales: list[FloatArray], good: BoolArray
) -> None:
    given = zip(model.measurements, scales, strict=True)
    worst = max((float(scale.max()) for kind, scale in given if not kind.estimated), default=0.0)
    if worst > DISAGREEMENT and not good.all():
        raise InputError(
            f"the measurements contradict each other: even those that agree best are {worst:.0f} "
            "times the noise given apart",
            hint="more than half of them may be wrong, or the noise is far larger: without a noise "
            "given it is estimated",
            name="measurements",
            value=worst,
            bound=DISAGREEMENT,
        )


def not_converged(change: float) -> ConvergenceError:
    """The error of a fit that has not come to rest."""
    return ConvergenceError(
        f"the identification has not converged after {ITERATIONS} iterations "
        f"(the last one still moved the predictions by {change:.2g} times the noise)",
        hint="check that the measurements belong to this robot and that the tool point and "
        "the joint signs are about right",
    )
