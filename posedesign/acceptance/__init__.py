"""Proof after a calibration: acceptance tests, and whether the robot is still the same."""

from posedesign.acceptance.judge import Judged as Judged
from posedesign.acceptance.judge import Verdict as Verdict
from posedesign.acceptance.judge import judge as judge
from posedesign.acceptance.places import AcceptancePlan as AcceptancePlan
from posedesign.acceptance.places import AcceptanceRequest as AcceptanceRequest
from posedesign.acceptance.places import plan_acceptance as plan_acceptance
from posedesign.acceptance.recheck import RecheckPlan as RecheckPlan
from posedesign.acceptance.recheck import Watch as Watch
from posedesign.acceptance.recheck import plan_recheck as plan_recheck
