"""Measurements that contradict the others.

``huber``, ``cauchy`` and ``student-t`` weigh a measurement down by how far it is off, ``graduated``
decides which to leave out; noise that is not known is estimated with either:
:mod:`calib.identification.noise`.

Graduated truncated least squares: from the best of many fits to a few measurements each, so that no
gross error has a say in where it starts (Rousseeuw and Van Driessen, Data Min. Knowl. Discov. 12,
2006), it goes in steps from a problem with one minimum to that of truncated least squares
(graduated non-convexity: Yang et al., IEEE RA-L 5(2), 2020). Of many measurements the search takes
a part; all of them are judged by what it has found.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib.errors import ConvergenceError, InputError
from calib.identification.least_squares import ITERATIONS, minimise, orthonormal
from calib.identification.noise import (
    WEIGHED_DOWN,
    WEIGHTS,
    Loss,
    by_chance,
    costs_of,
    distances2,
    limits,
    noise_scales,
    rescaled,
    spread,
    suspects,
)
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

_ROUNDS = 100
_SETTLED = 1e-3
"""Change of weights and of the logarithm of the noise below which they have settled: residuals are
then known to a hundredth of a standard deviation of any parameter."""


def _one() -> FloatArray:
    return np.ones(1)


def _nobody() -> BoolArray:
    return np.zeros(1, dtype=bool)


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit with the noise and the weights that belong to it."""

    model: CalibrationModel  # with the noise of its kinds as given or as estimated
    x: FloatArray  # (p,) [SI]
    weights: FloatArray  # (N,): of the squares of each measurement
    outliers: BoolArray  # (N,): left out
    iterations: int
    loss: Loss = "least-squares"  # that the weights are of
    suspects: BoolArray = field(default_factory=_nobody)
    """(N,) or (1,): farther off than noise takes one, but not left out: see
    :func:`noise.suspects`."""
    consistency: FloatArray = field(default_factory=_one)
    """(N,) or (1,): of the loss: weighted squares of residuals are divided by it, in the fit as
    well, so that they stand against what is known besides as the noise says."""
    inflation: FloatArray = field(default_factory=_one)
    """(N,) or (1,): variance over what the weighted measurements promise: their information is
    divided by it."""


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
    weights = good.astype(float)
    if near and loss in WEIGHED_DOWN:
        weights = WEIGHTS[loss](distances2(model, data, x), model.rows_read(data.setup))
    model, x, weights, iterations = _alternate(model, data, x, weights, loss, weighted)
    consistency, inflation = costs_of(model, data, x, weights, loss)
    return Solved(
        model=model,
        x=x,
        weights=weights,
        outliers=~good,
        iterations=iterations,
        loss=loss,
        suspects=suspects(model, data, x) & good if loss in WEIGHED_DOWN else _nobody(),
        consistency=consistency,
        inflation=inflation,
    )


def _alternate(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray,
    loss: Loss,
    weighted: bool,
) -> tuple[CalibrationModel, FloatArray, FloatArray, int]:
    """Fit, weigh and estimate the noise in turns, until nothing moves.

    The model with its noise, parameters ``(p,)``, weights ``(N,)`` and iterations.
    """
    rows, weigh = model.rows_read(data.setup), WEIGHTS[loss]
    estimated = any(kind.estimated for kind in model.measurements)
    total, moved = 0, 0.0
    for _ in range(_ROUNDS):
        shares = weights / costs_of(model, data, x, weights, loss)[0]
        fit = minimise(model, data.trials(None), x[None], weights=shares[None], weighted=weighted)
        if not np.isfinite(fit.x).all():
            break
        x, total = fit.x[0], total + fit.iterations
        if loss in ("least-squares", "graduated") and not estimated:
            break
        moved = 0.0
        if estimated:
            scales = noise_scales(model, data, x, shares, needed=True)
            model = rescaled(model, scales)
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
    if moved >= _SETTLED:
        raise ConvergenceError(
            f"weights and noise have not come to rest after {_ROUNDS} rounds (the last one still "
            f"moved them by {moved:.2g})",
            hint="give the noise of each kind, or measure more poses",
        )
    return model, x, weights, total


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

_TINY = np.finfo(float).tiny


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
    return _settle(model, data, x, s2 <= by_chance(model, data) * spread(model, data, s2))


def _graduate(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    """From a loss with one minimum to that of truncated least squares: parameters ``(p,)``."""
    chance = by_chance(model, data)
    s2 = distances2(model, data, x)
    limit = chance * spread(model, data, s2)
    shape = 1.0 / max(float(np.max(2.0 * s2 / limit)) - 1.0, 1e-3)
    for _ in range(_GRADUATED_ROUNDS):
        weights = _truncated(s2, limit, shape)
        x = minimise(model, data.trials(None), x[None], weights=weights[None]).x[0]
        s2 = distances2(model, data, x)
        limit = chance * spread(model, data, s2)
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
        limit, scales = limits(model, data, x, good)
        before, good = good, distances2(model, data, x) <= limit
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
    Q = orthonormal(linear.stacked(x)[1])[linear.rows_last.size :]
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
