"""Moves that a loop must not make: beyond the limits, or into what stands around."""

from __future__ import annotations

from dataclasses import replace

from calib.se3 import FloatArray
from calib.visual.drive import Refuses
from posedesign.cell import Cell
from posedesign.feasibility import Checker

_SAFETY = 0.5
"""Part of the safety distance that a loop keeps: poses are planned with all of it, and the loop
moves the arm on from there by what the robot is off."""


def refusals_of(cell: Cell) -> Refuses:
    """Why postures must not be taken: joint limits, collisions as far as the cell has bodies."""
    section = cell.config.constraints
    nearer = section.model_copy(update={"safety_distance_mm": _SAFETY * section.safety_distance_mm})
    loose = replace(cell, config=cell.config.model_copy(update={"constraints": nearer}))
    checker = Checker(cell.robot, loose.solid)

    def refuses(q: FloatArray) -> list[str]:
        verdicts = checker.check(q, every=False)
        return ["" if ok else verdicts.says(i) for i, ok in enumerate(verdicts.feasible.tolist())]

    return refuses
