"""Postures at which an arm will work: where its error counts, before measuring and afterwards."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from calib.errors import CalibError, UnreachableError
from calib.identification import Workplace, tool_motion
from calib.identification.prediction import placed_anew
from calib.model import CalibrationModel, Setup
from calib.se3 import FloatArray
from posedesign.candidates.building import (
    away_from_singularities,
    box_of_cell,
    candidates_of,
    functions_of_picture,
)
from posedesign.candidates.candidate_poses import CandidatePoses
from posedesign.candidates.postures import MOST_PER_POSE
from posedesign.cell import Cell, poses_about_tool
from posedesign.cell.task_box import BOX_OF_REACH, TaskBox, box_functions, reached_points
from posedesign.constraints import Checker, nearest_postures

WORK_POSTURES = 120
"""Postures that an arm is judged at. Another sample of as many changes the expected error by two to
six per cent."""

FEW_CANDIDATES = 300
"""Draws of a pool that stands for the whole: a tenth of the usual ones, in a tenth of a second. On
the reference cell and a KR 6 the best choice out of them was 12 % worse than out of all. Of a
redundant arm, which gives several postures of each, so many fewer."""

_TRIED = 10
"""Points drawn for each posture: of a box about joints that turned everywhere most are beyond
reach."""


HALF_WAY = "half-way between measurements"
"""Words of a workplace where hardly any point of the box can be reached."""


def workplace(
    cell: Cell,
    postures: FloatArray,
    setup: Setup,
    count: int = WORK_POSTURES,
    *,
    rng: np.random.Generator | None = None,
) -> Workplace:
    """Postures over the volume that the arm will work in, its tool turned as it is measured.

    Points fill the task box of the cell evenly, or where there is none the box about all measuring
    postures and a little beyond. Each is reached with the tool turned as at one of them, by the
    posture inside the limits that is nearest to the middle of all. Where hardly any can be reached,
    half-way postures between pairs of measurements take their place. The order of the measurements
    changes nothing.

    Parameters
    ----------
    postures : array (N, n)
        Measuring postures [rad].
    setup : Setup
        Tool and payload at each.
    count : int
        Postures wanted; at least half as many are found.
    rng : numpy Generator, optional
        Source of other points than the usual ones.
    """
    robot, measured = cell.robot, len(postures)
    order = np.lexsort((setup.payload, setup.tool, *postures.T))
    postures, setup = postures[order], setup[order]
    even = _Even(4, np.random.default_rng(0) if rng is None else rng)
    state = robot.state(postures)
    if cell.config.task_box is not None:
        at_work, words = box_of_cell(cell)[0], "the task box"
    else:
        points = state.point(cell.tool_m)
        beyond = BOX_OF_REACH * robot.chain.reach_m
        at_work = TaskBox(points.min(axis=0) - beyond, points.max(axis=0) + beyond)
        words = f"all that was measured and {1e3 * beyond:.0f} mm around it"
    middle = np.median(postures, axis=0)
    near = postures[np.argmin(np.abs(postures - middle).max(axis=1))]
    checker = Checker(robot, (), cell.margin)
    q, like = np.empty((0, robot.n)), np.empty(0, dtype=np.intp)
    for _ in range(_TRIED):
        share = even.next(count)
        row = (share[:, 3] * measured).astype(np.intp)
        at = at_work.lowest_m + (at_work.highest_m - at_work.lowest_m) * share[:, :3]
        R = state.R_base_tip[row]
        poses = poses_about_tool(robot, R, cell.tool_m, at, near, cell.margin)
        found = nearest_postures(checker, poses, near)
        q = np.concatenate([q, found.q[found.feasible]])[:count]
        like = np.concatenate([like, row[found.feasible]])[:count]
        if 2 * len(q) >= count:
            break
    else:
        like, other = (even.next(count)[:, :2].T * measured).astype(np.intp)
        q = (postures[like] + postures[other]) / 2.0
        words = HALF_WAY
    return Workplace(q, Setup.of(len(q), tool=setup.tool[like], payload=setup.payload[like]), words)


class _Even:
    """Points that fill a unit cube evenly: Halton's sequence, shifted at random as a whole.

    Digits of the index in a prime base, mirrored at the point, are the coordinates along one axis
    (Halton, Numer. Math. 2, 1960). A mean over such points scatters half as much as over random
    ones and less.
    """

    def __init__(self, dimensions: int, rng: np.random.Generator) -> None:
        self._bases = (2, 3, 5, 7)[:dimensions]
        self._shift = rng.random(dimensions)
        self._count = 0

    def next(self, count: int) -> FloatArray:
        """Return the next points ``(count, dimensions)``."""
        index = np.arange(self._count + 1, self._count + count + 1)
        self._count += count
        points = np.zeros((count, len(self._bases)))
        for axis, base in enumerate(self._bases):
            left, digit = index.copy(), 1.0 / base
            while left.any():
                points[:, axis] += digit * (left % base)
                left, digit = left // base, digit / base
        return np.asarray((points + self._shift) % 1.0)


@lru_cache(maxsize=2)
def small_pool_of(cell: Cell) -> CandidatePoses:
    """A small pool of a cell: what the whole pool looks like."""
    draws = FEW_CANDIDATES if cell.robot.n <= 6 else FEW_CANDIDATES // MOST_PER_POSE
    pool = cell.config.pool.model_copy(update={"candidates": draws})
    config = cell.config.model_copy(update={"pool": pool})
    return candidates_of(away_from_singularities(replace(cell, config=config)))


@lru_cache(maxsize=8)
def workplace_of(cell: Cell) -> Workplace:
    """Postures at which the arm of a cell will work, whatever poses it is measured at.

    See :func:`drawn_workplace_of`.
    """
    return drawn_workplace_of(cell)


def drawn_workplace_of(
    cell: Cell, count: int = WORK_POSTURES, *, rng: np.random.Generator | None = None
) -> Workplace:
    """Draw postures at which the arm of a cell will work, whatever poses it is measured at.

    Those that the identification of measurements from all over its pool is judged at. Where the
    cell has no pool, the points of the task box, the tool turned as at the base pose; where none of
    them can be reached, the base posture.
    """
    box, words = box_of_cell(cell)
    try:
        pool = small_pool_of(cell)
    except CalibError:
        try:
            found = reached_points(cell, box)
        except UnreachableError:
            if cell.config.task_box is not None:
                raise
            return Workplace(cell.base_posture[None], Setup.of(1), "the target alone")
        return Workplace(found.q[found.feasible], Setup.of(int(found.feasible.sum())), words)
    setup = Setup.of(len(pool), payload=pool.loads)
    at = workplace(cell, pool.postures, setup, count, rng=rng)
    if cell.is_plain and cell.config.task_box is None:
        return replace(at, words=words)  # the same box: all that is measured is at the target
    return replace(at, words=at.words.replace("was measured", "can be measured"))


def functions_over_work(
    cell: Cell, model: CalibrationModel, at: Workplace | None = None
) -> tuple[FloatArray, str]:
    """Displacements of the tool point by each parameter where the arm will work ``(K, 3, p)``.

    In base axes [m per unit], the base placed anew: rigid motions of all points alike are no error
    of the arm, see :mod:`calib.identification.prediction`. And where that is, in words. Where
    pictures of a board are taken, of what the camera sees; of other cells of hand-eye calibration,
    over the box.

    ``at``: where an arm that touches up will work, :func:`workplace_of` the cell by default.
    """
    if cell.sees_board:
        return functions_of_picture(cell, model)
    if cell.is_hand_eye:
        box, words = box_of_cell(cell)
        try:
            return box_functions(cell, model, box), words
        except UnreachableError:
            if cell.config.task_box is not None:
                raise
        point = TaskBox(cell.target_m, cell.target_m, (1, 1, 1))
        return box_functions(cell, model, point), "the target alone"
    at = workplace_of(cell) if at is None else at
    moved = tool_motion(model, at.postures, at.setup)
    return placed_anew(moved, model.view(at.postures, None, at.setup).tool_points), at.words
