"""Several models of one robot on the same data: before and after, and which of them to take.

"Before" is told apart from a set-up that was never fitted: ``nominal`` leaves everything as
described, ``frames only`` fits tool and targets. Every model is judged by what it says of
measurements that it has not seen, see :mod:`calib.identification.choice`. Of models that do not
differ by more than chance the one with fewer parameters is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError
from calib.identification.candidate import Candidate, Reference, fit
from calib.identification.choice import Contender, choose, choose_expected
from calib.identification.left_out import targets_left_out
from calib.identification.noise import Loss
from calib.identification.prediction import ExpectedError
from calib.identification.result import IdentificationResult
from calib.identification.solver import Method
from calib.model.measurements import Measurements
from calib.se3 import FloatArray


@dataclass(frozen=True, eq=False)
class Trial:
    """What became of a candidate.

    Attributes
    ----------
    candidate : Candidate
        With the sizes of its priors and the noise that were found.
    result : IdentificationResult or None
        None where it could not be identified.
    error : CalibError or None
        Why not.
    target_out : array (N, m)
        Rows at each measurement [m, rad] with the arm identified from all targets but its own, and
        only that target's place from other poses at it; NaN where no target was left out.
    expected : ExpectedError or None
        Of the tool point where the arm will work, by the reference; None without one.
    """

    candidate: Candidate
    result: IdentificationResult | None
    error: CalibError | None
    target_out: FloatArray
    expected: ExpectedError | None = None

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.candidate.name

    @property
    def target_out_m(self) -> FloatArray:
        """Distance at each measurement with its target left out, ``(N,)`` [m], or NaN."""
        if self.result is None:
            return np.full(len(self.target_out), np.nan)
        return self.result.lengths_m(self.target_out)

    @property
    def target_out_rms_m(self) -> float:
        """Root mean square of :attr:`target_out_m` [m], weighted as in the fit; NaN without."""
        return float("nan") if self.result is None else self.result.rms_of(self.target_out_m)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side.

    Attributes
    ----------
    nominal_m : array (N,)
        Distance at each measurement with everything as described [m]; NaN where the set-up is not.
    recommended : str or None
        Name of the model to take; None where nothing can be compared.
    reason : str
        Why, in a sentence.
    criterion : str
        ``expected error``, ``leave-one-out`` or ``leave-one-target-out``.
    reference : str or None
        Name of the model that the others were judged by.
    """

    nominal_m: FloatArray
    trials: tuple[Trial, ...]
    recommended: str | None
    reason: str
    criterion: str
    reference: str | None = None

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
    nominal_m : array (N,), optional
        Distances with everything as described [m].
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
    trials: list[Trial] = []
    contenders: list[Contender] = []
    none = np.full(data.count, np.nan)
    every = [*candidates, *([] if reference is None else [reference.candidate])]
    for tried in every:
        candidate = tried
        try:
            if reference is not None and tried is reference.candidate:
                fitted = reference.fitted
            else:
                fitted = fit(candidate, data, weighted=weighted, method=method, loss=loss)
        except CalibError as error:
            trials.append(Trial(candidate, None, error, none[:, None]))
            continue
        model, result = fitted.model, fitted.result
        candidate = replace(candidate, model=model)
        out = targets_left_out(model, data, result, weighted=weighted)
        expected = None if reference is None else reference.arms.error_of(model, result.values)
        trials.append(Trial(candidate, result, None, out, expected))
        contenders.append(Contender(candidate.name, model, result, out, expected))
    refused = next((trial.error for trial in trials if trial.error is not None), None)
    if refused is not None and all(trial.result is None for trial in trials):
        raise refused
    before = none if nominal_m is None else nominal_m
    if reference is None:
        choice, judge = choose(contenders, data, weighted=weighted), None
    else:
        choice, judge = (
            choose_expected(contenders, data, weighted=weighted),
            reference.candidate.name,
        )
    return Comparison(before, tuple(trials), choice.name, choice.reason, choice.criterion, judge)
