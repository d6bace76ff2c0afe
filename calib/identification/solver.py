"""Identification: the parameters that bring the tool point onto the target at every posture.

Two ways to the same minimum. ``gauss-newton`` uses the analytic Jacobian. ``newton-raphson`` is
the paper's own (Eq. 4 to 8 of [Watanabe2006]_): finite differences, pseudo inverse, full steps.
Both weight the rows by the noise unless told not to, as the paper does not.

The batch solver at the bottom carries many trials of one plan at once: Monte Carlo is a single
call.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from calib.errors import ConvergenceError, InputError
from calib.identification.covariance import best_chi2, covariance_of, leave_one_out
from calib.identification.identifiability import check_believable, check_identifiable
from calib.identification.result import IdentificationResult, chi2_is_too_large
from calib.measurement.data import TouchUps
from calib.measurement.touch import touch
from calib.model import CalibrationModel
from calib.parameters.base import Unit
from calib.se3 import FloatArray, IntArray

Method = Literal["gauss-newton", "newton-raphson"]

ITERATIONS = 30
"""Steps after which a fit has failed; calibrations take three to six."""

STEP_TOLERANCE = 1e-7
"""Change of the predictions, in standard deviations of the noise, of the last step. No parameter
then moves by more than this part of its own standard deviation, whatever its unit; and since the
last step is taken too, what is left is far smaller still."""

FINITE_DIFFERENCE: dict[Unit, float] = {"rad": 1e-6, "m": 1e-6, "rad/Nm": 1e-9}
"""The Δp of Eq. 5: balances truncation against rounding for arms of a few metres, and of torques
of some thousand Nm."""


def identify(
    model: CalibrationModel,
    measurements: TouchUps,
    *,
    weighted: bool = True,
    method: Method = "gauss-newton",
    name: str = "offsets",
) -> IdentificationResult:
    """Identify the parameters of a model from touch-ups.

    Parameters
    ----------
    model : CalibrationModel
    measurements : TouchUps
        One set, postures ``(N, n)``.
    weighted : bool
        Divide the rows by the noise of the measurement (the better estimate), or take all rows
        alike as in the paper. The covariance is right in both cases.
    method : {"gauss-newton", "newton-raphson"}
    name : str
        Name of the set of parameters in the result.

    Raises
    ------
    InputError
        Fewer equations than parameters, or an unknown method.
    NotIdentifiableError
        Parameters that these measurements cannot identify; nothing is returned then.
    ConvergenceError
        No minimum within the iterations allowed.
    """
    check_enough(model, measurements)
    if measurements.postures.ndim != 2:
        raise InputError(
            f"the postures have shape {measurements.postures.shape}: more than one set",
            hint="identify_batch takes the trials of a Monte Carlo run",
            name="touch-ups",
        )
    if method not in get_args(Method):
        known = ", ".join(get_args(Method))
        raise InputError(f"unknown method {method!r}", hint=f"one of {known}")
    x = _place_setup(model, measurements, weighted)
    _check_identifiable_at(model, measurements, x)
    x, iterations = _iterate(model, measurements, x, weighted, method)
    result = _result(model, measurements, x, weighted, iterations, name)
    check_believable(result.sigma, model.names, model.units)
    return result


def _iterate(
    model: CalibrationModel, measurements: TouchUps, x: FloatArray, weighted: bool, method: Method
) -> tuple[FloatArray, int]:
    """Full steps until the predictions stand still: the parameters, and how many it took."""
    q, target = measurements.postures, measurements.target
    change = np.inf
    for iteration in range(1, ITERATIONS + 1):
        if method == "gauss-newton":
            J = model.jacobian(q, x, target)
        else:
            J = finite_difference_jacobian(model, q, x, target)
        J = _weigh(model, q, x, J, weighted).reshape(-1, model.p)
        rows = _weigh(model, q, x, model.predict(q, x, target)[..., None], weighted).ravel()
        step = _least_squares(J, -rows)
        x = x + step
        change = float(np.linalg.norm(J @ step))
        if change < STEP_TOLERANCE:
            return x, iteration
        if not np.isfinite(x).all():
            break
    raise ConvergenceError(
        f"the identification has not converged after {ITERATIONS} iterations "
        f"(the last one still moved the predictions by {change:.2g} times the noise)",
        hint="check that the touch-ups belong to this robot and that the tool point and "
        "the joint signs are about right",
    )


def check_enough(model: CalibrationModel, measurements: TouchUps) -> None:
    """Check that touch-ups and model speak of the same targets, with enough equations.

    Raises
    ------
    InputError
    """
    if measurements.labels != model.labels:
        raise InputError(
            f"the touch-ups name the targets {', '.join(measurements.labels)}, "
            f"the model {', '.join(model.labels)}",
            name="target",
        )
    equations = measurements.count * model.measurement.rows
    if equations < model.p:
        need = -(-model.p // model.measurement.rows)
        raise InputError(
            f"{measurements.count} touch-ups give {equations} equations for {model.p} parameters",
            hint=f"measure at least {need} poses, better twice as many",
            name="touch-ups",
            value=equations,
            bound=model.p,
        )


def finite_difference_jacobian(
    model: CalibrationModel, q: FloatArray, x: FloatArray, target: IntArray | None = None
) -> FloatArray:
    """Eq. 5 of [Watanabe2006]_ as printed: forward differences, ``(N, m, p)``."""
    step = np.array([FINITE_DIFFERENCE[unit] for unit in model.units])
    moved = model.predict(q[None], x + np.diag(step), target)  # (p, N, m)
    columns = (moved - model.predict(q, x, target)) / step[:, None, None]
    return np.moveaxis(columns, 0, -1)


def identify_batch(
    model: CalibrationModel, measurements: TouchUps, *, weighted: bool = True
) -> FloatArray:
    """Identify every trial of a Monte Carlo run, ``(T, N, n)`` postures, to ``(T, p)`` values [SI].

    Gauss-Newton steps for all trials at once. Identifiability is checked on the first trial:
    trials of one plan differ by noise only. A trial that does not converge gives NaN.

    Raises
    ------
    InputError, NotIdentifiableError
        As :func:`identify`.
    ConvergenceError
        No trial has converged.
    """
    check_enough(model, measurements)
    q, target = measurements.postures, measurements.target
    x = np.broadcast_to(model.nominal, (len(q), model.p)).copy()
    _check_identifiable_at(model, TouchUps(q[0], target, measurements.labels), x[0])
    moving = np.ones(len(q), dtype=bool)
    with np.errstate(all="ignore"):  # a trial that runs away is told by its NaN
        for _ in range(ITERATIONS):
            step, change = _batch_step(model, q, x, target, weighted)
            x = x + step
            moving = ~(change < STEP_TOLERANCE)
            if not moving.any():
                break
    if moving.all():
        raise ConvergenceError(
            f"none of {len(q)} trials has converged after {ITERATIONS} iterations",
            hint="are the simulated errors of a size that occurs?",
        )
    x[moving] = np.nan
    return np.asarray(x)


def _batch_step(
    model: CalibrationModel, q: FloatArray, x: FloatArray, target: IntArray, weighted: bool
) -> tuple[FloatArray, FloatArray]:
    """Step ``(T, p)`` [SI] of each trial, and by how much it moves the predictions ``(T,)``."""
    rows, J, R = model.linearise(q, x, target)
    stacked = np.concatenate([J, rows[..., None]], axis=-1)
    if weighted:
        stacked = model.measurement.whiten(stacked, R)
    else:
        stacked = stacked / model.measurement.mean_sigma_m
    stacked = stacked.reshape(len(q), -1, model.p + 1)
    scale = np.linalg.norm(stacked[..., :-1], axis=1, keepdims=True)  # (T, 1, p)
    # QR, not normal equations: the worst planned sets have a condition of 1e4
    Q, Rf = np.linalg.qr(stacked[..., :-1] / scale)
    change = np.swapaxes(Q, -1, -2) @ stacked[..., -1:]  # (T, p, 1)
    step = -np.linalg.solve(Rf, change)[..., 0] / scale[:, 0]
    return step, np.linalg.norm(change[..., 0], axis=-1)


def _check_identifiable_at(model: CalibrationModel, measurements: TouchUps, x: FloatArray) -> None:
    """Check what the postures can tell, with the residuals taken out of them.

    A residual lends a hidden parameter a false hold: turning the whole arm about its base turns
    every residual with it, so that the Jacobian is not quite singular, though nothing has been
    seen. The postures are therefore first moved (by as little as the residuals) onto the target.
    """
    q, _ = touch(model, measurements.postures, x, measurements.target, hold_orientation=False)
    _, J, R = model.linearise(q, x, measurements.target)
    white = model.measurement.whiten(J, R).reshape(-1, model.p)
    check_identifiable(white, model.names, model.nuisance)
    # what the noise alone leaves unknown would wander off before it could be refused
    sigma = np.linalg.norm(np.linalg.pinv(white), axis=1)
    check_believable(sigma, model.names, model.units)


def _place_setup(model: CalibrationModel, measurements: TouchUps, weighted: bool) -> FloatArray:
    """First guess: tool point and targets where the nominal robot puts them.

    With the robot held they enter linearly (touch-up) or nearly so, so that any first guess of
    them will do. The step is the shortest one where they cannot be told apart.
    """
    q, target = measurements.postures, measurements.target
    x, free = model.nominal.copy(), model.nuisance
    if not free.any():
        return x
    for _ in range(2):
        rows = _weigh(model, q, x, model.predict(q, x, target)[..., None], weighted).ravel()
        J = _weigh(model, q, x, model.jacobian(q, x, target), weighted).reshape(-1, model.p)
        x[free] += np.linalg.lstsq(J[:, free], -rows, rcond=1e-9)[0]
    return x


def _weigh(
    model: CalibrationModel, q: FloatArray, x: FloatArray, rows: FloatArray, weighted: bool
) -> FloatArray:
    """Rows over the noise: each over its own, or all over the same (which changes no estimate)."""
    if weighted:
        return model.whiten(q, rows, x)
    return np.asarray(rows / model.measurement.mean_sigma_m)


def _least_squares(J: FloatArray, rows: FloatArray) -> FloatArray:
    """``G⁺ e`` of Eq. 8, with columns brought to unit length first so that units do not matter."""
    scale = np.linalg.norm(J, axis=0)
    return np.asarray(np.linalg.lstsq(J / scale, rows, rcond=None)[0] / scale)


def _result(
    model: CalibrationModel,
    measurements: TouchUps,
    x: FloatArray,
    weighted: bool,
    iterations: int,
    name: str,
) -> IdentificationResult:
    q, target = measurements.postures, measurements.target
    rows, J, R = model.linearise(q, x, target)
    chi2 = best_chi2(J, rows, R, model)
    freedom = rows.size - model.p
    scale = float(np.sqrt(chi2 / freedom)) if freedom else float("nan")
    covariance = covariance_of(model, q, x, target, weighted=weighted)
    if freedom == 0:
        message = "there are as many equations as parameters: nothing is left to test the model by"
    elif chi2_is_too_large(chi2, freedom):
        covariance = covariance * scale**2
        message = (
            f"the residuals are {scale:.1f} times the noise given: the model leaves something out "
            "or the noise is larger; standard deviations are scaled up to the residuals, which "
            "does not cover the bias of a model that leaves something out"
        )
    else:
        message = f"the noise given explains the residuals (ratio {scale:.2f})"
    return IdentificationResult(
        model=name,
        names=model.names,
        units=model.units,
        nuisance=model.nuisance,
        values=x,
        nominal=model.nominal,
        covariance=covariance,
        residuals=rows,
        leave_one_out=leave_one_out(J, rows, R, model, weighted),
        chi2=chi2,
        degrees_of_freedom=freedom,
        noise_scale=scale,
        iterations=iterations,
        status="converged",
        message=message,
    )
