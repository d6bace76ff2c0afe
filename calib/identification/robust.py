"""Measurements that contradict the others, and noise that nobody has given.

``huber``, ``cauchy`` and ``student-t`` weigh a measurement down by how far it is off:
:mod:`calib.identification.losses`. ``graduated`` decides which measurements to leave out:
:mod:`calib.identification.graduated`. Noise that is not known is estimated with either:
:mod:`calib.identification.noise`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib.errors import ConvergenceError
from calib.identification.graduated import DISAGREEMENT, choose
from calib.identification.least_squares import ITERATIONS, minimise
from calib.identification.losses import (
    STUDENT_FREEDOM,
    WEIGHED_DOWN,
    WEIGHTS,
    Loss,
    variance_factor,
)
from calib.identification.noise import (
    OUTLIER_CHANCE,
    costs_of,
    distances2,
    noise_scales,
    rescaled,
    rows_of,
    suspects,
)
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray

__all__ = [
    "DISAGREEMENT",
    "OUTLIER_CHANCE",
    "STUDENT_FREEDOM",
    "WEIGHTS",
    "Loss",
    "Solved",
    "distances2",
    "fit_robustly",
    "noise_scales",
    "not_converged",
    "variance_factor",
]

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
    loss : Loss
        That the weights are of.
    suspects : array (N,) or (1,) of bool
        Farther off than noise takes one, but not left out: see :func:`noise.suspects`.
    consistency : array (N,) or (1,)
        Of the loss: weighted squares of residuals are divided by it, in the fit as well, so that
        they stand against what is known besides as the noise says.
    inflation : array (N,) or (1,)
        Variance over what the weighted measurements promise: their information is divided by it.
    """

    model: CalibrationModel
    x: FloatArray
    weights: FloatArray
    outliers: BoolArray
    iterations: int
    loss: Loss = "least-squares"
    suspects: BoolArray = field(default_factory=_nobody)
    consistency: FloatArray = field(default_factory=_one)
    inflation: FloatArray = field(default_factory=_one)


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
        weights = WEIGHTS[loss](distances2(model, data, x), rows_of(model, data))
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
    rows, weigh = rows_of(model, data), WEIGHTS[loss]
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
        raise _not_settled(moved)
    return model, x, weights, total


def not_converged(change: float) -> ConvergenceError:
    """The error of a fit that has not come to rest."""
    return ConvergenceError(
        f"the identification has not converged after {ITERATIONS} iterations "
        f"(the last one still moved the predictions by {change:.2g} times the noise)",
        hint="check that the measurements belong to this robot and that the tool point and "
        "the joint signs are about right",
    )


def _not_settled(moved: float) -> ConvergenceError:
    return ConvergenceError(
        f"weights and noise have not come to rest after {_ROUNDS} rounds (the last one still moved "
        f"them by {moved:.2g})",
        hint="give the noise of each kind, or measure more poses",
    )
