"""Residuals of a model whose every parameter is held by what is known of it, and tests on them.

Parameters with priors are integrated out: measurements y, linearised, have the covariance
``V = I + J P Jᵀ`` over their noise, and a further effect z is judged by ``zᵀV⁻¹y`` and ``zᵀV⁻¹z``
(Rao's score test; Lindley and Smith, J. R. Stat. Soc. B 34, 1972). At the solution ``V⁻¹y`` are the
residuals, so that nothing is fitted again, wherever an effect is looked for.

How much likelier the measurements are with an effect is its Bayes factor, sizes of effects having
a normal distribution about nothing. Where there is none, a factor above K has a probability below
1/K, however many tests the factor is a mean of (Ville's inequality): level and search need no
further care. The noise is common to both sides and integrated out: Student's form.

Noise and sizes of priors for which measurements are likeliest, with an effect and without it.

What a fault leaves over makes noise and errors of the arm look larger than they are, and then
hides among them. Where the scores show something, both are found again with the effect in the
model: the ratio of the two marginal likelihoods is the Bayes factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from calib.errors import CalibError
from calib.identification.evidence import (
    LinearEvidence,
    TunedPriors,
    groups_of,
    linear_evidence,
    members_of,
    noise_classes,
    tune_priors,
)
from calib.identification.identifiability import UNSEEN_SCALE
from calib.identification.least_squares import column_lengths
from calib.model import CalibrationModel, Linearisation
from calib.model.measurements import Measurements
from calib.se3 import FloatArray

_RANK = 1e-10
"""Singular value over the largest, of columns of unit length, below which it is none."""

_LEFT = 1e-9
"""Part of an effect that the parameters leave, below which nothing is left of it."""

SIZES = (0.1, 1.0, 10.0)
"""Standard deviations of the sizes of effects that are tried, over the usual one."""


@dataclass(frozen=True, eq=False)
class Held:
    """Residuals at the solution of a model, and what its parameters take up."""

    linear: Linearisation  # at the solution
    data: Measurements
    x: FloatArray  # (p,) [SI]
    rows: FloatArray  # (N, m): residuals over their noise: ``V⁻¹y``
    J: FloatArray  # (N, m, p)
    Q: FloatArray
    """(N, m, r): of the orthonormal columns that parameters span, the rows of the measurements."""
    squares: float  # ``yᵀV⁻¹y``: of residuals and of what is known besides
    freedom: float  # what that is on average

    @property
    def model(self) -> CalibrationModel:
        """The model with its priors and its noise."""
        return self.linear.model

    @cached_property
    def blocks(self) -> FloatArray:
        """``V⁻¹`` of each measurement alone, ``(N, m, m)``."""
        return np.asarray(np.eye(self.rows.shape[1]) - self.Q @ np.swapaxes(self.Q, 1, 2))

    @cached_property
    def left_out(self) -> FloatArray:
        """Rows ``(N, m)`` of each measurement predicted from the others, over the noise."""
        inverse = np.linalg.pinv(self.blocks, rcond=_LEFT, hermitian=True)
        return np.asarray((inverse @ self.rows[..., None])[..., 0])

    @cached_property
    def standing_out(self) -> FloatArray:
        """Squares ``(N,)`` that would not be there without each measurement."""
        return np.asarray(np.sum(self.left_out * self.rows, axis=1))

    def gain(self, explained: FloatArray | float) -> FloatArray:
        """Logarithms of likelihoods gained by what explains so much of the squares."""
        whole = max(self.squares, self.freedom)
        left = np.maximum(whole - np.asarray(explained, dtype=float), _LEFT * whole)
        return np.asarray(0.5 * self.freedom * np.log(whole / left))

    def without(self, columns: FloatArray) -> FloatArray:
        """``V⁻¹z`` of effects ``(N, m, k)``: what the parameters do not take up of them."""
        inner = np.einsum("imr,imk->rk", self.Q, columns)
        return np.asarray(columns - self.Q @ inner)

    def after(self, columns: FloatArray, size: FloatArray) -> FloatArray:
        """Residuals ``(N, m)`` with effects ``(N, m, k)`` of a size ``(k,)`` taken into account."""
        return np.asarray(self.rows + self.without(columns) @ size)

    def lengths_m(self, rows: FloatArray) -> FloatArray:
        """Distances ``(N,)`` [m] of rows ``(N, m)`` over the noise; angles apart."""
        whole = self.linear.coloured(rows)
        for k, kind in enumerate(self.model.measurements):
            whole[self.data.setup.kind == k, kind.rows - kind.turns :] = 0.0
        return np.asarray(np.linalg.norm(whole, axis=1))

    def rms_m(self, rows: FloatArray | None = None) -> float:
        """Root mean square of :meth:`lengths_m` [m]; of the residuals by default."""
        return float(np.sqrt(np.mean(self.lengths_m(self.rows if rows is None else rows) ** 2)))


def held_at(model: CalibrationModel, data: Measurements, x: FloatArray) -> Held:
    """Linearise at the solution ``(p,)`` of a model."""
    linear = model.linearise_at(data, x)
    rows, J = linear.white_rows, linear.white_jacobian
    right, stacked = linear.stacked()
    U, singular, _ = np.linalg.svd(stacked / column_lengths(stacked), full_matrices=False)
    U = U[:, singular > _RANK * singular.max(initial=0.0)]
    right = right - U @ (U.T @ right)  # the last step: exact where the model is linear
    besides = len(right) - rows.size
    freedom = float(model.equations(data.setup) + besides - U.shape[1])
    return Held(
        linear,
        data,
        x,
        right[: rows.size].reshape(rows.shape),
        J,
        U[: rows.size].reshape(*rows.shape, -1),
        float(right @ right),
        max(freedom, 1.0),
    )


@dataclass(frozen=True, eq=False)
class Scores:
    """Effects tested at once."""

    log_odds: FloatArray  # (C,): logarithms of Bayes factors
    size: FloatArray  # (C, k): the likeliest size of each, in units of its columns
    usual: FloatArray  # (C,): deviation of sizes with which each is likeliest, of SIZES


@dataclass(frozen=True, eq=False)
class Effect:
    """A finding with the columns that it adds to the model."""

    finding: Finding
    columns: FloatArray
    """(N, m, k): change of the rows over the noise by the effect, in units of its usual size."""
    usual: float  # standard deviation of its size
    tried: float  # logarithm of how many others were tried beside it
    alike: float  # correlation of the residuals that it leaves, from one measurement to the next


def scores(
    held: Held, score: FloatArray, information: FloatArray, whole: FloatArray, alike: float = 0.0
) -> Scores:
    """Test effects by their scores.

    Parameters
    ----------
    score : array (C, k)
        ``zᵀV⁻¹y`` of C effects, columns in units of the usual size.
    information, whole : array (C, k, k)
        ``zᵀV⁻¹z`` and ``zᵀz``.
    alike : float
        Correlation of residuals from one measurement to the next, which effects that last feign.
    """
    k = score.shape[-1]
    total = np.maximum(np.trace(whole, axis1=1, axis2=2), np.finfo(float).tiny)
    seen = np.trace(information, axis1=1, axis2=2) > _LEFT * total
    tempered = lasting(alike)
    odds, size = [], []
    for usual in SIZES:
        A = information + np.eye(k) / usual**2
        b = np.linalg.solve(A, -score[..., None])[..., 0]
        took = np.sum(-score * b, axis=1)
        det = np.linalg.slogdet(A * usual**2)[1]
        odds.append(np.where(seen, held.gain(took * tempered) - 0.5 * det, -np.inf))
        size.append(b)
    best = np.argmax(odds, axis=0)
    every = np.arange(len(score))
    log_odds = np.array(odds)[best, every] - np.log(len(SIZES))
    return Scores(log_odds, np.array(size)[best, every], np.array(SIZES)[best])


def log_mean(log_odds: FloatArray) -> float:
    """Logarithm of the mean of Bayes factors, for which their level holds as for one."""
    return float(np.logaddexp.reduce(log_odds) - np.log(len(log_odds)))


def lasting(alike: float) -> float:
    """Part of a gain that is left to effects that last, where neighbours are alike by chance."""
    return (1.0 - alike) / (1.0 + alike)


def score_of(held: Held, columns: FloatArray, alike: float = 0.0) -> Scores:
    """The same for one effect of columns ``(N, m, k)``."""
    return scores(
        held,
        np.einsum("imk,im->k", columns, held.rows)[None],
        np.einsum("imk,iml->kl", columns, held.without(columns))[None],
        np.einsum("imk,iml->kl", columns, columns)[None],
        alike,
    )


_SMALLER = 50.0
"""How much smaller than given priors may be found."""

_NOISE = (np.log(1e-2), np.log(1e2))
"""Logarithms of noise with an effect over the one without."""


@dataclass(frozen=True, eq=False)
class Tuned:
    """A solution with the noise and the priors that the measurements show."""

    held: Held
    priors: TunedPriors


def tuned(model: CalibrationModel, data: Measurements) -> Tuned | None:
    """Fit with the noise and the priors for which measurements are likeliest; None where none is.

    Priors are at most as large as given: what they cannot explain is no error of an arm.
    """
    kinds = [kind.of_unknown_noise() for kind in model.measurements]
    try:
        groups = groups_of(model, 1.0 / _SMALLER, 1.0)
        found = tune_priors(model.with_measurements(kinds), data, groups)
    except (CalibError, np.linalg.LinAlgError):
        return None
    held = held_at(found.model, data, found.x)
    return Tuned(held, found)


def log_odds(found: Tuned, effect: Effect) -> float:
    """Logarithm of the odds of an effect, noise and priors found again with it."""
    from scipy.optimize import minimize

    held = found.held
    members = members_of(held.model, found.priors.groups)
    plain = linear_evidence(held.linear, members, np.ones(held.data.count))
    start = np.zeros(len(plain.counts))
    start[: len(members)] = np.log(found.priors.sigma)
    before = plain.log_evidence(start)[0]
    wider = _with(plain, held, effect, len(members))
    bounds = [(np.log(group.lower), np.log(group.upper)) for group in found.priors.groups]
    bounds += [_NOISE] * (len(plain.counts) - len(members))

    def worse(theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = wider.log_evidence(theta)
        return -value, -gradient

    best = minimize(worse, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return float((-best.fun - before) * lasting(effect.alike) - effect.tried)


def _with(plain: LinearEvidence, held: Held, effect: Effect, groups: int) -> LinearEvidence:
    """The linearised problem with the columns of an effect as further parameters."""
    model = held.model
    k, p = effect.columns.shape[-1], model.p
    y = held.linear.white_jacobian @ (held.x - model.nominal) - held.linear.white_rows
    both = np.concatenate([held.J * plain.unit, effect.columns, y[..., None]], axis=-1)
    masks = noise_classes(model, held.data.setup)
    masks.append(~np.any(masks, axis=0) if masks else np.ones(both.shape[:2], dtype=bool))
    grams = np.zeros((len(plain.grams), p + k + 1, p + k + 1))
    for c, own in enumerate(masks, start=groups):
        grams[c] = both[own].T @ both[own]
    kept = [*range(p), p + k]
    grams[np.ix_(range(len(grams)), kept, kept)] = plain.grams  # with what is known besides
    added = np.arange(p, p + k)
    grams[-1, added, added] += effect.usual**-2
    return LinearEvidence(
        np.append(plain.nominal, np.zeros(k)),
        np.append(plain.unit, np.ones(k)),
        grams,
        plain.counts,
        plain.constant - k * float(np.log(effect.usual)),
    )


_Gross = Literal[
    "sign",
    "zero",
    "sign and zero",
    "coupling",
    "swapped joints",
    "all signs",
    "joint unit",
    "reading unit",
    "mirrored axis",
    "swapped axes",
    "turned axes",
    "inverted rotation",
    "inverted pose",
    "shifted rows",
    "shifted labels",
]

Cause = Literal[
    _Gross,
    "step",
    "drift",
    "warm-up",
    "scale",
    "reach",
    "harmonic",
    "swapped rows",
    "swapped labels",
    "wrong label",
]
"""Of residuals, as a measurement goes wrong."""

GROSS: frozenset[Cause] = frozenset(get_args(_Gross))
"""Causes that all rows suffer from: with them nothing that was identified is of the robot."""

MODEL: frozenset[Cause] = frozenset({"reach", "harmonic"})
"""Causes that lie in the arm, not in how it was measured: the model is incomplete there."""


@dataclass(frozen=True)
class Finding:
    """One cause that explains residuals far better than chance."""

    cause: Cause
    things: tuple[str, ...]
    """What it happened to: labels of tools or targets, names of joints, axes."""
    part: str
    """Of what kind these are: ``tool``, ``target``, ``targets``, ``instrument``, ``joint``,
    ``axis`` or nothing."""
    rows: tuple[int, ...]
    """Measurements concerned: the first one after a step, those swapped or mislabelled."""
    size: float  # of the effect: a length [m], an angle [rad], a factor; NaN where it has none
    unit: str  # ``m``, ``rad`` or nothing
    before_m: float
    after_m: float
    """before_m, after_m: root mean square distance left over as measured and with the cause taken
    out [m]."""
    log_odds: float
    """Natural logarithm of how much likelier the measurements are with the cause than without, what
    was tried besides considered."""
    also: tuple[Finding, ...] = ()  # other causes that explain the measurements as well

    @property
    def is_gross(self) -> bool:
        """Whether all rows suffer from it: nothing identified with it is of the robot.

        A scale, where it is off by more than arms are built: a model would take it for long links.
        """
        return abs(self.size) > UNSEEN_SCALE if self.cause == "scale" else self.cause in GROSS

    @property
    def is_of_the_model(self) -> bool:
        """Whether the arm has what its model leaves out; nothing went wrong in measuring then."""
        return self.cause in MODEL
