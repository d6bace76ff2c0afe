"""Several models of one robot on the same data: before and after, and which of them to take.

"Before" is told apart from a set-up that was never fitted: ``nominal`` leaves everything as
described, ``frames only`` fits tool and targets. Every model is judged by what it says of
measurements that it has not seen. Of models that do not differ by more than chance the one with
fewer parameters is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import CalibError
from calib.identification.least_squares import minimise
from calib.identification.result import IdentificationResult
from calib.identification.robust import Loss
from calib.identification.solver import Method, identify
from calib.measurement.data import Measurements
from calib.model import CalibrationModel
from calib.parameters.frames import Frames
from calib.se3 import BoolArray, FloatArray, IntArray

FEWEST_TARGETS = 3
"""Targets from which one can be left out: the others still stand apart."""

WORTH = 1.0
"""Standard errors by which a larger model has to be better than a smaller one to be taken."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model to be tried.

    Attributes
    ----------
    name : str
    model : CalibrationModel
    notes : tuple of str
        What was done to it, such as parameters merged with others.
    """

    name: str
    model: CalibrationModel
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Trial:
    """What became of a candidate.

    Attributes
    ----------
    candidate : Candidate
    result : IdentificationResult or None
        None where it could not be identified.
    error : CalibError or None
        Why not.
    target_out_m : array (N,)
        Distance at each measurement [m] with the arm identified from all targets but its own,
        and only that target's place from the measurements of it; NaN where no target was left out.
    """

    candidate: Candidate
    result: IdentificationResult | None
    error: CalibError | None
    target_out_m: FloatArray

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.candidate.name

    @property
    def target_out_rms_m(self) -> float:
        """Root mean square of :attr:`target_out_m` [m]; NaN without."""
        known = self.target_out_m[np.isfinite(self.target_out_m)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side.

    Attributes
    ----------
    nominal_m : array (N,)
        Distance at each measurement with everything as described [m]; NaN where the set-up is not.
    trials : tuple of Trial
    recommended : str or None
        Name of the model to take; None where nothing can be compared.
    reason : str
        Why, in a sentence.
    criterion : str
        ``leave-one-out`` or ``leave-one-target-out``.
    """

    nominal_m: FloatArray
    trials: tuple[Trial, ...]
    recommended: str | None
    reason: str
    criterion: str

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
    nominal_m: FloatArray | None = None,
    weighted: bool = True,
    method: Method = "gauss-newton",
    loss: Loss = "least-squares",
) -> Comparison:
    """Identify every candidate, and recommend one.

    Parameters
    ----------
    candidates : sequence of Candidate
        The smallest first; the first is the baseline. It may be refused where a larger one is
        not: with gross errors among them, measurements of an arm that is off agree upon nothing.
    data : Measurements
        One set.
    nominal_m : array (N,), optional
        Distances with everything as described [m].
    weighted, method, loss
        As for :func:`identify`.

    Raises
    ------
    CalibError
        As :func:`identify` for the first candidate, where none can be identified.
    """
    trials: list[Trial] = []
    none = np.full(data.count, np.nan)
    for candidate in candidates:
        try:
            result = identify(
                candidate.model,
                data,
                weighted=weighted,
                method=method,
                loss=loss,
                name=candidate.name,
            )
        except CalibError as error:
            trials.append(Trial(candidate, None, error, none))
            continue
        out = targets_left_out(candidate.model, data, result, weighted=weighted)
        trials.append(Trial(candidate, result, None, out))
    refused = next((trial.error for trial in trials if trial.error is not None), None)
    if refused is not None and all(trial.result is None for trial in trials):
        raise refused
    before = none if nominal_m is None else nominal_m
    recommended, reason, criterion = _choose(trials, data)
    return Comparison(before, tuple(trials), recommended, reason, criterion)


def targets_left_out(
    model: CalibrationModel,
    data: Measurements,
    result: IdentificationResult,
    *,
    weighted: bool = True,
) -> FloatArray:
    """Distances ``(N,)`` [m] at each target with the arm identified from all others.

    Only the place of that target is then fitted to the measurements of it. NaN throughout where
    there are fewer than ``FEWEST_TARGETS`` free points, and for a target whose absence leaves the
    arm unidentified.

    Parameters
    ----------
    model : CalibrationModel
    data : Measurements
    result : IdentificationResult
        Of all of them: where the fits start, which measurements count and with what noise.
    weighted : bool
    """
    out = np.full(data.count, np.nan)
    places = _target_columns(model)
    measured = [k for k in places if (data.setup.target == k).any()]
    if len(measured) < FEWEST_TARGETS:
        return out
    noisy = model.with_measurements(
        [
            kind.with_noise(noise.sigma / kind.sigma)
            for kind, noise in zip(model.measurements, result.noise, strict=True)
        ]
    )
    weights = np.stack([result.weights * (data.setup.target != k) for k in measured])
    start = np.tile(result.values, (len(measured), 1))
    others = minimise(
        noisy, data.repeated(len(measured)), start, weights=weights, weighted=weighted
    )
    for row, k in enumerate(measured):
        own: IntArray = np.flatnonzero(data.setup.target == k)
        if not others.converged[row] or not _is_held(noisy, data, others.x[row], weights[row], k):
            continue
        placed = minimise(
            noisy,
            data[own].trials(None),
            others.x[row][None],
            weights=np.maximum(result.weights[own], 0.0)[None],
            free=places[k],
            weighted=weighted,
        )
        linear = noisy.linearise(data.postures[own], placed.x[0], data.setup[own])
        lengths = np.where(result.angles[own], 0.0, linear.rows)
        out[own] = np.linalg.norm(lengths, axis=1)
    out[result.outliers] = np.nan
    return out


def _target_columns(model: CalibrationModel) -> dict[int, BoolArray]:
    """For each target that is a free point, which parameters ``(p,)`` are its place."""
    found = {}
    for block, part in zip(model.parameters, model.slices, strict=True):
        if not isinstance(block, Frames) or not block.targets or set(block.units) != {"m"}:
            continue
        each = block.size // len(block.labels)
        for k, label in enumerate(block.labels):
            columns = np.zeros(model.p, dtype=bool)
            columns[part.start + k * each : part.start + (k + 1) * each] = True
            if each == 3:
                found[model.targets.index(label)] = columns
    return found


def _is_held(
    model: CalibrationModel, data: Measurements, x: FloatArray, weights: FloatArray, target: int
) -> bool:
    """Whether measurements of the other targets hold all parameters but that target's place."""
    linear = model.linearise(data.postures, x, data.setup, data.observed)
    J = linear.white_jacobian * np.sqrt(weights)[:, None, None]
    stacked = np.concatenate([J.reshape(-1, model.p), model.known(x[None])[1][0]])
    stacked = stacked[:, ~_target_columns(model)[target]]
    length = np.linalg.norm(stacked, axis=0)
    if not (length > 0).all():
        return False
    return bool(np.linalg.matrix_rank(stacked / length, tol=1e-9) == stacked.shape[1])


def _choose(trials: Sequence[Trial], data: Measurements) -> tuple[str | None, str, str]:
    """Name of the model to take, why, and by which criterion."""
    able = [trial for trial in trials if trial.result is not None]
    errors = [trial.target_out_m for trial in able]
    criterion = "leave-one-target-out"
    if not np.isfinite(errors[0]).any():
        criterion = "leave-one-out"
        errors = [trial.result.leave_one_out_m for trial in able if trial.result is not None]
    # a large model that hangs on every measurement has nothing to be judged by, and must not keep
    # the others from being
    judged = [k for k, error in enumerate(errors) if k < 2 or np.isfinite(error).any()]
    able, errors = [able[k] for k in judged], [errors[k] for k in judged]
    # errors at different measurements cannot be compared
    common = np.isfinite(errors).all(axis=0)
    for trial in able:
        if trial.result is not None:
            common &= trial.result.used
    if not common.any():
        return None, "no measurement can be left out of every model, so they cannot be judged", ""
    pose = data.pose[common]
    squares = [_per_pose(error[common] ** 2, pose) for error in errors]
    best = int(np.argmin([square.mean() for square in squares]))
    sizes = [trial.candidate.model.p for trial in able]
    smallest_first = sorted(range(len(able)), key=lambda k: sizes[k])
    taken = next(k for k in smallest_first if k == best or _no_worse(squares[k], squares[best]))
    place = _Squares([trial.name for trial in able], squares, "mm", 1e3)
    said = f"{place.of(taken)} {criterion}"
    said += _in_position(place, sizes, taken, best) + _in_orientation(able, data, taken)
    return able[taken].name, said, criterion


def _per_pose(squares: FloatArray, pose: IntArray) -> FloatArray:
    """Mean square of each pose: measurements of one pose are not independent."""
    count = np.bincount(pose)
    return np.asarray(np.bincount(pose, squares)[count > 0] / count[count > 0])


def _paired(a: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Mean of the differences of squares, and its standard error; infinite for a single pose."""
    off = a - b
    return float(off.mean()), float(off.std(ddof=1) / np.sqrt(len(off))) if len(off) > 1 else np.inf


def _no_worse(a: FloatArray, b: FloatArray) -> bool:
    more, chance = _paired(a, b)
    return more <= WORTH * chance


@dataclass(frozen=True, eq=False)
class _Squares:
    """Squares of errors of several models at the same poses, and how they are put in words."""

    names: Sequence[str]
    each: Sequence[FloatArray]
    unit: str
    factor: float

    def rms(self, k: int) -> float:
        return self.factor * float(np.sqrt(self.each[k].mean()))

    def of(self, k: int) -> str:
        return f"{self.names[k]} leaves {self.rms(k):.3f} {self.unit}"

    def against(self, k: int, other: int) -> str:
        off, chance = (self.factor**2 * value for value in _paired(self.each[k], self.each[other]))
        by = f"{off:+.3g} +- {chance:.2g} {self.unit}² in the mean square"
        return f"{self.names[k]} {self.rms(k):.3f} {self.unit} ({by})"


def _in_position(place: _Squares, sizes: Sequence[int], taken: int, best: int) -> str:
    """What the model taken is better than, and what gains nothing over it."""
    said = ""
    smaller = [k for k in range(len(sizes)) if sizes[k] < sizes[taken]]
    if smaller:
        k = min(smaller, key=place.rms)
        if taken == best:
            said += f", better than {place.against(k, taken)}, more than chance"
        else:
            said += "; smaller models are worse than the best by more than chance, as "
            said += place.against(k, best)
    idle = [
        k
        for k in range(len(sizes))
        if sizes[k] > sizes[taken] and _no_worse(place.each[taken], place.each[k])
    ]
    if idle:
        listed = "; ".join(place.against(k, taken) for k in idle)
        said += f"; larger models gain nothing in position beyond chance: {listed}"
    return said


def _in_orientation(able: Sequence[Trial], data: Measurements, taken: int) -> str:
    """Whether another model than the one taken is better in orientation; nothing without angles."""
    results = [trial.result for trial in able if trial.result is not None]
    turns = np.stack([result.leave_one_out_rad for result in results])
    common = np.isfinite(turns).all(axis=0)
    for result in results:
        common &= result.used
    if not common.any():
        return ""
    squares = [_per_pose(turn[common] ** 2, data.pose[common]) for turn in turns]
    angle = _Squares([trial.name for trial in able], squares, "mrad", 1e3)
    best = int(np.argmin([square.mean() for square in squares]))
    if _no_worse(squares[taken], squares[best]):
        return f"; no other is better in orientation beyond chance: {angle.of(taken)} leave-one-out"
    gains = [
        k
        for k in range(len(able))
        if not _no_worse(squares[taken], squares[k]) and _no_worse(squares[k], squares[best])
    ]
    k = min(gains, key=lambda k: able[k].candidate.model.p)
    return (
        f"; in orientation, which this choice does not weigh, {angle.against(k, taken)} gains "
        f"beyond chance: {angle.of(taken)} leave-one-out"
    )
