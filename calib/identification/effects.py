"""What changes in the course of the measurements: something was moved, or moves all the time.

Effects of a thing (a tool, a target, an instrument, a joint) are the columns of its parameters from
some measurement on, or growing with their order. All places are tested at once: scores and
information are sums over the measurements that follow (Andrews, Econometrica 61, 1993).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.batch_last import along, cross
from calib.batch_last import turn as rotate
from calib.identification.held import (
    FEWEST_ASIDE,
    Cause,
    Effect,
    Finding,
    Held,
    ScoreTests,
    held_at,
)
from calib.model import simulate
from calib.model.parameters import JointHarmonics
from calib.se3 import FloatArray, IntArray

SHIFT_M, TURN_RAD, ZERO_RAD = 1e-3, 1e-3, 3e-3
"""Usual sizes: how far things are moved, and how far a joint loses its zero."""

CARRIED = 0.1
"""Usual load that nobody described, over the mass of the arm."""

GIVES = 1e-4
"""Compliance of a joint of which nothing is known beforehand [rad/Nm]."""

APPROACHES = (0.1, 0.25)
"""Time constants of warming up, in parts of the whole."""


@dataclass(frozen=True, eq=False)
class Thing:
    """What may change while measuring."""

    part: str
    names: tuple[str, ...]
    columns: FloatArray
    """(N, m, k): change of the rows over the noise by its parameters, each in units of its usual
    change."""
    usual: float = np.nan  # usual change, where the size of a change is told in its unit
    unit: str = "m"

    def size(self, held: Held, changed: FloatArray, by: FloatArray) -> tuple[float, str]:
        """Size of a change of the rows ``(N, m)`` by so many usual changes, and its unit."""
        if np.isfinite(self.usual):
            far = float(by[0]) if len(by) == 1 else float(np.linalg.norm(by))
            return far * self.usual, self.unit
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
            zero = held.J[..., [k]] * ZERO_RAD
            found.append(Thing("joint", (joint,), zero, ZERO_RAD, "rad"))
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


@dataclass(frozen=True, eq=False)
class Tried:
    """Effects that are tried: their tests, and what a finding says of them."""

    tests: ScoreTests
    cause: Cause
    thing: Thing
    tried: float  # logarithm of how many others are tried beside them

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds of all of them together."""
        return float(self.tests.odds_of_all(self.tests.held.rows[..., None])[0]) - self.tried

    def effect(self) -> Effect:
        """Return the likeliest of them, which stands for all."""
        held, log_odds = self.tests.held, self.log_odds
        start, usual, by = self.tests.likeliest()
        Z = self.tests.columns_of(start)
        rows = (int(self.tests.starts[start]),) if self.cause == "step" else ()
        size = self.thing.size(held, Z @ by, by)
        left = held.after(Z, by)
        change_m, sigmas = held.answer(held.moved_by(Z, by))
        # the noise that the residuals show is smaller with the effect
        smaller = float(np.linalg.norm(left) / max(float(np.linalg.norm(held.rows)), 1e-300))
        what = (self.cause, self.thing.names, self.thing.part, rows, *size)
        finding = Finding(
            *what,
            *(held.rms_m(), held.rms_m(left), log_odds),
            change_m=change_m,
            sigmas=sigmas / max(smaller, 1e-300),
        )
        own = float(self.tests.log_odds(held.rows[..., None]).max())
        return Effect(finding, Z, usual, by, own - log_odds)


def changes(held: Held) -> list[Tried]:
    """Changes of each thing in the course of the measurements: step, drift, warming up."""
    starts, things = _starts(held), [*things_of(held), *_payload(held)]
    tried, found = float(np.log(2 * len(things))), []
    steady = np.ones(len(held.rows))
    for thing in things:
        if len(starts):
            tests = ScoreTests(held, thing.columns, steady, starts)
            found.append(Tried(tests, "step", thing, tried))
        trends = _trends(thing) if thing.part != "payload" else []
        for cause, course in trends:
            tests = ScoreTests(held, thing.columns, course, np.zeros(1, dtype=np.intp))
            found.append(Tried(tests, cause, thing, tried + float(np.log(len(trends)))))
    return found


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
    first = np.unique(held.data.pose, return_index=True)[1]
    return np.sort(first)[FEWEST_ASIDE : len(first) - FEWEST_ASIDE + 1]


def _payload(held: Held) -> Iterator[Thing]:
    """A load of the flange that is not described, at the tool point.

    Each joint gives way by a part of its own: what the fit has of compliance may be little, and has
    seen the torque of the load as well.
    """
    model, view = held.model, held.linear.view
    robot, stem = model.robot, "compliance."
    own = [k for k, name in enumerate(model.names) if name.startswith(stem)]
    mass = float(robot.link_mass.sum()) * CARRIED
    if not own or not mass:
        return
    motion = np.zeros((len(own), 6, view.q.shape[1]))
    for out, k in zip(motion, own, strict=True):
        j = robot.joint_names.index(model.names[k].removeprefix(stem))
        origin, axis = view.walk.origins[j], view.axis(j)
        torque = along(axis, cross(view.point - origin, mass * _down(held)))
        view.turn_about(axis, origin, out)
        out *= torque
    give = np.minimum(model.prior[own], GIVES)
    yield Thing("payload", ("payload",), _seen(held, motion) * give)


def _down(held: Held) -> FloatArray:
    """Gravity ``(3, S)`` [m/s²] in base axes: a positioner turns the base about the floor."""
    robot, view = held.model.robot, held.linear.view
    down = np.tile(robot.gravity[:, None], view.q.shape[1])
    if robot.floor:
        down = rotate(robot.chain.link_columns(view.walk, robot.floor - 1), robot.gravity[:, None])
    return np.asarray(down)


SCALE = 0.01
"""Usual error of an instrument's scale, or of a target's size."""

COUPLED = 0.01
"""Usual part of a joint that another one turns by, and that a joint turns by too much."""

SAG_M = 1e-3
"""Usual size of what grows with the square of the reach, at the farthest."""

WAVE_RAD = 3e-4
"""Usual harmonic of a transmission."""

WAVES = (1.0, 2.0, 3.0, 4.0)

_HELD_RAD = 1e-9
"""Standard deviation of what is as good as nothing."""


def scales(held: Held) -> list[Tried]:
    """Readings of a kind that are all too long by the same part.

    In units of what the model predicts: what is left of measured readings where no length of the
    arm is seen is their noise, and a scale of the noise explains any noise.
    """
    data, model, found = held.data, held.model, []
    if data.observed is None:
        return []
    predicted = simulate(model, held.x, data.postures, None, setup=data.setup).observed
    if predicted is None:
        return []
    for k, kind in enumerate(model.measurements):
        own = data.setup.kind == k
        lengths = kind.rows - kind.turns
        if not kind.reads or not own.any():
            continue
        read = np.zeros(held.rows.shape)
        read[own, :lengths] = predicted[own, :lengths] * SCALE
        Z = model.whiten(data.postures, read[..., None], held.x, data.setup)
        found.append(_pattern(held, Z, "scale", Thing("instrument", (kind.name,), Z, SCALE, "")))
    return found


def coupled(held: Held) -> list[Tried]:
    """Joints that turn by a part of another joint, or by more than they show."""
    model, found = held.model, []
    names = model.robot.joint_names
    zeros = {name: k for k, name in enumerate(model.names) if name.startswith("zero_offset.")}
    pairs = [(a, b) for a in names for b in names if f"zero_offset.{a}" in zeros]
    for joint, by in pairs:
        angle = held.data.postures[:, names.index(by), None, None] * COUPLED
        Z = held.J[..., [zeros[f"zero_offset.{joint}"]]] * angle
        cause: Cause = "joint scale" if joint == by else "coupled joints"
        things = (joint,) if joint == by else (joint, by)
        thing = Thing("joint", things, Z, COUPLED, "")
        found.append(_pattern(held, Z, cause, thing, float(np.log(len(pairs)))))
    return found


def incomplete(held: Held) -> list[Tried]:
    """What the arm does that its model, harmonics apart, does not."""
    model = held.model
    prior = model.prior.copy()
    for block, part in zip(model.parameters, model.slices, strict=True):
        if isinstance(block, JointHarmonics):
            prior[part] = _HELD_RAD
    bare = held_at(model.with_prior(prior), held.data, held.x)
    view, n, found = bare.linear.view, model.robot.n, []
    tried = float(np.log(n * len(WAVES) + 1))
    for joint in np.flatnonzero(model.robot.arm_turns).tolist():
        turn = np.zeros((6, view.q.shape[1]))
        view.move_joint(joint, turn)
        for wave in WAVES:
            angle = wave * view.q[joint]
            Z = _seen(bare, np.stack([np.sin(angle) * turn, np.cos(angle) * turn]) * WAVE_RAD)
            name = (model.robot.joint_names[joint], f"{wave:g}")
            found.append(
                _pattern(bare, Z, "harmonic", Thing("joint", name, Z, WAVE_RAD, "rad"), tried)
            )
    # level and upright as the floor is
    robot, down = model.robot, _down(held)
    upright = -down / np.linalg.norm(robot.gravity)
    out = view.point.copy()
    if robot.n_external:
        out -= view.walk.origins[robot.n_external]
    out -= upright * along(upright, out)
    reach = np.linalg.norm(out, axis=0)
    grown = (reach / reach.max(initial=1e-9)) ** 2 * SAG_M
    motion = np.zeros((2, 6, view.q.shape[1]))
    motion[0, :3] = upright * grown
    motion[1, :3] = out / np.maximum(reach, 1e-9) * grown
    Z = _seen(bare, motion)
    return [*found, _pattern(bare, Z, "reach", Thing("", (), Z, SAG_M, "m"), tried)]


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


def _pattern(held: Held, Z: FloatArray, cause: Cause, thing: Thing, tried: float = 0.0) -> Tried:
    """Effect of columns ``(N, m, k)`` in all measurements alike."""
    whole = ScoreTests(held, Z, np.ones(len(Z)), np.zeros(1, dtype=np.intp))
    return Tried(whole, cause, thing, tried)
