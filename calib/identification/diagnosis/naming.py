"""All hypotheses against one set of measurements, and the one that explains them best."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from calib.identification.diagnosis.held import Effect, Finding, Held, Tuned, log_odds, tuned
from calib.identification.diagnosis.mistakes import (
    UNLIKELY,
    Mistake,
    fitted,
    of_all_rows,
    of_some_rows,
    squares_of,
)
from calib.identification.diagnosis.sequence import changes, incomplete, scales
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.model.parameters import ZeroOffsets

CHANCE = 2e-3
"""Probability that something is named that is not there, where the model is complete."""

ROUGH_M, ROUGH_RAD = 1e-3, 3e-3
"""What an arm as described is off once tool, targets and zeros are placed [m, rad]."""

ALMOST = 2.0
"""Residual over that, with the parameters of the arm held by their priors, which is of no arm."""

ROUGH_ZERO_RAD = float(np.radians(2.0))

FAR = 4.0
"""Squares of the residuals over those of a rough arm from which gross mistakes are tried."""

MOST_RETUNED = 6
"""Effects that look best, for which noise and priors are found again."""

MOST_FITTED = 12
"""Mistakes that look best after a few steps, which are fitted to the end."""

FAR_BETTER = 0.1
"""Squares left, over those as measured, of a mistake that is named."""

LITTLE = 0.1
"""Residual over the spread of the arm's places, of a mistake that is named: an arm that would
hardly have moved explains any touch-up."""

AS_WELL = 2.0
"""Difference of logarithms of odds within which another cause explains as well."""


def diagnose(model: CalibrationModel, data: Measurements) -> tuple[Finding, ...]:
    """Name what explains the residuals of measurements, if anything does far better than chance.

    Parameters
    ----------
    model : CalibrationModel
        All that may be off in the arm, held by priors: what it can explain is not held against the
        measurements. Sizes of priors and noise are taken from the measurements, priors at most as
        large as given.
    data : Measurements
        One set, in the order in which it was measured.

    Returns
    -------
    tuple of Finding
        The likeliest first; of gaps of the model only where nothing went wrong in measuring.
    """
    rough = _rough(model)
    before = fitted(rough, data)
    is_far = before is None or before.squares > FAR * before.freedom
    if is_far:
        found = _gross(rough, data, before)
        if found:
            return found
    usual = tuned(model, data)
    if usual is None:
        return ()
    held = usual.held
    effects = _retuned(usual, [*changes(held), *scales(held)])
    every = [*_rows(model, usual), *effects]
    if not is_far:
        return likeliest(every) or likeliest(incomplete(held))
    # of another arm anything makes a little more: with what is named it has to be this one
    return likeliest(found for found in every if found.after_m < ALMOST * ROUGH_M)


def _rough(model: CalibrationModel) -> CalibrationModel:
    """The arm as described but for its zeros, and noise of what it is off."""
    blocks = [block for block in model.parameters if block.nuisance]
    robot = model.robot
    rough = CalibrationModel(
        robot,
        [ZeroOffsets(robot, robot.joint_names, ROUGH_ZERO_RAD, ROUGH_M), *blocks],
        model.measurements,
        model.distances,
    )
    kinds = []
    for kind in model.measurements:
        floor = np.full(kind.rows, ROUGH_M)
        floor[kind.rows - kind.turns :] = ROUGH_RAD
        kinds.append(kind.with_noise(np.maximum(kind.sigma, floor) / kind.sigma))
    return rough.with_measurements(kinds)


def _gross(model: CalibrationModel, data: Measurements, held: Held | None) -> tuple[Finding, ...]:
    """Mistakes without which the measurements would be those of the arm as described."""
    tried: list[Mistake] = list(of_all_rows(data, model))
    if held is not None:
        tried += of_some_rows(held)
    equations = model.equations(data.setup)
    before = np.inf if held is None else held.squares / equations
    first = squares_of(model, tried)
    found = []
    for k in np.argsort(first)[:MOST_FITTED].tolist():
        right = fitted(model, tried[k].data)
        if right is None:
            continue
        places = right.linear.view.walk.p_base_tip
        spread2 = np.sum((places - places.mean(axis=1)[:, None]) ** 2, axis=0)
        if right.rms_m() < LITTLE * float(np.sqrt(np.mean(spread2))):
            after = right.squares / model.equations(tried[k].data.setup)
            weight = 0.5 * equations * after + UNLIKELY.get(tried[k].cause, 0.0)
            found.append((weight, after, tried[k], right))
    found = [each for each in found if each[1] < min(FAR_BETTER * before, FAR)]
    found.sort(key=lambda each: each[0])
    named = [_finding(mistake, held, right, len(tried)) for _, _, mistake, right in found]
    as_well = [
        other for other, each in zip(named, found, strict=True) if each[0] < found[0][0] + AS_WELL
    ]
    return tuple(replace(best, also=tuple(as_well[1:])) for best in named[:1])


def _finding(mistake: Mistake, held: Held | None, right: Held, tried: int) -> Finding:
    before = np.inf if held is None else held.squares / held.freedom
    gain = 0.5 * right.freedom * np.log(before / (right.squares / right.freedom))
    return Finding(
        mistake.cause,
        mistake.things,
        mistake.part,
        mistake.rows,
        float("nan"),
        "",
        float("nan") if held is None else held.rms_m(),
        right.rms_m(),
        float(gain - np.log(tried)),
    )


def _retuned(found: Tuned, effects: Iterable[Effect]) -> list[Finding]:
    """The likeliest effects with noise and priors as they are with them."""
    order = sorted(effects, key=lambda effect: -effect.finding.log_odds)[:MOST_RETUNED]
    return [
        replace(effect.finding, log_odds=log_odds(found, effect))
        for effect in order
        if effect.finding.log_odds > 0.0
    ]


def _rows(model: CalibrationModel, found: Tuned) -> list[Finding]:
    """Rows that are exchanged or have a wrong label."""
    named = []
    held = found.held
    count = held.data.count * max(len(held.data.targets), held.data.count)
    for mistake in of_some_rows(held):
        first = fitted(held.model, mistake.data, held.x)
        if first is None or held.gain(held.squares - first.squares) < np.log(count):
            continue
        right = tuned(model, mistake.data)
        if right is not None:
            odds = right.log_evidence - found.log_evidence - float(np.log(count))
            named.append(replace(_finding(mistake, held, right.held, 1), log_odds=odds))
    return named


def likeliest(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The likeliest finding, where all together are beyond chance, with those that explain as well.

    A fault that several hypotheses explain about as well is one for each of them and for their sum.
    """
    order = sorted(findings, key=lambda found: -found.log_odds)
    if np.logaddexp.reduce([found.log_odds for found in order]) < -np.log(CHANCE):
        return ()
    best = order[0]
    also = tuple(
        other
        for other in order[1:]
        if other.log_odds > best.log_odds - AS_WELL
        and (other.cause, other.things) != (best.cause, best.things)
    )
    return (replace(best, also=also),)
