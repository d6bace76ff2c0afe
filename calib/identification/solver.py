"""Identification: the parameters that make the model show what was measured.

Two ways to the same minimum. ``gauss-newton`` uses the analytic Jacobian and is damped where a step
makes things worse. ``newton-raphson`` is the paper's own (Eq. 4 to 8 of [Watanabe2006]_): finite
differences, pseudo inverse, full steps. Both weight the rows by the noise unless told not to, as
the paper does not.

:func:`identify_batch` carries many trials of one plan at once: Monte Carlo is a single call.

A fit becomes a result with its covariance, what poses left out say, the test of the noise, and what
is to be said about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from calib.chance import chi2_tail
from calib.errors import ConvergenceError, InputError, check_type
from calib.identification.cross_validation import leave_one_out
from calib.identification.identifiability import (
    UNSEEN_SCALE,
    check_believable,
    check_enough,
    check_identifiable_at,
    check_unweighted,
    covariance_at,
    unseen_scale,
)
from calib.identification.least_squares import (
    ITERATIONS,
    STEP_TOLERANCE,
    column_lengths,
    first_guess,
    minimise,
    orthonormal,
)
from calib.identification.result import SIZES, IdentificationResult, KindNoise, Loss
from calib.identification.robust import Solved, fit_robustly, not_converged
from calib.model import CalibrationModel, Linearisation
from calib.model.measurements import Measurements
from calib.one_thread import one_blas_thread
from calib.se3 import BoolArray, FloatArray, IntArray

Method = Literal["gauss-newton", "newton-raphson"]


@one_blas_thread
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
        one = np.ones(measurements.count)
        solved = Solved(model, found, iterations, one, one == 0, one == 0, one, one)
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


ANOTHER_ROBOT_M = 0.05
"""Residuals beyond which nothing is a calibration: no arm that is switched on is as far off."""


STANDS_OUT = 4.0
"""Residual over its own standard deviation, against the median of its kind, from which it is said
to stand out. Noise alone takes one single row in a hundred as far, and three rows never. What a
model leaves out of an arm stays below; gross errors that hide each other come up to it."""

FEW_LEFT = 10
"""Equations beyond the parameters below which it is said that they are few: the standard deviation
of the residuals is then itself uncertain by a quarter and more."""

_MOST_NAMED = 5


def make_result(
    solved: Solved, data: Measurements, *, weighted: bool, name: str
) -> IdentificationResult:
    """The result of a fit to one set of measurements."""
    model, x = solved.model, solved.x
    every = model.linearise_at(data, x)
    good = np.flatnonzero(~solved.outliers)
    kept = every
    if len(good) < data.count:
        kept = model.linearise_at(data[good], x)
    weights = (solved.weights / solved.consistency)[good]
    linear = kept.weighed(weights)
    tested = linear
    if solved.suspects.any():  # by the measurements that no loss distrusts
        sound = np.flatnonzero(_trusted(solved))
        shares = (solved.weights / solved.consistency)[sound]
        tested = model.linearise_at(data[sound], x).weighed(shares)
    test = noise_test(tested)
    # a loss that weighs down takes something from the good ones, too
    sure = kept.weighed((solved.weights / solved.inflation)[good])
    known = covariance_at(sure, weighted=weighted)
    covariance = known
    if test.doubted:
        covariance = covariance_at(sure, weighted=weighted, noise=test.found)
    left = every.rows.copy()
    left[good] = leave_one_out(linear, data.groups[good], weighted=weighted)
    if weighted:
        left[good] /= np.sqrt(weights)[:, None]
    white = sure.stacked()[1]
    few, scale = _notes(linear, test.freedom)
    return IdentificationResult(
        model=name,
        names=model.names,
        units=model.units,
        nuisance=model.nuisance,
        values=x,
        nominal=model.nominal,
        prior=model.prior,
        covariance=covariance,
        # covariance and prior may both be infinite, of parameters that nothing holds
        prior_share=np.divide(
            np.diag(known), model.prior**2, out=np.zeros(model.p), where=np.isfinite(model.prior)
        ),
        singular_values=np.asarray(
            np.linalg.svd(white / column_lengths(white), compute_uv=False)
        ),  # no units
        residuals=every.rows,
        leave_one_out=left,
        angles=_angles(every),
        poses=data.names,
        outliers=solved.outliers,
        weights=solved.weights,
        noise=tuple(
            KindNoise(
                kind.name,
                kind.sigma,
                kind.estimated or kind.found,
                float(scale),
                k in test.doubted,
                kind.unit,
                kind.arm_sigma,
            )
            for k, (kind, scale) in enumerate(zip(model.measurements, test.scales, strict=True))
        ),
        chi2=test.chi2,
        degrees_of_freedom=test.freedom,
        noise_scale=test.scale,
        chance=test.chance,
        iterations=solved.iterations,
        status="converged",
        message=_message(test, every, solved),
        notes=(*few, *_contradicting(solved, linear, left, data.names, bool(test.doubted)), *scale),
    )


def _trusted(solved: Solved) -> BoolArray:
    """Measurements that residuals are judged by: all, where most would have to be distrusted."""
    trusted = ~(solved.outliers | solved.suspects)
    return trusted if 2 * trusted.sum() >= len(trusted) else ~solved.outliers


def _angles(linear: Linearisation) -> BoolArray:
    """Which rows ``(N, m)`` are angles."""
    table = np.zeros((len(linear.model.measurements), linear.model.rows), dtype=bool)
    for k, kind in enumerate(linear.model.measurements):
        table[k, kind.rows - kind.turns : kind.rows] = True
    return np.asarray(table[linear.view.setup.kind])


def _message(test: NoiseTest, linear: Linearisation, solved: Solved) -> str:
    rows = np.where(_angles(linear), 0.0, linear.rows)[_trusted(solved)]
    rms = float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))
    if rms > ANOTHER_ROBOT_M and all(kind.unit == "m" for kind in solved.model.measurements):
        return (
            f"the residuals are {rms * 1e3:.0f} mm: these measurements are not of this robot, this "
            "tool or these joint signs"
        )
    if test.freedom <= 0:
        return "there are as many equations as parameters: nothing is left to test the model by"
    kinds = solved.model.measurements
    if all(kind.estimated for kind in kinds):
        return "the noise was not given: it is taken from the residuals, which then test nothing"
    known = "found" if any(kind.found for kind in kinds) else "given"
    if test.doubted:
        named = len(kinds) > 1
        ratios = " and ".join(
            f"the residuals{f' of {kinds[k].name}' if named else ''} are {test.scales[k]:.1f} "
            f"times the noise {known}"
            for k in test.doubted
        )
        return (
            f"{ratios}: the model leaves something out or the noise is larger; the noise is taken "
            "from the residuals, which does not cover the bias of a model that leaves something out"
        )
    if test.chance < HARDLY:
        return f"the noise {known} hardly explains the residuals (ratio {test.scale:.2f})"
    return f"the noise {known} explains the residuals (ratio {test.scale:.2f})"


def _contradicting(
    solved: Solved, linear: Linearisation, left: FloatArray, poses: Sequence[str], doubted: bool
) -> list[str]:
    """What was left out, or what should perhaps be where the noise does not explain the rest."""
    for those, words in ((solved.outliers, "left out"), (solved.suspects, "weighed down")):
        if those.any():
            listed = ", ".join(dict.fromkeys(poses[i] for i in np.flatnonzero(those).tolist()))
            return [f"{words} because they contradict the others: {listed}"]
    untested = any(kind.estimated or kind.found for kind in solved.model.measurements)
    if (solved.weights != 1.0).any() or not (doubted or untested):
        return []
    found = stand_out(linear, left)
    if not found.size:
        return []
    every = list(dict.fromkeys(poses[i] for i in found.tolist()))
    names = every[:_MOST_NAMED]
    more = f" and {len(every) - _MOST_NAMED} more" if len(every) > _MOST_NAMED else ""
    return [
        f"far beyond the others, when predicted from them: {', '.join(names)}{more}; if these are "
        'gross errors, parameters.loss = "graduated" leaves them out'
    ]


def stand_out(linear: Linearisation, left: FloatArray) -> IntArray:
    """Measurements that are far beyond the others of their kind, the farthest first.

    Parameters
    ----------
    left : array (N, m)
        Rows of each when predicted from the other poses [m, rad].
    """
    last = np.ascontiguousarray(np.nan_to_num(left).T)
    white = linear.view.posture_first(linear.model.whiten_last(last, linear.view))
    # rᵀ(I - H)⁻¹r: a pose that the fit hangs on is not suspected for what it alone tells
    size = np.sqrt(np.maximum(np.sum(white * linear.white_rows, axis=1), 0.0))
    kinds = linear.view.setup.kind
    for k in np.unique(kinds):
        middle = float(np.median(size[kinds == k]))
        size[kinds == k] /= middle if middle > 0 else np.inf
    order = np.argsort(-size)
    return np.asarray(order[size[order] > STANDS_OUT])


def _notes(linear: Linearisation, freedom: int) -> tuple[list[str], list[str]]:
    """What is to be said of the equations that are left over, and of the scale."""
    few, scale = [], []
    if 0 < freedom < FEW_LEFT:
        what = "a single equation is" if freedom == 1 else f"only {freedom} equations are"
        few.append(f"{what} left over to test the model by: measure more poses")
    share = unseen_scale(linear)
    if share > UNSEEN_SCALE:
        how = f"standard deviation {share * 1e3:.3g} mm per m" if share < 1.0 else "not at all"
        scale.append(
            f"the scale of arm and set-up together is not seen by these measurements ({how} "
            "without the priors): a known length, such as the distance of two targets, would show "
            "it"
        )
    return few, scale


MODEL_DOUBT = 0.01
"""Probability of residuals as large as those found below which the noise does not explain them."""

HARDLY = 0.05
"""The same below which it hardly does."""


@dataclass(frozen=True, eq=False)
class NoiseTest:
    """Residuals against the noise."""

    squares: FloatArray  # (K,): sum of the squared residuals of each kind over their noise
    redundancy: FloatArray
    """(K,): how many of the equations of each kind are free to show noise: the others are used up
    by the parameters. What is known besides uses up none."""

    @cached_property
    def chi2(self) -> float:
        """Of all kinds."""
        return float(self.squares.sum())

    @cached_property
    def freedom(self) -> int:
        """Equations left over, of all kinds."""
        return round(float(self.redundancy.sum()))

    @cached_property
    def scale(self) -> float:
        """Residuals over noise, of all kinds; NaN where no equation is left over."""
        return float(np.sqrt(self.chi2 / self.freedom)) if self.freedom > 0 else float("nan")

    @cached_property
    def chance(self) -> float:
        """Probability of residuals as large by the noise alone."""
        if self.freedom <= 0:
            return 1.0
        return float(chi2_tail(self.chi2, self.redundancy.sum()))

    @cached_property
    def scales(self) -> FloatArray:
        """Residuals over noise of each kind ``(K,)``; 1 where nothing can be said."""
        free = np.maximum(self.redundancy, 1e-9)
        return np.where(self.redundancy > 1.0, np.sqrt(self.squares / free), 1.0)

    @cached_property
    def found(self) -> FloatArray:
        """What the noise of each kind ``(K,)`` has to be multiplied by: that of doubted ones."""
        out = np.ones(len(self.squares))
        out[self.doubted] = self.scales[self.doubted]
        return out

    @cached_property
    def doubted(self) -> list[int]:
        """Kinds whose residuals are larger than their noise explains."""
        tested = np.flatnonzero(self.redundancy > 1.0).tolist()
        chances = chi2_tail(self.squares, np.maximum(self.redundancy, 1.0))
        found = [k for k in tested if chances[k] < MODEL_DOUBT]
        if self.chance < MODEL_DOUBT and not found:  # a little in each of several kinds
            return tested
        return found


def noise_test(linear: Linearisation) -> NoiseTest:
    """Test the residuals of a fit to one set, weighted or not, at its solution.

    After an unweighted fit the residuals are larger than those of the weighted one, by what it
    gives away, and would not have the distribution of chi²: what the parameters could still
    explain is taken out.
    """
    rows, J = linear.stacked()
    used = np.zeros(len(rows))
    if J.shape[1]:
        Q = orthonormal(J)
        rows = rows - Q @ (Q.T @ rows)
        used = np.sum(Q**2, axis=1)
    count, m = linear.white_rows.shape
    left = rows[: count * m].reshape(count, m)
    free = 1.0 - used[: count * m].reshape(count, m)
    if linear.view.setup.seen is not None:
        free = free * linear.view.setup.seen
    kinds = linear.view.setup.kind
    parts = [(kinds == k, kind.rows) for k, kind in enumerate(linear.model.measurements)]
    return NoiseTest(
        np.array([np.sum(left[own, :rows] ** 2) for own, rows in parts]),
        np.array([np.sum(free[own, :rows]) for own, rows in parts]),
    )
