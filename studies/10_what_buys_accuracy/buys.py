"""What a cell can do for accuracy: sets of poses, what they touch, how they are identified."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from calib.identification import tool_motion
from calib.model import CalibrationModel, KnownDistance
from calib.model.measurements import Measurement, TouchUp, ViewLine
from calib.model.parameters import JointCompliance, ToolPoint, ZeroOffsets
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import CandidatePoses, cone_candidates, grid_candidates, offset_targets
from posedesign.cell import Cell, free_tool_axes
from posedesign.cell.orientations import GRID
from posedesign.motion import Router
from posedesign.planning import plan
from posedesign.selection import mean_deviation, select
from studies.tool_errors import (
    Experiment,
    ToolErrors,
    box_postures,
    grid_pool,
    pool_at_target,
    simulate_errors,
    simulated_arm,
    study_cell,
    tool_errors,
)

HALF = (GRID != 0).sum(axis=1) % 2 == 0
"""Thirteen of the 27 poses of the grid that lie evenly in it: the middle and that of each edge."""


@dataclass(frozen=True)
class Variant:
    """One way to measure; see the study's TOML."""

    key: str
    says: str
    poses: int = 27
    width_deg: float = 40.0
    chosen: str = "grid"
    pool: str = "cone"
    configurations: str = "nearest"
    targets: str = "1"
    repeats: int = 1
    known: bool = False
    weighted: bool = True
    kind: str = "touch-up"
    compliance: bool = False


@dataclass(frozen=True)
class Measured:
    """What a variant came to."""

    variant: Variant
    measurements: int
    targets: int  # measurements, targets: touch-ups, and how many targets they touch
    minutes: float
    moving_minutes: float  # minutes, moving_minutes: predicted time of the round, and of its moves
    rigid: ToolErrors  # over the box, of an arm that is as the model has it
    deflecting: ToolErrors | None  # of one whose reducers give way, where its stiffness is known


def _without_unused(pool: CandidatePoses) -> CandidatePoses:
    """The pool without targets that none of its poses touches: nothing tells where they are."""
    used, target = np.unique(pool.target, return_inverse=True)
    names = tuple(pool.target_names[k] for k in used)
    return replace(pool, target=target, targets_m=pool.targets_m[used], target_names=names)


class Bench:
    """One arm and its box, on which variants are tried.

    Parameters
    ----------
    name : str
        Of the preset.
    settings : dict
        The study's TOML.
    """

    def __init__(self, name: str, settings: dict[str, Any]) -> None:
        self.name, self.settings = name, settings
        self.own = settings["arms"][name]
        self.cell = study_cell(name, settings["smallest_singular_value"])
        self.box = box_postures(self.cell, self.own)
        self._router = Router.of_cell(self.cell)
        self._pools: dict[tuple[Any, ...], CandidatePoses] = {}

    def before_m(self, *, deflects: bool) -> float:
        """Error over the box before calibration, root mean square [m]."""
        baseline = Variant("", "")
        pool = grid_pool(self.cell, baseline.width_deg)
        model = self.model(baseline, pool)
        arm = simulated_arm(self.cell, pool, model.measurement, deflects=deflects)
        error = tool_errors(arm, model, model.nominal[None], self.box)
        return float(np.sqrt((error**2).sum(axis=-1).mean()))

    def measure(self, variant: Variant, trials: int, deflecting: int, stream: int) -> Measured:
        """Plan, time, predict and simulate a variant."""
        poses = self.plan(variant)
        route = self._router.route(poses.postures)
        count = len(poses) * variant.repeats
        moving = route.moving_s / 60.0
        rng = np.random.default_rng([self.settings["seed"], stream])
        rigid = self.simulate(variant, poses, trials, rng, deflects=False)
        bent = None
        if self.cell.deflects:
            bent = self.simulate(variant, poses, deflecting, rng, deflects=True)
        minutes = moving + count * route.dwell_s / 60.0
        return Measured(variant, count, len(poses.targets_m), minutes, moving, rigid, bent)

    def plan(self, variant: Variant) -> CandidatePoses:
        """The poses of a variant."""
        if variant.chosen == "grid":
            part = HALF if variant.poses < len(GRID) else None
            return grid_pool(self.cell, variant.width_deg, part)
        if variant.chosen == "loop":
            return pool_at_target(self.cell, plan(self.cell).postures)
        pool = self._pool(variant)
        if variant.chosen == "C_G":
            pool = pool.take(np.arange(min(len(pool), self.settings["candidates_c_g"])))
        return _without_unused(pool.take(self._choose(variant, pool)))

    def model(
        self, variant: Variant, pool: CandidatePoses, lengths_m: FloatArray | None = None
    ) -> CalibrationModel:
        """The model of a variant; known distances have these lengths, or the nominal ones."""
        distances = []
        if variant.known:
            pairs = list(combinations(range(len(pool.targets_m)), 2))
            if lengths_m is None:
                lengths_m = self._lengths(pool)
            sigma = self.settings["sigma_length_mm"] / 1e3
            names = pool.target_names
            distances = [
                KnownDistance(names[a], names[b], float(length), sigma)
                for (a, b), length in zip(pairs, lengths_m, strict=True)
            ]
        cell, measurement = self.cell, self._measurement(variant)
        carrying = cell.robot.joint_names[1:6]
        loaded = [JointCompliance(cell.robot, carrying, cell.payload)] if variant.compliance else []
        return CalibrationModel(
            cell.robot,
            [
                ZeroOffsets(cell.robot, cell.offset_joints),
                *loaded,
                ToolPoint(cell.tool_m, free_tool_axes(cell, measurement)),
                pool.target_points(),
            ],
            measurement,
            distances,
        )

    def simulate(
        self,
        variant: Variant,
        poses: CandidatePoses,
        trials: int,
        rng: np.random.Generator,
        *,
        deflects: bool,
    ) -> ToolErrors:
        """Errors over the box; a known length is off in each of a few groups of trials."""
        measurement = self._measurement(variant)
        touch_up = variant.kind == "touch-up"
        arm = simulated_arm(self.cell, poses, measurement, deflects=deflects, tool_z=touch_up)
        groups = min(self.settings["lengths"], trials) if variant.known else 1
        true = self._lengths(poses)  # all targets are off alike
        sigma = self.settings["sigma_length_mm"] / 1e3
        parts = []
        for _ in range(groups):
            read = true + sigma * rng.standard_normal(len(true))
            experiment = Experiment.of(
                self.model(variant, poses, read), poses, variant.repeats, weighted=variant.weighted
            )
            parts.append(simulate_errors(arm, experiment, self.box, trials // groups, rng))
        return parts[0] if groups == 1 else ToolErrors.joined(parts)

    def _measurement(self, variant: Variant) -> Measurement:
        sigma = np.array(self.cell.config.measurement.three_sigma_mm) / 3e3
        return TouchUp(sigma) if variant.kind == "touch-up" else ViewLine(sigma[:2])

    def _lengths(self, pool: CandidatePoses) -> FloatArray:
        pairs = combinations(pool.targets_m, 2)
        return np.array([np.linalg.norm(a - b) for a, b in pairs])

    def _pool(self, variant: Variant) -> CandidatePoses:
        key = variant.pool, variant.width_deg, variant.configurations, variant.targets
        if key not in self._pools:
            self._pools[key] = self._new_pool(variant)
        return self._pools[key]

    def _new_pool(self, variant: Variant) -> CandidatePoses:
        cell = self.cell
        if variant.pool == "grids":
            section = cell.config.variations.model_copy(
                update={"largest_deg": (variant.width_deg,) * 3}
            )
            config = cell.config.model_copy(update={"variations": section})
            return grid_candidates(Cell.from_config(config, Path("cell.toml")))
        offsets = np.array(self.own["offsets_mm"][variant.targets])
        targets = None if len(offsets) == 1 else offset_targets(cell, offsets)
        rng = np.random.default_rng(self.settings["seed"])
        tilt, count = float(np.deg2rad(variant.width_deg)), self.settings["candidates"]
        return cone_candidates(cell, tilt, count, rng, variant.configurations, targets_m=targets)

    def _choose(self, variant: Variant, pool: CandidatePoses) -> IntArray:
        model = self.model(variant, pool)
        linear = pool.linearise(model)
        blocks = linear.jacobian if variant.chosen == "C_G" else linear.white_jacobian
        known = model.known(model.nominal[None])[1][0]
        criterion = (
            mean_deviation(tool_motion(model, self.box))
            if variant.chosen == "I"
            else variant.chosen
        )
        return select(
            blocks,
            variant.poses,
            criterion,
            known=known if len(known) else None,
            starts=self.settings["starts"],
        ).indices
