"""Candidate postures to choose measuring poses from: what the robot can take, and what it touches.

A builder gives a :class:`Pool`, the pool gives the blocks ``(N, m, p)`` of a model, and
:mod:`posedesign.selection` chooses among these.
"""

from posedesign.candidates.branches import CONFIGURATIONS, Configurations
from posedesign.candidates.joint_space import joint_pool
from posedesign.candidates.local import local_poses
from posedesign.candidates.of_cell import (
    away_from_singularities,
    box_of_cell,
    functions_over_box,
    pool_of,
)
from posedesign.candidates.pool import Pool
from posedesign.candidates.targets import feasible, offset_targets
from posedesign.candidates.touching import cone_pool, wpr_pool

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
