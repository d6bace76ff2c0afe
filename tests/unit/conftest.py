"""Robots, set-ups, postures and measurements that the tests share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from calib import Robot, se3
from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import KINDS, Measurements, TouchUp
from calib.model.parameters import (
    ParameterBlock,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import FloatArray, inverse, rotation_from_wpr, transform
from posedesign.cell import Cell
from posedesign.files.measurements import MeasurementTable, read_measurements, write_measurements
from tests.arms import arm_from

TOOL_M = np.array([0.2, -0.05, 0.35])
BASE_POSTURE = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
SIGMA_M = np.array([0.02, 0.02, 0.12]) / 3e3


@pytest.fixture(scope="session")
def reference_robot() -> Robot:
    """FANUC R-2000iC/165F, the arm of the reference cell, each joint with limits of its own."""
    return replace(Robot.preset("r2000ic165f"), coupled_limits=())


@pytest.fixture(scope="session")
def target_m(reference_robot) -> np.ndarray:
    """Where the pin tip is at the base posture."""
    return se3.apply(reference_robot.fk(BASE_POSTURE), TOOL_M)


@pytest.fixture(scope="session")
def make_model(reference_robot, target_m) -> Callable[..., CalibrationModel]:
    """The reference model with other joints freed, another measurement or further blocks."""

    def make(
        joints: tuple[int, ...] = (2, 3, 4, 5),
        measurement=None,
        *,
        free: str = "xyz",
        targets: int = 1,
        extra: tuple[ParameterBlock, ...] = (),
    ) -> CalibrationModel:
        places = target_m + np.outer(np.arange(targets), [0.0, 0.3, 0.4])
        blocks = [
            ZeroOffsets(reference_robot, [f"joint_{j}" for j in joints]),
            *extra,
            ToolPoint(TOOL_M, free),
            TargetPoints(places, [f"T{k + 1}" for k in range(targets)]),
        ]
        return CalibrationModel(reference_robot, blocks, measurement or TouchUp(SIGMA_M))

    return make


@pytest.fixture(scope="session")
def touching(reference_robot, target_m) -> Callable[..., np.ndarray]:
    """Postures ``(N, 6)`` with the pin tip on a target and the tool tilted at random."""

    def make(count: int, seed: int = 0, tilt: float = 0.6, shift=(0.0, 0.0, 0.0)) -> np.ndarray:
        rng = np.random.default_rng(seed)
        R_0 = reference_robot.fk(BASE_POSTURE)[:3, :3]
        found: list[np.ndarray] = []
        while len(found) < count:
            R = R_0 @ se3.rotation_exp(rng.uniform(-tilt, tilt, 3))
            pose = se3.transform(R, target_m + np.asarray(shift) - R @ TOOL_M)[None]
            q, ok = reference_robot.inverse(pose, near=BASE_POSTURE).nearest()
            if ok[0]:
                found.append(q[0])
        return np.array(found)

    return make


@pytest.fixture
def random_urdf(tmp_path) -> Callable[..., Path]:
    """Write an arm of n joints with arbitrary origins, axes, limits and masses; some slide."""

    def write(rng: np.random.Generator, n: int, slides: int = 0) -> Path:
        def numbers(low: float, high: float, count: int) -> str:
            return " ".join(repr(float(v)) for v in rng.uniform(low, high, count))

        text = ['<robot name="random"><link name="root"/>']
        for j in range(n):
            upper = rng.uniform(0.5, 3.0)
            text.append(
                f'<joint name="j{j + 1}" type="{"prismatic" if j < slides else "revolute"}">'
                f'<parent link="{"root" if j == 0 else f"link{j}"}"/><child link="link{j + 1}"/>'
                f'<origin xyz="{numbers(-0.5, 0.5, 3)}" rpy="{numbers(-3, 3, 3)}"/>'
                f'<axis xyz="{numbers(-2, 2, 3)}"/>'
                f'<limit lower="{-upper}" upper="{upper + 0.3}" velocity="{j + 1}" effort="1"/>'
                f'</joint><link name="link{j + 1}"><inertial>'
                f'<origin xyz="{numbers(-0.2, 0.2, 3)}" rpy="{numbers(-1, 1, 3)}"/>'
                f'<mass value="{rng.uniform(1, 20)}"/>'
                '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
            )
        text.append(
            f'<joint name="mount" type="fixed"><parent link="link{n}"/><child link="tool0"/>'
            f'<origin xyz="{numbers(-0.3, 0.3, 3)}" rpy="{numbers(-3, 3, 3)}"/></joint>'
            '<link name="tool0"/></robot>'
        )
        path = tmp_path / f"random{n}.urdf"
        path.write_text("".join(text))
        return path

    return write


SEVEN_JOINTS = [  # xyz [m], roll [deg], limits [rad] in the manner of a Franka arm
    ((0, 0, 0.333), 0, (-2.9, 2.9)),
    ((0, 0, 0), -90, (-1.76, 1.76)),
    ((0, -0.316, 0), 90, (-2.9, 2.9)),
    ((0.0825, 0, 0), 90, (-3.07, -0.07)),
    ((-0.0825, 0.384, 0), -90, (-2.9, 2.9)),
    ((0, 0, 0), 90, (-0.02, 3.75)),
    ((0.088, 0, 0), 90, (-2.9, 2.9)),
]


@pytest.fixture(scope="session")
def seven_axis_robot() -> Robot:
    """A redundant arm, for which there is no closed form."""
    joints = [
        (xyz, (roll, 0, 0), "0 0 1", tuple(np.degrees(limits)))
        for xyz, roll, limits in SEVEN_JOINTS
    ]
    return arm_from(joints, flange_m=0.107)


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


@pytest.fixture
def tabled(tmp_path) -> Callable[[Measured], MeasurementTable]:
    """Measurements written to a file and read again."""

    def again(measured: Measured) -> MeasurementTable:
        path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds)
        return read_measurements(path, measured.truth.robot.n)

    return again
