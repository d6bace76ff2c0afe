"""Several models of one robot on the same data: before and after, and which of them to take.

The first, ``frames only``, is the "before": it fits tool and targets, and is told apart from a
set-up that was never fitted. Every model is judged by what it says of measurements that it has not
seen.

Squares of the lengths that a model leaves where it has not seen them are compared in units of one
noise, that of the largest model for all: in metres the coarsest kind or axis would drown the
others. Weights and what counts as a gross error are those of that model, too: it leaves least of
the arm out. The
smallest model is taken that is not worse than the best by more than chance. What chance does is
seen in the differences from pose to pose, of squares of two models at the same poses. Where
targets are left out, those of one target have its absence in common: the standard error is then
also taken from target to target, with the quantile of so few, and what reaches farther counts:
three targets may agree by luck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.chance import student_quantile
from calib.errors import CalibError
from calib.identification.candidate import Candidate, ExpectedError, Reference, fit
from calib.identification.cross_validation import (
    FEWEST_TARGETS,
    measured_points,
    targets_left_out,
    with_noise_of,
)
from calib.identification.result import IdentificationResult, Loss
from calib.identification.solver import Method
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

CHANCE = 0.025
"""One-sided probability that a difference is chance, by Student's distribution: that of two
standard errors of many poses. Where there is nothing to gain a larger model was taken in none of
150 simulated draws (10 poses, 4 parameters); four offsets of three standard deviations each in 77 %
of them."""

AS_GOOD = 0.05
"""Part of the least expected error that a smaller model may have more."""

JUDGED = 0.8
"""Share of the measurements that has to be judged: by leaving targets out, to judge models so; or
of what another model can be judged by, for a model to be compared at all."""


@dataclass(frozen=True, eq=False)
class Trial:
    """What became of a candidate."""

    candidate: Candidate  # with the sizes of its priors and the noise that were found
    result: IdentificationResult | None  # None where it could not be identified
    error: CalibError | None  # why not
    target_out: FloatArray
    """(N, m): rows at each measurement [m, rad] with the arm identified from all targets but its
    own, and only that target's place from other poses at it; NaN where no target was left out."""
    expected: ExpectedError | None = None
    """Of the tool point where the arm will work, by the reference; None without one."""
    as_measured: ExpectedError | None = None
    """The same as the instrument will read it at ten poses that took no part; of the recommended
    model alone."""

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.candidate.name

    @property
    def found(self) -> IdentificationResult:
        """The result of one that could be identified; raises why not."""
        if self.result is None:
            raise self.error or CalibError(f"{self.name} was not identified")
        return self.result

    @property
    def target_out_m(self) -> FloatArray:
        """Distance at each measurement with its target left out, ``(N,)`` [m], or NaN."""
        if self.result is None:
            return np.full(len(self.target_out), np.nan)
        return self.result.lengths_m(self.target_out)

    @property
    def target_out_rms_m(self) -> float:
        """Root mean square of :attr:`target_out_m` [m]; NaN without."""
        return float("nan") if self.result is None else self.result.rms_of(self.target_out_m)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side."""

    trials: tuple[Trial, ...]
    recommended: str | None  # name of the model to take; None where nothing can be compared
    reason: str  # why, in a sentence
    criterion: str  # ``expected error``, ``leave-one-out`` or ``leave-one-target-out``
    reference: str | None = None  # name of the model that the others were judged by

    @property
    def results(self) -> tuple[IdentificationResult, ...]:
        """Of the models that could be identified."""
        return tuple(trial.result for trial in self.trials if trial.result is not None)

    @property
    def best(self) -> IdentificationResult:
        """The result of the recommended model, or of the last where none is."""
        found = [r for r in self.results if r.model == self.recommended]
        return found[0] if found else self.results[-1]


def compare(
    candidates: Sequence[Candidate],
    data: Measurements,
    *,
    weighted: bool = True,
    method: Method = "gauss-newton",
    loss: Loss = "least-squares",
    reference: Reference | None = None,
) -> Comparison:
    """Identify every candidate, and recommend one.

    Parameters
    ----------
    candidates : sequence of Candidate
        The smallest first; the first is the baseline. It may be refused where a larger one is
        not: with gross errors among them, measurements of an arm that is off agree upon nothing.
    data : Measurements
        One set.
    weighted, method, loss
        As for :func:`identify`.
    reference : Reference, optional
        The model that the error where the arm will work is expected by, fitted to the same
        measurements: the last to be compared. Without one, models are chosen by what they say of
        measurements left out.

    Raises
    ------
    CalibError
        As :func:`identify` for the first candidate, where none can be identified.
    """

    def tried(candidate: Candidate) -> Trial:
        try:
            if reference is not None and candidate is reference.candidate:
                fitted = reference.fitted
            else:
                fitted = fit(candidate, data, weighted=weighted, method=method, loss=loss)
        except CalibError as error:
            return Trial(candidate, None, error, np.full((data.count, 1), np.nan))
        model, result = fitted.model, fitted.result
        out = targets_left_out(model, data, result, weighted=weighted)
        expected = None if reference is None else reference.arms.error_of(model, result.values)
        return Trial(replace(candidate, model=model), result, None, out, expected)

    every = [*candidates, *([] if reference is None else [reference.candidate])]
    trials = tuple(map(tried, every))
    able = [trial for trial in trials if trial.result is not None]
    if not able and trials[0].error is not None:
        raise trials[0].error
    able = _judgeable(able) if reference is None else able
    place = _left_out(able, data, weighted)
    sizes = [one.found.effective_parameters for one in able]
    taken, criterion = None, ""
    reason = "no measurement can be left out of every model, so they cannot be judged"
    if reference is not None:
        contradicted = _contradicted(sizes, place)
        taken = _least_expected(able, sizes, contradicted)
        reason, criterion = _by_expected(able, place, contradicted, taken), "expected error"
    elif place is not None:
        taken, best = _smallest_no_worse(place, sizes)
        reason, criterion = _by_left_out(place, sizes, taken, best), place.criterion
        reason += _in_orientation(able, _turns_left_out(able, data), taken)
    if taken is not None and reference is not None:
        chosen = able[taken]
        values = chosen.found.values
        error = reference.arms.error_of(chosen.candidate.model, values, as_measured=True)
        trials = tuple(replace(t, as_measured=error) if t is chosen else t for t in trials)
    return Comparison(
        trials,
        None if taken is None else able[taken].name,
        reason,
        criterion,
        None if reference is None else reference.candidate.name,
    )


def _smallest_no_worse(place: _Errors, sizes: Sequence[float]) -> tuple[int, int]:
    """The smallest model that is not worse than the best by more than chance, and the best."""
    best = min(range(len(sizes)), key=lambda k: float(place.squares[k].mean()))
    order = sorted(range(len(sizes)), key=lambda k: sizes[k])
    return next(k for k in order if k == best or place.no_worse(k, best)), best


def _contradicted(sizes: Sequence[float], place: _Errors | None) -> list[bool]:
    """Models that say less of measurements left out than a smaller one, by more than chance."""
    return [
        place is not None
        and any(not place.no_worse(k, j) for j, other in enumerate(sizes) if other < size)
        for k, size in enumerate(sizes)
    ]


def _least_expected(
    able: Sequence[Trial], sizes: Sequence[float], contradicted: Sequence[bool]
) -> int:
    """The smallest model whose expected error where the arm will work is as good as the least.

    Of those that measurements left out do not contradict.
    """
    # models of one draw of the noise differ less than their intervals say: they are of one arm
    error = _expected_m(able)
    free = [k for k in range(len(able)) if not contradicted[k]]
    least = min(error[k] for k in free)
    near = [k for k in free if error[k] <= (1.0 + AS_GOOD) * least]
    return min(near, key=lambda k: sizes[k])


def _expected_m(able: Sequence[Trial]) -> list[float]:
    return [one.expected.rms_m if one.expected is not None else np.inf for one in able]


def _by_expected(
    able: Sequence[Trial], place: _Errors | None, contradicted: Sequence[bool], taken: int
) -> str:
    """Say why a model was taken by its expected error."""
    error, said = _expected_m(able), [_expected_in_words(able, taken)]
    if taken == 0:
        said.append("no model of the arm is better than the arm as described by more than that")
    if place is not None:
        said.append(place.of(taken))
        said += [
            f"{able[k].name} would be better by expected error, but says less of measurements left "
            f"out than a smaller model: {place.rms[k]:.3f} mm"
            for k in range(len(able))
            if contradicted[k] and error[k] < error[taken]
        ]
        better = [k for k in range(len(able)) if k != taken and not place.no_worse(taken, k)]
        if better:
            k = min(better, key=lambda k: place.rms[k])
            said.append(
                f"measurements left out speak for another model, {place.against(k, taken)}; the "
                "error expected where the arm will work decides"
            )
    return "; ".join(said)


def _expected_in_words(able: Sequence[Trial], taken: int) -> str:
    """Expected errors of the model taken, the arm as described, and the best of the others."""

    def shown(k: int) -> str:
        one = able[k].expected
        if one is None:
            return "unknown"
        return f"{1e3 * one.rms_m:.3f} mm ({1e3 * one.low_m:.3f} to {1e3 * one.high_m:.3f})"

    said = f"{able[taken].name}: error expected at the tool point {shown(taken)}"
    return said + (f", {able[0].name} {shown(0)}" if taken else "")


def _left_out(able: Sequence[Trial], data: Measurements, weighted: bool) -> _Errors | None:
    """Errors of all models at measurements left out of each, in units of the noise of the largest.

    None where there is no measurement that could be left out of all of them.
    """
    largest = max(able, key=lambda one: one.found.effective_parameters)
    result = largest.found
    left = [one.found.leave_one_out for one in able]
    common = _everywhere(left) & result.used
    if not common.any():
        return None
    criterion, target, aside = "leave-one-out", None, ""
    apart = _everywhere([one.target_out for one in able]) & result.used
    if apart.sum() >= JUDGED * result.used.sum():
        criterion, target = "leave-one-target-out", data.target
        left, common = [one.target_out for one in able], apart
    elif len(measured_points(largest.candidate.model, data)) >= FEWEST_TARGETS:
        aside = (
            f"; only {apart.sum()} of {result.used.sum()} measurements can be predicted with their "
            "target left out of every model, too few to judge by"
        )
    model = with_noise_of(largest.candidate.model, result)
    lengths = [np.nan_to_num(np.where(result.angles, 0.0, rows)) for rows in left]
    plain = [np.asarray(np.sum(rows**2, axis=1)) for rows in lengths]
    if weighted:
        view = model.view(data.postures, result.values, data.setup)
        white = [np.sum(model.whiten_last(rows.T, view) ** 2, axis=0) for rows in lengths]
    else:
        white = [squares / model.equal_sigma**2 for squares in plain]
    units = _Units.of(data, common, target, result.weights)
    alike, kinds = _equal_noise_m(model, data, weighted), {}
    measured = {k: model.measurements[k] for k in np.unique(data.setup.kind).tolist()}
    with_lengths = {k: kind for k, kind in measured.items() if kind.rows > kind.turns}
    if alike is None and len(with_lengths) > 1:
        for k, kind in with_lengths.items():
            own = data.setup.kind == k
            if (own & common).any():
                parts = [float(np.sum(squares[own & common])) for squares in white]
                kinds[kind.name] = parts, [_rms_milli(each[own & common]) for each in plain]
    return _Errors(
        names=[one.name for one in able],
        squares=[(1.0 if alike is None else (1e3 * alike) ** 2) * units.mean(s) for s in white],
        rms=[_rms_milli(squares[common]) for squares in plain],
        unit="mm",
        square="noise²" if alike is None else "mm²",
        criterion=criterion,
        cluster=units.cluster,
        by_kind=kinds,
        aside=aside,
    )


def _equal_noise_m(model: CalibrationModel, data: Measurements, weighted: bool) -> float | None:
    """The noise [m] where it is the same for all lengths that were measured."""
    if not weighted:
        return model.equal_sigma
    kinds = [model.measurements[k] for k in np.unique(data.setup.kind)]
    sigma = np.concatenate([kind.sigma[: kind.rows - kind.turns] for kind in kinds])
    return float(sigma[0]) if np.allclose(sigma, sigma[0], rtol=1e-9, atol=0.0) else None


def _judgeable(able: Sequence[Trial]) -> list[Trial]:
    """Without large models that hang on most measurements: they keep the others from nothing.

    The baseline and the smallest of an arm with errors stay: without either nothing is compared.
    """
    counts = [int(_everywhere([one.found.leave_one_out]).sum()) for one in able]
    enough = max(1.0, JUDGED * max(counts, default=0))
    return [one for k, one in enumerate(able) if k < 2 or counts[k] >= enough]


def _everywhere(rows: Sequence[FloatArray]) -> BoolArray:
    """Measurements ``(N,)`` that every model says something of."""
    return np.asarray(np.all([np.isfinite(each).all(axis=1) for each in rows], axis=0))


@dataclass(frozen=True, eq=False)
class _Units:
    """What is compared as one: measurements that were left out together, of one target each."""

    rows: BoolArray  # (N,): measurements compared
    index: IntArray  # (K,): unit of each of the K that are
    weights: FloatArray
    """(K,): share of each in the fit, on average one: gross errors count as little as in the
    fit."""
    cluster: IntArray | None  # (G,): target of each unit, where targets were left out

    @classmethod
    def of(
        cls, data: Measurements, rows: BoolArray, target: IntArray | None, weights: FloatArray
    ) -> _Units:
        apart = np.zeros(data.count, dtype=int) if target is None else target
        pairs = np.stack([data.groups[rows], apart[rows]], axis=1)
        found, index = np.unique(pairs, axis=0, return_inverse=True)
        shares = np.minimum(weights[rows], 1.0)
        return cls(
            rows,
            index.ravel(),
            shares / shares.mean(),
            None if target is None else np.unique(found[:, 1], return_inverse=True)[1].ravel(),
        )

    def mean(self, squares: FloatArray) -> FloatArray:
        """Mean ``(G,)`` of squares ``(N,)`` in each unit, weighed."""
        total = np.bincount(self.index, squares[self.rows] * self.weights)
        return np.asarray(total / np.bincount(self.index))


@dataclass(frozen=True, eq=False)
class _Errors:
    """Squares of errors of several models at the same units, and how they are put in words."""

    names: Sequence[str]
    squares: list[FloatArray]  # (G,): what is compared, in units of ``square``
    rms: list[float]  # what is shown, in units of ``unit``
    unit: str
    square: str
    criterion: str  # how measurements were left out
    cluster: IntArray | None = None  # (G,): see :class:`_Units`
    by_kind: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    """Of each kind of measurement, where there are several: part of the squares of each model, and
    its rms [mm]."""
    aside: str = ""  # what is to be said of the criterion

    def paired(self, k: int, other: int) -> tuple[float, float, float]:
        """Mean of the differences of squares, its standard error, and how far chance reaches.

        Infinite for a single unit.
        """
        off = self.squares[k] - self.squares[other]
        count, more = len(off), float(off.mean())
        if count < 2:
            return more, np.inf, np.inf
        chances = [(float(off.std(ddof=1) / np.sqrt(count)), count)]
        if self.cluster is not None:
            sums = np.bincount(self.cluster, off - more)
            few = len(sums)
            if few < 2:
                return more, np.inf, np.inf
            chances.append((float(np.sqrt(few / (few - 1) * float(sums @ sums))) / count, few))
        reaches = [error * student_quantile(1.0 - CHANCE, n - 1) for error, n in chances]
        widest = int(np.argmax(reaches))
        return more, chances[widest][0], reaches[widest]

    def no_worse(self, k: int, other: int) -> bool:
        more, _, reach = self.paired(k, other)
        return more <= reach

    def of(self, k: int) -> str:
        return f"{self.names[k]} leaves {self.rms[k]:.3f} {self.unit} {self.criterion}"

    def against(self, k: int, other: int) -> str:
        off, error, _ = self.paired(k, other)
        by = f"{off:+.3g} +- {error:.2g} {self.square} in the mean square"
        return f"{self.names[k]} {self.rms[k]:.3f} {self.unit} ({by})"

    def decided_by(self, k: int, better: int) -> str:
        """The kind of measurement that tells two models apart, where another has larger errors."""
        if not self.by_kind:
            return ""
        gain = {name: parts[k] - parts[better] for name, (parts, _) in self.by_kind.items()}
        name = max(gain, key=lambda each: gain[each])
        rms = self.by_kind[name][1]
        return (
            f"; in units of the noise {name} decides: {rms[k]:.3f} mm with {self.names[k]}, "
            f"{rms[better]:.3f} mm with {self.names[better]}"
        )


def _rms_milli(squares: FloatArray) -> float:
    return 1e3 * float(np.sqrt(squares.mean()))


def _by_left_out(place: _Errors, sizes: Sequence[float], taken: int, best: int) -> str:
    """Say what the model taken is better than, and what gains nothing over it."""
    said = place.of(taken)
    smaller = [k for k in range(len(sizes)) if sizes[k] < sizes[taken]]
    if smaller:
        k = min(smaller, key=lambda k: float(place.squares[k].mean()))
        if taken == best:
            said += f", better than {place.against(k, taken)}, more than chance"
        else:
            said += "; smaller models are worse than the best by more than chance, as "
            said += place.against(k, best)
        said += place.decided_by(k, taken)
    idle = [k for k in range(len(sizes)) if sizes[k] > sizes[taken] and place.no_worse(taken, k)]
    if idle:
        listed = "; ".join(place.against(k, taken) for k in idle)
        said += f"; larger models gain nothing in position beyond chance: {listed}"
    return said + place.aside


def _turns_left_out(able: Sequence[Trial], data: Measurements) -> _Errors | None:
    """Errors of all models in orientation at measurements left out of each; None without any."""
    largest = max(able, key=lambda one: one.found.effective_parameters).found
    turns = [one.found.leave_one_out_rad for one in able]
    common = np.isfinite(turns).all(axis=0) & largest.used
    if not common.any():
        return None
    units = _Units.of(data, common, None, largest.weights)
    plain = [np.nan_to_num(1e3 * turn) ** 2 for turn in turns]
    squares = [units.mean(each) for each in plain]
    rms = [float(np.sqrt(each[common].mean())) for each in plain]
    return _Errors([one.name for one in able], squares, rms, "mrad", "mrad²", "leave-one-out")


def _in_orientation(able: Sequence[Trial], angle: _Errors | None, taken: int) -> str:
    """Say whether another model than the one taken is better in orientation."""
    if angle is None:
        return ""
    best = int(np.argmin(angle.rms))
    if angle.no_worse(taken, best):
        return f"; no other is better in orientation beyond chance: {angle.of(taken)}"
    gains = [
        k for k in range(len(able)) if not angle.no_worse(taken, k) and angle.no_worse(k, best)
    ]
    k = min(gains, key=lambda k: able[k].found.effective_parameters)
    return (
        f"; in orientation, which this choice does not weigh, {angle.against(k, taken)} gains "
        f"beyond chance: {angle.of(taken)}"
    )
