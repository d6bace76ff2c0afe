"""Poses that the robot can really take: every constraint, one verdict, its reason."""

from posedesign.constraints.checker import (
    ROUNDING,
    Checker,
    Constraint,
    Postures,
    Situation,
    Verdicts,
    nearest_postures,
)
from posedesign.constraints.space import Collision, MotionChecker, Retreat, SelfCollision
from posedesign.constraints.visibility import Distance, InImage, Tilt

__all__ = [
    "ROUNDING",
    "Checker",
    "Collision",
    "Constraint",
    "Distance",
    "InImage",
    "MotionChecker",
    "Postures",
    "Retreat",
    "SelfCollision",
    "Situation",
    "Tilt",
    "Verdicts",
    "nearest_postures",
]
