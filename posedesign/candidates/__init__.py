"""Candidate postures to choose measuring poses from: what the robot can take, and what it touches.

A builder gives a :class:`CandidatePoses`, the pool gives the blocks ``(N, m, p)`` of a model, and
:mod:`posedesign.selection` chooses among these.
"""

from posedesign.candidates.building import (
    away_from_singularities,
    box_of_cell,
    candidates_of,
    cone_candidates,
    functions_over_box,
    grid_candidates,
    joint_candidates,
)
from posedesign.candidates.candidate_poses import CandidatePoses, feasible, offset_targets
from posedesign.candidates.postures import CONFIGURATIONS, Configurations, local_poses

__all__ = [
    "CONFIGURATIONS",
    "CandidatePoses",
    "Configurations",
    "away_from_singularities",
    "box_of_cell",
    "candidates_of",
    "cone_candidates",
    "feasible",
    "functions_over_box",
    "grid_candidates",
    "joint_candidates",
    "local_poses",
    "offset_targets",
]
