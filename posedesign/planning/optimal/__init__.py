"""The best poses that a cell allows: chosen out of a pool, with a proof of how good they are."""

from posedesign.planning.optimal.plan import plan_fewest as plan_fewest
from posedesign.planning.optimal.plan import plan_optimal as plan_optimal
from posedesign.planning.optimal.request import OBJECTIVES as OBJECTIVES
from posedesign.planning.optimal.request import Request as Request
from posedesign.planning.optimal.result import NextPoses as NextPoses
from posedesign.planning.optimal.result import OptimalPlan as OptimalPlan
from posedesign.planning.optimal.sequential import plan_next as plan_next
from posedesign.planning.optimal.sequential import plan_next_views as plan_next_views
