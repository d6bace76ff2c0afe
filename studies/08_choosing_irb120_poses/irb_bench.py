"""The IRB 120 under the measuring arm: what is free, its blocks, and fits to some of its poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from calib import CalibrationModel, Robot
from calib.identification import reduce, tool_motion
from calib.model import Setup
from calib.model.measurements import Measurements, Point
from calib.model.parameters import (
    Frames,
    JointCompliance,
    LinkGeometry,
    ParameterBlock,
    TargetFrame,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import BoolArray, FloatArray, apply, inverse
from posedesign.study.library import find_study
from studies.choices import Pool

measuring_arm = find_study("irb120_measuring_arm").load()
"""Study 03, which reads the recordings."""

STEPS, STILL = 20, 1e-6
"""Gauss-Newton steps allowed, and the length of the last one in standard deviations."""

AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Bench(Pool):
    """A model of the arm, the 36 configurations as a pool, and what was read in them.

    The readings have a row for each point of each configuration.
    """

    recorded: Any
    common: float  # error common to the points of a configuration, over that of each of them

    @property
    def count(self) -> int:
        """Configurations in the pool."""
        return len(self.recorded.q)

    @property
    def points(self) -> int:
        """Points measured in each configuration."""
        return self.data.count // self.count

    @cached_property
    def whitening(self) -> FloatArray:
        """What rows of a configuration, over their own noise, are multiplied with ``(m, m)``."""
        k = self.points
        cov = np.eye(3 * k) + self.common**2 * np.kron(np.ones((k, k)), np.eye(3))
        return np.asarray(np.linalg.inv(np.linalg.cholesky(cov)))

    @cached_property
    def blocks(self) -> FloatArray:
        """Nominal blocks ``(36, m, p)`` of the configurations, in ``sizes``. No reading is used."""
        found = self.model.linearise(self.data.postures, None, self.data.setup).white_jacobian
        return np.asarray(self.whitening @ self._by_pose(found) * self.sizes)

    @cached_property
    def functions(self) -> FloatArray:
        """How each point measured moves in each configuration ``(36 k, 3, p)`` [m], in ``sizes``.

        As seen from the measuring arm: base and points are found by the same fit.
        """
        motion = tool_motion(self.model, self.data.postures, self.data.setup, against="target")
        return np.asarray(motion * self.sizes)

    @property
    def noise_m(self) -> float:
        """Distance that a point just read is off by its noise alone, rms."""
        sigma = float(self.model.measurement.sigma[0])
        return float(np.sqrt(3.0 * (1.0 + self.common**2)) * sigma)

    def _by_pose(self, rows: FloatArray) -> FloatArray:
        """Rows ``(..., 108, 3, p)`` as blocks ``(..., 36, 9, p)``."""
        return rows.reshape(*rows.shape[:-3], self.count, 3 * self.points, rows.shape[-1])

    def fit(self, chosen: BoolArray) -> FloatArray:
        """Parameters ``(T, p)`` [SI] from the readings of the chosen of each trial ``(T, 36)``.

        Raises
        ------
        RuntimeError
            A fit that has not converged.
        """
        model, data = self.model, self.data
        x = np.tile(model.nominal, (len(chosen), 1))
        for _ in range(STEPS):
            linear = model.linearise(data.postures, x, data.setup, data.observed)
            rows = self._by_pose(linear.white_rows[..., None])
            A = self.whitening @ self._by_pose(linear.white_jacobian)
            A *= chosen[..., None, None] * self.sizes
            r = (self.whitening @ rows)[..., 0].reshape(len(x), -1)
            known, K = model.known(x)
            A = np.concatenate([A.reshape(len(x), -1, model.p), K * self.sizes], axis=1)
            r = np.concatenate([r, known], axis=1)
            normal = np.swapaxes(A, 1, 2) @ A
            step = -np.linalg.solve(normal, np.einsum("tkp,tk->tp", A, r)[..., None])[..., 0]
            x = x + step * self.sizes
            if np.einsum("tp,tpq,tq->t", step, normal, step).max() < STILL**2:
                return x
        raise RuntimeError("a fit to some of the configurations has not converged")

    def squares(self, x: FloatArray) -> FloatArray:
        """Mean square distance ``(T, 36)`` [m²] of the points of each configuration."""
        data = self.data
        rows = self.model.linearise(data.postures, x, data.setup, data.observed).rows
        return np.asarray((rows**2).sum(-1).reshape(len(x), self.count, -1).mean(-1))

    def check_squares(self, x: FloatArray, chosen: BoolArray) -> FloatArray:
        """The same ``(T, 36)`` of check points, which no fit uses.

        Where they are on the tip is taken from the chosen configurations.
        """
        frame = next(b for b in self.model.parameters if isinstance(b, Frames) and b.targets)
        part = self.model.slices[self.model.parameters.index(frame)]
        T_base_arm = np.stack([frame.poses(values[part])[0] for values in x])
        T_base_tip = self.model.view(self.recorded.q, x).T_base_tip
        T_arm_tip = inverse(T_base_arm)[:, None] @ T_base_tip  # (T, 36, 4, 4)
        seen = self.recorded.check[: self.count]
        on_tip = apply(inverse(T_arm_tip)[:, :, None], seen[None])  # (T, 36, K, 3)
        place = np.einsum("tn,tnkc->tkc", chosen, on_tip) / chosen.sum(1)[:, None, None]
        off = apply(T_arm_tip[:, :, None], place[:, None]) - seen
        return np.asarray((off**2).sum(-1).mean(-1))


def bench_of(data: Path, row: dict[str, Any], settings: dict[str, Any]) -> Bench:
    """The bench of a row of the study's models."""
    recorded = measuring_arm.load(data)
    labels = measuring_arm.SETTINGS["points"]
    robot = Robot.from_urdf(
        data / measuring_arm.SETTINGS["urdf"], tip=measuring_arm.SETTINGS["tip"]
    )
    # where the points are on the tool is known beforehand from the zero posture, which is none
    # of the 36; they are 16 mm off
    at_zero = apply(inverse(robot.fk(np.zeros(robot.n))) @ recorded.T_base_arm, recorded.zero)
    count = len(recorded.q)
    frames = [ToolPoints(at_zero, labels), TargetFrame(recorded.T_base_arm, "arm")]
    sizes = settings["sizes"]
    blocks = arm_blocks(robot, row["blocks"], sizes if row["priors"] else None)
    sigma = 1e-3 * settings["point_sigma_mm"]
    common = 1e-3 * settings["common_sigma_mm"]
    # independent rows: as large in all
    noise = sigma if row["common"] else float(np.hypot(sigma, common))
    model = CalibrationModel(robot, [*blocks, *frames], Point(noise))
    measured = Measurements(
        np.repeat(recorded.q, len(labels), axis=0),
        Setup.of(count * len(labels), tool=np.tile(np.arange(len(labels)), count)),
        model.targets,
        model.tools,
        recorded.points.reshape(-1, 3),
        tuple(f"C{i + 1:02d}" for i in range(count) for _ in labels),
    )
    if blocks and not row["priors"]:
        model = reduced_at_nominal(model, measured)
    return Bench(
        model,
        measured,
        unit_sizes(model, sizes),
        recorded,
        common / sigma if row["common"] else 0.0,
    )


def reduced_at_nominal(model: CalibrationModel, measured: Measurements) -> CalibrationModel:
    """The model without what these postures cannot tell, from nominal Jacobians alone."""
    postures, setup = measured.postures, measured.setup
    as_described = Measurements(
        postures,
        setup,
        measured.targets,
        measured.tools,
        model.predict(postures, None, setup),
        measured.names,
    )
    return reduce(model, as_described, model.nominal).model


def arm_blocks(
    robot: Robot, words: Sequence[str], priors: dict[str, float] | None
) -> list[ParameterBlock]:
    """Blocks of the arm that words free; with priors all of them, without what is left to reduce.

    A turn of a link about its joint's own axis is a zero offset, and has that prior.
    """
    joints = robot.joint_names
    across = [
        f"link.{joint}.{name}"
        for joint, axis in zip(joints, robot.chain.axes, strict=True)
        for k, name in enumerate(AXES)
        if k < 3 or abs(axis[k - 3]) < 0.5
    ]
    given = priors or {}
    made: dict[str, ParameterBlock] = {
        "zero_offsets": ZeroOffsets(robot, joints, given.get("offset_rad")),
        "geometry": LinkGeometry(
            robot, across if priors else None, given.get("m"), given.get("rad")
        ),
        "compliance": JointCompliance(robot, joints, prior=given.get("rad/Nm")),
    }
    return [made[word] for word in words]


def unit_sizes(model: CalibrationModel, sizes: dict[str, float]) -> FloatArray:
    """What errors of each parameter may be, ``(p,)`` [SI]."""
    found = []
    for name, unit, set_up in zip(model.names, model.units, model.nuisance, strict=True):
        key = f"set_up_{unit}" if set_up else unit
        found.append(sizes["offset_rad" if name.startswith("zero_offset") else key])
    return np.array(found)
