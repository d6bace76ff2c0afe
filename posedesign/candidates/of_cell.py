"""The pool that a cell asks for, and the task box that accuracy is judged over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.errors import InputError, UnreachableError
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.candidates.joint_space import joint_pool
from posedesign.candidates.pool import Pool
from posedesign.candidates.touching import cone_pool, wpr_pool
from posedesign.cell import Cell, TaskBox
from posedesign.cell.task_box import BOX_OF_REACH, box_functions


def pool_of(cell: Cell) -> Pool:
    """Candidates of a cell, by its section ``[pool]``.

    ``auto`` is the view cone for touch-ups, and all W P R grids for a camera that sees a target.

    Raises InputError: postures that do not touch the target, for a measurement that does.
    UnreachableError: the robot can take none of them.
    """
    section = cell.config.pool
    kind = section.kind
    if kind == "auto":
        kind = "wpr" if cell.is_hand_eye else "cone"
    if kind == "wpr":
        return wpr_pool(cell, configurations="nearest")
    rng = np.random.default_rng(section.seed)
    if kind == "joints":
        if not cell.is_hand_eye:
            raise InputError(
                "postures drawn in the joints do not touch the target, as "
                f"{cell.config.measurement.kind} needs",
                hint='set pool.kind = "cone"',
                name="pool.kind",
            )
        return joint_pool(cell, section.candidates, rng)
    tilt = float(np.deg2rad(section.tilt_deg))
    return cone_pool(cell, tilt, section.candidates, rng, section.configurations)


def away_from_singularities(cell: Cell) -> Cell:
    """The cell with the distance from singularities that chosen poses keep.

    The best poses lie at the edge of what an arm can do. Near full reach a millimetre of correction
    in a touch-up takes degrees of a joint, or cannot be made at all.
    """
    least = cell.config.pool.smallest_singular_value
    section = cell.config.constraints
    if cell.is_hand_eye or section.smallest_singular_value >= least:
        return cell
    stricter = section.model_copy(update={"smallest_singular_value": least})
    return replace(cell, config=cell.config.model_copy(update={"constraints": stricter}))


def with_kept(cell: Cell, pool: Pool, postures: FloatArray) -> Pool:
    """The pool with poses of the user's own ``(k, n)`` [rad] as its first ones."""
    k = len(postures)
    return replace(
        pool,
        postures=np.concatenate([postures, pool.postures]),
        orientations=np.concatenate([cell.robot.fk(postures)[:, :3, :3], pool.orientations]),
        target=np.concatenate([np.zeros(k, dtype=np.intp), pool.target]),
        tried=pool.tried + k,
    )


def box_of_cell(cell: Cell) -> tuple[TaskBox, str]:
    """The task box of a cell, and where it is from in words."""
    section = cell.config.task_box
    if section is not None:
        lowest, highest = np.array(section.lowest_mm) / 1e3, np.array(section.highest_mm) / 1e3
        return TaskBox(lowest, highest, section.steps), "the task box of the cell"
    half = BOX_OF_REACH * cell.robot.chain.reach_m
    words = f"a cube of {2e3 * half:.0f} mm about the target (the cell has no [task_box])"
    return TaskBox(cell.target_m - half, cell.target_m + half), words


def functions_over_box(cell: Cell, model: CalibrationModel) -> tuple[FloatArray, str]:
    """How the tool point moves with the parameters over the box ``(K, 3, p)``, and which box.

    Without a task box of its own, a cell is judged at the base pose where nothing else is reached.
    """
    box, words = box_of_cell(cell)
    try:
        return box_functions(cell, model, box), words
    except UnreachableError:
        if cell.config.task_box is not None:
            raise
    point = TaskBox(cell.target_m, cell.target_m, (1, 1, 1))
    return box_functions(cell, model, point), "the target alone"
