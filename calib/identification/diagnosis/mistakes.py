"""Mistakes that a table of measurements may have: conventions of the arm, of readings, of rows.

Each is a change of the table that would put it right. What all rows suffer from is tried by fitting
the changed table; rows that are exchanged or have a wrong label are looked for among those that
the others contradict, and fitted then.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.identification.diagnosis.held import Cause, Held, held_at
from calib.identification.least_squares import column_lengths, minimise
from calib.identification.start import first_guess
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, IntArray, inverse, rotation_exp, rotation_log, transform

_RIGHT_ANGLES = {"+90": np.pi / 2, "-90": -np.pi / 2, "180": np.pi}

_MOST_SUSPECT = 10
"""Rows that stand out most, of which wrong ones are looked for."""

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
    q, n = data.postures, len(names)
    for j, name in enumerate(names):
        for sign in (1.0, -1.0):
            for zero, angle in {"": 0.0, **_RIGHT_ANGLES}.items():
                if sign > 0 and not angle:
                    continue
                changed = q.copy()
                changed[:, j] = sign * q[:, j] + angle
                cause: Cause = "zero" if sign > 0 else "sign and zero" if angle else "sign"
                yield _of(data, cause, "joint", (name, zero) if zero else (name,), changed)
    if n >= 3:
        for way in (1.0, -1.0):
            changed = q.copy()
            changed[:, 2] += way * q[:, 1]
            things = (names[2], names[1], "less" if way > 0 else "plus")
            yield _of(data, "coupling", "joint", things, changed)
    for a, b in combinations(range(n), 2):
        changed = q.copy()
        changed[:, [a, b]] = q[:, [b, a]]
        yield _of(data, "swapped joints", "joint", (names[a], names[b]), changed)
    yield _of(data, "all signs", "joint", (), -q)
    for words, factor in (
        ("degrees for radians", np.pi / 180),
        ("radians for degrees", 180 / np.pi),
    ):
        yield _of(data, "joint unit", "joint", (words,), q * factor)


def _of(
    data: Measurements, cause: Cause, part: str, things: tuple[str, ...], postures: FloatArray
) -> Mistake:
    return Mistake(cause, part, things, (), replace(data, postures=postures))


def _of_readings(data: Measurements, model: CalibrationModel) -> Iterator[Mistake]:
    if data.observed is None:
        return
    kinds = model.measurements
    read = np.array([kind.reads for kind in kinds])[data.setup.kind]
    places = np.array([kind.rows - kind.turns >= 3 for kind in kinds])[data.setup.kind] & read
    turns = np.array([kind.turns == 3 for kind in kinds])[data.setup.kind] & read

    def changed(cause: Cause, things: tuple[str, ...], rows: FloatArray) -> Mistake:
        return Mistake(cause, "axis", things, (), replace(data, observed=rows))

    for words, factor in _UNITS.items():
        rows = data.observed.copy()
        lengths = np.array([kind.rows - kind.turns for kind in kinds])[data.setup.kind]
        scaled = np.arange(rows.shape[1]) < (lengths * read)[:, None]
        rows[scaled] *= factor
        yield changed("reading unit", (words,), rows)
    if not places.any():
        return
    for k, axis in enumerate("xyz"):
        rows = data.observed.copy()
        rows[places, k] *= -1.0
        yield changed("mirrored axis", (axis,), rows)
        if not turns.any():
            return  # any one axis mirrored, or two swapped: their frame is turned all the same
    for a, b in combinations(range(3), 2):
        rows = data.observed.copy()
        rows[:, [a, b]] = np.where(places[:, None], rows[:, [b, a]], rows[:, [a, b]])
        yield changed("swapped axes", ("xyz"[a], "xyz"[b]), rows)
    for order in ([1, 2, 0], [2, 0, 1]):
        rows = data.observed.copy()
        rows[:, :3] = np.where(places[:, None], rows[:, order], rows[:, :3])
        yield changed("turned axes", ("".join("xyz"[k] for k in order),), rows)
    rows = data.observed.copy()
    rows[turns, 3:6] *= -1.0
    yield changed("inverted rotation", (), rows)
    rows = data.observed.copy()
    T = inverse(transform(rotation_exp(rows[turns, 3:6]), rows[turns, :3]))
    rows[turns, :3], rows[turns, 3:6] = T[:, :3, 3], rotation_log(T[:, :3, :3])
    yield changed("inverted pose", (), rows)


def _of_order(data: Measurements) -> Iterator[Mistake]:
    count = data.count
    if count < 4:
        return
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
    """Rows that are exchanged, or have the label of another target: the likeliest few."""
    data = held.data
    suspect = np.argsort(-held.standing_out)[:_MOST_SUSPECT]
    if data.observed is not None:
        yield from _swapped_readings(held, data.observed, suspect)
    if len(data.targets) > 1:
        yield from _wrong_labels(held, suspect)


def _swapped_readings(held: Held, observed: FloatArray, suspect: IntArray) -> Iterator[Mistake]:
    """The best few exchanges of the readings of two rows: by how much the squares would shrink."""
    data, model = held.data, held.model
    reads = np.array([kind.reads for kind in model.measurements])[data.setup.kind]
    pairs = {
        (min(a, b), max(a, b))
        for a, b in combinations(suspect.tolist(), 2)
        if reads[a] and reads[b] and data.setup.kind[a] == data.setup.kind[b]
    }
    pairs |= {
        (i, i + 1)
        for i in range(data.count - 1)
        if reads[i] and reads[i + 1] and data.setup.kind[i] == data.setup.kind[i + 1]
    }
    if not pairs:
        return
    both = np.array(sorted(pairs))
    swapped = replace(data[both.ravel()], observed=observed[both[:, ::-1].ravel()])
    white = model.white_residuals(swapped, held.x).reshape(len(both), 2, -1)
    own = model.white_residuals(data, held.x)
    change = white - own[both]
    taken = held.Q[both]  # C, 2, m, r
    inner = np.einsum("camr,cam->cr", taken, change)
    after = (
        2.0 * np.einsum("cam,cam->c", change, held.rows[both])
        + np.einsum("cam,cam->c", change, change)
        - np.einsum("cr,cr->c", inner, inner)
    )
    for c in np.argsort(after)[:3].tolist():
        a, b = both[c].tolist()
        if after[c] >= 0.0:
            return
        changed = observed.copy()
        changed[[a, b]] = observed[[b, a]]
        names = (data.names[a], data.names[b])
        yield Mistake("swapped rows", "", names, (a, b), replace(data, observed=changed))


def _wrong_labels(held: Held, suspect: IntArray) -> Iterator[Mistake]:
    """The best few changes of one label, or exchanges of two, among rows that stand out."""
    data, model = held.data, held.model
    found: list[tuple[float, tuple[int, ...], tuple[int, ...]]] = []
    fits: dict[int, tuple[float, int]] = {}
    for i in suspect.tolist():
        own = data.setup.target[i]
        others = [t for t in range(len(data.targets)) if t != own]
        x = _without_row(held, i)
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


def _without_row(held: Held, i: int) -> FloatArray:
    """Parameters ``(p,)`` [SI] from all measurements but one, linearised."""
    J = held.linear.stacked(held.x)[1]
    # x without i: as if its rows had been predicted, r_i less what is predicted of it
    right = np.zeros(len(J))
    m = held.rows.shape[1]
    right[i * m : (i + 1) * m] = held.left_out[i]
    length = column_lengths(J)
    step = np.linalg.lstsq(J / length, right, rcond=1e-10)[0] / length
    return np.asarray(held.x + step)
