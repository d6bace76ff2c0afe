"""Poses that the robot can really take: every constraint, one verdict, its reason."""

from posedesign.constraints.checker import Checker, Verdicts
from posedesign.constraints.constraint import ROUNDING, Constraint, Situation
from posedesign.constraints.postures import Postures, nearest_postures
from posedesign.constraints.retreat import MotionChecker, Retreat
from posedesign.constraints.space import Collision, SelfCollision
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
