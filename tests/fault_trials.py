"""Simulated measurements of arms that are off as arms are, with one fault or none.

Three kinds of measurement: touch-ups of three targets, points of a tracker, poses of a target by a
camera. The arm has errors of zeros, geometry and compliance; harmonics and lost motion on request.
"""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from calib.identification.held import Held
from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import KINDS, Measurements
from calib.model.parameters import ParameterBlock, TargetFrame, TargetPoints, ToolFrame, ToolPoints
from calib.se3 import FloatArray, IntArray, rotation_exp, transform
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.cell.models import robot_blocks
from posedesign.constraints import nearest_postures
from posedesign.files.measurements import MeasurementTable

ARMS = ("irb120", "panda", "lrmate200id", "ur10e")
MEASURED = ("touch-up", "point", "camera-pose")
NOISE = {"touch-up": 3e-5, "point": 2e-5, "camera-pose": 5e-5}
TURN_NOISE = 1e-4
LEAST_M = 0.1e-3
"""Of drifts and bumps."""

DEVIATION_M = 3e-4
"""Deviation of an arm at each pose, which no parameter describes."""

FEWEST_ASIDE = 3
"""Measurements of a target before and after it is moved: of fewer, nothing could tell."""

_DEGREE = np.pi / 180.0


@cache
def cell_for(arm: str) -> Cell:
    """The default cell of an arm, without surroundings, its noise as simulated."""
    raw = tomllib.loads(cell_template(arm, surroundings=False))
    raw["noise"] = [
        {"kind": kind, "three_sigma_mm": 3e3 * sigma}
        | ({"three_sigma_deg": float(np.degrees(3 * TURN_NOISE))} if KINDS[kind].turns else {})
        for kind, sigma in NOISE.items()
    ]
    raw["parameters"]["models"] = [["zero_offsets"], ["geometry"]]
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


@cache
def _pool(arm: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Postures ``(3, K, n)`` that touch three targets ``(3, 3)``, and postures anywhere."""
    cell, rng = cell_for(arm), np.random.default_rng(3)
    robot, T0 = cell.robot, cell.robot.fk(cell.base_posture)
    reach = float(np.linalg.norm(cell.target_m))
    touching: list[FloatArray] = []
    places: list[FloatArray] = []
    while len(places) < 3:
        place = cell.target_m + (0.3 * reach * rng.uniform(-1, 1, 3) if places else 0.0)
        axes = rng.standard_normal((400, 3))
        axes *= (rng.uniform(0, 35, 400) * _DEGREE / np.linalg.norm(axes, axis=1))[:, None]
        spin = np.column_stack([np.zeros((400, 2)), rng.uniform(-1.2, 1.2, 400)])
        R = T0[:3, :3] @ rotation_exp(axes) @ rotation_exp(spin)
        T = transform(R, place - R @ cell.tool_m)
        found = nearest_postures(cell.passing, T, cell.base_posture)
        good = found.q[found.feasible]
        if len(good) >= 40:
            touching.append(good[:40])
            places.append(place)
    spread = 35 * _DEGREE * rng.uniform(-1, 1, (400, robot.n))
    anywhere = np.clip(cell.base_posture + spread, robot.lower, robot.upper)
    return np.array(touching), np.array(places), anywhere


def _route(q: FloatArray, target: IntArray) -> IntArray:
    """Order ``(N,)`` in which each posture is followed by the nearest of its target, as planned."""
    order, left = [], list(range(len(q)))
    here = left[0]
    while left:
        own = [i for i in left if target[i] == target[here]] or left
        here = min(own, key=lambda i: float(np.abs(q[i] - q[here]).max()))
        left.remove(here)
        order.append(here)
    return np.array(order, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Arm:
    """A simulated arm before its set-up, and what is measured of it."""

    cell: Cell
    kind: str
    truth: CalibrationModel
    x: FloatArray
    q: FloatArray
    setup: Setup

    def measured(self, noise: np.random.Generator | None) -> Measurements:
        """All of it; without noise where there is no source of it."""
        return simulate(self.truth, self.x, self.q, noise, setup=self.setup)

    def value(self, name: str) -> int:
        """Index of a parameter."""
        return self.truth.names.index(name)


def draw_arm(
    arm: str,
    kind: str,
    rng: np.random.Generator,
    *,
    count: int = 42,
    waves: bool = False,
    noise: float = 1.0,
) -> Arm:
    """An arm with errors of usual size and postures to measure it in.

    Parameters
    ----------
    waves : bool
        Harmonics and lost motion, which models of touch-ups leave out.
    noise : float
        How many times the noise given is.
    """
    cell = cell_for(arm)
    touching, places, anywhere = _pool(arm)
    words = ["geometry", *(["compliance"] if cell.robot.link_mass.any() else [])]
    if waves:
        words += ["harmonics", *(["lost_motion"] if cell.robot.link_mass.any() else [])]
    blocks: list[ParameterBlock] = robot_blocks(cell, words)
    target = np.zeros(count, dtype=np.intp)
    if kind == "touch-up":
        target = np.arange(count) * 3 // count  # one target after the other, or as it comes
        target = target if rng.random() < 0.5 else rng.permutation(target)
        q = np.array([touching[t, rng.integers(40)] for t in target])
        while len(np.unique(q, axis=0)) < count:
            q = np.array([touching[t, rng.integers(40)] for t in target])
        blocks += [ToolPoints([cell.tool_m], ["tool"]), TargetPoints(places, ["T1", "T2", "T3"])]
    else:
        q = anywhere[rng.permutation(len(anywhere))[:count]]
        there = transform(rotation_exp(rng.uniform(-1, 1, 3)), rng.uniform(-2, 2, 3))
        if kind == "camera-pose":
            there = transform(rotation_exp(rng.uniform(-1, 1, 3)), cell.target_m)
        on_tool = ToolFrame(transform(np.eye(3), cell.tool_m), "tool")
        blocks += [
            on_tool if kind == "camera-pose" else ToolPoints([cell.tool_m], ["tool"]),
            TargetFrame(there, "T1"),
        ]
    if rng.random() < 0.5:
        order = _route(q, target)
        q, target = q[order], target[order]
    sigma = np.full(KINDS[kind].rows, NOISE[kind])
    sigma[KINDS[kind].rows - KINDS[kind].turns :] = TURN_NOISE
    truth = CalibrationModel(cell.robot, blocks, KINDS[kind](sigma * noise))
    x = truth.nominal.copy()
    size = {"zero": 0.2 * _DEGREE, "harm": 0.01 * _DEGREE}
    for k, (name, unit) in enumerate(zip(truth.names, truth.units, strict=True)):
        draw = rng.standard_normal()
        if name.startswith("link."):
            x[k] += draw * (0.25e-3 if unit == "m" else 0.03 * _DEGREE)
        elif name.startswith("lost"):
            x[k] += abs(draw) * 0.005 * _DEGREE
        elif unit == "rad/Nm":
            x[k] += abs(1.0 + 0.3 * draw) * 2e-6
        elif name.startswith(("tool", "target")):
            x[k] += draw * (2e-3 if unit == "m" else 1e-2)
        else:
            x[k] += draw * size[name[:4]]
    return Arm(cell, kind, truth, x, q, Setup.of(count, target=target))


def deviating(
    arm: Arm, data: Measurements, rng: np.random.Generator, *, tails: bool = False
) -> Measurements:
    """The measurements of an arm that is :data:`DEVIATION_M` off at each pose, in every axis."""
    off = DEVIATION_M * rng.standard_normal((data.count, 3))
    if tails:
        off *= np.abs(rng.standard_t(3.0, (data.count, 1)))
    if data.observed is not None:
        read = data.observed.copy()
        read[:, :3] += off
        return replace(data, observed=read)
    J = arm.cell.robot.jacobian(data.postures)[:, :3]
    return replace(data, postures=data.postures + np.einsum("ijk,ik->ij", np.linalg.pinv(J), off))


def table_of(arm: Arm, data: Measurements) -> MeasurementTable:
    """The measurements as if they had been read from a file."""
    return MeasurementTable(data, (arm.kind,), tuple(range(2, 2 + data.count)))


Noise = np.random.Generator | None
Faulty = tuple[Measurements, tuple[str, ...]]
Fault = Callable[[Arm, np.random.Generator, Noise], Faulty]
"""Measurements with a fault drawn from the first generator and noise from the other, and names of
causes of which one is to be named."""


def _changing(
    arm: Arm, rng: np.random.Generator, noise: Noise, course: FloatArray, size_m: float
) -> Measurements:
    """Measured while the tool, a target or an instrument moves as a course ``(N,)`` says."""
    way = rng.standard_normal(3)
    way *= size_m / np.linalg.norm(way)
    labels = ["tool"]
    for k, label in enumerate(arm.truth.targets):
        own = course[arm.setup.target == k]
        if min((own < 0.5).sum(), (own >= 0.5).sum()) >= FEWEST_ASIDE:
            labels.append(f"target.{label}")
    label = str(rng.choice(labels))
    where = [arm.value(f"{label}.{axis}") for axis in "xyz"]
    parts = []
    for i, share in enumerate(course):
        x = arm.x.copy()
        x[where] += share * way
        parts.append(simulate(arm.truth, x, arm.q[i : i + 1], noise, setup=arm.setup[i : i + 1]))
    read = [part.observed for part in parts if part.observed is not None]
    return Measurements(
        np.concatenate([part.postures for part in parts]),
        arm.setup,
        arm.truth.targets,
        arm.truth.tools,
        np.concatenate(read) if read else None,
    )


def _size_m(rng: np.random.Generator, most_m: float) -> float:
    """A length [m], as often in one octave as in another."""
    return float(np.exp(rng.uniform(np.log(LEAST_M), np.log(most_m))))


def drift(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """Something goes on moving, or stops doing so as it gets warm."""
    order = np.arange(len(arm.q)) / (len(arm.q) - 1)
    course = order if rng.random() < 0.5 else 1.0 - np.exp(-order / rng.uniform(0.1, 0.4))
    return _changing(arm, rng, noise, course, _size_m(rng, 2e-3)), ("drift", "warm-up")


def bump(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """A tool, a target or an instrument is bumped."""
    count = len(arm.q)
    start = int(rng.integers(count // 4, 3 * count // 4))
    course = (np.arange(count) >= start).astype(float)
    return _changing(arm, rng, noise, course, _size_m(rng, 5e-3)), ("step",)


def scale(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """Readings are 1 % long or short."""
    data = arm.measured(noise)
    assert data.observed is not None
    observed = data.observed.copy()
    observed[:, :3] *= 1.0 + 0.01 * rng.choice([-1.0, 1.0])
    return replace(data, observed=observed), ("scale",)


def sign(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """The first joint is counted the other way."""
    data = arm.measured(noise)
    q = data.postures.copy()
    q[:, 0] *= -1.0
    return replace(data, postures=q), ("sign",)


def mirror(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """An axis of the readings points the other way."""
    data = arm.measured(noise)
    assert data.observed is not None
    observed = data.observed.copy()
    observed[:, rng.integers(3)] *= -1.0
    return replace(data, observed=observed), ("mirrored axis",)


def shift(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """Readings, or targets, stand one row too low."""
    data = arm.measured(noise)
    if data.observed is not None:
        return replace(data[1:], observed=data.observed[:-1]), ("shifted rows",)
    setup = replace(data.setup[1:], target=data.setup.target[:-1])
    return replace(data[1:], setup=setup), ("shifted labels",)


def swap(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """Two rows have exchanged their readings, or their targets."""
    data = arm.measured(noise)
    a, b = rng.permutation(data.count)[:2]
    if data.observed is not None:
        observed = data.observed.copy()
        observed[[a, b]] = observed[[b, a]]
        return replace(data, observed=observed), ("swapped rows",)
    while data.target[a] == data.target[b]:
        a, b = rng.permutation(data.count)[:2]
    target = data.target.copy()
    target[[a, b]] = target[[b, a]]
    return replace(data, setup=replace(data.setup, target=target)), ("swapped labels",)


def label(arm: Arm, rng: np.random.Generator, noise: Noise) -> Faulty:
    """One row has the name of another target."""
    data = arm.measured(noise)
    target = data.target.copy()
    i = rng.integers(data.count)
    target[i] = (target[i] + rng.integers(1, 3)) % 3
    return replace(data, setup=replace(data.setup, target=target)), ("wrong label",)


FAULTS: dict[str, Fault] = {
    "drift": drift,
    "bump": bump,
    "scale": scale,
    "sign": sign,
    "mirror": mirror,
    "shift": shift,
    "swap": swap,
    "label": label,
}


def noncentrality(arm: Arm, faulty: Measurements, held: Held) -> float:
    """Of chi² of the true fault, the arm's own errors being held as a diagnosis holds them.

    Parameters
    ----------
    faulty : Measurements
        Without noise.
    held : Held
        The solution for the same postures without the fault.
    """
    white = arm.truth.white_residuals(faulty, arm.x)
    return float(np.sum(white * held.without(white[..., None])[..., 0]))


def makes_sense(fault: str, kind: str) -> bool:
    """Whether a kind of measurement can have a fault."""
    if fault in ("scale", "mirror"):
        return kind != "touch-up"
    return fault != "label" or kind == "touch-up"
