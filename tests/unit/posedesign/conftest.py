"""Measurements of every kind on the reference cell, of an arm whose errors are known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import KINDS, Measurements
from calib.model.parameters import (
    ParameterBlock,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import FloatArray, inverse, rotation_from_wpr, transform
from posedesign.cell import Cell

OFFSETS_DEG = (0.08, -0.06, 0.05, 0.10)
_MET = ("touch-up", "view-line")


@dataclass(frozen=True)
class Measured:
    """Simulated measurements, with the kinds that they are of and what is true."""

    data: Measurements
    kinds: tuple[str, ...]
    truth: CalibrationModel
    x: FloatArray

    def value(self, name: str) -> float:
        """True value of a parameter [SI]."""
        return float(self.x[self.truth.names.index(name)])


class Lab:
    """The reference cell's arm with known zero offsets, measured in any way."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.joints = cell.robot.joint_names[1:-1]

    def postures(self, count: int, rng: np.random.Generator, spread_deg: float) -> FloatArray:
        """Postures around the base posture ``(count, n)`` [rad]."""
        q = self.cell.base_posture + np.deg2rad(spread_deg) * rng.uniform(-1, 1, (count, 6))
        return np.clip(q, self.cell.robot.lower, self.cell.robot.upper)

    def measure(
        self,
        kinds: Sequence[str],
        count: int = 40,
        *,
        tools: Sequence[str] = ("tool",),
        targets_each: int = 1,
        seed: int = 1,
        noise: float | None = None,
        payload: ArrayLike = 0,
        blocks: Sequence[ParameterBlock] = (),
    ) -> Measured:
        """Measure ``count`` times with each kind, from targets ``A0, A1, .. B0, ..`` in turn."""
        rng = np.random.default_rng(seed)
        robot, cell = self.cell.robot, self.cell
        turns = any(kind.endswith("pose") for kind in kinds)
        placed: list[ParameterBlock] = [ZeroOffsets(robot, self.joints), *blocks]
        for k, label in enumerate(tools):
            tool = cell.tool_m + np.array([0.002, -0.001, 0.003 - 0.02 * k])
            tilt = rotation_from_wpr(np.deg2rad([4.0, -3.0, 2.0]) * turns)
            T = transform(tilt, tool)
            placed.append(ToolFrame(T, label) if turns else ToolPoints([tool], [label]))
        postures, kind_of, target_of, labels = [], [], [], []
        for k, kind in enumerate(kinds):
            q = self.postures(count, rng, 15.0 if kind in (*_MET, "plane") else 25.0)
            points = robot.state(q).point(cell.tool_m)
            for t in range(targets_each):
                label = f"{'ABCDEFG'[k]}{t}"
                labels.append(label)
                placed.append(self._target(kind, label, points.mean(axis=0), t))
            postures.append(q)
            kind_of += [k] * count
            target_of += [k * targets_each + i % targets_each for i in range(count)]
        truth = CalibrationModel(robot, placed, [KINDS[k](noise or 1e-5) for k in kinds])
        x = truth.nominal.copy()
        for joint, offset in zip(self.joints, OFFSETS_DEG, strict=True):
            x[truth.names.index(f"zero_offset.{joint}")] = np.deg2rad(offset)
        total = len(kind_of)
        setup = Setup.of(
            total,
            kind=kind_of,
            target=target_of,
            tool=np.arange(total) // targets_each % len(tools),
            payload=payload,
        )
        q = np.concatenate(postures)
        data = simulate(truth, x, q, rng if noise else None, setup=setup)
        names = tuple(f"M{i + 1}" for i in range(total))
        assert data.targets == tuple(labels)
        return Measured(replace(data, names=names), tuple(kinds), truth, x)

    def _target(self, kind: str, label: str, middle: FloatArray, t: int) -> ParameterBlock:
        place = middle + np.array([0.02, -0.03, 0.01]) * (1 + 2 * t)
        if kind in ("point", "pose", "camera-pose"):
            there = rotation_from_wpr(np.deg2rad([20.0, -35.0, 110.0 + 20.0 * t]))
            return TargetFrame(inverse(transform(there, [1.5, -2.0, 0.4])), label)
        if kind == "plane":
            return TargetPlane(place, [0.02 + 0.5 * t, -0.4 * t, 1.0], label)
        if kind == "distance":
            place = place + np.array([0.6, -0.4, -0.5])
        return TargetPoints([place], [label])


@pytest.fixture(scope="session")
def lab(reference_cell) -> Lab:
    """The reference cell, measured in any way."""
    return Lab(reference_cell)
