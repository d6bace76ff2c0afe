"""Diagnosis by name: which mistake, change or gap of the model explains what a fit leaves over.

All hypotheses against one set of measurements. Mistakes that a table may have, in conventions of
the arm, of readings, of rows, are each a change of the table that would put it right. What all rows
suffer from is tried by fitting the changed table; rows that are exchanged or have a wrong label are
looked for among those that the others contradict, and fitted then. Changes in the course of the
measurements, and gaps of the model, are effects on the residuals, see
:mod:`calib.identification.effects`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from calib.identification.effects import SCALE, Tried, changes, coupled, incomplete, scales
from calib.identification.held import Cause, Effect, Finding, Held, Tuned, held_at, log_odds, tuned
from calib.identification.least_squares import column_lengths, first_guess, minimise
from calib.identification.placebo import chance_of
from calib.judgement import level_of_each
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.model.parameters import ZeroOffsets
from calib.se3 import (
    BoolArray,
    FloatArray,
    IntArray,
    inverse,
    rotation_exp,
    rotation_log,
    transform,
)

_RIGHT_ANGLES = {"+90": np.pi / 2, "-90": -np.pi / 2, "180": np.pi}

_MOST_SUSPECT = 10
"""Rows that stand out most, of which wrong ones are looked for."""

_MISTYPED = 3
"""Poses that stand out most, of which a mistyped joint is looked for."""

_GROSS, _USUAL = 100.0, 4.0
"""Squares of the residuals of such a pose over the median of poses, and of one put right: a scatter
of poses that no parameter describes has heavy tails, and one joint explains a good part of any."""

_STEPS, _STEP_RAD, _LARGEST_RAD = 6, 1e-4, 0.5
"""Steps of a joint that is put right, the difference of its derivative, and its largest step."""

_SEEN = 1e-9
"""Part of a pose that the other poses leave open, below which it is not predicted."""

_ITERATIONS, _FIRST = 25, 5
"""Steps of a fit, and of one that has to show whether more are worth it."""

UNLIKELY: dict[Cause, float] = {"zero": 2.0, "sign and zero": 4.0, "turned axes": 2.0}
"""Logarithms of how much less often mistakes are made than others: some look the same, such as a
first joint that counts the other way, and half a turn of the second where their axes meet."""

_UNITS = {
    "mm for m": 1e-3,
    "m for mm": 1e3,
    "cm for mm": 10.0,
    "mm for cm": 0.1,
    "inches for mm": 25.4,
    "mm for inches": 1 / 25.4,
}


@dataclass(frozen=True, eq=False)
class Mistake:
    """A mistake, and the table with it put right."""

    cause: Cause
    part: str
    things: tuple[str, ...]
    rows: tuple[int, ...]
    data: Measurements


def fitted(model: CalibrationModel, data: Measurements, x: FloatArray | None = None) -> Held | None:
    """The solution for a table; None where there is none."""
    with np.errstate(all="ignore"):
        try:
            start = first_guess(model, data) if x is None else x
            found = minimise(model, data.trials(None), start[None], iterations=_ITERATIONS)
            if not np.isfinite(found.x).all():
                return None
            held = held_at(model, data, found.x[0])
        except (np.linalg.LinAlgError, ValueError):
            return None
    return held if np.isfinite(held.squares) else None


def squares_of(model: CalibrationModel, mistakes: Sequence[Mistake]) -> FloatArray:
    """Sums of squares ``(M,)`` per equation, after a few steps of the fits of changed tables."""
    out = np.full(len(mistakes), np.inf)
    alike: dict[tuple[bytes, int], list[int]] = {}
    for k, mistake in enumerate(mistakes):
        key = (mistake.data.setup.target.tobytes(), mistake.data.count)
        alike.setdefault(key, []).append(k)
    for members in alike.values():
        tables = [mistakes[k].data for k in members]
        observed = [table.observed for table in tables if table.observed is not None]
        every = Measurements(
            np.array([table.postures for table in tables]),
            tables[0].setup,
            tables[0].targets,
            tables[0].tools,
            np.array(observed) if observed else None,
            tables[0].names,
        )
        with np.errstate(all="ignore"):
            x = np.array([_guess(model, table) for table in tables])
            fit = minimise(model, every, x, iterations=_FIRST)
        out[members] = fit.cost / model.equations(every.setup)
    return np.where(np.isfinite(out), out, np.inf)


def _guess(model: CalibrationModel, data: Measurements) -> FloatArray:
    try:
        return first_guess(model, data)
    except (np.linalg.LinAlgError, ValueError):
        return model.nominal


def of_all_rows(data: Measurements, model: CalibrationModel) -> Iterator[Mistake]:
    """Every mistake that is made in all rows alike."""
    yield from _of_joints(data, model.robot.joint_names)
    yield from _of_readings(data, model)
    yield from _of_order(data)


def _of_joints(data: Measurements, names: Sequence[str]) -> Iterator[Mistake]:
    q, every = data.postures, list(range(len(names)))

    def of(cause: Cause, things: tuple[str, ...], at: list[int], columns: FloatArray) -> Mistake:
        changed = q.copy()
        changed[:, at] = columns
        return Mistake(cause, "joint", things, (), replace(data, postures=changed))

    for j, name in enumerate(names):
        for sign in (1.0, -1.0):
            for zero, angle in {"": 0.0, **_RIGHT_ANGLES}.items():
                if sign < 0 or angle:
                    cause: Cause = "zero" if sign > 0 else "sign and zero" if angle else "sign"
                    things = (name, zero) if zero else (name,)
                    yield of(cause, things, [j], sign * q[:, [j]] + angle)
    for way, words in ((1.0, "less"), (-1.0, "plus")) if len(names) >= 3 else ():
        yield of("coupling", (names[2], names[1], words), [2], q[:, [2]] + way * q[:, [1]])
    for a, b in combinations(every, 2):
        yield of("swapped joints", (names[a], names[b]), [a, b], q[:, [b, a]])
    yield of("all signs", (), every, -q)
    yield of("joint unit", ("degrees for radians",), every, q * (np.pi / 180))
    yield of("joint unit", ("radians for degrees",), every, q * (180 / np.pi))
    yield of("joint unit", ("tenths of degrees",), every, 0.1 * q)


def _of_readings(data: Measurements, model: CalibrationModel) -> Iterator[Mistake]:
    read, kind_of_each = data.observed, data.setup.kind
    if read is None:
        return
    kinds = model.measurements
    reads = np.array([kind.reads for kind in kinds])[kind_of_each]
    lengths = np.array([kind.rows - kind.turns for kind in kinds])[kind_of_each]
    places = reads & (lengths >= 3)
    turns = reads & np.array([kind.turns == 3 for kind in kinds])[kind_of_each]

    def of(
        cause: Cause, things: tuple[str, ...], rows: BoolArray, at: list[int], values: FloatArray
    ) -> Mistake:
        changed = read.copy()
        changed[np.flatnonzero(rows)[:, None], at] = values
        return Mistake(cause, "axis", things, (), replace(data, observed=changed))

    for words, factor in _UNITS.items():
        scaled = np.arange(read.shape[1]) < (lengths * reads)[:, None]
        changed = np.where(scaled, factor * read, read)
        yield Mistake("reading unit", "axis", (words,), (), replace(data, observed=changed))
    if not places.any():
        return
    place, pose = read[places], read[turns]
    for k, axis in enumerate("xyz"):
        yield of("mirrored axis", (axis,), places, [k], -place[:, [k]])
        if not turns.any():
            return  # any one axis mirrored, or two swapped: their frame is turned all the same
    for a, b in combinations(range(3), 2):
        yield of("swapped axes", ("xyz"[a], "xyz"[b]), places, [a, b], place[:, [b, a]])
    for order in ([1, 2, 0], [2, 0, 1]):
        words = "".join("xyz"[k] for k in order)
        yield of("turned axes", (words,), places, [0, 1, 2], place[:, order])
    yield of("inverted rotation", (), turns, [3, 4, 5], -pose[:, 3:6])
    T = inverse(transform(rotation_exp(pose[:, 3:6]), pose[:, :3]))
    values = np.concatenate([T[:, :3, 3], rotation_log(T[:, :3, :3])], axis=1)
    yield of("inverted pose", (), turns, list(range(6)), values)


def _of_order(data: Measurements) -> Iterator[Mistake]:
    count = data.count
    if count < 4:
        return
    pose, first = data.pose, np.unique(data.pose, return_index=True)[1]
    for by, way in ((1, "later"), (-1, "earlier")) if len(first) < count else ():
        kept = np.flatnonzero((pose - by >= 0) & (pose - by < len(first)))
        own = replace(data[kept], postures=data.postures[first[pose[kept] - by]])
        yield Mistake("shifted rows", "pose", (way,), (), own)
    for by, way in ((1, "later"), (-1, "earlier")):
        ahead = np.arange(max(by, 0), count + min(by, 0))
        if data.observed is not None:
            yield Mistake(
                "shifted rows",
                "",
                (way,),
                (),
                replace(data[ahead - by], observed=data.observed[ahead]),
            )
        if len(set(data.target.tolist())) > 1:
            target = data.setup.target[ahead]
            own = data[ahead - by]
            setup = replace(own.setup, target=target)
            yield Mistake("shifted labels", "target", (way,), (), replace(own, setup=setup))


def of_some_rows(held: Held) -> Iterator[Mistake]:
    """Poses whose readings are exchanged, a joint mistyped, labels of other targets."""
    data = held.data
    members = [np.flatnonzero(data.pose == p) for p in range(int(data.pose.max()) + 1)]
    off = np.array([held.standing_out[own].sum() for own in members])
    suspect = [members[p] for p in np.argsort(-off)[:_MOST_SUSPECT]]
    if data.observed is not None:
        yield from _swapped_readings(held, data.observed, members, suspect)
    usual = float(np.median(off))
    gross = [own for own in suspect[:_MISTYPED] if held.standing_out[own].sum() > _GROSS * usual]
    yield from _mistyped(held, gross, _USUAL * usual)
    if len(data.targets) > 1:
        yield from _wrong_labels(held, np.argsort(-held.standing_out)[:_MOST_SUSPECT])


def _swapped_readings(
    held: Held, observed: FloatArray, members: list[IntArray], suspect: list[IntArray]
) -> Iterator[Mistake]:
    """The best few exchanges of readings of two poses: by how much the squares would shrink."""
    data, model = held.data, held.model
    reads = np.array([kind.reads for kind in model.measurements])[data.setup.kind]
    what = np.stack([data.setup.kind, data.setup.tool, data.setup.target], axis=1)
    own = model.white_residuals(data, held.x)
    pairs = [*combinations(suspect, 2), *pairwise(members)]
    found = []
    for a, b in pairs:
        if not reads[a].all() or what[a].tolist() != what[b].tolist():
            continue
        at = np.concatenate([a, b])
        swapped = replace(data[at], observed=observed[np.concatenate([b, a])])
        change = model.white_residuals(swapped, held.x) - own[at]
        inner = np.einsum("amr,am->r", held.Q[at], change)
        after = float(np.sum(change * (2.0 * held.rows[at] + change)) - inner @ inner)
        found.append((after, a, b))
    for after, a, b in sorted(found, key=lambda each: each[0])[:3]:
        if after >= 0.0:
            return
        changed = observed.copy()
        changed[a], changed[b] = observed[b], observed[a]
        rows = (int(min(a[0], b[0])), int(max(a[0], b[0])))
        names = (data.names[rows[0]], data.names[rows[1]])
        yield Mistake("swapped rows", "", names, rows, replace(data, observed=changed))


def _mistyped(held: Held, suspect: list[IntArray], most: float) -> Iterator[Mistake]:
    """One joint of a pose, put right by what the other poses predict: the best one of each pose.

    ``most``: squares that are left of the pose then.
    """
    data, model = held.data, held.model
    for own in suspect:
        x, part = _without_rows(held, own), data[own]
        best: tuple[float, int, FloatArray] | None = None
        for j in range(model.robot.n):
            q = part.postures.copy()
            for _ in range(_STEPS):
                white = model.white_residuals(replace(part, postures=q), x).ravel()
                ahead = q.copy()
                ahead[:, j] += _STEP_RAD
                slope = model.white_residuals(replace(part, postures=ahead), x).ravel() - white
                by = -(slope @ white) / max(float(slope @ slope), 1e-300)
                q[:, j] += np.clip(by * _STEP_RAD, -_LARGEST_RAD, _LARGEST_RAD)
            white = model.white_residuals(replace(part, postures=q), x).ravel()
            cost = float(white @ white)
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = cost, j, q
        if best is not None and best[0] < most:
            changed = data.postures.copy()
            changed[own] = best[2]
            name = (model.robot.joint_names[best[1]],)
            right = replace(data, postures=changed)
            yield Mistake("mistyped joint", "joint", name, (int(own[0]),), right)


def _wrong_labels(held: Held, suspect: IntArray) -> Iterator[Mistake]:
    """The best few changes of one label, or exchanges of two, among rows that stand out."""
    data, model = held.data, held.model
    found: list[tuple[float, tuple[int, ...], tuple[int, ...]]] = []
    fits: dict[int, tuple[float, int]] = {}
    for i in suspect.tolist():
        own = data.setup.target[i]
        others = [t for t in range(len(data.targets)) if t != own]
        x = _without_rows(held, np.array([i]))
        same = data[np.full(len(others), i)]
        setup = replace(same.setup, target=np.array(others, dtype=np.intp))
        white = model.white_residuals(replace(same, setup=setup), x)
        cost = np.einsum("tm,mn,tn->t", white, held.blocks[i], white)
        best = int(np.argmin(cost))
        gain = float(held.standing_out[i] - cost[best])
        fits[i] = (gain, others[best])
        found.append((gain, (i,), (others[best],)))
    for i, j in combinations(suspect.tolist(), 2):
        a, b = int(data.setup.target[i]), int(data.setup.target[j])
        if a != b and fits[i][1] == b and fits[j][1] == a:
            found.append((fits[i][0] + fits[j][0], (i, j), (b, a)))
    found.sort(reverse=True)
    for gain, rows, labels in found[:4]:
        if gain <= 0.0:
            return
        target = data.setup.target.copy()
        target[list(rows)] = labels
        changed = replace(data, setup=replace(data.setup, target=target))
        names = tuple(data.targets[t] for t in labels)
        cause: Cause = "wrong label" if len(rows) == 1 else "swapped labels"
        yield Mistake(cause, "target", names, rows, changed)


def _without_rows(held: Held, own: IntArray) -> FloatArray:
    """Parameters ``(p,)`` from all measurements but some, linearised."""
    J = held.linear.stacked()[1]
    m = held.rows.shape[1]
    at = (own[:, None] * m + np.arange(m)).ravel()
    # x without them: as if their rows had been predicted, r less what is predicted of it
    Q = held.Q[own].reshape(len(at), -1)
    right = np.zeros(len(J))
    right[at] = np.linalg.lstsq(np.eye(len(at)) - Q @ Q.T, held.rows[own].ravel(), rcond=_SEEN)[0]
    length = column_lengths(J)
    step = np.linalg.lstsq(J / length, right, rcond=1e-10)[0] / length
    return np.asarray(held.x + step)


CHANCE = level_of_each(4)
"""Largest probability that a family of causes is named where nothing is wrong: mistakes of rows,
changes in the course of measuring, scales, gaps of the model."""

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

UNIT_TOLD = 0.1
"""Standard deviation of the scale of readings, with an arm as rough as it is, from which on their
unit cannot be told: inches from cm."""

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
    every = _rows(model, usual)
    every += _retuned(usual, changes(held), course=True)
    # links may be off by what is known of them, not by as little as these seem to be
    given = held_at(held.model.with_prior(model.prior), data, held.x)
    every += _named([*scales(given), *coupled(given)])
    if not is_far:
        return likeliest(every) or likeliest(_named(incomplete(held)))
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
        if right.rms_m() < LITTLE * float(np.sqrt(np.mean(spread2))) and _tells(tried[k], right):
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


def _tells(mistake: Mistake, right: Held) -> bool:
    """Return True if a unit of readings can be told: lengths of the arm are seen in them."""
    if mistake.cause != "reading unit":
        return True
    informations = [each.tests.information[0, 0, 0] for each in scales(right)]
    return max(informations, default=0.0) > (SCALE / UNIT_TOLD) ** 2


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


def _beyond_chance(every: Sequence[Tried], *, course: bool = False) -> tuple[list[Effect], float]:
    """The likeliest effects of a family; none where placebos have as likely ones.

    And the log odds that are worth a unit of log odds.
    """
    odds = np.array([each.log_odds for each in every])
    together = np.logaddexp.reduce(odds, initial=-np.inf)
    if not together > -np.log(CHANCE):
        return [], 1.0
    tried = [(each.tests, each.tried) for each in every]
    chance = chance_of(every[0].tests.held, tried, CHANCE, course=course)
    if chance.probability > CHANCE:
        return [], 1.0
    order = np.argsort(-odds)[:MOST_RETUNED].tolist()
    return [every[k].effect() for k in order if odds[k] > 0.0], chance.scale


def _retuned(found: Tuned, every: Sequence[Tried], *, course: bool = False) -> list[Finding]:
    """The same, noise and priors found again with each effect."""
    effects, scale = _beyond_chance(every, course=course)
    return [replace(effect.finding, log_odds=log_odds(found, effect) / scale) for effect in effects]


def _named(every: Sequence[Tried]) -> list[Finding]:
    """The same, noise and priors as they are."""
    effects, scale = _beyond_chance(every)
    return [replace(effect.finding, log_odds=effect.finding.log_odds / scale) for effect in effects]


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
            odds = right.priors.log_evidence - found.priors.log_evidence - float(np.log(count))
            said = _finding(mistake, held, right.held, 1)
            change_m, sigmas = right.held.answer(right.held.x - held.x)
            named.append(replace(said, log_odds=odds, change_m=change_m, sigmas=sigmas))
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
