"""What measurements make of the robot, beside the baselines that leave it as it is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calib.errors import CalibError, InputError, NotIdentifiableError
from calib.identification import (
    DISPLAY,
    Comparison,
    IdentificationResult,
    Reference,
    Trial,
    check_enough,
    compare,
    fit_reference,
)
from calib.identification.diagnosis import Finding
from calib.identification.noise import WEIGHED_DOWN
from calib.identification.report import ANOTHER_ROBOT_M
from calib.model.parameters import Unit
from calib.se3 import FloatArray
from posedesign.candidates import box_of_cell
from posedesign.cell import Cell
from posedesign.cell.task_box import workplace
from posedesign.files.csv_tables import MOST_LISTED, a_few, first_like
from posedesign.files.measurements import MeasurementTable
from posedesign.identification.findings import diagnose_table, in_words, is_gross, is_of_the_model
from posedesign.identification.measurement_set_up import nominal_distances, seen_once
from posedesign.identification.models import OFFSETS, candidates, held_only, left_out, reference

_PLANNED = re.compile(r"P(\d{2,4})", re.ASCII)
"""Names that plans give to poses."""

BELIEVABLE: dict[Unit, float] = {
    "m": ANOTHER_ROBOT_M,
    "rad": 0.2,
    "rad/Nm": 1e-3,
    "rad/rad": 0.05,
    "m/m": 0.05,
}
"""How far parameters of an arm can be from its description. Freed links turn any arm into any
other: touch-ups of a small arm, read for a large one, are explained to the noise by links that are
a metre off."""

FAR_M, FAR_FITTED_M = 0.1, 0.01
"""Distances of the nominal tool point from its target, as described and with tool and targets
placed, that say where to look when nothing can be identified: most likely it is another arm."""

PLANNED_M = 1e-7
"""Distance of the nominal tool point from its target that no measured arm comes down to."""

BEYOND_PRIOR = 4.0
"""Standard deviations known beforehand beyond which a parameter, or a distance, contradicts them:
chance takes one of a hundred parameters there in a thousand."""

LEFT_OVER_M = 2e-3
"""Residuals that no arm leaves with everything free that may be off."""

FAR_FROM_NOISE = 10.0
"""Residuals over noise beyond which a model explains nothing, where no larger one can be fitted."""


@dataclass(frozen=True)
class Contradiction:
    """Something of a model that cannot be, or that such arms do not have."""

    kind: Literal["zero", "arm", "sign", "distance"]
    """A joint's zero, or another error of the arm, beyond what is known of it; a compliance below
    zero; a known distance that comes out otherwise."""
    said: str  # in words


@dataclass(frozen=True, eq=False)
class Identified:
    """All models on one set of measurements."""

    comparison: Comparison
    table: MeasurementTable
    warnings: tuple[str, ...]
    findings: tuple[Finding, ...] = ()  # what explains the residuals by name, the likeliest first
    contradictions: tuple[Contradiction, ...] = ()
    """What the recommended model says against what is known of such arms."""
    workplace: str = ""
    """Where the errors of the models are expected, in words; empty where they are not."""
    held_only: tuple[str, ...] = ()
    """Models that were not tried, since nothing measured sees the scale of their links."""
    probabilities: dict[str, float] = field(default_factory=dict)
    """Of errors that the arm may have, as models with priors: what the others were judged by."""
    measured: dict[str, str] = field(default_factory=dict)
    """What the file of an instrument has, in words by what it is about."""

    @property
    def nominal_rms_m(self) -> float:
        """Root mean square distance with everything as described [m]; NaN where that says none."""
        return _rms(self.comparison.nominal_m)

    @property
    def best(self) -> IdentificationResult:
        """The result of the recommended model."""
        return self.shown[1]

    @property
    def shown(self) -> tuple[Trial, IdentificationResult]:
        """The recommended model; where none is, the smallest of an arm that has errors of its own.

        The baseline where that has nothing left over to test it by.
        """
        found = [(t, t.result) for t in self.comparison.trials if t.result is not None]
        named = [pair for pair in found if pair[0].name == self.comparison.recommended]
        tested = [pair for pair in found if pair[1].degrees_of_freedom > 0]
        return (named or tested[1:2] or found[:1])[0]

    @property
    def is_of_this_robot(self) -> bool:
        """Whether what explains the measurements best is an arm as described, but for its errors.

        Where no model is recommended, whether any is that. Not where all rows suffer from the same
        mistake.
        """
        if is_gross(self.findings) or self.priors_contradict:
            return False
        if self.comparison.recommended is not None:
            return is_believable(self.best)
        return any(is_believable(result) for result in self.comparison.results)

    @property
    def priors_contradict(self) -> bool:
        """Whether the arm is off by what no such arm is, and explains the measurements not even so.

        Errors alone may say that the description is wrong, residuals alone that noise is larger.
        Zeros may be off by anything.
        """
        beyond = any(each.kind == "arm" for each in self.contradictions)
        return beyond and self.best.rms_m > LEFT_OVER_M


def is_believable(result: IdentificationResult) -> bool:
    """Whether an arm that is switched on can be off by what was found, and by what is left over."""
    return result.rms_m <= ANOTHER_ROBOT_M and beyond_belief(result) is None


def beyond_belief(result: IdentificationResult) -> str | None:
    """Name of the parameter that is farthest beyond what an arm can be off, if any is."""
    bounds = np.array([BELIEVABLE[unit] for unit in result.units])
    share = np.where(result.nuisance, 0.0, np.abs(result.values - result.nominal) / bounds)
    worst = int(np.argmax(share)) if share.size else 0
    return result.names[worst] if share.size and share[worst] > 1.0 else None


def identify_models(cell: Cell, table: MeasurementTable) -> Identified:
    """Identify what the cell asks for, and the baselines that it has to beat.

    ``frames only`` places tool and targets and leaves the robot as it is: errors of the set-up are
    not the robot's, and a "before" that contains them flatters every calibration. Then each set of
    ``parameters.models``, from small to large.

    ``table``: of any targets; their positions need not be known. Raises InputError,
    NotIdentifiableError, ConvergenceError: as :func:`calib.identification.identify`, for the
    baseline or where all else is refused; measurements that contradict each other, with no mistake
    that explains it.
    """
    section = cell.config.parameters
    # otherwise the fit is to be the paper's
    judged = section.method == "gauss-newton" and cell.config.measurement.weighted
    judge = _reference(cell, table) if judged else None
    kinds = None if judge is None else judge.fitted.model.measurements
    robust = judge is not None and judge.loss in WEIGHED_DOWN
    held = tuple(held_only(cell, table))
    tried = candidates(cell, table, kinds, without=held, own_noise=robust)
    # before the baseline, which has fewer parameters and would be refused for another reason
    for candidate in reversed(tried):
        if not candidate.notes:  # a reduced one has as many as there are equations for
            check_enough(candidate.model, table.data)
    nominal = nominal_distances(cell, table)
    try:
        comparison = compare(
            tried,
            table.data,
            nominal_m=nominal,
            weighted=cell.config.measurement.weighted,
            method=section.method,
            loss=judge.loss if judge is not None else section.loss_given or "least-squares",
            reference=judge,
        )
        _refuse_if_asked_for(cell, comparison)
        if judge is None and judged:
            comparison = _unexplained(comparison)
    except CalibError as error:
        far = _rms(nominal)
        if far > FAR_M:
            error.hint = _another(far, "as described")
        mistakes = [f for f in diagnose_table(cell, table) if not is_of_the_model(f)]
        if mistakes:  # the likeliest first
            error.hint = in_words(mistakes[0], table)
        raise
    said = [*table.notes, *missing_poses(table.data.names)]
    if _rms(nominal) < PLANNED_M:
        said.append(
            "the tool point of the arm as described is exactly on its target: these postures were "
            "planned, not measured"
        )
    once = seen_once(table.data)
    if once:
        said.append(
            f"measured once, which says nothing but where they are: {a_few(once, 'targets')}"
        )
    said += left_out(cell)
    findings = diagnose_table(cell, table)
    if judge is None:
        return Identified(comparison, table, tuple(said), findings, held_only=held)
    if all(map(is_of_the_model, findings)):  # otherwise that is what the residuals show
        said += noise_found(judge)
    words = judge.arms.workplace.words
    found = Identified(
        comparison, table, tuple(said), findings, (), words, held, judge.probabilities
    )
    found = replace(found, contradictions=tuple(contradictions(judge, found)))
    _refuse_unexplained(judge, found)
    return found


def noise_found(judge: Reference) -> list[str]:
    """Kinds whose residuals show another noise than was given, with both."""
    said = []
    for given, found in judge.noise_found:
        was, now = 1e3 * given.mean_sigma_m, 1e3 * found.mean_sigma_m
        why = "it is larger, or the arm has errors that no model here describes"
        if now < was:  # such as with few gross errors, which weigh little
            why = "most of them agree better than that"
        said.append(
            f"the residuals of {found.name} show a noise of {now:.3g} mm an axis where {was:.3g} "
            f"mm was given: {why}; models and priors are weighed against the noise found"
        )
    return said


def contradictions(judge: Reference, identified: Identified) -> list[Contradiction]:
    """What the recommended model has that cannot be, or that arms of the cell's kind have not."""
    trial, result = identified.shown
    known = dict(zip(judge.given.names, judge.given.prior, strict=True))
    prior = np.array([known.get(name, np.inf) for name in result.names])
    beyond = np.abs(result.values - result.nominal) / np.hypot(
        prior, np.where(np.isfinite(result.prior), 0.0, result.sigma)
    )
    said: list[Contradiction] = []
    for k in np.argsort(-beyond).tolist()[:MOST_LISTED]:
        if beyond[k] > BEYOND_PRIOR:
            unit, factor = DISPLAY[result.units[k]]
            off = factor * (result.values[k] - result.nominal[k])
            words = (
                f"{result.names[k]} is off by {off:.3g} {unit}, {beyond[k]:.1f} times what arms "
                f"are by the cell ({factor * prior[k]:.3g} {unit})"
            )
            is_zero = result.names[k].startswith("zero_offset.")
            said.append(Contradiction("zero" if is_zero else "arm", words))
    gives_way = np.array([unit == "rad/Nm" for unit in result.units])
    for k in np.flatnonzero(gives_way & (result.values < -2.0 * result.sigma)).tolist():
        words = (
            f"{result.names[k]} is negative, {1e6 * result.values[k]:.3g} urad/Nm: no reducer is"
        )
        said.append(Contradiction("sign", words))
    model = trial.candidate.model
    if model.distances:
        rows = model.known(result.values[None])[0][0, -len(model.distances) :]
        said += [
            Contradiction(
                "distance",
                f"{known.first} and {known.second} come out {1e3 * (known.length_m + off):.3f} mm "
                f"apart, known are {1e3 * known.length_m:.3f}",
            )
            for known, off in zip(
                model.distances, rows * np.array([d.sigma_m for d in model.distances]), strict=True
            )
            if abs(off) > BEYOND_PRIOR * known.sigma_m
        ]
    return said


def _reference(cell: Cell, table: MeasurementTable) -> Reference | None:
    """The model that all are judged by; None where it cannot be fitted."""
    box = None if cell.config.task_box is None else box_of_cell(cell)[0]
    try:
        at = workplace(cell, table, box)
        loss = cell.config.parameters.loss_given
        everything, others = reference(cell, table)
        return fit_reference(everything, table.data, at, others, loss=loss)
    except CalibError:
        return None


def _refuse_unexplained(judge: Reference, identified: Identified) -> None:
    """Raise where an arm with everything that may be off leaves what no arm leaves, unnamed."""
    result = judge.fitted.result
    larger = [found.mean_sigma_m / given.mean_sigma_m for given, found in judge.noise_found]
    nothing = result.rms_m > FAR_FITTED_M and max(larger, default=1.0) > FAR_FROM_NOISE
    if nothing and identified.is_of_this_robot and not identified.findings:
        raise InputError(
            "the measurements contradict each other: an arm with everything that may be off leaves "
            f"{1e3 * result.rms_m:.3g} mm, {max(larger):.0f} times the noise that is given",
            hint="most of them may be wrong: measure again, or look at tool, targets and joints",
            name="measurements",
        )


def _unexplained(comparison: Comparison) -> Comparison:
    """Without a recommendation where it would be of a model that explains next to nothing.

    An arm with everything that may be off could not be fitted either: it is another one.
    """
    best = comparison.best
    if comparison.recommended is None or not best.noise_scale > FAR_FROM_NOISE:
        return comparison
    reason = (
        f"no model explains the measurements: {best.model} leaves {1e3 * best.rms_m:.3g} mm, "
        f"{best.noise_scale:.0f} times the noise, and an arm with everything that may be off "
        "cannot be fitted to them"
    )
    return replace(comparison, recommended=None, reason=reason, criterion="")


def summed_up(lines: Sequence[str], what: str) -> list[str]:
    """A few lines, and in another one how many more there are of what."""
    more = len(lines) - MOST_LISTED
    return [*lines[:MOST_LISTED], *([f"and {more} more {what}"] if more > 0 else [])]


def _refuse_if_asked_for(cell: Cell, comparison: Comparison) -> None:
    """Raise what kept a model from being identified that the cell asks for joint by joint.

    Or what kept the first one, where nothing beyond the baseline was left. Not where the baseline
    says that it is another arm: that is the answer then.
    """
    baseline, *others = comparison.trials
    if baseline.result is not None and baseline.result.rms_m > ANOTHER_ROBOT_M:
        return
    nothing = all(trial.result is None for trial in others)
    for trial in others:
        by_name = trial.name == OFFSETS and cell.config.parameters.zero_offsets is not None
        hidden = isinstance(trial.error, NotIdentifiableError)
        if trial.error and ((by_name and hidden) or nothing):
            if baseline.result is not None and baseline.result.rms_m > FAR_FITTED_M:
                trial.error.hint = _another(baseline.result.rms_m, "with tool and targets placed")
            raise trial.error


def _another(far_m: float, when: str) -> str:
    return (
        f"{when}, the tool point is {far_m * 1e3:.0f} mm off its target on average: are these of "
        "this robot, this tool, in URDF joint signs? FANUC pendants show J3 less J2"
    )


def without_repeats(table: MeasurementTable) -> tuple[MeasurementTable, list[str]]:
    """The table without rows that repeat another number by number, and what was left out.

    A measurement that was made twice differs in its last digits; a row that was pasted twice does
    not, and would count double.
    """
    data, setup, lines = table.data, table.data.setup, table.lines
    read = np.zeros((data.count, 0)) if data.observed is None else data.observed
    of = np.stack([setup.kind, setup.tool, setup.target, setup.payload], axis=1)
    rows = zip(of.tolist(), data.postures, read, strict=True)
    first = np.array(first_like((*k, q.tobytes(), r.tobytes()) for k, q, r in rows))
    kept = first == np.arange(data.count)
    if kept.all():
        return table, []
    again = [f"line {lines[i]} as line {lines[first[i]]}" for i in np.flatnonzero(~kept)]
    said = f"rows that repeat another number by number are left out: {a_few(again, 'rows')}"
    return table.some(np.flatnonzero(kept)), [said]


def missing_poses(names: Sequence[str]) -> list[str]:
    """What a numbered plan has between its first and its last pose, and the data have not."""
    found = [_PLANNED.fullmatch(name) for name in dict.fromkeys(names)]
    if not names or not all(found):
        return []
    numbers = {int(match[1]) for match in found if match}
    width = min(len(match[1]) for match in found if match)
    gaps = [k for k in range(1, max(numbers)) if k not in numbers]
    if not gaps:
        return []
    absent = a_few([f"P{k:0{width}d}" for k in gaps], "poses")
    return [f"of the poses up to P{max(numbers):0{width}d} there are no measurements of {absent}"]


def why_another(identified: Identified) -> str:
    """In a sentence, why these are not measurements of the robot of the cell."""
    for finding in identified.findings:
        if not is_of_the_model(finding):
            return in_words(finding, identified.table)
    best = identified.best
    name = beyond_belief(best)
    if name is None and identified.priors_contradict:
        beyond = next(each.said for each in identified.contradictions if each.kind == "arm")
        return (
            f"{beyond}, and the residuals are {1e3 * best.rms_m:.3g} mm even so: these "
            "measurements are not of this robot, this tool or these joint signs"
        )
    if name is None:
        return best.message
    k = best.names.index(name)
    unit, factor = DISPLAY[best.units[k]]
    off = (best.values[k] - best.nominal[k]) * factor
    return (
        f"what explains these measurements best, {best.model}, has {name} off by {off:.4g} {unit}: "
        "they are not of this robot, this tool or these joint signs (FANUC pendants show J3 less "
        "J2), or its joints are far off zero"
    )


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
