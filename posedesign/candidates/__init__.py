"""Candidate postures to choose measuring poses from: what the robot can take, and what it touches.

A builder gives a :class:`CandidatePoses`, the pool gives the blocks ``(N, m, p)`` of a model, and
:mod:`posedesign.selection` chooses among these.
"""

from posedesign.candidates.building import away_from_singularities as away_from_singularities
from posedesign.candidates.building import box_of_cell as box_of_cell
from posedesign.candidates.building import candidates_of as candidates_of
from posedesign.candidates.building import cone_candidates as cone_candidates
from posedesign.candidates.building import grid_candidates as grid_candidates
from posedesign.candidates.building import joint_candidates as joint_candidates
from posedesign.candidates.candidate_poses import CandidatePoses as CandidatePoses
from posedesign.candidates.candidate_poses import feasible as feasible
from posedesign.candidates.candidate_poses import offset_targets as offset_targets
from posedesign.candidates.postures import CONFIGURATIONS as CONFIGURATIONS
from posedesign.candidates.postures import Configurations as Configurations
from posedesign.candidates.postures import local_poses as local_poses
from posedesign.candidates.workplaces import functions_over_work as functions_over_work
from posedesign.candidates.workplaces import workplace as workplace
from posedesign.candidates.workplaces import workplace_of as workplace_of
