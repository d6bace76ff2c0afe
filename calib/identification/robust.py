"""Noise as the residuals show it, and measurements that contradict the others.

``huber``, ``cauchy`` and ``student-t`` weigh a measurement down by how far it is off, ``graduated``
decides which to leave out; noise that is not known is estimated with either: what the squares of
the residuals of a kind are over their redundancy (variance components: Förstner, Z.
Vermessungswesen 104, 1979), lengths and angles apart.

The weights of a loss make the estimate one of Huber's M-estimates. Under Gaussian noise, which is
what the noise of a kind means, they take something from the good measurements, too: the sum of
their squares is smaller than that of the errors, and the inverse of the weighted information is not
the covariance (Huber, Ann. Math. Statist. 35, 1964; Ann. Statist. 1, 1973). By how much are
constants of the loss, known once and for all.

Graduated truncated least squares: from the best of many fits to a few measurements each, so that no
gross error has a say in where it starts (Rousseeuw and Van Driessen, Data Min. Knowl. Discov. 12,
2006), it goes in steps from a problem with one minimum to that of truncated least squares
(graduated non-convexity: Yang et al., IEEE RA-L 5(2), 2020). Of many measurements the search takes
a part; all of them are judged by what it has found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from calib.chance import chi2_quantile
from calib.errors import ConvergenceError, InputError
from calib.identification.least_squares import ITERATIONS, minimise, orthonormal
from calib.identification.result import Loss
from calib.model import CalibrationModel, Linearisation, Setup
from calib.model.deviation import summed
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

OUTLIER_CHANCE = 1e-4
"""Probability that noise alone takes a measurement as far off as one that is left out."""

LEAST_NOISE = 1e-10
"""Noise that is estimated is no smaller [m, rad]: where readings hold none, what a prediction is
rounded by (some 1e-14) would be taken for it, and no fit comes to rest in units of that."""

_AT_ONCE = 3000
"""Measurements of all trials that are predicted at once."""

_SUSPECT_ROUNDS = 20
_TINY = np.finfo(float).tiny


def distances2(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    """Squares ``(..., N)`` of the residuals over their noise, see :func:`judged_together`.

    Without a Jacobian, and of many trials ``(T, N, n)`` with ``(T, p)`` not all at once.
    """
    if x.ndim == 1:
        each = np.sum(model.white_residuals(data, x) ** 2, axis=-1)
        return judged_together(model, data.setup, each)
    step = max(_AT_ONCE // max(data.count, 1), 1)
    parts = [slice(start, start + step) for start in range(0, len(x), step)]
    white = (model.white_residuals(data.trials(part), x[part]) for part in parts)
    each = np.concatenate([np.sum(rows**2, axis=-1) for rows in white])
    return judged_together(model, data.setup, each)


def judged_together(model: CalibrationModel, setup: Setup, each: FloatArray) -> FloatArray:
    """Return sums ``(..., N)`` over what is judged together, of ``(..., N)``.

    A measurement is judged alone, unless the arm deviates at a stop: then all that was measured
    there is off together, and is judged as one.
    """
    if model.arm_sigma is None or setup.stop is None:
        return np.asarray(each)
    last = np.moveaxis(each, -1, 0)
    return np.asarray(np.moveaxis(summed(last, setup.stop)[setup.stop], 0, -1))


def rows_judged(model: CalibrationModel, setup: Setup) -> IntArray:
    """Return the rows ``(N,)`` that are judged together with each measurement."""
    rows = model.rows_read(setup)
    return np.round(judged_together(model, setup, rows.astype(float))).astype(np.intp)


def redundancy(linear: Linearisation, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted residuals over their noise ``(N, m)``, and the redundancy of each ``(N, m)``."""
    linear, seen = linear.weighed(weights), linear.view.setup.seen
    rows = linear.white_rows
    Q = orthonormal(linear.stacked()[1])[: rows.size]
    free = 1.0 - np.sum(Q**2, axis=1).reshape(rows.shape)
    return rows, free if seen is None else free * seen


def noise_scales(
    linear: Linearisation, weights: FloatArray, *, needed: bool = False
) -> list[FloatArray]:
    """What the residuals of each kind are over its noise, ``(m,)`` each; redundancy considered.

    1 for a kind that nothing is measured with, or whose every measurement is needed. Where the
    noise is estimated, not so little that it would be below :data:`LEAST_NOISE`. Weights ``(N,)``
    are such that the weighted squares of Gaussian residuals are as large as the squares.

    Kinds of unknown noise that do not show it are refused where it is ``needed``.
    """
    rows, free = redundancy(linear, weights)
    scales = []
    for k, kind in enumerate(linear.model.measurements):
        own = (linear.view.setup.kind == k) & (weights > 0)
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


def costs_of(
    linear: Linearisation, weights: FloatArray, loss: Loss
) -> tuple[FloatArray, FloatArray]:
    """Consistency and variance factor of a loss for each measurement: ``(N,)`` and ``(N,)``."""
    usual, factor = np.ones(len(weights)), np.ones(len(weights))
    if loss in WEIGHED_DOWN:
        model, setup = linear.model, linear.view.setup
        _, free = redundancy(linear, weights)
        read, rows = model.rows_read(setup), rows_judged(model, setup)
        for k, count in np.unique(np.column_stack([setup.kind, rows]), axis=0).tolist():
            own = (setup.kind == k) & (rows == count)
            share = float(np.clip(free[own].sum() / max(read[own].sum(), 1), 0.0, 1.0))
            usual[own] = consistency(loss, count, share)
            factor[own] = variance_factor(loss, count, share)
    return usual, factor


def spread(model: CalibrationModel, setup: Setup, s2: FloatArray) -> FloatArray:
    """Variance over the noise given, by the median of a kind, of each measurement ``(N,)``."""
    over = s2 / chi2_quantile(0.5, np.maximum(rows_judged(model, setup), 1))
    each = [over[setup.kind == k] for k in range(len(model.measurements))]
    found = [float(np.median(own)) if own.size else 1.0 for own in each]
    return _at_least_given(model, found)[setup.kind]


def limits(linear: Linearisation, good: BoolArray) -> tuple[FloatArray, list[FloatArray]]:
    """Squares ``(N,)`` beyond which a measurement is not noise, by the noise of the good ones.

    And what that noise is over the one given, see :func:`noise_scales`.
    """
    model, setup = linear.model, linear.view.setup
    scales = noise_scales(linear, good.astype(float))
    variances = _at_least_given(model, [float(np.mean(scale**2)) for scale in scales])
    return by_chance(model, setup) * variances[setup.kind], scales


def by_chance(model: CalibrationModel, setup: Setup) -> FloatArray:
    """Squares ``(N,)`` of residuals over their noise that noise alone does not exceed."""
    return chi2_quantile(1.0 - OUTLIER_CHANCE, rows_judged(model, setup))


def suspects(linear: Linearisation) -> BoolArray:
    """Measurements ``(N,)`` that are farther off than noise takes one, at a solution.

    By the noise given, or that of the residuals of the others where this is larger.
    """
    model, setup = linear.model, linear.view.setup
    s2 = judged_together(model, setup, linear.squares)
    good = s2 <= by_chance(model, setup) * spread(model, setup, s2)
    for _ in range(_SUSPECT_ROUNDS):
        before, good = good, s2 <= limits(linear, good)[0]
        if (before == good).all():
            break
    return ~good


def _at_least_given(model: CalibrationModel, variances: list[float]) -> FloatArray:
    """Variances of the kinds, not below the noise given: good luck makes nothing an outlier."""
    floors = [0.0 if kind.estimated else 1.0 for kind in model.measurements]
    return np.maximum(variances, np.maximum(floors, _TINY))


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
    s2 = _nodes(rows)
    w = WEIGHTS[loss](share * s2, np.full(_NODES, rows))
    return float(w.mean()), float(np.mean(w * s2)) / rows, float(np.mean(w**2 * s2)) / rows


@cache
def _nodes(rows: int) -> FloatArray:
    """Quantiles of the squares of m Gaussian rows."""
    return chi2_quantile((np.arange(_NODES) + 0.5) / _NODES, rows)


def log_weights(weights: FloatArray, counts: FloatArray | float = 1.0) -> float:
    """How likely the weights ``(N,)`` of Student's loss are, logarithm but for a constant.

    ``counts`` (N,): the share of each, where several are one weight.

    Student's noise is Gaussian with precisions that are drawn, about one: with them the likelihood
    of weighted squares is that of Student's, at its likeliest weights.
    """
    return float(STUDENT_FREEDOM / 2.0 * np.sum(counts * (np.log(weights) - weights)))


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


_ROUNDS = 100
_SETTLED = 1e-3
"""Change of weights and of the logarithm of the noise below which they have settled: residuals are
then known to a hundredth of a standard deviation of any parameter."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit with the noise and the weights that belong to it."""

    model: CalibrationModel  # with the noise of its kinds as given or as estimated
    x: FloatArray  # (p,) [SI]
    iterations: int
    weights: FloatArray  # (N,): of the squares of each measurement
    outliers: BoolArray  # (N,): left out
    suspects: BoolArray  # (N,): farther off than noise takes one, but not left out
    consistency: FloatArray
    """(N,): of the loss: weighted squares of residuals are divided by it, in the fit as well, so
    that they stand against what is known besides as the noise says."""
    inflation: FloatArray
    """(N,): variance over what the weighted measurements promise: their information is divided by
    it."""


def fit_robustly(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    *,
    loss: Loss = "least-squares",
    weighted: bool = True,
    near: bool = False,
) -> Solved:
    """Fit from parameters ``(p,)``, with the weights of a loss and the noise that is not known.

    ``near`` says that the parameters are a fit already, by which measurements can be weighed.

    Raises
    ------
    InputError
        More than half of the measurements would have to be left out, or a noise cannot be
        estimated.
    ConvergenceError
        No minimum within the iterations allowed, or weights and noise that do not come to rest.
    """
    good = np.ones(data.count, dtype=bool)
    if loss == "graduated":
        x, good = choose(model, data, x)
    rows, weigh = rows_judged(model, data.setup), WEIGHTS[loss]
    weights = good.astype(float)
    linear = model.linearise_at(data, x)
    if near and loss in WEIGHED_DOWN:
        weights = weigh(judged_together(model, data.setup, linear.squares), rows)
    estimated = any(kind.estimated for kind in model.measurements)
    total, moved = 0, 0.0
    for _ in range(_ROUNDS):  # fit, weigh and estimate the noise in turns, until nothing moves
        shares = weights / costs_of(linear, weights, loss)[0]
        fit = minimise(model, data.trials(None), x[None], weights=shares[None], weighted=weighted)
        if not np.isfinite(fit.x).all():
            break
        x, total = fit.x[0], total + fit.iterations
        linear = model.linearise_at(data, x)
        if loss not in WEIGHED_DOWN and not estimated:
            break
        moved = 0.0
        if estimated:
            scales = noise_scales(linear, shares, needed=True)
            kinds = list(zip(model.measurements, scales, strict=True))
            moved = max(float(np.abs(np.log(s)).max()) for kind, s in kinds if kind.estimated)
            model = model.with_measurements(
                [kind.with_noise(scale) if kind.estimated else kind for kind, scale in kinds]
            )
            linear = linear.by(model)
        squares = judged_together(model, data.setup, linear.squares)
        new = np.where(weights > 0, weigh(squares, rows), 0.0)
        moved = max(moved, float(np.abs(new - weights).max(initial=0.0)))
        weights = new
        if moved < _SETTLED:
            break
    if not fit.converged[0]:  # on the way there weights and noise may make it slow
        raise not_converged(float(fit.change[0]))
    if moved >= _SETTLED:
        raise ConvergenceError(
            f"weights and noise have not come to rest after {_ROUNDS} rounds (the last one still "
            f"moved them by {moved:.2g})",
            hint="give the noise of each kind, or measure more poses",
        )
    consistency, inflation = costs_of(linear, weights, loss)
    doubtful = suspects(linear) & good if loss in WEIGHED_DOWN else np.zeros_like(good)
    return Solved(model, x, total, weights, ~good, doubtful, consistency, inflation)


def not_converged(change: float) -> ConvergenceError:
    """The error of a fit that has not come to rest."""
    return ConvergenceError(
        f"the identification has not converged after {ITERATIONS} iterations "
        f"(the last one still moved the predictions by {change:.2g} times the noise)",
        hint="check that the measurements belong to this robot and that the tool point and "
        "the joint signs are about right",
    )


DISAGREEMENT = 30.0
"""Residuals of what was not left out, over the noise given, beyond which nothing can be said to
contradict it: what a model leaves out of a real arm is below that, what half of the measurements
would have to agree upon if the other half were wrong as well."""

_GRADUATED_ROUNDS = 60
_GRADUATION = 1.4
"""Growth of the shape of the loss from step to step (Yang et al.)."""

_STARTS, _BETTER, _BEST = 400, 10, 5
_PREDICTED_AT_MOST = 100_000
"""Measurements that are predicted to judge all starts by."""

_SEARCHED = 300
_SEARCHED_PER_NEEDED = 10
"""Measurements to search among: as many, or so many times those that the parameters need."""


def choose(
    model: CalibrationModel, data: Measurements, x: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Which measurements to keep, ``(N,)``, and the fit to them, ``(p,)``; from parameters.

    The draws are always the same ones, so that a result can be had again.
    """
    rng = np.random.default_rng(0)
    needed = _needed(model, data, x)
    part = data
    most = max(_SEARCHED, _SEARCHED_PER_NEEDED * needed)
    if most < data.count:
        counts = _shares(_classes(data), most)
        part = data[np.sort(_drawn(_classes(data), counts, 1, rng)[0])]
        needed = _needed(model, part, x)
    x = _best_of_many(model, part, x, needed, rng)
    x = _graduate(model, part, x)
    s2 = distances2(model, data, x)
    limit = by_chance(model, data.setup) * spread(model, data.setup, s2)
    return _settle(model, data, x, s2 <= limit)


def _graduate(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    """From a loss with one minimum to that of truncated least squares: parameters ``(p,)``."""
    chance = by_chance(model, data.setup)
    s2 = distances2(model, data, x)
    limit = chance * spread(model, data.setup, s2)
    shape = 1.0 / max(float(np.max(2.0 * s2 / limit)) - 1.0, 1e-3)
    for _ in range(_GRADUATED_ROUNDS):
        weights = _truncated(s2, limit, shape)
        x = minimise(model, data.trials(None), x[None], weights=weights[None]).x[0]
        s2 = distances2(model, data, x)
        limit = chance * spread(model, data.setup, s2)
        shape *= _GRADUATION
        if ((weights == 0) | (weights == 1)).all() and shape > 1.0:
            break
    return x


def _settle(
    model: CalibrationModel, data: Measurements, x: FloatArray, good: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """The median has chosen the good ones; now by the noise that these have."""
    for _ in range(_GRADUATED_ROUNDS):
        _refuse_most(good, data)
        x = minimise(model, data.trials(None), x[None], weights=good[None].astype(float)).x[0]
        linear = model.linearise_at(data, x)
        limit, scales = limits(linear, good)
        squares = judged_together(model, data.setup, linear.squares)
        before, good = good, squares <= limit
        if (before == good).all():
            break
    _refuse_disagreement(model, scales, good)
    return x, good


def _truncated(s2: FloatArray, limit: FloatArray, shape: float) -> FloatArray:
    """Weights of truncated least squares made smooth: sharp where ``shape`` is large."""
    between = np.sqrt(limit * shape * (shape + 1.0) / np.maximum(s2, _TINY)) - shape
    low, high = limit * shape / (shape + 1.0), limit * (shape + 1.0) / shape
    return np.where(s2 <= low, 1.0, np.where(s2 >= high, 0.0, np.clip(between, 0.0, 1.0)))


def _needed(model: CalibrationModel, data: Measurements, x: FloatArray) -> int:
    """Measurements with as many equations as parameters that they, not the priors, decide on.

    Few measurements decide on fewer parameters than all of them do: the trace of the information
    of so many in that of the posterior.
    """
    linear = model.linearise_at(data, x)
    Q = orthonormal(linear.stacked()[1])[linear.rows_last.size :]
    held = np.clip(np.linalg.eigvalsh(Q.T @ Q), 0.0, 1.0)
    told = np.arange(1, data.count + 1)[:, None] / data.count * (1.0 - held)
    decided = np.sum(told / np.maximum(told + held, _TINY), axis=1)
    equations = np.arange(1, data.count + 1) * float(np.mean(model.rows_read(data.setup)))
    enough = np.flatnonzero(equations >= decided - 1e-6)
    return int(enough[0]) + 1 if enough.size else data.count


def _classes(data: Measurements) -> IntArray:
    """Index ``(N,)`` of those that measurements of one set-up share."""
    setup = data.setup
    every = np.stack([setup.kind, setup.tool, setup.target, setup.payload], axis=1)
    return np.asarray(np.unique(every, axis=0, return_inverse=True)[1]).reshape(-1)


def _shares(classes: IntArray, count: int) -> IntArray:
    """How many of each class make ``count``, or more where each has to have one."""
    sizes = np.bincount(classes)
    counts = np.maximum(sizes * count // len(classes), 1)
    for k in np.argsort(-sizes / counts, kind="stable"):
        if counts.sum() >= count:
            break
        counts[k] += int(counts[k] < sizes[k])
    return np.asarray(counts)


def _drawn(classes: IntArray, counts: IntArray, draws: int, rng: np.random.Generator) -> IntArray:
    """Indices ``(draws, sum of counts)``: so many of each class, class after class."""
    found = []
    for k, count in enumerate(counts.tolist()):
        own = np.flatnonzero(classes == k)
        order = np.argsort(rng.random((draws, len(own))), axis=1)
        found.append(own[order[:, :count]])
    return np.concatenate(found, axis=1)


def _gathered(data: Measurements, index: IntArray) -> Measurements:
    """Trials ``(T, K, n)`` of other measurements each, all of one set-up."""
    return Measurements(
        data.postures[index],
        data.setup[index[0]],
        data.targets,
        data.tools,
        None if data.observed is None else data.observed[index],
    )


def _best_of_many(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    needed: int,
    rng: np.random.Generator,
) -> FloatArray:
    """The fit with the smallest sum over the better half, of many that start from few.

    Least trimmed squares: half of the measurements, and as many more as there are parameters for.
    """
    classes, count = _classes(data), data.count
    starts = int(np.clip(_PREDICTED_AT_MOST // count, 20, _STARTS))
    index = _drawn(classes, _shares(classes, min(needed + 2, count)), starts, rng)
    few = _gathered(data, index)
    fits = minimise(model, few, np.tile(x, (starts, 1)), iterations=6).x
    fits[0] = minimise(model, data.trials(None), x[None], iterations=6).x[0]  # and that to all
    half = min((count + needed + 1) // 2, count)
    for kept, steps in ((_BETTER, 4), (_BEST, 12), (_BEST, 12), (_BEST, 0)):
        s2 = distances2(model, data.repeated(len(fits)), fits)
        s2 = np.nan_to_num(s2, nan=np.inf)
        value = np.sort(s2, axis=1)[:, :half].sum(axis=1)
        best = np.argsort(value)[:kept]
        if not steps:
            break
        chosen = np.zeros((len(best), count))
        np.put_along_axis(chosen, np.argsort(s2[best], axis=1)[:, :half], 1.0, axis=1)
        every = data.repeated(len(best))
        fits = minimise(model, every, fits[best], weights=chosen, iterations=steps).x
    return np.asarray(fits[best[0]])


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
