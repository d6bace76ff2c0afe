"""What measurements make of the robot, beside the baselines that leave it as it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
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
from calib.identification.diagnosis import diagnose
from calib.identification.held import Finding
from calib.identification.robust import WEIGHED_DOWN
from calib.identification.solver import ANOTHER_ROBOT_M
from calib.model.parameters import AXES, Unit
from calib.one_thread import one_blas_thread
from calib.se3 import FloatArray, rotation_angle, rotation_exp
from posedesign.cell import Cell
from posedesign.files.csv_tables import MOST_LISTED, a_few
from posedesign.files.measurements import TOOL, MeasurementTable
from posedesign.identification.checks import oddities
from posedesign.identification.findings import in_words
from posedesign.identification.instruments import goes_with_temperature
from posedesign.identification.models import OFFSETS, Models, left_out

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

BEYOND_PRIOR = 4.0
"""Standard deviations known beforehand beyond which a parameter, or a distance, contradicts them:
chance takes one of a hundred parameters there in a thousand."""

LEFT_OVER_M = 2e-3
"""Residuals that no arm leaves with everything free that may be off."""

FAR_FROM_NOISE = 10.0
"""Residuals over noise beyond which a model explains nothing, where no larger one can be fitted."""


LITTLE_WEIGHT = 0.1
"""Weight in a robust loss below which a measurement as good as takes no part."""

TOOL_FAR_M, EXCHANGED = 0.05, 0.25
"""Distance of a tool point from where the cell has it that nobody measures wrongly by, and the part
of it within which another one is that it was taken for."""

INSTRUMENT_FAR_M, INSTRUMENT_TURNED_RAD = 0.5, float(np.deg2rad(10.0))
"""How far off an instrument is that was not paced out, but given wrongly or moved."""


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
    nominal_m: FloatArray
    """(N,): distance at each measurement with everything as described [m]; NaN where the set-up is
    not."""
    findings: tuple[Finding, ...] = ()  # what explains the residuals by name, the likeliest first
    held_only: tuple[str, ...] = ()
    """Models that were not tried, since nothing measured sees the scale of their links."""
    judge: Reference | None = None
    """An arm with everything that it may be off by, which the models were judged by."""
    warnings: tuple[str, ...] = ()

    @property
    def nominal_rms_m(self) -> float:
        """Root mean square distance with everything as described [m]; NaN where that says none."""
        return _rms(self.nominal_m)

    @property
    def workplace(self) -> str:
        """Where the errors of the models are expected, in words; empty where they are not."""
        return "" if self.judge is None else self.judge.arms.workplace.words

    @property
    def probabilities(self) -> dict[str, float]:
        """Of errors that the arm may have, as models with priors: what others were judged by."""
        return {} if self.judge is None else self.judge.probabilities

    @cached_property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """What the recommended model says against what is known of such arms."""
        return () if self.judge is None else tuple(_contradictions(self.judge, *self.shown))

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

    @cached_property
    def is_of_this_robot(self) -> bool:
        """Whether what explains the measurements best is an arm as described, but for its errors.

        Where no model is recommended, whether any is that. Not where all rows suffer from the same
        mistake.
        """
        if any(finding.is_gross for finding in self.findings) or self.priors_contradict:
            return False
        if self.comparison.recommended is not None:
            return is_believable(self.best)
        return any(is_believable(result) for result in self.comparison.results)

    @property
    def distrusted(self) -> Finding | None:
        """The likeliest finding that changes the answer by so much that none is given."""
        return next((found for found in self.findings if found.grade == "not to be trusted"), None)

    @property
    def is_trusted(self) -> bool:
        """Return True if a model may be used: of this robot, and no finding says otherwise."""
        return self.is_of_this_robot and self.distrusted is None

    @property
    def priors_contradict(self) -> bool:
        """Whether the arm is off by what no such arm is, and explains the measurements not even so.

        Errors alone may say that the description is wrong, residuals alone that noise is larger.
        Zeros may be off by anything.
        """
        beyond = any(each.kind == "arm" for each in self.contradictions)
        return beyond and self.best.weighed_rms_m > LEFT_OVER_M

    @property
    def recommended(self) -> str | None:
        """Name of the model to take; None where there is none, or these are of another robot."""
        return self.comparison.recommended if self.is_trusted else None

    @property
    def reason(self) -> str:
        """Why it is that one, in a sentence; or why these are measurements of another robot."""
        if not self.is_of_this_robot:
            return _why_another(self)
        if self.distrusted is not None:
            return in_words(self.distrusted, self.table)
        return self.comparison.reason


def is_believable(result: IdentificationResult) -> bool:
    """Whether an arm that is switched on can be off by what was found, and by what is left over."""
    return result.weighed_rms_m <= ANOTHER_ROBOT_M and beyond_belief(result) is None


def beyond_belief(result: IdentificationResult) -> str | None:
    """Name of the parameter that is farthest beyond what an arm can be off, if any is."""
    bounds = np.array([BELIEVABLE[unit] for unit in result.units])
    share = np.where(result.nuisance, 0.0, np.abs(result.values - result.nominal) / bounds)
    worst = int(np.argmax(share)) if share.size else 0
    return result.names[worst] if share.size and share[worst] > 1.0 else None


@one_blas_thread
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
    table = replace(table, data=table.data.at_stops())
    models, section = Models(cell, table), cell.config.parameters
    weighted = cell.config.measurement.weighted
    # otherwise the fit is to be the paper's
    judged = section.method == "gauss-newton" and weighted
    judge = _judge(models) if judged else None
    loss = judge.loss if judge is not None else section.loss_given or "least-squares"
    tried = models.candidates(
        None if judge is None else judge.fitted.model.measurements,
        own_noise=judge is not None and loss in WEIGHED_DOWN,
    )
    # before the baseline, which has fewer parameters and would be refused for another reason
    for candidate in reversed(tried):
        if not candidate.notes:  # a reduced one has as many as there are equations for
            check_enough(candidate.model, table.data)
    nominal_m = models.nominal_m()
    try:
        comparison = compare(
            tried,
            table.data,
            weighted=weighted,
            method=section.method,
            loss=loss,
            reference=judge,
        )
        _refuse_if_asked_for(cell, comparison)
        if judge is None and judged:
            comparison = _unexplained(comparison)
    except CalibError as error:
        far = _rms(nominal_m)
        if far > FAR_M:
            error.hint = _another(far, "as described")
        mistakes = [f for f in diagnose(models.of_arm(), table.data) if not f.is_of_the_model]
        if mistakes:  # the likeliest first
            error.hint = in_words(mistakes[0], table)
        raise
    findings = diagnose(models.of_arm(), table.data)
    found = Identified(comparison, table, nominal_m, findings, models.held_only, judge)
    said = [*table.notes, *oddities(table.data, found.nominal_rms_m), *left_out(cell)]
    if judge is not None:
        if all(finding.is_of_the_model for finding in findings):  # else residuals show that
            said += noise_found(judge)
        _refuse_unexplained(judge, found)
    if found.is_of_this_robot:
        if all(finding.is_of_the_model for finding in findings):  # else they name the rows
            said += hardly_counted(table, found.best)
        said += tools_elsewhere(cell, table, found.best)
        said += instruments_elsewhere(cell, found.best)
    said += goes_with_temperature(table, found.best.residuals)
    return replace(found, warnings=tuple(said))


def _judge(models: Models) -> Reference | None:
    """The model that all are judged by; None where it cannot be fitted."""
    loss = models.cell.config.parameters.loss_given
    try:
        at = models.workplace()
        everything, others = models.reference()
        return fit_reference(everything, models.table.data, at, others, loss=loss)
    except CalibError:
        return None


def noise_found(judge: Reference) -> list[str]:
    """Kinds whose residuals show another noise than was given, with both."""
    said = []
    for given, found in judge.noise_found:
        was, now = 1e3 * given.mean_sigma_m, 1e3 * found.mean_sigma_m
        why = "it is larger, or the arm has errors that no model here describes"
        if now < was:  # such as with few gross errors, which weigh little
            why = "most of them agree better than that"
        if found.arm_sigma is not None:
            shift, turn = found.arm_sigma
            turned = f" and {np.rad2deg(turn):.2g} deg about" if turn else ""
            said.append(
                f"the arm stops off by {1e3 * shift:.3g} mm along{turned} each axis from pose to "
                f"pose, by what no model here describes; {found.name} itself scatters by "
                f"{now:.3g} mm where {was:.3g} mm was given"
            )
            continue
        said.append(
            f"the residuals of {found.name} show a noise of {now:.3g} mm an axis where {was:.3g} "
            f"mm was given: {why}; models and priors are weighed against the noise found"
        )
    return said


def hardly_counted(table: MeasurementTable, result: IdentificationResult) -> list[str]:
    """Measurements that a robust loss has weighed down to next to nothing, with their lines."""
    lost = np.flatnonzero((result.weights < LITTLE_WEIGHT) & result.used)
    if not lost.size:
        return []
    far, names = result.lengths_m(result.residuals), table.data.names
    worst = sorted(lost.tolist(), key=lambda i: -far[i])
    said = a_few(
        [f"{names[i]} (line {table.lines[i]}) by {1e3 * far[i]:.3g} mm" for i in worst], "rows"
    )
    return [
        f"{lost.size} of {table.data.count} measurements are so far off the others that they "
        f"hardly count: {said}; put them right, or leave them out"
    ]


def tools_elsewhere(cell: Cell, table: MeasurementTable, result: IdentificationResult) -> list[str]:
    """Tool points that came out far from where the cell has them, and which other sits there."""
    values = dict(zip(result.names, result.values, strict=True))
    described = {mark.name: np.array(mark.point_mm) / 1e3 for mark in cell.config.tool.mark}
    described.setdefault(TOOL, cell.tool_m)
    said = []
    for label in (name for name in table.data.tools if name in described):
        stem = "tool" if label == TOOL else f"tool.{label}"
        axes = [f"{stem}.{axis}" for axis in "xyz"]
        if not all(axis in values for axis in axes) or f"{stem}.rx" in values:
            continue  # a frame of its own, as of a camera, is elsewhere
        found = np.array([values[axis] for axis in axes])
        far = {other: float(np.linalg.norm(found - place)) for other, place in described.items()}
        nearest = min(far, key=lambda other: far[other])
        there = f", where it has {nearest}" if far[nearest] < EXCHANGED * far[label] else ""
        if there or far[label] > TOOL_FAR_M:
            said.append(
                f"{stem} came out {1e3 * far[label]:.3g} mm from where the cell has it{there}: is "
                "the name right, and the tool?"
            )
    return said


def instruments_elsewhere(cell: Cell, result: IdentificationResult) -> list[str]:
    """Instruments that came out far from where the cell has them, which plans go by."""
    values = dict(zip(result.names, result.values, strict=True))
    said = []
    for target in cell.config.targets:
        stem = f"target.{target.name}"
        if f"{stem}.rx" not in values or target.position_mm is None:
            continue
        shift, turn = ([values[f"{stem}.{k}"] for k in axes] for axes in (AXES[:3], AXES[3:]))
        far = float(np.linalg.norm(np.array(shift) - np.array(target.position_mm) / 1e3))
        turned = float(rotation_angle(rotation_exp(np.array(turn))))
        off = [f"{far:.2g} m away"] if far > INSTRUMENT_FAR_M else []
        if turned > INSTRUMENT_TURNED_RAD and "wpr_deg" in target.model_fields_set:
            off.append(f"turned by {np.rad2deg(turned):.3g} deg")
        if off:
            said.append(
                f"{stem} came out {' and '.join(off)} from where the cell has it: what it sees of "
                "planned poses is wrong until position_mm and wpr_deg are mended"
            )
    return said


def _contradictions(
    judge: Reference, trial: Trial, result: IdentificationResult
) -> list[Contradiction]:
    """What a model has that cannot be, or that arms of the cell's kind have not."""
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


def _refuse_unexplained(judge: Reference, identified: Identified) -> None:
    """Raise where an arm with everything that may be off leaves what no arm leaves, unnamed."""
    result = judge.fitted.result
    larger = [
        np.hypot(found.mean_sigma_m, (found.arm_sigma or (0.0,))[0]) / given.mean_sigma_m
        for given, found in judge.noise_found
    ]
    nothing = result.weighed_rms_m > FAR_FITTED_M and max(larger, default=1.0) > FAR_FROM_NOISE
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


def _why_another(identified: Identified) -> str:
    """In a sentence, why these are not measurements of the robot of the cell."""
    for finding in identified.findings:
        if not finding.is_of_the_model:
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
