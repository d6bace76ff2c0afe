"""Proof after a calibration: acceptance tests, and whether the robot is still the same."""

from posedesign.acceptance.judge import Judged, Verdict, judge
from posedesign.acceptance.places import AcceptancePlan, AcceptanceRequest, plan_acceptance
from posedesign.acceptance.recheck import RecheckPlan, Watch, plan_recheck

__all__ = [
    "AcceptancePlan",
    "AcceptanceRequest",
    "Judged",
    "RecheckPlan",
    "Verdict",
    "Watch",
    "judge",
    "plan_acceptance",
    "plan_recheck",
]
