"""How the arm of a cell is moved: not beyond the limits, nor into what stands around."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.se3 import FloatArray
from calib.vision.touch_up import Arms, Drive
from calib.vision.touch_up.drive import LARGEST_CORRECTION_RAD, Refuses
from posedesign.cell import Cell
from posedesign.constraints import Checker
from posedesign.motion import Router

_SAFETY = 0.5
"""Part of the safety distance that a loop keeps: poses are planned with all of it, and the loop
moves the arm on from there by what the robot is off."""


def drive_of(cell: Cell, arms: Arms, tell: Callable[[str], None] = lambda text: None) -> Drive:
    """The drive that a cell asks for; ``tell`` is told what could not be checked."""
    section = cell.config.constraints
    nearer = section.model_copy(update={"safety_distance_mm": _SAFETY * section.safety_distance_mm})
    loose = replace(cell, config=cell.config.model_copy(update={"constraints": nearer}))
    return Drive(
        cell.robot,
        arms,
        float(np.deg2rad(cell.config.touch_up.approach_deg)),
        refusals_of(loose),
        Router.of_cell(loose).between,
        shown_within_rad=shown_within_rad(cell),
        tell=tell,
    )


def shown_within_rad(cell: Cell) -> float:
    """How far joints may be shown off what was commanded [rad]."""
    return float(np.deg2rad(cell.config.touch_up.shown_within_deg))


def refusals_of(cell: Cell) -> Refuses:
    """Why moves must not be made: joint limits, and collisions as far as the cell has bodies.

    A motion from where an arm really stands is checked as the planner checks its own; no joint
    travels farther in it than a planned one, but for what corrections have added at both ends.

    Bodies that may meet at the target keep their distance there, too, unlike in a plan: the loop
    corrects sideways, and where the target is it has yet to find.
    """
    checker = Checker(cell.robot, cell.solid)
    travel = cell.ways.largest_travel + 2.0 * LARGEST_CORRECTION_RAD
    ways = replace(cell.ways, largest_travel=travel)

    def refuses(start: FloatArray, end: FloatArray) -> list[str]:
        reasons = [""] * len(end)
        known = np.isfinite(start).all(axis=1) & cell.config.constraints.ways
        found = ways.check(start[known], end[known])
        for k, reason, part in zip(
            np.flatnonzero(known).tolist(), found.reasons, found.part.tolist(), strict=True
        ):
            reasons[k] = f"on the way, {reason}" if reason and part < 1.0 else reason
        alone = checker.check(end[~known], every=False)
        for i, k in enumerate(np.flatnonzero(~known).tolist()):
            reasons[k] = "" if alone.feasible[i] else alone.says(i)
        return reasons

    return refuses
