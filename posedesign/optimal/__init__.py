"""The best poses that a cell allows: chosen out of a pool, with a proof of how good they are."""

from posedesign.optimal.goal import GOALS
from posedesign.optimal.planning import plan_fewest, plan_optimal
from posedesign.optimal.result import OptimalPlan
from posedesign.optimal.wish import Wish

__all__ = ["GOALS", "OptimalPlan", "Wish", "plan_fewest", "plan_optimal"]
