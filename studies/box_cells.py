"""Cells, task boxes and grids of poses that studies 10 and 11 have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calib.se3 import BoolArray, FloatArray, wpr_from_rotation
from posedesign.candidates import Pool
from posedesign.cell import Cell, TaskBox, cell_template, touching_poses, wpr_rotations
from posedesign.cell.task_box import reached_points
from posedesign.constraints import nearest_postures


def study_cell(name: str, smallest_singular_value: float) -> Cell:
    """The cell of a preset, bounded by joint limits and a distance from singular postures."""
    cell = Cell.from_text(cell_template(name, surroundings=False))
    constraints = cell.config.constraints.model_copy(
        update={"smallest_singular_value": smallest_singular_value}
    )
    config = cell.config.model_copy(update={"constraints": constraints})
    return Cell.from_config(config, Path("cell.toml"))


def box_postures(cell: Cell, box: Mapping[str, Sequence[float]]) -> FloatArray:
    """Postures ``(K, n)`` [rad] at the points of a box ``lowest_mm`` to ``highest_mm``."""
    lowest, highest = (np.array(box[key]) / 1e3 for key in ("lowest_mm", "highest_mm"))
    found = reached_points(cell, TaskBox(lowest, highest))
    return found.q[found.feasible]


def grid_pool(cell: Cell, width_deg: float, part: BoolArray | None = None) -> Pool:
    """Poses of the W P R grid that can be taken, or of a part ``(27,)`` of it."""
    wpr = wpr_from_rotation(cell.robot.fk(cell.base_posture)[:3, :3])
    rotations = wpr_rotations(wpr, np.deg2rad([width_deg] * 3))
    poses = touching_poses(
        rotations if part is None else rotations[part], cell.tool_m, cell.target_m
    )
    found = nearest_postures(cell.checker, poses, cell.base_posture)
    return pool_at_target(cell, found.q[found.feasible])


def pool_at_target(cell: Cell, postures: FloatArray) -> Pool:
    """Postures ``(N, n)`` [rad] at the one target of a cell, as a pool."""
    return Pool(
        postures,
        cell.robot.fk(postures)[:, :3, :3],
        np.zeros(len(postures), dtype=np.intp),
        cell.target_m[None],
        (cell.config.target.name,),
        len(postures),
        "given postures",
    )
