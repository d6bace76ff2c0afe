"""Simulated arms that touch up a target by sight: what the paper's experiment is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import ConvergenceError
from calib.robots import Robot
from calib.se3 import FloatArray
from calib.vision.camera import FastObserver, MeasurementNoise, Observer
from calib.vision.camera.observers import Kind
from calib.vision.touch_up import (
    Drive,
    ImageJacobian,
    Loop,
    NoSetUp,
    SimulatedArms,
    Station,
    TiltBias,
    TrueCell,
    find_set_up,
    touch_up,
)
from posedesign.cell import Cell, cell_template
from posedesign.cell.schema import TruthSection
from posedesign.planning import plan
from posedesign.simulation import SimulatedRobot, true_cell, true_observer


@dataclass(frozen=True, eq=False)
class PoseSet:
    """What the planner's loop returns for a threshold."""

    d_deg: float  # variation of W, P and R
    c_g: float
    postures: FloatArray  # (N, n) [rad]


@dataclass(frozen=True, eq=False)
class DataSets:
    """Touch-ups of T data sets."""

    q: FloatArray  # (T, N, n): what the controllers showed [rad]
    failed: int  # data sets that are left out, for a pose was not touched
    moves: float  # of a touch-up, on average

    def scatter(self, robot: Robot) -> FloatArray:
        """Standard deviations ``(3,)`` [m] of where touch-ups of a pose end, in the tip's axes.

        Pooled over the poses. What repeats tell a user, who does not know where the target is.
        """
        T_base_tip = robot.fk(self.q)
        off = T_base_tip[..., :3, 3] - T_base_tip[..., :3, 3].mean(axis=0)
        across = np.einsum("tnji,tnj->tni", T_base_tip[..., :3, :3], off)
        freedom = (len(self.q) - 1) * self.q.shape[1]
        return np.asarray(np.sqrt((across**2).sum(axis=(0, 1)) / freedom))

    def first(self, count: int) -> DataSets:
        """The first of them."""
        return replace(self, q=self.q[:count])


@dataclass(frozen=True, eq=False)
class Bench:
    """A cell with the truth of one arm."""

    cell: Cell
    settings: Mapping[str, Any]  # of the study
    noise: MeasurementNoise  # of the pictures, which the fast observer draws from

    @classmethod
    def of(cls, settings: Mapping[str, Any], truth: Mapping[str, Any]) -> Bench:
        """The cell of the paper with an arm as ``truth`` says, in the words of a cell file."""
        cell = with_truth(paper_cell(settings), truth)
        observer = true_observer(cell, "fast")
        if not isinstance(observer, FastObserver):
            raise TypeError("a fast observer has the noise of pictures")
        return cls(cell, settings, observer.noise)

    def with_arm(self, truth: Mapping[str, Any]) -> Bench:
        """The same cell and pictures with another arm."""
        return replace(self, cell=with_truth(self.cell, truth))

    @cached_property
    def robot(self) -> SimulatedRobot:
        """The arm as it really is."""
        return SimulatedRobot.of(self.cell)

    @cached_property
    def truth(self) -> TrueCell:
        """The arm, its camera and its target as they really are."""
        return true_cell(self.cell)

    @cached_property
    def jacobian(self) -> ImageJacobian:
        """Measured as the first step of section 2.5 of the paper does, by one arm."""
        rng = np.random.default_rng([self.settings["seed"], 1])
        drive = self.drive(1, rng)
        focal_px = self.observer("fast").camera.focal_px
        size_px = focal_px * self.settings["diameter_mm"] / self.settings["stand_off_mm"]
        found = find_set_up(Station(drive), self.cell.base_posture, self.loop(), size_px=size_px)
        if isinstance(found, NoSetUp):
            raise ConvergenceError(found.reason, hint=found.hint)
        return found.jacobian

    def loop(self, *, view_line: bool = False) -> Loop:
        """When a touch-up ends."""
        given = {k: self.settings["loop"][k] for k in ("center_px", "size_px", "iterations")}
        return Loop(**given, view_line=view_line)

    def observer(self, kind: Kind) -> Observer:
        """What looks at the target."""
        return true_observer(self.cell, kind, self.noise)

    def drive(
        self,
        count: int,
        rng: np.random.Generator,
        kind: Kind = "fast",
        T_base_target: FloatArray | None = None,
    ) -> Drive:
        """Arms side by side, all at the base posture, each with a target ``(count, 4, 4)``."""
        truth = self.truth
        if T_base_target is not None:
            truth = replace(truth, T_base_target=T_base_target)
        arms = SimulatedArms(truth, self.observer(kind), count, rng, self.cell.base_posture)
        return Drive(self.cell.robot, arms, np.deg2rad(self.settings["loop"]["approach_deg"]))

    def touched(
        self,
        postures: FloatArray,
        data_sets: int,
        rng: np.random.Generator,
        *,
        view_line: bool = False,
        kind: Kind = "fast",
        T_base_target: FloatArray | None = None,
        tilt_known: bool = False,
    ) -> DataSets:
        """Touch up from postures ``(N, n)``, or ``(T, N, n)`` of each data set [rad].

        Targets ``(N, 4, 4)`` are of each posture; that of the cell by default. With ``tilt_known``
        what a tilt does to the ellipse is taken off, which the paper does not do.
        """
        N, n = postures.shape[-2:]
        start = np.broadcast_to(postures, (data_sets, N, n)).reshape(-1, n)
        own = None if T_base_target is None else np.tile(T_base_target, (data_sets, 1, 1))
        drive = self.drive(len(start), rng, kind, own)
        bias = None
        if tilt_known:
            bias = TiltBias(self.cell.robot, self.jacobian, self.truth.T_base_target[:3, 2])
        done = touch_up(drive, start, self.jacobian, self.loop(view_line=view_line), bias)
        whole = done.touched.reshape(data_sets, N).all(axis=1)
        q = done.q.reshape(data_sets, N, n)[whole]
        return DataSets(q, int((~whole).sum()), float(done.moves.mean()))


def paper_cell(settings: Mapping[str, Any]) -> Cell:
    """The reference cell with the target; a cell without ``[camera]`` has the paper's."""
    config = Cell.from_text(cell_template(settings["robot"], surroundings=False)).config
    given = {
        "tool": {"camera_stand_off_mm": settings["stand_off_mm"]},
        "target": {"radius_mm": settings["diameter_mm"] / 2.0},
        "plan": {"limit_margin_deg": settings["limit_margin_deg"]},
    }
    sections = {name: getattr(config, name).model_copy(update=new) for name, new in given.items()}
    return Cell.from_config(config.model_copy(update=sections), Path("cell.toml"))


def with_truth(cell: Cell, truth: Mapping[str, Any]) -> Cell:
    """A cell with another ``[truth]``."""
    section = TruthSection.model_validate(dict(truth))
    return replace(cell, config=cell.config.model_copy(update={"truth": section}))


def pose_set(cell: Cell, threshold: float) -> PoseSet:
    """The poses that the planner's loop ends with."""
    section = cell.config.plan.model_copy(update={"condition_threshold": threshold})
    planned = plan(replace(cell, config=cell.config.model_copy(update={"plan": section})))
    best = planned.rounds[planned.best]
    return PoseSet(best.variation_deg[0], best.c_g, planned.poses.kept)
