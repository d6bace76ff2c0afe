"""Priors from the measurements themselves: empirical Bayes.

How large errors of a kind are on this arm, its lengths, its bearings, its reducers, shows in how
many parameters of the kind together explain. Parameters of a group share one standard deviation
about their nominal values; it is that for which the measurements are likeliest, whatever the
parameters are: :mod:`calib.identification.marginal`. Noise that nobody has given is found in the
same way. The problem is linearised, solved and weighted again until nothing moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import ConvergenceError, InputError, near_names
from calib.identification.identifiability import check_enough, check_identifiable_at
from calib.identification.marginal import (
    LinearEvidence,
    linear_evidence,
    noise_classes,
    proportions,
)
from calib.identification.noise import WEIGHTS, Loss, costs_of, distances2, log_weights
from calib.identification.start import first_guess
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, IntArray

LOSSES: tuple[Loss, ...] = ("least-squares", "student-t")
"""Losses under which a marginal likelihood is what it says: Student's noise is Gaussian with a
variance of its own for each measurement."""

NOISE_BOUNDS = (1e-2, 1e3)
"""Of noise that is to be found, over the noise that its kind starts with: 1 um to 0.1 m."""

USUAL_WITHIN = np.log(3.0)
"""Standard deviation of the logarithm of a size about the usual one."""

_PASSES = 100
_SETTLED = 1e-3
"""Change of weights and of the logarithms of standard deviations below which they have settled:
a hundredth of how well the best of them can be known."""

_CURVATURE_STEP = 0.05
"""Of logarithms, for second derivatives by differences of the gradient: sizes are known to some
.2 and worse."""

_AT_BOUND = 1e-3
"""Distance of a logarithm from that of a bound within which it stands there."""


@dataclass(frozen=True)
class PriorGroup:
    """Parameters that are taken to be of one size, or of sizes in the proportions of their priors.

    Attributes
    ----------
    name : str
        In words, for reports.
    parameters : tuple of str
        Names, as the model has them; of one unit.
    lower, upper : float
        Bounds of the standard deviation [SI], the root mean square where sizes differ. They say
        what is possible for the arm, and have to be given: touch-ups do not see the scale of all
        lengths, and without bounds the likeliest arm may be one that shrinks until its residuals
        are small.
    usual : float, optional
        What the standard deviation is for such arms, within a factor of three [SI]: a few
        parameters do not tell it well. Without it every size within the bounds is as likely.

    Raises
    ------
    InputError
        No parameters, or bounds that are not in order above zero.
    """

    name: str
    parameters: tuple[str, ...]
    lower: float
    upper: float
    usual: float | None = None

    def __post_init__(self) -> None:
        if not self.parameters:
            raise InputError(f"the group {self.name!r} has no parameters", name=self.name)
        if not 0.0 < self.lower <= self.upper < np.inf:
            raise InputError(
                f"the bounds {self.lower:g} and {self.upper:g} of the group {self.name!r} are not "
                "two numbers above zero in order",
                name=self.name,
            )


@dataclass(frozen=True, eq=False)
class TunedPriors:
    """Priors and noise for which the measurements are likeliest.

    Attributes
    ----------
    model : CalibrationModel
        With these priors and this noise: for :func:`calib.identify` with the same loss.
    sigma : array (G,)
        Standard deviation of each group [SI].
    log_evidence : float
        Logarithm of the marginal likelihood of the linearised problem at these sizes and this
        noise, weights as they are.
    log_marginal : float
        The same over all sizes and noises, too (Laplace's approximation), and for Student's loss
        over the weights: it compares models of the same measurements, loss and parameters without
        a prior.
    x : array (p,)
        Parameters [SI]; :func:`calib.identify` finds the same, and what they are worth.
    weights : array (N,)
        Of the squares of each measurement.
    covariance : array (p, p)
        What parameters are uncertain by because the sizes are [SI], to be added to the covariance
        of a fit with the priors: the law of total variance, by the curvature of the likelihood.
    passes : int
        Linearisations.
    notes : tuple of str
        Groups whose standard deviation stands at a bound.
    """

    model: CalibrationModel
    groups: tuple[PriorGroup, ...]
    sigma: FloatArray
    log_evidence: float
    log_marginal: float
    x: FloatArray
    weights: FloatArray
    covariance: FloatArray
    passes: int
    notes: tuple[str, ...]


def tune_priors(
    model: CalibrationModel,
    data: Measurements,
    groups: Sequence[PriorGroup],
    *,
    loss: Loss = "least-squares",
    noise_bounds: tuple[float, float] = NOISE_BOUNDS,
) -> TunedPriors:
    """Find the standard deviations of groups of parameters, and noise that is not known.

    Parameters
    ----------
    model : CalibrationModel
        Its priors of parameters that are in no group stay as they are.
    data : Measurements
        One set.
    loss : {"least-squares", "student-t"}
        As in the identification that is to follow.
    noise_bounds : tuple of float
        Of noise that is to be estimated, over what it starts with.

    Raises
    ------
    InputError
        Groups that do not fit the model or each other, another loss, too few measurements.
    NotIdentifiableError
        Parameters that measurements and priors leave open.
    ConvergenceError
        Priors and weights that do not come to rest.
    """
    groups = tuple(groups)
    members = _members(model, groups)
    if loss not in LOSSES:
        raise InputError(
            f"priors cannot be found under the loss {loss!r}",
            hint="one of " + ", ".join(LOSSES),
            name="loss",
        )
    bounds = _bounds(model, data, groups, noise_bounds)
    theta = bounds.mean(axis=0)  # the middle of what is possible; of noise, what it starts with
    theta[len(groups) :] = np.clip(0.0, *bounds[:, len(groups) :])
    tuned = _applied(model, data, members, theta)
    check_enough(tuned, data)
    x = first_guess(tuned, data)
    check_identifiable_at(tuned, data, x)
    usual = _usual(groups, len(theta))
    theta, x, weights, passes = _alternate(model, data, members, bounds, usual, theta, x, loss)
    tuned = _applied(model, data, members, theta)
    shares = weights / costs_of(tuned, data, x, weights, loss)[0]
    problem = linear_evidence(model, data, x, members, shares)
    curvature = _curvature(problem, theta, bounds, usual)
    log_evidence = problem.log_evidence(theta)[0]
    log_marginal = log_evidence + _volume(curvature, theta, bounds, usual)
    if loss == "student-t":
        log_marginal += log_weights(weights)
    return TunedPriors(
        model=tuned,
        groups=groups,
        sigma=np.exp(theta[: len(groups)]),
        log_evidence=log_evidence,
        log_marginal=log_marginal,
        x=x,
        weights=weights,
        covariance=_covariance_of_sizes(problem, theta, curvature),
        passes=passes,
        notes=tuple(_notes(groups, theta, bounds)),
    )


def _alternate(
    model: CalibrationModel,
    data: Measurements,
    members: Sequence[IntArray],
    bounds: FloatArray,
    usual: FloatArray,
    theta: FloatArray,
    x: FloatArray,
    loss: Loss,
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Linearise, maximise, solve and weigh: standard deviations, parameters, weights, passes."""
    rows = model.rows_read(data.setup)
    weights = np.ones(data.count)
    moved = np.inf
    for passes in range(_PASSES):
        tuned = _applied(model, data, members, theta)
        shares = weights / costs_of(tuned, data, x, weights, loss)[0]  # as the fit has them
        problem = linear_evidence(model, data, x, members, shares)
        # at first the arm is linearised as described, too far off to tell sizes by
        best = _maximise(problem, theta, bounds, usual) if passes else theta
        x = problem.parameters(best)
        tuned = _applied(model, data, members, best)
        heavier = WEIGHTS[loss](distances2(tuned, data, x), rows)
        moved = float(max(np.abs(best - theta).max(initial=0.0), np.abs(heavier - weights).max()))
        theta, weights = best, heavier
        if moved < _SETTLED and passes > 1:
            return theta, x, weights, passes + 1
    raise ConvergenceError(
        f"the priors have not come to rest after {_PASSES} passes (the last one still moved them "
        f"by {moved:.2g} of their size)",
        hint="free fewer groups, or give narrower bounds",
    )


def _applied(
    model: CalibrationModel, data: Measurements, members: Sequence[IntArray], theta: FloatArray
) -> CalibrationModel:
    """The model with the priors and the noise that the logarithms ``(G + C,)`` say."""
    prior = model.prior.copy()
    for columns, log_sigma in zip(members, theta, strict=False):
        prior[columns] = np.exp(log_sigma) * proportions(model.prior[columns])
    scales = np.ones((data.count, model.rows))
    for own, log_scale in zip(noise_classes(model, data), theta[len(members) :], strict=True):
        scales[own] = np.exp(log_scale)
    kinds = []
    for k, kind in enumerate(model.measurements):
        of = np.flatnonzero(data.setup.kind == k)
        kinds.append(kind.with_noise(scales[of[0], : kind.rows]) if of.size else kind)
    return model.with_prior(prior).with_measurements(kinds)


def _bounds(
    model: CalibrationModel,
    data: Measurements,
    groups: Sequence[PriorGroup],
    noise_bounds: tuple[float, float],
) -> FloatArray:
    """Logarithms ``(2, G + C)`` between which the standard deviations may be."""
    low, high = noise_bounds
    if not 0.0 < low <= high < np.inf:
        raise InputError(
            f"the bounds {low:g} and {high:g} of the noise are not two numbers above zero in order",
            name="noise_bounds",
        )
    every = [(group.lower, group.upper) for group in groups]
    every += [(low, high)] * len(noise_classes(model, data))
    return np.asarray(np.log(np.array(every, dtype=float).reshape(-1, 2)).T)


def _usual(groups: Sequence[PriorGroup], count: int) -> FloatArray:
    """Logarithms of the usual sizes ``(G + C,)``; NaN where none is known, as of noise."""
    out = np.full(count, np.nan)
    out[: len(groups)] = [np.nan if g.usual is None else np.log(g.usual) for g in groups]
    return out


def _slope(
    problem: LinearEvidence, theta: FloatArray, usual: FloatArray
) -> tuple[float, FloatArray]:
    """Logarithm of how likely sizes and noise are after the measurements, and its gradient."""
    value, gradient = problem.log_evidence(theta)
    off = np.nan_to_num((theta - usual) / USUAL_WITHIN)
    return value - 0.5 * float(off @ off), gradient - off / USUAL_WITHIN


def _maximise(
    problem: LinearEvidence, theta: FloatArray, bounds: FloatArray, usual: FloatArray
) -> FloatArray:
    """Logarithms for which the linearised problem is likeliest, from those of the pass before."""
    if not theta.size:
        return theta

    from scipy.optimize import minimize

    def worse(t: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = _slope(problem, t, usual)
        return -value, -gradient

    start = np.clip(theta, *bounds)
    found = minimize(
        worse,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(float(low), float(high)) for low, high in bounds.T],
        options={"maxiter": 300, "ftol": 1e-13, "gtol": 1e-5},
    )
    return np.asarray(found.x)


def _curvature(
    problem: LinearEvidence, theta: FloatArray, bounds: FloatArray, usual: FloatArray
) -> FloatArray:
    """Information ``(G + C, G + C)`` on the logarithms of sizes and noise.

    By the curvature of their likelihood, but no less than their bounds give: as if uniform between
    them.
    """
    step = _CURVATURE_STEP * np.eye(len(theta))
    curvature = [
        (_slope(problem, theta + s, usual)[1] - _slope(problem, theta - s, usual)[1])
        / (2.0 * _CURVATURE_STEP)
        for s in step
    ]
    least = 12.0 / np.maximum(bounds[1] - bounds[0], _CURVATURE_STEP) ** 2
    information = -np.asarray(curvature).reshape(len(theta), -1) + np.diag(least)
    values, vectors = np.linalg.eigh((information + information.T) / 2.0)
    return np.asarray((vectors * np.maximum(values, least.min(initial=np.inf))) @ vectors.T)


def _volume(
    information: FloatArray, theta: FloatArray, bounds: FloatArray, usual: FloatArray
) -> float:
    """Logarithm of the share of all that sizes and noise may be which the measurements leave.

    Laplace's approximation: the prior at the likeliest sizes (MacKay 1992, "Bayesian
    interpolation"), log-normal about the usual one or uniform between the bounds, times the volume
    of what is as likely.
    """
    known = np.isfinite(usual)
    off = (theta - usual)[known] / USUAL_WITHIN
    prior = -0.5 * off @ off - known.sum() * np.log(USUAL_WITHIN * np.sqrt(2.0 * np.pi))
    widths = np.maximum((bounds[1] - bounds[0])[~known], _CURVATURE_STEP)
    prior -= np.log(widths).sum()
    return float(prior - 0.5 * np.linalg.slogdet(information / (2.0 * np.pi))[1])


def _covariance_of_sizes(
    problem: LinearEvidence, theta: FloatArray, information: FloatArray
) -> FloatArray:
    """Covariance ``(p, p)`` [SI] of the likeliest parameters over sizes and noise as uncertain."""
    if not theta.size:
        return np.zeros((len(problem.nominal), len(problem.nominal)))
    moved = problem.sensitivity(theta)
    return np.asarray(moved @ np.linalg.solve(information, moved.T))


def _members(model: CalibrationModel, groups: Sequence[PriorGroup]) -> tuple[IntArray, ...]:
    """Columns of the parameters of each group."""
    taken: dict[str, str] = {}
    members = []
    for group in groups:
        for name in group.parameters:
            if name not in model.names:
                raise InputError(
                    f"the group {group.name!r} names {name!r}, which is no parameter of the model",
                    hint=near_names(name, model.names),
                    name=name,
                )
            if name in taken:
                raise InputError(
                    f"{name} is in two groups, {taken[name]!r} and {group.name!r}",
                    hint="put it in one",
                    name=name,
                )
            taken[name] = group.name
        columns = np.array([model.names.index(name) for name in group.parameters], dtype=np.intp)
        units = {model.units[k] for k in columns}
        if len(units) > 1:
            raise InputError(
                f"the group {group.name!r} mixes units: {', '.join(sorted(units))}",
                hint="one standard deviation has one unit: make two groups",
                name=group.name,
            )
        members.append(columns)
    return tuple(members)


def _notes(groups: Sequence[PriorGroup], theta: FloatArray, bounds: FloatArray) -> list[str]:
    notes = []
    for g, group in enumerate(groups):
        for bound, side in zip(bounds[:, g], ("lower", "upper"), strict=True):
            if group.lower < group.upper and abs(theta[g] - bound) < _AT_BOUND:
                notes.append(f"the prior of the group {group.name!r} stands at its {side} bound")
    return notes
