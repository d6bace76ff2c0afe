"""The fewest poses that promise the accuracy wanted, before anything is measured.

The loop of :mod:`posedesign.planner` takes 27 poses and makes them wider. Here all its grids, from
the first to the widest angles, make one pool; of what the robot can take of it the fewest poses are
chosen whose predicted standard deviations are as small as wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.identification import check_identifiable
from calib.model import CalibrationModel
from calib.parameters.base import Unit
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.feasibility import nearest_postures
from posedesign.generation import touching_poses, wpr_rotations
from posedesign.indices import Indices, evaluate
from posedesign.planner import check_base_pose, regressor
from posedesign.pose_plan import PoseSet, displayed, fingerprint
from posedesign.route import Route, Router
from posedesign.selection import Selection, select_fewest

LEVELS = 16
"""Grids of the pool, from the first to the widest angles: 417 poses. Half as many poses took none
to two more of thirty in the cells tried."""

ATTEMPTS = 10
"""How often poses that no clear way leads to are left out of the pool and others are chosen."""

Advance = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class FewestPoses:
    """The fewest poses of a pool that reach standard deviations, and the way through them.

    Attributes
    ----------
    selection : Selection
        Of the postures of the pool; where they are out of reach, with all of them.
    poses : PoseSet
        The poses chosen; those of the whole pool where the deviations are out of reach.
    route : Route or None
        Their order, and what lies between them; None where they are out of reach.
    pool_size, tried : int
        Poses of the pool that the robot can take, of how many.
    indices : Indices
        Of the poses chosen.
    model : CalibrationModel
    """

    selection: Selection
    poses: PoseSet
    route: Route | None
    pool_size: int
    tried: int
    indices: Indices
    model: CalibrationModel

    @property
    def reached(self) -> bool:
        """Whether the deviations are as small as wanted."""
        return self.selection.reached

    @property
    def fingerprint(self) -> str:
        """Short digest of the postures in their order, as of a plan."""
        order = slice(None) if self.route is None else self.route.order
        return fingerprint(self.poses.kept[order])

    @property
    def message(self) -> str:
        """The outcome in one line."""
        pool = f"of {self.tried} poses the robot can take {self.pool_size}; "
        if self.reached:
            name = self.model.names[self.selection.tightest]
            return f"{pool}{self.selection.message} ({name} decides)"
        return (
            f"{pool}{self.selection.message}; or widen variations.largest_deg, or make room around "
            "the base pose"
        )

    def rows(self) -> list[dict[str, object]]:
        """Predicted deviation of each parameter beside the one wanted, as people read them."""
        chosen = displayed(self.model, self.selection.sigma)
        fewer = displayed(self.model, self.selection.sigma_of_fewer)
        wanted = displayed(self.model, self.selection.wanted)
        rows: list[dict[str, object]] = []
        for (name, unit, sigma), (_, _, less), (_, _, limit) in zip(
            chosen, fewer, wanted, strict=True
        ):
            row: dict[str, object] = {"parameter": name, "predicted sigma": sigma, "unit": unit}
            row["wanted"] = limit if np.isfinite(limit) else None
            if self.reached:
                row["with one pose fewer"] = less
            rows.append(row)
        return rows


def plan_fewest(
    cell: Cell,
    sigma_m: float | None = None,
    sigma_rad: float | None = None,
    advance: Advance = lambda what, part: None,
) -> FewestPoses:
    """Choose the fewest poses whose predicted standard deviations are as small as wanted.

    Parameters
    ----------
    cell : Cell
    sigma_m, sigma_rad : float, optional
        Largest standard deviation of each parameter that is a length, and of each that is an
        angle; at least one of the two. Of hand-eye calibration: of each coordinate of camera and
        target, and of their rotation about each axis.
    advance : callable, optional
        Called with what is being done and the part of all work that is done.

    Raises
    ------
    InputError
        Nothing is wanted, or the cell's estimate is not weighted by its noise.
    UnreachableError
        The base pose itself cannot be taken.
    NotIdentifiableError
        The whole pool cannot identify some of the parameters, which are named.
    """
    model = cell.model()
    wanted = _wanted(model, sigma_m, sigma_rad)
    if not cell.config.measurement.weighted:
        raise InputError(
            "what an unweighted estimate needs cannot be chosen pose by pose",
            hint="set measurement.weighted = true",
            name="measurement.weighted",
        )
    check_base_pose(cell)
    advance("looking for postures", 0.0)
    pool, tried = _pool(cell)
    router = Router(cell.robot, cell.ways, cell.passing, cell.base_posture)
    for attempt in range(ATTEMPTS):
        advance("choosing poses", 0.5 + 0.5 * attempt / ATTEMPTS)
        postures = pool.kept
        linear = model.linearise(postures)
        white = linear.white_jacobian
        check_identifiable(white.reshape(-1, model.p), model.names, model.nuisance)
        selection = select_fewest(white, wanted)
        chosen = _chosen(pool, selection)
        indices = evaluate(regressor(linear)[selection.indices], white[selection.indices])
        found = FewestPoses(selection, chosen, None, len(postures), tried, indices, model)
        if not selection.reached:
            return found
        route = router.route(postures[selection.indices])
        if not route.lost:
            return FewestPoses(selection, chosen, route, len(postures), tried, indices, model)
        pool = _without(pool, [int(selection.indices[i]) for i in route.lost])
    raise InputError(
        f"no clear way leads to some of the poses: {next(iter(route.lost.values()))}",
        hint="move the base posture to the side of the target that has room, or what is in the way",
        name="base_pose",
    )


def _wanted(model: CalibrationModel, sigma_m: float | None, sigma_rad: float | None) -> FloatArray:
    """Largest standard deviation ``(p,)`` of each parameter [SI]; infinite where any will do."""
    limits: dict[Unit, float | None] = {"m": sigma_m, "rad": sigma_rad}
    given = [limits.get(unit) for unit in model.units]
    wanted = np.array([np.inf if limit is None else limit for limit in given])
    if np.isinf(wanted).all():
        raise InputError(
            "no accuracy is wanted of anything that is identified",
            hint="give --wanted-sigma-mm, --wanted-sigma-deg, or both",
            name="wanted",
        )
    return wanted


def _pool(cell: Cell) -> tuple[PoseSet, int]:
    """Poses of all grids that the robot can take, and how many there are in all."""
    section = cell.config.variations
    wpr = wpr_from_rotation(cell.robot.fk(cell.base_posture)[:3, :3])
    levels = np.linspace(np.deg2rad(section.start_deg), np.deg2rad(section.largest_deg), LEVELS)
    rotations = np.concatenate([wpr_rotations(wpr, level) for level in levels])
    # the base pose is in every grid, and so are all poses of an angle that is held
    _, first = np.unique(rotations.reshape(len(rotations), -1).round(9), axis=0, return_index=True)
    rotations = rotations[np.sort(first)]
    poses = touching_poses(rotations, cell.tool_m, cell.target_m)
    found = nearest_postures(cell.checker, poses, cell.base_posture)
    postures = found.q[found.feasible]
    nothing = ("",) * len(postures)
    return PoseSet.of_grid(postures, nothing, rotations[found.feasible]), len(rotations)


def _chosen(pool: PoseSet, selection: Selection) -> PoseSet:
    rows = selection.indices
    return PoseSet.of_grid(pool.postures[rows], ("",) * len(rows), pool.orientations[rows])


def _without(pool: PoseSet, rows: list[int]) -> PoseSet:
    kept = np.delete(np.arange(len(pool.status)), rows)
    return PoseSet.of_grid(pool.postures[kept], ("",) * len(kept), pool.orientations[kept])
