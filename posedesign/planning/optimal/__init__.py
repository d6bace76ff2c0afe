"""The best poses that a cell allows: chosen out of a pool, with a proof of how good they are."""

from posedesign.planning.optimal.plan import plan_fewest, plan_optimal
from posedesign.planning.optimal.request import OBJECTIVES, Request
from posedesign.planning.optimal.result import NextPoses, OptimalPlan
from posedesign.planning.optimal.sequential import plan_next, plan_next_views

__all__ = [
    "OBJECTIVES",
    "NextPoses",
    "OptimalPlan",
    "Request",
    "plan_fewest",
    "plan_next",
    "plan_next_views",
    "plan_optimal",
]
