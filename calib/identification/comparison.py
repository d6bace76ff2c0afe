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
from calib.identification.candidate import Candidate, Reference, Trial, fit
from calib.identification.choice import choose, choose_expected
from calib.identification.cross_validation import targets_left_out
from calib.identification.noise import Loss
from calib.identification.result import IdentificationResult
from calib.identification.solver import Method
from calib.model.measurements import Measurements
from calib.se3 import FloatArray


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
    chosen = (choose if reference is None else choose_expected)(able, data, weighted=weighted)
    return Comparison(
        np.full(data.count, np.nan) if nominal_m is None else nominal_m,
        trials,
        chosen.name,
        chosen.reason,
        chosen.criterion,
        None if reference is None else reference.candidate.name,
    )
