"""Cells, their plans, and the simulated arms that the plans are tried on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from calib.identification import ExpectedError, Workplace
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel
from calib.model.parameters import (
    JointCompliance,
    JointHarmonics,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import FloatArray
from posedesign.candidates import box_of_cell, workplace_of
from posedesign.cell import Cell, TaskBox, cell_template
from posedesign.cell.models import has_weight
from posedesign.cell.reference import reference_of
from posedesign.cell.task_box import reached_points
from posedesign.planning import plan
from posedesign.planning.optimal import OptimalPlan, Request, plan_optimal
from posedesign.planning.optimal.outlook import outlook_of
from studies import writing
from studies.simulated_arms import across_axes, largest_torque_nm

SETTINGS = writing.settings_of(__file__)

GRID, EXCHANGE, OFFSETS_ALONE = "grid", "exchange", "offsets alone"
PLANS = (GRID, EXCHANGE, OFFSETS_ALONE)
"""Plans that are compared: the W P R grid of the paper's loop, poses chosen for the arm that is
fitted, and poses chosen for zero offsets alone."""

POSITIVE = "compliance", "bearing", "lost_motion"
"""First words of parameters that are never negative."""

REFERENCE = "reference"
"""Name of the cell that `posedesign new` writes without a preset."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A simulated arm."""

    model: CalibrationModel
    values: FloatArray  # (p,) [SI]
    deviation_rad: float = 0.0  # of each joint at each pose, which no parameter describes

    @property
    def as_described(self) -> FloatArray:
        """Its parameters ``(p,)`` without errors of the robot: tool and target only."""
        return np.where(self.model.nuisance, self.values, 0.0)


@dataclass(frozen=True, eq=False)
class _Part:
    """Errors of one kind: a block, the usual size of each error, and how errors are drawn."""

    block: ParameterBlock
    sizes: FloatArray  # (k,) [SI]
    values: FloatArray  # (k,) [SI]


class Bench:
    """The cell of a preset, plans for it, and arms to try the plans on."""

    def __init__(self, preset: str, settings: Mapping[str, Any]) -> None:
        self.preset, self.settings = preset, settings
        name = None if preset == REFERENCE else preset
        self.cell = Cell.from_text(cell_template(name) if name else cell_template())

    @cached_property
    def plans(self) -> dict[str, FloatArray]:
        """Postures ``(N, n)`` [rad] of each plan; all plans have as many."""
        grid = plan(self.cell).postures
        request = Request(count=len(grid))
        return {
            GRID: grid,
            EXCHANGE: plan_optimal(self.cell, request).postures,
            OFFSETS_ALONE: self._by_offsets.postures,
        }

    @cached_property
    def promises(self) -> dict[str, ExpectedError]:
        """Error to expect after each plan, of the arms that plans are made for."""
        said = {name: outlook_of(self.cell, q).expected for name, q in self.plans.items()}
        return {name: expected for name, expected in said.items() if expected is not None}

    @property
    def promised_by_offsets_m(self) -> float:
        """Error [m] that the plan for zero offsets alone promises itself."""
        return self._by_offsets.accuracy.tcp_m

    @cached_property
    def work(self) -> Workplace:
        """Postures at which the arm works: the promise is of these."""
        return workplace_of(self.cell)

    @cached_property
    def in_box(self) -> FloatArray:
        """Postures ``(V, n)`` [rad] over the task box, the tool oriented as at the base pose."""
        box, steps = box_of_cell(self.cell)[0], self.settings["box"]["steps"]
        found = reached_points(self.cell, TaskBox(box.lowest_m, box.highest_m, (steps,) * 3))
        return found.q[found.feasible]

    def arm(self, population: str, trial: int) -> Arm:
        """Return the arm of a trial: the same for every plan."""
        rng = self.rng(population, trial)
        if self.settings["populations"][population].get("usual"):
            return self._usual_arm(rng)
        parts = self._parts(population, rng)
        tool, target = self._set_up(rng)
        values = np.concatenate([*(part.values for part in parts), tool, target])
        return Arm(self._model(parts, tool, target), values)

    def known(self, population: str) -> PriorArms:
        """Return the arms of a population as they are known to whoever knows how they are drawn."""
        if self.settings["populations"][population].get("usual"):
            return reference_of(self.cell)
        parts = self._parts(population, np.random.default_rng(0))
        model = self._model(parts, self.cell.tool_m, self.cell.target_m)
        sizes = [part.sizes for part in parts]
        return PriorArms(model.with_prior([*np.concatenate(sizes), *[np.inf] * 6]))

    def rng(self, population: str, trial: int, *stream: int) -> np.random.Generator:
        """Return the random numbers of a trial."""
        preset = self.settings["presets"].index(self.preset)
        number = list(self.settings["populations"]).index(population)
        return np.random.default_rng([self.settings["seed"], preset, number, trial, *stream])

    @cached_property
    def _by_offsets(self) -> OptimalPlan:
        parameters = self.cell.config.parameters.model_copy(update={"planned": ("zero_offsets",)})
        config = self.cell.config.model_copy(update={"parameters": parameters})
        cell = Cell.from_config(config, Path("cell.toml"))
        return plan_optimal(cell, Request(count=len(plan(self.cell).postures)))

    @cached_property
    def _torque_nm(self) -> FloatArray:
        count = self.settings["arm"]["postures"]
        return largest_torque_nm(
            self.cell, count, np.random.default_rng([self.settings["seed"], count])
        )

    def _usual_arm(self, rng: np.random.Generator) -> Arm:
        """An arm as plans take it to be: sizes of its errors are drawn first, then the errors."""
        arms = reference_of(self.cell)
        sizes = np.where(np.isfinite(arms.model.prior), arms.model.prior, 0.0)
        for columns, usual in arms.kinds:  # priors are root mean squares over arms
            sizes[columns] *= np.exp(usual.log_sd * rng.standard_normal() - usual.log_sd**2)
        values = arms.model.nominal + sizes * rng.standard_normal(arms.model.p)
        words = [name.partition(".")[0] for name in arms.model.names]
        values = np.where(np.isin(words, POSITIVE), np.abs(values), values)
        values[arms.model.nuisance] = np.concatenate(self._set_up(rng))
        return Arm(arms.model, values, arms.deviation_rad)

    def _set_up(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Tool point and target [m]: as in the cell, and what the cell does not know."""
        given, cell = self.settings["arm"], self.cell
        tool = cell.tool_m + 1e-3 * given["tool_mm"] * rng.standard_normal(3)
        return tool, cell.target_m + 1e-3 * given["target_mm"] * rng.standard_normal(3)

    def _model(
        self, parts: list[_Part], tool_m: FloatArray, target_m: FloatArray
    ) -> CalibrationModel:
        cell = self.cell
        set_up = [ToolPoint(tool_m), TargetPoints([target_m], [cell.config.target.name])]
        blocks = [*(part.block for part in parts), *set_up]
        return CalibrationModel(cell.robot, blocks, cell.measurement)

    def _parts(self, population: str, rng: np.random.Generator) -> list[_Part]:
        """Errors of an arm, kind by kind."""
        robot, given = self.cell.robot, self.settings["populations"][population]
        joints, load, parts = robot.joint_names, self.cell.payload, []
        degree = np.pi / 180.0

        def add(block: ParameterBlock, sizes: FloatArray) -> None:
            parts.append(_Part(block, sizes, sizes * rng.standard_normal(len(sizes))))

        if "offset_deg" in given:
            add(ZeroOffsets(robot, joints), np.full(robot.n, given["offset_deg"] * degree))
        if "link_mm" in given:
            links = LinkGeometry(robot, across_axes(robot))
            lengths = np.array([unit == "m" for unit in links.units])
            add(links, 1e-3 * np.where(lengths, given["link_mm"], given["link_mrad"]))
        if given.get("compliant") and has_weight(self.cell):
            parts.append(self._compliance(rng))
        if "lost_motion_deg" in given and has_weight(self.cell):
            taken = self.settings["arm"]["friction_share"] * self._torque_nm
            lost = np.full(robot.n, given["lost_motion_deg"] * degree)
            drawn = lost * np.abs(rng.standard_normal(robot.n))
            parts.append(_Part(LostMotion(robot, joints, taken, load), lost, drawn))
        if "harmonic_deg" in given:
            waves = JointHarmonics(robot, joints, self.settings["arm"]["harmonics"])
            add(waves, np.full(waves.size, given["harmonic_deg"] * degree))
        return parts

    def _compliance(self, rng: np.random.Generator) -> _Part:
        """Compliance of all joints, about the stiffness of the preset where it has one."""
        robot, given = self.cell.robot, self.settings["arm"]
        known = given["stiffness_spread"] ** rng.standard_normal(robot.n) / robot.stiffness
        low, high = (1e-3 * mrad for mrad in given["give_mrad"])
        give = rng.uniform(low, high, robot.n)
        stiff = np.isfinite(robot.stiffness)
        values, sizes = (
            np.where(stiff, of_stiff, of_others / self._torque_nm)
            for of_stiff, of_others in ((known, give), (1.0 / robot.stiffness, (low + high) / 2.0))
        )
        block = JointCompliance(robot, robot.joint_names, self.cell.payload)
        return _Part(block, sizes, values)


def has_errors(preset: str, population: str) -> bool:
    """Return True if arms of the population have errors: no masses, no weight to give way under."""
    given = SETTINGS["populations"][population]
    weightless = {"offset_deg", "link_mm", "harmonic_deg", "usual"}
    return bool(weightless & set(given)) or has_weight(bench_of(preset).cell)


@lru_cache(maxsize=8)
def bench_of(preset: str) -> Bench:
    """Return the bench of the study, made once a process."""
    return Bench(preset, SETTINGS)
