"""Candidate postures to choose measuring poses from: what the robot can take, and what it touches.

A builder gives a :class:`Pool`, the pool gives the blocks ``(N, m, p)`` of a model, and
:mod:`posedesign.selection` chooses among these.
"""

from posedesign.pools.branches import CONFIGURATIONS, Configurations
from posedesign.pools.joint_space import joint_pool
from posedesign.pools.local import local_poses
from posedesign.pools.pool import Pool
from posedesign.pools.targets import feasible, offset_targets
from posedesign.pools.touching import cone_pool, wpr_pool

__all__ = [
    "CONFIGURATIONS",
    "Configurations",
    "Pool",
    "cone_pool",
    "feasible",
    "joint_pool",
    "local_poses",
    "offset_targets",
    "wpr_pool",
]
