"""Poses that the robot can really take: every constraint, one verdict, its reason."""

from posedesign.constraints.checker import ROUNDING as ROUNDING
from posedesign.constraints.checker import Checker as Checker
from posedesign.constraints.checker import Constraint as Constraint
from posedesign.constraints.checker import Postures as Postures
from posedesign.constraints.checker import Situation as Situation
from posedesign.constraints.checker import Verdicts as Verdicts
from posedesign.constraints.checker import nearest_postures as nearest_postures
from posedesign.constraints.space import Collision as Collision
from posedesign.constraints.space import MotionChecker as MotionChecker
from posedesign.constraints.space import Retreat as Retreat
from posedesign.constraints.space import SelfCollision as SelfCollision
from posedesign.constraints.visibility import Distance as Distance
from posedesign.constraints.visibility import InImage as InImage
from posedesign.constraints.visibility import Tilt as Tilt
