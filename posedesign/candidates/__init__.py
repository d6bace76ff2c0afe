"""Candidate postures to choose measuring poses from: what the robot can take, and what it touches.

A builder gives a :class:`Pool`, the pool gives the blocks ``(N, m, p)`` of a model, and
:mod:`posedesign.selection` chooses among these.
"""

from posedesign.candidates.building import (
    away_from_singularities,
    box_of_cell,
    cone_pool,
    functions_over_box,
    joint_pool,
    pool_of,
    wpr_pool,
)
from posedesign.candidates.pool import Pool, feasible, offset_targets
from posedesign.candidates.postures import CONFIGURATIONS, Configurations, local_poses

__all__ = [
    "CONFIGURATIONS",
    "Configurations",
    "Pool",
    "away_from_singularities",
    "box_of_cell",
    "cone_pool",
    "feasible",
    "functions_over_box",
    "joint_pool",
    "local_poses",
    "offset_targets",
    "pool_of",
    "wpr_pool",
]
