"""Simulated arms, richer than any model that is tried on them, and what is measured of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import ConvergenceError
from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import Measurement, Point
from calib.model.parameters import (
    JointCompliance,
    JointHarmonics,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import FloatArray, IntArray, rotation_exp, transform
from posedesign.candidates import (
    CandidatePoses,
    away_from_singularities,
    box_of_cell,
    cone_candidates,
    joint_candidates,
)
from posedesign.cell import Cell, cell_template, touching_poses
from posedesign.constraints import nearest_postures
from posedesign.files.measurements import TOOL, MeasurementTable
from studies import writing
from studies.simulated_arms import across_axes, largest_torque_nm

SETTINGS = writing.settings_of(__file__)

KINDS = {"touch-up": "touch-up", "camera": "camera-pose", "tracker": "point"}
"""Kind of measurement of each way to measure."""

TRIES = 20
"""Draws of postures, where the arm cannot touch from one of them."""


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm as it really is."""

    model: CalibrationModel
    """With all its errors, held by priors of the sizes that they were drawn with, and the noise as
    it is: what whoever knew all that would identify."""
    values: FloatArray  # (p,) [SI]
    compliant: bool
    wavy: bool
    """compliant, wavy: whether its joints give way, and whether its transmissions run unevenly and
    have play."""
    noise: float  # over what the cell says

    def without(self, *words: str) -> FloatArray:
        """Its parameters ``(p,)``, those whose names begin with a word at zero."""
        gone = [name.partition(".")[0] in words for name in self.model.names]
        return np.where(gone, 0.0, self.values)


class Bench:
    """A cell as it is written for a preset, and postures to measure arms in it."""

    def __init__(self, preset: str, way: str, settings: Mapping[str, Any]) -> None:
        self.way, self.settings = way, settings
        self._number = settings["presets"].index(preset)
        text = cell_template(preset)
        if way == "camera":
            text = text.replace('\nkind = "touch-up" ', '\nkind = "camera-pose" ')
        self.cell = Cell.from_text(text)
        self.kind = KINDS[way]

    @cached_property
    def pool(self) -> CandidatePoses:
        """What measuring postures are drawn from."""
        cell, count = away_from_singularities(self.cell), self.settings["candidates"]
        rng = self._rng(0)
        if self.way == "touch-up":
            tilt = float(np.deg2rad(cell.config.pool.tilt_deg))
            few = self.settings["touch_candidates"]
            return cone_candidates(cell, tilt, few, rng, targets_m=self.targets_m)
        if self.way == "camera":
            return joint_candidates(cell, count, rng)
        return joint_candidates(_blind(cell), count, rng, np.deg2rad(self.settings["turn_deg"]))

    @cached_property
    def targets_m(self) -> FloatArray:
        """Targets ``(K, 3)`` [m]."""
        apart = np.array(self.settings["offsets_of_reach"]) * self.cell.robot.chain.reach_m
        return self.cell.target_m + apart

    @cached_property
    def fresh(self) -> FloatArray:
        """Postures ``(V, n)`` [rad] that are not measured, over all that may be and around it.

        The tool turned as at one of the measuring postures. Fewer where most cannot be reached.
        """
        robot, q = self.cell.robot, self.pool.postures
        state = robot.state(q)
        beyond = self.settings["beyond_of_reach"] * robot.chain.reach_m
        points = state.point(self.cell.tool_m)
        rng = self._rng(1)
        like = rng.integers(len(q), size=3 * self.settings["fresh"])
        rotations = robot.fk(q)[like, :3, :3]
        return self._reached(
            rng, rotations, points.min(axis=0) - beyond, points.max(axis=0) + beyond
        )

    @cached_property
    def in_box(self) -> FloatArray:
        """Such postures over the usual task box, the tool turned little against the base pose."""
        cell, count = self.cell, 3 * self.settings["fresh"]
        box = box_of_cell(cell)[0]
        rng = self._rng(2)
        drawn = rng.standard_normal((count, 3))
        drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
        turn = np.deg2rad(self.settings["turned_deg"]) * drawn * rng.random((count, 1))
        rotations = cell.robot.fk(cell.base_posture)[:3, :3] @ rotation_exp(turn)
        return self._reached(rng, rotations, box.lowest_m, box.highest_m)

    def _rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self.settings["seed"], stream])

    def _reached(
        self,
        rng: np.random.Generator,
        rotations: FloatArray,
        lowest: FloatArray,
        highest: FloatArray,
    ) -> FloatArray:
        """Postures at points of a box, of orientations ``(N, 3, 3)`` of the tip."""
        points = lowest + rng.random((len(rotations), 3)) * (highest - lowest)
        poses = touching_poses(rotations, self.cell.tool_m, points)
        found = nearest_postures(_blind(self.cell).passing, poses, self.cell.base_posture)
        return found.q[found.feasible][: self.settings["fresh"]]

    @cached_property
    def torque_nm(self) -> FloatArray:
        """Largest torque of gravity ``(n,)`` [Nm] anywhere, a little at least: of the arm alone."""
        return largest_torque_nm(self.cell, self.settings["candidates"], self._rng(3))

    def arm(self, trial: int) -> Arm:
        """The arm of a trial: the same, however it is measured, but for tool and target."""
        settings, robot, n = self.settings, self.cell.robot, self.cell.robot.n
        rng = np.random.default_rng([settings["seed"], self._number, trial])

        def size(name: str, factor: float = 1.0) -> float:
            return float(rng.uniform(*settings[name])) * factor

        degree = np.pi / 180.0
        zero = size("offset_deg", degree)
        offsets = zero * rng.standard_normal(n)
        links = LinkGeometry(robot, across_axes(robot))
        lengths, angles = size("length_mm", 1e-3), size("angle_deg", degree)
        sigma = np.where([unit == "m" for unit in links.units], lengths, angles)
        blocks: list[ParameterBlock] = [ZeroOffsets(robot, robot.joint_names), links]
        values = [offsets, sigma * rng.standard_normal(links.size)]
        sizes = [np.full(n, zero), sigma]
        compliant = bool(trial % 2) and bool(robot.link_mass.any())
        wavy = trial % 3 == 0
        low, high = settings["give_mrad"]
        give, spread = rng.uniform(low, high, n) * 1e-3, rng.standard_normal(n)
        if compliant:
            known = settings["stiffness_spread"] ** spread / robot.stiffness
            blocks.append(JointCompliance(robot, robot.joint_names, self.cell.payload))
            stiff = np.isfinite(robot.stiffness)
            values.append(np.where(stiff, known, give / self.torque_nm))
            usual = (low + high) / 2.0 * 1e-3 / self.torque_nm
            sizes.append(np.where(stiff, 1.0 / robot.stiffness, usual))
        if wavy:
            waves = JointHarmonics(robot, robot.joint_names, [1.0, 2.0])
            play = LostMotion(
                robot,
                robot.joint_names,
                settings["friction_share"] * self.torque_nm,
                self.cell.payload,
            )
            blocks += [waves, play]
            wave = size("harmonic_deg", degree)
            values.append(wave * rng.standard_normal(waves.size))
            lost = size("lost_motion_deg", degree)
            values.append(lost * np.abs(rng.standard_normal(n)))
            sizes += [np.full(waves.size, wave), np.full(n, lost)]
        scale = float(settings["noise_scales"][trial // 3 % len(settings["noise_scales"])])
        set_up, placed = self._set_up(rng)
        model = CalibrationModel(robot, [*blocks, *set_up], self._measurement(scale))
        model = model.with_prior([*np.concatenate(sizes), *np.full(sum(map(len, placed)), np.inf)])
        return Arm(model, np.concatenate([*values, *placed]), compliant, wavy, scale)

    def measured(self, arm: Arm, trial: int) -> tuple[MeasurementTable, FloatArray, Setup]:
        """What is measured of an arm: the table, and from which planned postures ``(N, n)``."""
        way = list(KINDS).index(self.way)
        rng = np.random.default_rng([self.settings["seed"], self._number, trial, way])
        for left in reversed(range(TRIES)):
            rows = self._drawn(rng)
            q = self.pool.postures[rows]
            how = Setup.of(len(rows), target=self.pool.target[rows])
            try:
                data = simulate(arm.model, arm.values, q, rng, setup=how)
            except ConvergenceError:
                if not left:
                    raise
                continue
            break
        lines = tuple(range(2, 2 + data.count))
        return MeasurementTable(data, (self.kind,), lines), q, how

    def _drawn(self, rng: np.random.Generator) -> IntArray:
        target, count = self.pool.target, self.settings["poses"]
        if self.way == "touch-up":
            count = self.settings["touched"]
        each = [np.flatnonzero(target == k) for k in range(len(self.pool.targets_m))]
        return np.concatenate([rng.choice(rows, count, replace=False) for rows in each])

    def _measurement(self, scale: float) -> Measurement:
        if self.way == "tracker":
            return Point(np.full(3, self.settings["tracker_three_sigma_mm"] / 3e3 * scale))
        own = self.cell.measurement
        return own.with_noise(np.full(own.rows, scale))

    def _set_up(self, rng: np.random.Generator) -> tuple[list[ParameterBlock], list[FloatArray]]:
        """Where tool and targets really are: as the cell has them, and what it does not know."""
        tool, target = (self.settings[k] * 1e-3 for k in ("tool_mm", "target_mm"))
        turn = np.deg2rad(self.settings["frame_deg"])

        def six(size: float) -> FloatArray:
            return np.array([size] * 3 + [turn] * 3) * rng.standard_normal(6)

        cell, name = self.cell, self.cell.config.target.name
        if self.way == "camera":
            frames = (
                ToolFrame(_moved(cell.T_tip_camera, six(tool))),
                TargetFrame(_moved(cell.T_base_target, six(target)), name),
            )
            return list(frames), [frame.nominal for frame in frames]
        point = ToolPoints([cell.tool_m + tool * rng.standard_normal(3)], [TOOL])
        if self.way == "tracker":
            away = transform(rotation_exp(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-3.0, 3.0, 3))
            frame = TargetFrame(away, "tracker")
            return [point, frame], [point.nominal, frame.nominal]
        there = self.targets_m + target * rng.standard_normal(self.targets_m.shape)
        points = TargetPoints(there, self.pool.target_names)
        return [point, points], [point.nominal, points.nominal]


@lru_cache(maxsize=18)
def bench_of(preset: str, way: str) -> Bench:
    """The bench of the study, made once a process."""
    return Bench(preset, way, SETTINGS)


def _blind(cell: Cell) -> Cell:
    """The cell without its camera: a tracker looks from elsewhere."""
    return Cell.from_config(cell.config.model_copy(update={"camera": None}), Path("cell.toml"))


def _moved(T: FloatArray, six: FloatArray) -> FloatArray:
    return np.asarray(T @ transform(rotation_exp(six[3:]), six[:3]))
