"""Step 4 of the paper's algorithm: a posture in place of a pose that cannot be reached.

"Adjust the rotation angles of all axes ... so that their displacements from those of other
measuring poses will become as large as possible to move within the operating range": from a pool
of postures that all keep the tool point on the target and lie inside the limits, the one farthest
from all postures already chosen is taken, again and again (max-min).
"""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.generation import cone_rotations, touching_poses

POOL_ORIENTATIONS = 400
"""Orientations that the pool is made of; twice as many lower C_G by less than a tenth."""

_POOL_SEED = 2006


def repair_pool(cell: Cell) -> FloatArray:
    """Postures ``(K, n)`` [rad] that replacements are taken from.

    All arm configurations over a cone of orientations around the base pose, rolled freely, with
    the tool point on the target; inside the limits less the repair margin, and with the first
    joint near its base value, so that no replacement reaches over the arm's back.
    """
    plan = cell.config.plan
    robot, base = cell.robot, cell.base_posture
    rotations = cone_rotations(
        robot.fk(base)[:3, :3],
        float(np.deg2rad(plan.repair_tilt_deg)),
        POOL_ORIENTATIONS,
        np.random.default_rng(_POOL_SEED),  # fixed: the same cell gives the same plan
    )
    poses = touching_poses(rotations, cell.tool_m, cell.target_m)
    margin = float(np.deg2rad(max(plan.repair_margin_deg, plan.limit_margin_deg)))
    solutions = robot.inverse(poses, near=base, margin=margin)
    swing = np.abs(solutions.postures[:, 0] - base[0])
    near = swing <= np.deg2rad(plan.repair_base_joint_deg)
    return np.asarray(solutions.postures[solutions.inside & near])


def farthest_postures(
    pool: FloatArray, chosen: FloatArray, count: int, joint_range: FloatArray
) -> FloatArray:
    """Pick postures one by one, each as far as possible from all chosen before it.

    Parameters
    ----------
    pool : array (K, n)
        Postures to pick from [rad].
    chosen : array (N, n)
        Postures already in the set [rad].
    count : int
        How many to pick; fewer are returned where the pool runs out.
    joint_range : array (n,)
        Joint differences are divided by it, so that every joint counts by how far it can turn.

    Returns
    -------
    array (count, n)
        [rad]
    """
    points = pool / joint_range
    distance = np.full(len(pool), np.inf)
    for posture in chosen / joint_range:
        distance = np.minimum(distance, np.linalg.norm(points - posture, axis=1))
    picked: list[int] = []
    for _ in range(min(count, len(pool))):
        best = int(np.argmax(distance))
        if distance[best] == 0.0:  # only repetitions are left
            break
        picked.append(best)
        distance = np.minimum(distance, np.linalg.norm(points - points[best], axis=1))
    return pool[picked]
