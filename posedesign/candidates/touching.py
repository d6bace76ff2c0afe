"""Pools of postures that keep the tool point on a target."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray, wpr_from_rotation
from posedesign.candidates.branches import (
    IN_WORDS,
    asked_for,
    check_configurations,
    feasible_postures,
)
from posedesign.candidates.draws import check_count, even_points, no_pose, once
from posedesign.candidates.pool import Pool
from posedesign.candidates.targets import checkers_of, targets_of
from posedesign.cell import Cell, cone_rotations_at, touching_poses, wpr_rotations

LEVELS = 16
"""Grids of W, P and R, from the first to the widest angles: 417 poses."""

_SAME_TURN_RAD = 1e-8
"""Orientations of which no entry differs by more are one; forming them rounds 1e-15."""


def wpr_pool(
    cell: Cell,
    levels: int = LEVELS,
    configurations: str = "nearest",
    *,
    targets_m: ArrayLike | None = None,
    target_names: Sequence[str] | None = None,
) -> Pool:
    """Postures of all W P R grids of a cell, from its first angles to its largest.

    ``levels``: number of grids (Eq. 13 of [Watanabe2006]_), their angles evenly spaced.
    ``configurations``: see :data:`~posedesign.candidates.Configurations`. ``targets_m`` (K, 3):
    targets [m] in the base frame; each pose touches one, and each grid is laid at each. That of the
    cell by default. ``target_names``: their labels in a model. Raises InputError: an argument
    cannot be used. UnreachableError: no pose at all can be taken.
    """
    levels = check_count(levels)
    section = cell.config.variations
    start, largest = np.deg2rad([section.start_deg, section.largest_deg])
    wpr = wpr_from_rotation(_base_rotation(cell))
    grids = [wpr_rotations(wpr, angles) for angles in np.linspace(start, largest, levels)]
    rotations = np.concatenate(grids)
    # the base pose is in every grid, and so are all poses of an angle that is held
    rotations = rotations[_distinct(rotations)]
    angles = " to ".join(
        ", ".join(f"{angle:g}" for angle in given)
        for given in (section.start_deg, section.largest_deg)
    )
    return _touching(
        cell,
        lambda: rotations,
        f"W P R varied by {angles} deg in {levels} levels",
        configurations,
        (targets_m, target_names),
    )


def cone_pool(
    cell: Cell,
    tilt: float,
    count: int,
    rng: np.random.Generator,
    configurations: str = "front",
    *,
    targets_m: ArrayLike | None = None,
    target_names: Sequence[str] | None = None,
) -> Pool:
    """Postures with the tool tilted up to an angle against the base pose and rolled freely.

    ``tilt``: largest angle between the tool's z and that of the base pose [rad]. ``count``:
    orientations tried at each target; each gives as many postures as it can be taken in. ``rng``:
    scrambles the orientations, which fill the cone evenly. ``configurations``: see
    :data:`~posedesign.candidates.Configurations`. A redundant arm gives at most
    :data:`~posedesign.candidates.branches.MOST_PER_POSE` of each pose. ``targets_m``,
    ``target_names``: see :func:`wpr_pool`. Raises InputError: an argument cannot be used.
    UnreachableError: no pose at all can be taken.
    """
    if not 0.0 < tilt <= np.pi:
        raise InputError(
            f"a cone of {tilt:g} rad: its tilt is above 0 and at most pi",
            hint="give it in radians",
            name="tilt",
            value=tilt,
            bound=(0.0, np.pi),
        )
    count, base = check_count(count), _base_rotation(cell)
    return _touching(
        cell,
        lambda: cone_rotations_at(base, tilt, even_points(count, 3, rng)),
        f"cone of {np.rad2deg(tilt):g} deg, rolled freely",
        configurations,
        (targets_m, target_names),
    )


def _touching(
    cell: Cell,
    orient: Callable[[], FloatArray],
    orientations: str,
    configurations: str,
    asked: tuple[ArrayLike | None, Sequence[str] | None],
) -> Pool:
    """The pool of orientations ``(M, 3, 3)`` that are called for anew at each target."""
    chosen = check_configurations(configurations)
    targets_m, names = targets_of(cell, *asked)
    checkers = checkers_of(cell, targets_m)
    poses = [touching_poses(orient(), cell.tool_m, target_m) for target_m in targets_m]
    found = [
        feasible_postures(checker, part, cell.base_posture, chosen)
        for checker, part in zip(checkers, poses, strict=True)
    ]
    postures = np.concatenate([q for q, _ in found])
    if not len(postures):
        raise no_pose(
            checkers[0],
            poses[0],
            cell.base_posture,
            lambda solutions: asked_for(solutions, chosen),
            (
                "only with the first joint on the other side of the base posture",
                'take configurations = "all"',
            ),
        )
    turned = [part[pose, :3, :3] for part, (_, pose) in zip(poses, found, strict=True)]
    target = np.repeat(np.arange(len(targets_m)), [len(q) for q, _ in found])
    pool = Pool(
        postures=postures,
        orientations=np.concatenate(turned),
        target=target,
        targets_m=targets_m,
        target_names=names,
        tried=sum(len(part) for part in poses),
        description=f"{orientations}, {IN_WORDS[chosen]}",
    )
    return pool.take(once(postures))


def _base_rotation(cell: Cell) -> FloatArray:
    return np.asarray(cell.robot.fk(cell.base_posture)[:3, :3])


def _distinct(rotations: FloatArray) -> IntArray:
    """First row of each orientation of ``(M, 3, 3)``, ascending."""
    return np.flatnonzero(once(rotations.reshape(len(rotations), 9), _SAME_TURN_RAD))
