"""Poses that the robot can really take: every constraint, one verdict, its reason."""

from posedesign.constraints.checker import Checker, Verdicts
from posedesign.constraints.constraint import Constraint
from posedesign.constraints.postures import Postures, nearest_postures
from posedesign.constraints.situation import Situation

__all__ = ["Checker", "Constraint", "Postures", "Situation", "Verdicts", "nearest_postures"]
