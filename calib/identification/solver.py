"""Identification: the parameters that make the model show what was measured.

Two ways to the same minimum. ``gauss-newton`` uses the analytic Jacobian and is damped where a step
makes things worse. ``newton-raphson`` is the paper's own (Eq. 4 to 8 of [Watanabe2006]_): finite
differences, pseudo inverse, full steps. Both weight the rows by the noise unless told not to, as
the paper does not.

:func:`identify_batch` carries many trials of one plan at once: Monte Carlo is a single call.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from calib.errors import ConvergenceError, InputError, check_type
from calib.identification.identifiability import (
    check_believable,
    check_enough,
    check_identifiable_at,
    check_unweighted,
)
from calib.identification.least_squares import ITERATIONS, STEP_TOLERANCE, minimise
from calib.identification.noise import Loss
from calib.identification.report import make_result
from calib.identification.result import SIZES, IdentificationResult
from calib.identification.robust import Solved, fit_robustly, not_converged
from calib.identification.start import first_guess
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import FloatArray

Method = Literal["gauss-newton", "newton-raphson"]


def identify(
    model: CalibrationModel,
    measurements: Measurements,
    *,
    weighted: bool = True,
    method: Method = "gauss-newton",
    loss: Loss = "least-squares",
    name: str = "offsets",
    start: FloatArray | None = None,
) -> IdentificationResult:
    """Identify the parameters of a model from measurements.

    Parameters
    ----------
    measurements : Measurements
        One set, postures ``(N, n)``.
    weighted : bool
        Divide the rows by the noise of the measurement (the better estimate), or take all rows
        alike as in the paper. The covariance is right in both cases.
    method : {"gauss-newton", "newton-raphson"}
    loss : {"least-squares", "huber", "cauchy", "student-t", "graduated"}
        What a measurement far from the others may do: see :mod:`calib.identification.robust`.
    name : str
        Name of the set of parameters in the result.
    start : array (p,), optional
        Parameters to start from, such as those of :func:`tune_priors` [SI]; by default tool and
        targets are placed first.

    Raises
    ------
    InputError
        Fewer equations than parameters, an unknown method or loss, or options that exclude each
        other.
    NotIdentifiableError
        Parameters that these measurements cannot identify; nothing is returned then.
    ConvergenceError
        No minimum within the iterations allowed.
    """
    check_type(model, CalibrationModel, "model")
    check_type(measurements, Measurements, "measurements")
    _check_options(model, method, loss, weighted)
    check_enough(model, measurements)
    if measurements.postures.ndim != 2:
        raise InputError(
            f"the postures have shape {measurements.postures.shape}: more than one set",
            hint="identify_batch takes the trials of a Monte Carlo run",
            name="measurements",
        )
    x = first_guess(model, measurements, weighted=weighted) if start is None else start
    check_identifiable_at(model, measurements, x)
    if method == "newton-raphson":
        found, iterations = _newton_raphson(model, measurements, x, weighted)
        everything = np.ones(measurements.count)
        solved = Solved(model, found, everything, everything == 0, iterations)
    else:
        solved = fit_robustly(
            model, measurements, x, loss=loss, weighted=weighted, near=start is not None
        )
    result = make_result(solved, measurements, weighted=weighted, name=name)
    check_believable(model, result.sigma)
    return result


def _check_options(model: CalibrationModel, method: str, loss: str, weighted: bool) -> None:
    for given, known, what in ((method, Method, "method"), (loss, Loss, "loss")):
        if given not in get_args(known):
            options = ", ".join(get_args(known))
            raise InputError(f"unknown {what} {given!r}", hint=f"one of {options}", name=what)
    estimated = any(kind.estimated for kind in model.measurements)
    if method == "newton-raphson" and (loss != "least-squares" or estimated):
        raise InputError(
            "the paper's newton-raphson knows no robust loss and no unknown noise",
            hint="use gauss-newton",
            name="method",
        )
    if not weighted:
        check_unweighted(model)
        if loss != "least-squares":
            raise InputError(
                f"the loss {loss} needs rows that are weighted by their noise",
                hint="weight them, or use least-squares",
                name="loss",
            )


def _newton_raphson(
    model: CalibrationModel, data: Measurements, x: FloatArray, weighted: bool
) -> tuple[FloatArray, int]:
    """Full steps with Eq. 5's differences until the predictions stand still."""
    sizes = np.array([SIZES[unit].difference for unit in model.units])
    change = np.inf
    for iteration in range(1, ITERATIONS + 1):
        # of the rows as they are squared: the axes of their noise turn with the parameters, too
        here = model.linearise_at(data, x)
        there = model.linearise_at(data.trials(None), x + np.diag(sizes))
        r, ahead = (linear.over_noise_last(weighted)[0] for linear in (here, there))
        moved = ahead.reshape(len(r), model.p, -1) - r[:, None]
        A, r = np.moveaxis(moved / sizes[:, None], 1, -1).reshape(r.size, model.p), r.ravel()
        known, K = model.known(x[None])
        step = _least_squares(np.concatenate([A, K[0]]), -np.concatenate([r, known[0]]))
        x = x + step
        change = float(np.linalg.norm(A @ step))
        if change < STEP_TOLERANCE:
            return x, iteration
        if not np.isfinite(x).all():
            break
    raise not_converged(change)


def _least_squares(J: FloatArray, rows: FloatArray) -> FloatArray:
    """``G⁺ e`` of Eq. 8, with columns brought to unit length first so that units do not matter."""
    scale = np.linalg.norm(J, axis=0)
    return np.asarray(np.linalg.lstsq(J / scale, rows, rcond=None)[0] / scale)


def identify_batch(
    model: CalibrationModel, measurements: Measurements, *, weighted: bool = True
) -> FloatArray:
    """Identify every trial of a Monte Carlo run, ``(T, N, n)`` postures, to ``(T, p)`` values [SI].

    Identifiability is checked on the first trial: trials of one plan differ by noise only. A trial
    that does not converge gives NaN.

    Raises
    ------
    InputError, NotIdentifiableError
        As :func:`identify`.
    ConvergenceError
        No trial has converged.
    """
    check_enough(model, measurements)
    if measurements.postures.ndim != 3:
        raise InputError(
            f"the postures have shape {measurements.postures.shape}: one set of measurements, or "
            "more than a list of them",
            hint="identify takes one set; trials are (T, N, n)",
            name="measurements",
        )
    if not weighted:
        check_unweighted(model)
    first = measurements.trials(0)
    x = first_guess(model, first, weighted=weighted)
    check_identifiable_at(model, first, x)
    near = minimise(model, first.trials(None), x[None], weighted=weighted)
    start = near.x[0] if near.converged[0] else x  # the others differ from it by noise only
    trials = len(measurements.postures)
    fit = minimise(model, measurements, np.tile(start, (trials, 1)), weighted=weighted)
    if not fit.converged.any():
        raise ConvergenceError(
            f"none of {trials} trials has converged after {ITERATIONS} iterations",
            hint="are the simulated errors of a size that occurs?",
        )
    fit.x[~fit.converged] = np.nan
    return fit.x
