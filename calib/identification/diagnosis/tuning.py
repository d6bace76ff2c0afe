"""Noise and sizes of priors for which measurements are likeliest, with an effect and without it.

What a fault leaves over makes noise and errors of the arm look larger than they are, and then
hides among them. Where the scores show something, both are found again with the effect in the
model: the ratio of the two marginal likelihoods is the Bayes factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from calib.errors import CalibError
from calib.identification.diagnosis.held import Effect, Held, held_at, lasting
from calib.identification.evidence import PriorGroup, tune_priors
from calib.identification.marginal import LinearEvidence, linear_evidence, noise_classes
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import FloatArray

_SMALLER = 50.0
"""How much smaller than given priors may be found."""

_NOISE = (np.log(1e-2), np.log(1e2))
"""Logarithms of noise with an effect over the one without."""


@dataclass(frozen=True, eq=False)
class Tuned:
    """A solution with the noise and the priors that the measurements show.

    Attributes
    ----------
    held : Held
    groups : tuple of PriorGroup
    sigma : array (G,)
        Standard deviation of each group [SI].
    log_evidence : float
        Logarithm of the marginal likelihood.
    """

    held: Held
    groups: tuple[PriorGroup, ...]
    sigma: FloatArray
    log_evidence: float


def tuned(model: CalibrationModel, data: Measurements) -> Tuned | None:
    """Fit with the noise and the priors for which measurements are likeliest; None where none is.

    Priors are at most as large as given: what they cannot explain is no error of an arm.
    """
    kinds = [kind.of_unknown_noise() for kind in model.measurements]
    try:
        found = tune_priors(model.with_measurements(kinds), data, _groups(model))
    except (CalibError, np.linalg.LinAlgError):
        return None
    held = held_at(found.model, data, found.x)
    return Tuned(held, found.groups, found.sigma, found.log_evidence)


def _groups(model: CalibrationModel) -> list[PriorGroup]:
    """Parameters of the arm of one block and unit, whose priors have one size."""
    groups = []
    for block, part in zip(model.parameters, model.slices, strict=True):
        for unit in () if block.nuisance else dict.fromkeys(block.units):
            own = {
                name: float(sigma)
                for name, of, sigma in zip(block.names, block.units, model.prior[part], strict=True)
                if of == unit and np.isfinite(sigma)
            }
            if own:
                usual = float(np.sqrt(np.mean(np.square(list(own.values())))))
                groups.append(PriorGroup(next(iter(own)), tuple(own), usual / _SMALLER, usual))
    return groups


def log_odds(found: Tuned, effect: Effect) -> float:
    """Logarithm of the odds of an effect, noise and priors found again with it."""
    held = found.held
    model, data = held.model, held.data
    members = tuple(
        np.array([model.names.index(name) for name in group.parameters], dtype=np.intp)
        for group in found.groups
    )
    plain = linear_evidence(model, data, held.x, members, np.ones(data.count))
    start = np.append(np.log(found.sigma), np.zeros(len(plain.counts)))
    before = plain.log_evidence(start)[0]
    wider = _with(plain, held, effect)
    bounds = [(np.log(group.lower), np.log(group.upper)) for group in found.groups]
    bounds += [_NOISE] * len(plain.counts)

    def worse(theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = wider.log_evidence(theta)
        return -value, -gradient

    best = minimize(worse, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return float((-best.fun - before) * lasting(effect.alike) - effect.tried)


def _with(plain: LinearEvidence, held: Held, effect: Effect) -> LinearEvidence:
    """The linearised problem with the columns of an effect as further parameters."""
    model, data = held.model, held.data
    k, p = effect.columns.shape[-1], model.p
    y = held.linear.white_jacobian @ (held.x - model.nominal) - held.linear.white_rows
    both = np.concatenate([held.J * plain.unit, effect.columns, y[..., None]], axis=-1)
    masks = noise_classes(model, data)
    masks.append(~np.any(masks, axis=0) if masks else np.ones(both.shape[:2], dtype=bool))
    kept = [*range(p), p + k]
    grams = np.zeros((len(masks), p + k + 1, p + k + 1))
    for c, own in enumerate(masks):
        grams[c] = both[own].T @ both[own]
        grams[c][np.ix_(kept, kept)] = plain.grams[c]  # with what is known besides
    added = np.arange(p, p + k)
    grams[-1, added, added] += effect.usual**-2
    return LinearEvidence(
        np.append(plain.nominal, np.zeros(k)),
        np.append(plain.unit, np.ones(k)),
        np.append(plain.pull, np.ones(k)),
        grams,
        plain.counts,
        plain.members,
        plain.constant - k * float(np.log(effect.usual)),
    )
