"""A model to be tried, and its fit: with the sizes of its priors where these are to be found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.identification.evidence import LOSSES, PriorGroup, tune_priors
from calib.identification.result import IdentificationResult
from calib.identification.robust import Loss
from calib.identification.solver import Method, identify
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import FloatArray

HELD = 1e-3
"""Of its prior: standard deviation of a compliance that came out below zero, and is held there. No
reducer gives way against its load."""

_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model to be tried.

    Attributes
    ----------
    name : str
    model : CalibrationModel
    notes : tuple of str
        What was done to it, such as parameters merged with others.
    groups : tuple of PriorGroup
        Priors of which the sizes are to be found from the measurements.
    """

    name: str
    model: CalibrationModel
    notes: tuple[str, ...] = ()
    groups: tuple[PriorGroup, ...] = ()


@dataclass(frozen=True, eq=False)
class Fitted:
    """A candidate as fitted.

    Attributes
    ----------
    model : CalibrationModel
        With the sizes of its priors and the noise that were found.
    result : IdentificationResult
    log_marginal : float
        How likely the measurements are under the model, see
        :class:`~calib.identification.TunedPriors`; NaN of a model whose priors were not tuned.
    """

    model: CalibrationModel
    result: IdentificationResult
    log_marginal: float = float("nan")


def fit(
    candidate: Candidate,
    data: Measurements,
    *,
    weighted: bool = True,
    method: Method = "gauss-newton",
    loss: Loss = "least-squares",
) -> Fitted:
    """Identify a candidate.

    Sizes of its priors, and with them noise that is to be estimated, are found first. Compliances
    held by a prior that come out below zero are held at zero.

    Raises
    ------
    CalibError
        As :func:`~calib.identification.tune_priors` and :func:`calib.identify`.
    """
    model, start, known = candidate.model, None, None
    of_sizes: FloatArray | float = 0.0
    log_marginal = float("nan")
    if candidate.groups:
        tuned = tune_priors(
            model, data, candidate.groups, loss=loss if loss in LOSSES else "student-t"
        )
        model, start, of_sizes = tuned.model, tuned.x, tuned.covariance
        log_marginal = tuned.log_marginal
        kinds = [kind.of_found_noise() if kind.estimated else kind for kind in model.measurements]
        model = model.with_measurements(kinds)
    usual = model.prior
    free = np.array([unit == "rad/Nm" for unit in model.units]) & np.isfinite(usual)
    for _ in range(_ROUNDS):
        result = identify(
            model,
            data,
            weighted=weighted,
            method=method,
            loss=loss,
            name=candidate.name,
            start=start,
        )
        if known is None:  # how well parameters are known does not hang on what is held at zero
            known = result.covariance + of_sizes
        result = replace(result, covariance=known, prior=usual)
        below = free & (result.values < -2.0 * HELD * usual)
        if not below.any():
            break
        free &= ~below
        model = model.with_prior(np.where(below, HELD * usual, model.prior))
        start = None if start is None else np.where(below, model.nominal, result.values)
    return Fitted(model, result, log_marginal)
