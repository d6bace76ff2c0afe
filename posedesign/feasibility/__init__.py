"""Poses that the robot can really take: every constraint, one verdict, its reason."""

from posedesign.feasibility.checker import Checker, Verdicts
from posedesign.feasibility.constraint import Constraint
from posedesign.feasibility.postures import Postures, nearest_postures
from posedesign.feasibility.situation import Situation

__all__ = ["Checker", "Constraint", "Postures", "Situation", "Verdicts", "nearest_postures"]
