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

from calib.batch_last import cross
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
from calib.judgement import Grade, grade_of
from calib.model import CalibrationModel, Linearisation
from calib.model.deviation import summed
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

_RANK = 1e-10
"""Singular value over the largest, of columns of unit length, below which it is none."""

_LEFT = 1e-9
"""Part of an effect that the parameters leave, below which nothing is left of it."""

FEWEST_ASIDE = 3
"""Poses before and after a step: of two, one that is wrong is no step."""

MOST_TAKEN = 24
"""Directions of what parameters take up of an effect that are looked at in other orders."""

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

    def moved_by(self, columns: FloatArray, size: FloatArray) -> FloatArray:
        """Change ``(p,)`` [SI] of the parameters when effects ``(N, m, k)`` are taken into account.

        They take up less of the effects then.
        """
        J = self.linear.stacked()[1]
        right = np.zeros(len(J))
        right[: self.rows.size] = (columns @ size).ravel()
        length = column_lengths(J)
        return np.asarray(-np.linalg.lstsq(J / length, right, rcond=_RANK)[0] / length)

    def answer(self, change: FloatArray) -> tuple[float, float]:
        """Effect of a change ``(p,)`` of the parameters on the answer: [m], and in its sigmas.

        The answer is where the arm takes its tool point at the postures measured, the base placed
        anew, and the tool: what parameters of the arm make of a rigid motion is no error of it.
        Root mean squares over the postures.
        """
        view, arm = self.linear.view, ~self.model.nuisance
        D = self.linear.motion[:, :3].reshape(self.model.p, -1).T  # by x, y, z of all postures
        rigid = np.zeros((6, *view.point.shape))
        rigid[[0, 1, 2], [0, 1, 2]] = 1.0
        for k, axis in enumerate(np.eye(3)):
            rigid[3 + k] = cross(axis[:, None], view.point)
        placed = np.column_stack([D[:, ~arm], rigid.reshape(6, -1).T])
        U, singular, _ = np.linalg.svd(placed / column_lengths(placed), full_matrices=False)
        U = U[:, singular > _RANK * singular.max(initial=0.0)]
        D = D[:, arm] - U @ (U.T @ D[:, arm])
        J = self.linear.stacked()[1]
        length = column_lengths(J)
        _, values, V = np.linalg.svd(J / length, full_matrices=False)
        seen = values > _RANK * values.max(initial=0.0)
        spread = D @ (V[seen] / values[seen, None] / length).T[arm]
        squares = float(np.sum((D @ change[arm]) ** 2))
        known = float(np.sum(spread**2))
        count = view.point.shape[1]
        return float(np.sqrt(squares / count)), float(np.sqrt(squares / max(known, 1e-300)))

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
class Effect:
    """A finding with the columns that it adds to the model."""

    finding: Finding
    columns: FloatArray
    """(N, m, k): change of the rows over the noise by the effect, in units of its usual size."""
    usual: float  # standard deviation of its size
    size: FloatArray  # (k,): likeliest size, in units of the columns
    tried: float  # logarithm of how many others were tried beside it


@dataclass(frozen=True, eq=False)
class ScoreTests:
    """Score tests of effects that have the same columns, in several courses of measurement.

    An effect has the columns ``course_i z_i`` from one of the starts on. What is inverted depends
    on no residual: residuals of many placebos are tested at once.
    """

    held: Held
    columns: FloatArray  # (N, m, k): in units of the usual size
    course: FloatArray  # (N,): factor of the columns of each measurement
    starts: IntArray  # (C,): first measurement of each effect

    @cached_property
    def information(self) -> FloatArray:
        """``zᵀV⁻¹z`` ``(C, k, k)`` of each effect; noughts where next to nothing is left of it."""
        Z = self.columns * self.course[:, None, None]
        whole = self._from(np.einsum("imk,iml->ikl", Z, Z, optimize=True))
        inner = self._from(np.einsum("imr,imk->irk", self.held.Q, Z, optimize=True))
        left = whole - np.swapaxes(inner, 1, 2) @ inner
        seen = np.trace(left, axis1=1, axis2=2) > _LEFT * np.trace(whole, axis1=1, axis2=2)
        return np.asarray(np.where(seen[:, None, None], left, 0.0))

    @cached_property
    def _inverted(self) -> tuple[FloatArray, FloatArray]:
        """Inverse information ``(S, C, k, k)`` and its half logarithm ``(S, C)``, by size."""
        usual = np.array(SIZES)[:, None, None, None]
        A = self.information + np.eye(self.columns.shape[-1]) / usual**2
        half_log = 0.5 * np.linalg.slogdet(A * usual**2)[1]
        seen = self.information.any(axis=(1, 2))
        return np.linalg.inv(A), np.where(seen, half_log, np.inf)

    def _from(self, each: FloatArray) -> FloatArray:
        """Sums ``(..., C, k)`` over each start and all that follow, of ``(..., N, k)`` by rows."""
        if len(self.starts) == 1:
            return np.asarray(each[self.starts[0] :].sum(axis=0)[None])
        return np.asarray(np.cumsum(each[::-1], axis=0)[::-1][self.starts])

    def log_odds(self, rows: FloatArray) -> FloatArray:
        """Logarithms of Bayes factors ``(S, C, B)`` for residuals ``(N, m, B)``, by size."""
        return np.asarray(self.held.gain(self._took(rows)[0]) - self._inverted[1][..., None])

    def _took(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squares ``(S, C, B)`` that effects explain, and their sizes ``(S, C, k, B)``."""
        Z = self.columns * self.course[:, None, None]
        score = self._from(np.einsum("imk,imb->ikb", Z, rows, optimize=True))
        size = -(self._inverted[0] @ score)
        return -np.sum(score * size, axis=2), size

    def odds_of_all(self, rows: FloatArray) -> FloatArray:
        """Logarithms of the mean Bayes factors ``(B,)`` of all courses, sizes being tried."""
        odds = self.log_odds(rows).max(axis=0) - np.log(len(SIZES))
        return np.asarray(np.logaddexp.reduce(odds, axis=0) - np.log(len(self.starts)))

    def odds_in_orders(self, orders: IntArray) -> FloatArray:
        """Logarithms of mean Bayes factors ``(B,)`` with the poses in other orders ``(B, P)``.

        Residuals and columns go with their poses; the course goes on. Of what parameters take up,
        the directions that matter most are enough: a permutation test is exact by any statistic.
        """
        score, whole, inner, course, there = self._of_poses
        own = (np.cumsum(there) - 1)[orders[there[orders]].reshape(len(orders), -1)]

        def summed_up(each: FloatArray) -> FloatArray:
            flat = each.reshape(len(each), -1)
            if not self.starts[0]:
                return np.asarray((np.swapaxes(flat[own], 1, 2) @ course)[:, None])
            sums = np.cumsum(flat[own][:, ::-1], axis=1)
            return np.asarray(sums[:, FEWEST_ASIDE - 1 : len(course) - FEWEST_ASIDE])

        k = score.shape[-1]
        s = summed_up(score)
        if not s.shape[1]:
            return np.full(len(orders), -np.inf)
        taken = summed_up(inner).reshape(*s.shape[:2], -1, k)
        if not self.starts[0]:
            course = course**2
        info = summed_up(whole).reshape(*s.shape, k) - np.swapaxes(taken, -1, -2) @ taken
        values, along = info[..., 0], s**2
        if k > 1:
            values, vectors = np.linalg.eigh(info)
            along = (np.swapaxes(vectors, -1, -2) @ s[..., None])[..., 0] ** 2
        odds = []
        for usual in SIZES:
            kept = np.maximum(values, 0.0) + usual**-2
            took = np.sum(along / kept, axis=-1)
            odds.append(self.held.gain(took) - 0.5 * np.sum(np.log(kept * usual**2), axis=-1))
        best = np.max(odds, axis=0) - np.log(len(SIZES))
        return np.asarray(np.logaddexp.reduce(best, axis=1) - np.log(best.shape[1]))

    @cached_property
    def _of_poses(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]:
        """Score, squares, what parameters take up, course; poses ``(P,)`` that have columns."""
        pose, Z = self.held.data.pose, self.columns
        first = np.unique(pose, return_index=True)[1]
        there = np.zeros(len(first), dtype=bool)
        there[pose[np.any(Z, axis=(1, 2))]] = True
        each = (
            np.einsum("imk,im->ik", Z, self.held.rows),
            np.einsum("imk,iml->ikl", Z, Z),
            np.einsum("imr,imk->irk", self.held.Q, Z, optimize=True),
        )
        score, whole, inner = (summed(rows, pose)[there] for rows in each)
        U = np.linalg.svd(np.hstack(list(inner)), full_matrices=False)[0][:, :MOST_TAKEN]
        return score, whole, U.T @ inner, self.course[first][there], there

    def likeliest(self) -> tuple[int, float, FloatArray]:
        """The likeliest course, the usual size that goes with it, and its size ``(k,)``."""
        rows = self.held.rows[..., None]
        odds = self.log_odds(rows)[..., 0]
        s, c = np.unravel_index(int(np.argmax(odds)), odds.shape)
        return int(c), SIZES[s], self._took(rows)[1][s, c, :, 0]

    def columns_of(self, start: int) -> FloatArray:
        """Columns ``(N, m, k)`` of one of the courses."""
        after = np.arange(len(self.course)) >= self.starts[start]
        return np.asarray(self.columns * (self.course * after)[:, None, None])


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
    return float(-best.fun - before - effect.tried)


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
    "mistyped joint",
    "coupled joints",
    "joint scale",
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
    change_m: float = np.nan
    """Root mean square change of where the arm takes its tool point, when the cause is taken into
    account [m]; NaN where nothing is known without it."""
    sigmas: float = np.nan  # the same in standard deviations of the answer

    @property
    def is_gross(self) -> bool:
        """Whether all rows suffer from it: nothing identified with it is of the robot.

        A scale, where it is off by more than arms are built: a model would take it for long links.
        """
        return abs(self.size) > UNSEEN_SCALE if self.cause == "scale" else self.cause in GROSS

    @property
    def grade(self) -> Grade:
        """Loudness of the finding, by its effect on the answer.

        Of an arm that has what its model leaves out no answer is withheld: errors to expect are
        those of the model as it is.
        """
        if self.is_of_the_model:
            return "note"
        return "not to be trusted" if self.is_gross else grade_of(self.sigmas)

    @property
    def is_of_the_model(self) -> bool:
        """Whether the arm has what its model leaves out; nothing went wrong in measuring then."""
        return self.cause in MODEL
