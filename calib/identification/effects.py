"""What changes in the course of the measurements: something was moved, or moves all the time.

Effects of a thing (a tool, a target, an instrument, a joint) are the columns of its parameters from
some measurement on, or growing with their order. All places are tested at once: scores and
information are sums over the measurements that follow (Andrews, Econometrica 61, 1993).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.batch_last import along
from calib.batch_last import turn as rotate
from calib.identification.held import (
    Cause,
    Effect,
    Finding,
    Held,
    Scores,
    held_at,
    log_mean,
    score_of,
    scores,
)
from calib.model.parameters import JointHarmonics
from calib.se3 import FloatArray, IntArray

SHIFT_M, TURN_RAD, ZERO_RAD = 1e-3, 1e-3, 3e-3
"""Usual sizes: how far things are moved, and how far a joint loses its zero."""

FEWEST_ASIDE = 3
"""Measurements before and after a step: of two, one that is wrong is no step."""

APPROACHES = (0.1, 0.25)
"""Time constants of warming up, in parts of the whole."""

_MOST_ALIKE = 0.9

_What = tuple[Cause, tuple[str, ...], str, tuple[int, ...], float, str]
"""Of a finding, what it is of: cause, things, part, rows, size and unit."""


@dataclass(frozen=True, eq=False)
class Thing:
    """What may change while measuring."""

    part: str
    names: tuple[str, ...]
    columns: FloatArray
    """(N, m, k): change of the rows over the noise by its parameters, each in units of its usual
    change."""

    def size(self, held: Held, changed: FloatArray, by: FloatArray) -> tuple[float, str]:
        """Size of a change of the rows ``(N, m)`` by so many usual changes, and its unit."""
        if self.part == "joint":
            return float(np.abs(by[0])) * ZERO_RAD, "rad"
        # where it is measured: the origin of an instrument's frame may be metres off
        return float(held.lengths_m(changed).max(initial=0.0)), "m"


def things_of(held: Held) -> list[Thing]:
    """Tools, targets, all targets together, and joints, as the model has parameters of them."""
    model = held.model
    usual = {"m": SHIFT_M, "rad": TURN_RAD}
    found = []
    frames: dict[tuple[str, str], list[int]] = {}
    for block, part in zip(model.parameters, model.slices, strict=True):
        index = range(part.start, part.stop)
        for side, labels in (("tool", block.tools), ("target", block.targets)):
            for label in labels:
                stem = label if label == side else f"{side}.{label}"
                own = [
                    k
                    for k in index
                    if model.names[k].rpartition(".")[0] == stem and model.units[k] in usual
                ]
                if own:
                    frames[side, label] = own
    for (side, label), own in frames.items():
        lengths = [k for k in own if model.units[k] == "m"]
        turns = len(lengths) < len(own)
        part_name = "instrument" if side == "target" and turns else side
        # a shift alone is told by fewer measurements than one with a turn
        for some in (lengths, own) if turns and lengths else (own,):
            scale = np.array([usual[model.units[k]] for k in some])
            found.append(Thing(part_name, (label,), held.J[..., some] * scale))
    together = _together(held, {k[1]: v for k, v in frames.items() if k[0] == "target"})
    if together is not None:
        found.append(together)
    for k, name in enumerate(model.names):
        if name.startswith("zero_offset."):
            joint = name.removeprefix("zero_offset.")
            found.append(Thing("joint", (joint,), held.J[..., [k]] * ZERO_RAD))
    return found


def _together(held: Held, frames: dict[str, list[int]]) -> Thing | None:
    """All targets that are points, moved as one: what they stand on, or the arm's foot."""
    model = held.model
    points = {
        label: own
        for label, own in frames.items()
        if [model.names[k].rpartition(".")[2] for k in own] == ["x", "y", "z"]
    }
    if len(points) < 2:
        return None
    places = np.array([held.x[own] for own in points.values()])
    lever = places - places.mean(axis=0)
    columns = np.zeros((*held.rows.shape, 6))
    for own, arm in zip(points.values(), lever, strict=True):
        J = held.J[..., own]
        columns[..., :3] += J * SHIFT_M
        # a turn w moves the point by w x arm
        cross = np.array([np.cross(axis, arm) for axis in np.eye(3)]).T
        columns[..., 3:] += J @ cross * TURN_RAD
    return Thing("targets", tuple(points), columns)


def alike(rows: FloatArray) -> float:
    """Correlation from one measurement to the next of rows ``(N, m)``."""
    if len(rows) < 2 * FEWEST_ASIDE:
        return 0.0
    square = float(np.sum(rows**2))
    if square <= 0.0:
        return 0.0
    found = float(np.sum(rows[1:] * rows[:-1])) / square + 1.0 / len(rows)
    return float(np.clip(found, 0.0, _MOST_ALIKE))


def changes(held: Held) -> Iterator[Effect]:
    """The likeliest change of each thing: its step, its drift, and its warming up."""
    count, starts, things = len(held.rows), _starts(held), things_of(held)
    tried = np.log(2 * len(things))
    for thing in things:
        if len(starts):
            found, neighbours = _steps(held, thing, starts)
            best = int(np.argmax(found.log_odds))
            if np.isfinite(found.log_odds[best]):  # else the parameters take up all of it
                after = (np.arange(count) >= starts[best]).astype(float)
                # of all places, the likeliest stands for the mean
                more = float(tried + found.log_odds[best] - log_mean(found.log_odds))
                Z, rows = thing.columns * after[:, None, None], (int(starts[best]),)
                size = thing.size(held, Z @ found.size[best], found.size[best])
                what: _What = ("step", thing.names, thing.part, rows, *size)
                yield _effect(held, Z, found, best, what, more, neighbours)
        trends = _trends(thing)
        for cause, course in trends:
            Z = thing.columns * course[:, None, None]
            neighbours = alike(held.after(Z, score_of(held, Z).size[0]))
            found = score_of(held, Z, neighbours)
            size = thing.size(held, Z @ found.size[0], found.size[0])
            what = (cause, thing.names, thing.part, (), *size)
            yield _effect(held, Z, found, 0, what, float(tried + np.log(len(trends))), neighbours)


def _trends(thing: Thing) -> list[tuple[Cause, FloatArray]]:
    """Courses ``(N,)`` from the first to the last measurement of a thing: from 0 up, by 1 or so."""
    seen = np.flatnonzero(np.any(thing.columns, axis=(1, 2)))
    if len(seen) < 2 * FEWEST_ASIDE:
        return []
    order = np.arange(len(thing.columns)) - seen[0]
    order = np.clip(order / (seen[-1] - seen[0]), 0.0, 1.0)
    found: list[tuple[Cause, FloatArray]] = [("drift", order)]
    return found + [("warm-up", 1.0 - np.exp(-order / part)) for part in APPROACHES]


def _starts(held: Held) -> IntArray:
    """First measurements after which something may have happened: between poses, not within."""
    pose = held.data.pose
    first = np.flatnonzero(pose[1:] != pose[:-1]) + 1
    return first[(first >= FEWEST_ASIDE) & (first <= len(pose) - FEWEST_ASIDE)]


def _steps(held: Held, thing: Thing, starts: IntArray) -> tuple[Scores, float]:
    """Scores of steps at all starts, and how alike neighbours are after the best."""
    Z = thing.columns
    score = _from(np.einsum("imk,im->ik", Z, held.rows))[starts]
    whole = _from(np.einsum("imk,iml->ikl", Z, Z))[starts]
    inner = _from(np.einsum("imr,imk->irk", held.Q, Z))[starts]
    information = whole - np.swapaxes(inner, 1, 2) @ inner
    found = scores(held, score, information, whole)
    best = int(np.argmax(found.log_odds))
    after = (np.arange(len(held.rows)) >= starts[best]).astype(float)
    left = held.after(Z * after[:, None, None], found.size[best])
    neighbours = alike(left)
    return scores(held, score, information, whole, neighbours), neighbours


def _from(each: FloatArray) -> FloatArray:
    """Sums over each measurement and all that follow."""
    return np.asarray(np.cumsum(each[::-1], axis=0)[::-1])


def _effect(
    held: Held,
    Z: FloatArray,
    found: Scores,
    best: int,
    what: _What,
    tried: float,
    neighbours: float,
) -> Effect:
    """Effect of columns ``(N, m, k)`` by one of its scores."""
    before, after = held.rms_m(), held.rms_m(held.after(Z, found.size[best]))
    finding = Finding(*what, before, after, float(found.log_odds[best]) - tried)
    return Effect(finding, Z, float(found.usual[best]), tried, neighbours)


SCALE = 0.01
"""Usual error of an instrument's scale, or of a target's size."""

SAG_M = 1e-3
"""Usual size of what grows with the square of the reach, at the farthest."""

WAVE_RAD = 3e-4
"""Usual harmonic of a transmission."""

WAVES = (1.0, 2.0, 3.0, 4.0)

_HELD_RAD = 1e-9
"""Standard deviation of what is as good as nothing."""


def scales(held: Held) -> Iterator[Effect]:
    """Readings of a kind that are all too long by the same part."""
    data, model = held.data, held.model
    if data.observed is None:
        return
    for k, kind in enumerate(model.measurements):
        own = data.setup.kind == k
        lengths = kind.rows - kind.turns
        if not kind.reads or not own.any():
            continue
        read = np.zeros(held.rows.shape)
        read[own, :lengths] = data.observed[own, :lengths] * SCALE
        Z = model.whiten(data.postures, read[..., None], held.x, data.setup)
        yield _pattern(held, Z, ("scale", (kind.name,), "instrument"), SCALE, "")


def incomplete(held: Held) -> Iterator[Finding]:
    """What the arm does that its model, harmonics apart, does not."""
    model = held.model
    prior = model.prior.copy()
    for block, part in zip(model.parameters, model.slices, strict=True):
        if isinstance(block, JointHarmonics):
            prior[part] = _HELD_RAD
    bare = held_at(model.with_prior(prior), held.data, held.x)
    view, n = bare.linear.view, model.robot.n
    tried = float(np.log(n * len(WAVES) + 1))
    for joint in range(model.robot.n_external, n):
        turn = np.zeros((6, view.q.shape[1]))
        view.turn_about(view.axis(joint), view.walk.origins[joint], turn)
        for wave in WAVES:
            angle = wave * view.q[joint]
            motion = np.stack([np.sin(angle) * turn, np.cos(angle) * turn]) * WAVE_RAD
            Z = _seen(bare, motion)
            name = (model.robot.joint_names[joint], f"{wave:g}")
            what: tuple[Cause, tuple[str, ...], str] = ("harmonic", name, "joint")
            yield _pattern(bare, Z, what, WAVE_RAD, "rad", tried).finding
    # level and upright as the floor is, which a positioner turns in the base
    robot = model.robot
    upright = -robot.gravity[:, None] / np.linalg.norm(robot.gravity)
    if robot.floor:
        upright = rotate(robot.chain.link_columns(view.walk, robot.floor - 1), upright)
    out = view.point.copy()
    if robot.n_external:
        out -= view.walk.origins[robot.n_external]
    out -= upright * along(upright, out)
    reach = np.linalg.norm(out, axis=0)
    grown = (reach / reach.max(initial=1e-9)) ** 2 * SAG_M
    motion = np.zeros((2, 6, view.q.shape[1]))
    motion[0, :3] = upright * grown
    motion[1, :3] = out / np.maximum(reach, 1e-9) * grown
    yield _pattern(bare, _seen(bare, motion), ("reach", (), ""), SAG_M, "m", tried).finding


def _seen(held: Held, motion: FloatArray) -> FloatArray:
    """Rows over the noise ``(N, m, k)`` that twists ``(k, 6, S)`` of the tool show as."""
    model, view = held.model, held.linear.view
    twists = motion[:, : held.linear.motion.shape[1]]
    out = np.zeros((len(motion), *held.linear.rows_last.shape))
    for kind, columns, part in model.by_kind(view):
        rows = held.linear.rows_last[: kind.rows, columns]
        moved = kind.differentiate(twists[:, :, columns], part, rows)
        out[:, : kind.rows, columns] = kind.whiten_derivative(
            moved, twists[:, :, columns], part, rows
        )
    return view.posture_first(out)


def _pattern(
    held: Held,
    Z: FloatArray,
    what: tuple[Cause, tuple[str, ...], str],
    usual: float,
    unit: str,
    tried: float = 0.0,
) -> Effect:
    """Effect of columns ``(N, m, k)`` in all measurements alike."""
    found = score_of(held, Z)
    size = found.size[0]
    far = float(size[0]) if len(size) == 1 else float(np.linalg.norm(size))
    return _effect(held, Z, found, 0, (*what, (), far * usual, unit), tried, 0.0)
