"""A model to be tried, and its fit: with the sizes of its priors where these are to be found.

An arm with everything that could be off, held by what arms of its kind are off by, is what other
models are judged by. How large errors of each kind are on this arm is found from
the measurements within bounds, and so is noise that does not explain the residuals: priors weigh
against the noise that there is, not against a wrong one.

Some errors most arms do not have: joints that give way, transmissions that run unevenly. Arms
without them are alternatives, each as probable as the measurements make it (Bayesian model
averaging: Hoeting, Madigan, Raftery and Volinsky 1999, Statistical Science 14, 382-417). An arm
that may have everything is taken to have a little of everything.

Models of everything that could be off on the arm, held by priors of the right size, say after the
measurements what the true arm may be: their probability, mean and covariance. Any model is judged
by that, the arm as described too: by how far its tool point is from the one of arms drawn from
there, at postures where the arm will work. Unlike residuals, this sees what the measurements do
not: where touch-ups leave the scale of the arm open, every drawn arm has another one. (Decision
theory: the mean of the loss after the data, Berger, Statistical Decision Theory and Bayesian
Analysis, 2nd ed., section 4.4.)
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from calib.chance import chi2_quantile
from calib.errors import CalibError, ConvergenceError
from calib.identification.deviations import components
from calib.identification.evidence import (
    LOSSES,
    SETTLED,
    PriorGroup,
    Similar,
    TunedPriors,
    tune_priors,
)
from calib.identification.prediction import Carried, Expectation, deviated_m2
from calib.identification.result import IdentificationResult, Loss
from calib.identification.robust import (
    HEAVY_TAILS,
    costs_of,
    gain_of_student,
    judged_together,
    redundancy,
    rows_judged,
)
from calib.identification.solver import Method, identify
from calib.model import CalibrationModel, Setup
from calib.model.deviation import summed
from calib.model.measurements import Measurement, Measurements
from calib.se3 import FloatArray

HELD = 1e-3
"""Of its prior: standard deviation of a compliance that came out below zero, and is held there. No
reducer gives way against its load."""

_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model to be tried."""

    name: str
    model: CalibrationModel
    notes: tuple[str, ...] = ()  # what was done to it, such as parameters merged with others
    groups: tuple[PriorGroup, ...] = ()
    """Priors of which the sizes are to be found from the measurements."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A candidate as fitted."""

    model: CalibrationModel  # with the sizes of its priors and the noise that were found
    result: IdentificationResult
    tuned: TunedPriors | None = None  # None of a model whose priors were not tuned

    @property
    def log_marginal(self) -> float:
        """Logarithm of how likely the measurements are under the model; NaN of one not tuned."""
        return float("nan") if self.tuned is None else self.tuned.log_marginal


def fit(
    candidate: Candidate,
    data: Measurements,
    *,
    weighted: bool = True,
    method: Method = "gauss-newton",
    loss: Loss = "least-squares",
    tuned: TunedPriors | None = None,
) -> Fitted:
    """Identify a candidate.

    Sizes of its priors, and with them noise that is to be estimated, are found first, unless they
    are given. Compliances held by a prior that come out below zero are held at zero.
    """
    model, start, known = candidate.model, None, None
    of_sizes: FloatArray | float = 0.0
    if candidate.groups:
        tuned = tuned or _tune(candidate, data, loss)
        model, start, of_sizes = tuned.model, tuned.x, tuned.covariance
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
    return Fitted(model, result, tuned)


def _tune(
    candidate: Candidate,
    data: Measurements,
    loss: Loss,
    like: Fitted | None = None,
    *,
    identifiable: bool = False,
) -> TunedPriors:
    """Find sizes and noise, from those of a model that has as many parameters or more.

    ``identifiable``: the other has more, so that this one needs no check; it is one of several
    alternatives, whose probabilities need fewer digits.
    """
    known = loss in LOSSES  # others may have weights of zero, which have no evidence
    return tune_priors(
        candidate.model,
        data,
        candidate.groups,
        loss=loss if known else "student-t",
        like=None if like is None else _similar(like, known),
        identifiable=identifiable,
        settled=10.0 * SETTLED if identifiable else SETTLED,
    )


def _similar(fitted: Fitted, weighed: bool) -> Similar | None:
    """Return what was found, for another model to start from."""
    tuned = fitted.tuned
    if tuned is None:
        return None
    sizes = {g.name: float(size) for g, size in zip(tuned.groups, tuned.sigma, strict=True)}
    weights = fitted.result.weights if weighed else None
    return Similar(fitted.model.names, tuned.x, weights, sizes)


DRAWS = 1000
"""Arms drawn: their mean square is known to some three per cent, and models are compared on the
same ones."""


LEAST_PROBABILITY = 0.01
"""Of arms of one kind, below which none is drawn."""


INTERVAL = 0.95

FURTHER_POSES = 10
"""Poses of the check that people make: their root mean square scatters, too."""


@dataclass(frozen=True, eq=False)
class Workplace:
    """Where an arm will work."""

    postures: FloatArray  # (K, n) [rad]
    setup: Setup  # tool and payload at each
    words: str  # what they are, for reports


@dataclass(frozen=True)
class ExpectedError:
    """Distance of the tool point from where the arm takes it to be, mean over a workplace.

    With the deviation of the arm from pose to pose, where the measurements show one.
    """

    rms_m: float  # root mean square over arms and workplace [m]
    low_m: float
    high_m: float
    """low_m, high_m: ends of the range of the root mean square over the workplace that holds
    ``share`` of the arms [m]."""
    share: float = INTERVAL
    median_m: float = float("nan")  # of the same over the arms [m]; NaN where it was not asked for


@dataclass(frozen=True, eq=False)
class Posterior(Carried):
    """What is known of the true arm after the measurements, if it is of one kind."""

    probability: float = 1.0  # that it is of this kind


class DrawnArms:
    """Arms drawn from what is known of the true one: what errors models have by it.

    ``scatter``: of arm and readings from pose to pose, which no model takes away; of it the
    ``deviation`` is that of the arm, along and about each axis [m, rad].
    """

    def __init__(
        self, kinds: Sequence[Posterior], workplace: Workplace, scatter: Scatter | None = None
    ) -> None:
        self.workplace = workplace
        self._scatter = (scatter or Scatter()).over(kinds[0], workplace)
        self.deviation = self._scatter.deviation
        self._drawn = [
            _drawn(kind, workplace) for kind in kinds if kind.probability >= LEAST_PROBABILITY
        ]

    def error_of(
        self, model: CalibrationModel, x: FloatArray, *, as_measured: bool = False
    ) -> ExpectedError:
        """Error of an arm whose controller knew the parameters ``(p,)`` of a model [SI].

        ``as_measured``: as the instrument will read it at :data:`FURTHER_POSES` poses that took no
        part, its noise included.
        """
        if as_measured:
            return self._as_measured(model, x)
        squares = np.concatenate(
            [
                3.0 * np.mean((mean.displaced(model, x)[0][:, None] + off) ** 2, axis=0)
                for mean, off in self._drawn
            ]
        )
        return _of_squares(squares + self._scatter.of_arm_m2 * self._scatter.larger(len(squares)))

    def _as_measured(self, model: CalibrationModel, x: FloatArray) -> ExpectedError:
        rng, scatter = np.random.default_rng(1), self._scatter
        every = []
        for mean, off in self._drawn:
            each = (mean.displaced(model, x)[0][:, None] + off) ** 2
            each = each.reshape(-1, 3, each.shape[1]).sum(axis=1)  # (K, draws)
            some = rng.integers(len(each), size=(FURTHER_POSES, each.shape[1]))
            every.append(np.take_along_axis(each, some, axis=0))
        squares = np.concatenate(every, axis=1)
        tails = scatter.tails[rng.integers(len(scatter.tails), size=squares.shape)]
        more = (scatter.of_arm_m2 + scatter.of_reading_m2) * scatter.larger(squares.shape[1])
        return _of_squares(np.mean(squares + more * tails, axis=0))


def _of_squares(squares: FloatArray) -> ExpectedError:
    """Return the error of mean squares ``(D,)`` [m²] of drawn arms."""
    tails = (1.0 - INTERVAL) / 2.0, (1.0 + INTERVAL) / 2.0
    low, high = np.sqrt(np.quantile(squares, tails))
    return ExpectedError(float(np.sqrt(squares.mean())), float(low), float(high))


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of arm and readings from pose to pose, heavy tails included."""

    deviation: tuple[float, float] = (0.0, 0.0)
    """Standard deviations of where the arm stops, along and about each axis [m, rad]."""
    of_reading_m2: float = 0.0  # mean square of the noise of a reading, all its lengths together
    freedom: float = np.inf  # degrees of freedom by which both are known
    tails: FloatArray = field(default_factory=lambda: np.ones(1))
    """(M,): square of each pose over their mean."""
    of_arm_m2: float = 0.0  # mean square of the tool point by the deviation

    def over(self, kind: Posterior, workplace: Workplace) -> Scatter:
        """Return the same with what the deviation does to the tool point over a workplace."""
        if not any(self.deviation):
            return self
        view = kind.model.view(workplace.postures, kind.x, workplace.setup)
        return replace(self, of_arm_m2=float(np.mean(deviated_m2(view, self.deviation))))

    def larger(self, count: int) -> FloatArray:
        """Return so many draws of the true mean square over the one that was found."""
        if not np.isfinite(self.freedom):
            return np.ones(count)
        quantiles = chi2_quantile((np.arange(count) + 0.5) / count, self.freedom)
        return np.random.default_rng(2).permutation(self.freedom / quantiles)


def _drawn(kind: Posterior, workplace: Workplace) -> tuple[Expectation, FloatArray]:
    """The mean of a kind, and how far arms drawn from it are from that, ``(3 K, draws)`` [m].

    As many of the draws as the kind is probable.
    """
    mean = Expectation(kind.model, kind.x, kind.covariance, workplace.postures, workplace.setup)
    values, vectors = np.linalg.eigh(kind.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # the same draws for all models, and without what chance gives the mean of so few
    pairs = round(kind.probability * DRAWS / 2)
    draws = np.random.default_rng(0).standard_normal((kind.model.p, pairs))
    return mean, mean.jacobian @ root @ np.concatenate([draws, -draws], axis=1)


LEAST_NOISE_SCALE = 0.1
"""Residuals over noise below which they are of rounding, and their tails say nothing."""

_COMPONENT_ROUNDS, _COMPONENTS_SETTLED = 6, 0.02
"""Rounds of components of variance, and their change below which they have settled: a fifth of how
well some hundred stops tell them."""

LEAST_LEFT = 0.1
"""Redundancy of a measurement from which its residual says something of its error."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference of a set of measurements."""

    candidate: Candidate
    given: CalibrationModel  # before sizes and noise were found
    fitted: Fitted
    arms: DrawnArms  # by which other models are judged
    loss: Loss  # that it was fitted with, and that the others are to be
    probabilities: dict[str, float]
    """Of the arm with everything, and of each alternative, by their names: after the measurements,
    before which all are alike."""

    @property
    def noise_found(self) -> list[tuple[Measurement, Measurement]]:
        """Kinds whose noise is that of the residuals and not the one given: both."""
        kinds = zip(self.given.measurements, self.fitted.model.measurements, strict=True)
        return [(given, found) for given, found in kinds if found.found and not given.estimated]


def fit_reference(
    candidate: Candidate,
    data: Measurements,
    workplace: Workplace,
    alternatives: Sequence[Candidate] = (),
    *,
    loss: Loss | None = None,
) -> Reference:
    """Fit with the noise given; where that does not explain the residuals, with the one they show.

    Parameters
    ----------
    candidate : Candidate
        Everything that may be off, with the groups of its priors.
    alternatives : sequence of Candidate
        Arms without some of it. One that cannot be fitted is improbable.
    loss : Loss, optional
        By default least squares, or Student's where residuals have heavier tails than noise has.
    """
    usual: Loss = "least-squares" if loss is None else loss
    given, data = candidate.model, data.at_stops()
    candidate, fitted = _fit(candidate, data, usual)
    shown = _components_of(fitted, data, usual)
    heavy = loss is None and _tails(shown or fitted.model, fitted.result, data) > HEAVY_TAILS
    if heavy:
        usual = "student-t"
    if shown is not None:
        candidate, fitted = _by_components(candidate, fitted, data, usual, shown)
    elif heavy:
        candidate, fitted = _fit(candidate, data, usual)
    fits = {candidate.name: fitted}
    logs = {candidate.name: fitted.log_marginal}
    for one in alternatives:
        # their noise is found where that of the whole arm was, about what that started from
        kinds = candidate.model.measurements
        one = replace(one, model=one.model.with_measurements(kinds))
        with suppress(CalibError):
            tuned = _tune(one, data, usual, fitted, identifiable=True)
            if tuned.log_marginal > fitted.log_marginal + np.log(LEAST_PROBABILITY):
                fits[one.name] = fit(one, data, loss=usual, tuned=tuned)
            logs[one.name] = tuned.log_marginal
    odds = np.exp(np.nan_to_num([log - max(logs.values()) for log in logs.values()]))
    shares = dict(zip(logs, (odds / odds.sum()).tolist(), strict=True))  # of one without groups: 1
    arms = DrawnArms(
        [
            Posterior(one.model, one.result.values, one.result.covariance, shares[name])
            for name, one in fits.items()
        ],
        workplace,
        _scatter_of(fitted, data),
    )
    return Reference(candidate, given, fitted, arms, usual, shares)


def _fit(candidate: Candidate, data: Measurements, loss: Loss) -> tuple[Candidate, Fitted]:
    """The fit, and the candidate with the kinds of measurement whose noise was found marked so."""
    kinds = candidate.model.measurements
    unknown = [kind.of_unknown_noise() for kind in kinds]
    try:
        fitted = fit(candidate, data, loss=loss)
        doubted = {noise.kind for noise in fitted.result.noise if noise.doubted}
        if not doubted:
            return candidate, fitted
        unknown = [u if u.name in doubted else k for u, k in zip(unknown, kinds, strict=True)]
    except ConvergenceError:  # a noise that is far too small makes valleys too narrow to follow
        fitted = None
    again = replace(candidate, model=candidate.model.with_measurements(unknown))
    try:
        return again, fit(again, data, loss=loss)
    except CalibError:  # so few equations that they do not show it
        if fitted is None:
            raise
        return candidate, fitted


def _components_of(fitted: Fitted, data: Measurements, loss: Loss) -> CalibrationModel | None:
    """Return the model with the components of variance that a fit shows, see :func:`components`."""
    used = np.flatnonzero(fitted.result.used)
    weights = fitted.result.weights[used]
    linear = fitted.model.linearise_at(data[used], fitted.result.values)
    return components(linear, weights / costs_of(linear, weights, loss)[0])


def _by_components(
    candidate: Candidate, fitted: Fitted, data: Measurements, loss: Loss, shown: CalibrationModel
) -> tuple[Candidate, Fitted]:
    """Fit again with the noise within stops and the deviation of the arm that a fit showed.

    Both are found at a solution, sizes of priors and the solution with these, in turns.
    """
    for _ in range(_COMPONENT_ROUNDS):
        again = replace(candidate, model=candidate.model.with_measurements(shown.measurements))
        try:
            tuned = _tune(again, data, loss, fitted) if again.groups else None
            candidate, fitted = again, fit(again, data, loss=loss, tuned=tuned)
        except CalibError:  # so few equations that they do not show it
            return candidate, fitted
        before, found = _noise_of(shown), _components_of(fitted, data, loss)
        if found is None or np.allclose(_noise_of(found), before, _COMPONENTS_SETTLED, 0.0):
            break
        shown = found
    return candidate, fitted


def _tails(model: CalibrationModel, result: IdentificationResult, data: Measurements) -> float:
    """How much likelier heavy tails make the residuals, see :func:`gain_of_student`."""
    if not result.noise_scale > LEAST_NOISE_SCALE:
        return 0.0
    setup = data.setup
    white, free = redundancy(model.linearise_at(data, result.values), np.ones(data.count))
    rows = rows_judged(model, setup)
    left = judged_together(model, setup, free.sum(axis=1)) / rows
    squares = judged_together(model, setup, np.sum(white**2, axis=1))
    first = np.arange(data.count)
    if model.arm_sigma is not None:
        first = np.unique(setup.stops, return_index=True)[1]
    seen = first[left[first] > LEAST_LEFT]
    return gain_of_student(squares[seen] / left[seen], rows[seen])


def _scatter_of(fitted: Fitted, data: Measurements) -> Scatter:
    """Return the scatter that the residuals show: larger than that of most where tails are heavy.

    Mean squares of stops scatter about their mean by what tells how well that is known.
    """
    model, result, used = fitted.model, fitted.result, fitted.result.used
    white, free = redundancy(model.linearise_at(data, result.values), np.ones(data.count))
    stops = data.setup.stops[used]
    squares, freedom = (summed(np.sum(r[used], axis=1), stops) for r in (white**2, free))
    heavier = float(squares.sum() / max(freedom.sum(), 1.0))
    off = squares - heavier * freedom
    known = 2.0 * squares.sum() ** 2 / max(float(off @ off), np.finfo(float).tiny)
    kinds = [model.measurements[k] for k in data.setup.kind[used]]
    lengths = [np.sum(kind.sigma[: kind.rows - kind.turns] ** 2) for kind in kinds]
    root = float(np.sqrt(max(heavier, 1.0)))
    shift, turn = (root * sigma for sigma in model.arm_sigma or (0.0, 0.0))
    told = freedom > LEAST_LEFT
    tails = squares[told] / freedom[told] if told.any() else np.ones(1)
    tails = tails / tails.mean() if tails.any() else np.ones(1)
    return Scatter((shift, turn), root**2 * float(np.mean(lengths)), max(known, 3.0), tails)


def _noise_of(model: CalibrationModel) -> FloatArray:
    """Return the noise of all kinds, and the deviation of the arm [m, rad]."""
    return np.concatenate([*(k.sigma for k in model.measurements), model.arm_sigma or (0.0, 0.0)])
