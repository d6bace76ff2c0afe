"""Motions between poses: their order, what is in their way, and how long the tour takes."""

from posedesign.motion.approach import find_approaches
from posedesign.motion.known_motions import KnownMotions
from posedesign.motion.route import Router
from posedesign.motion.waypoints import Route

__all__ = ["KnownMotions", "Route", "Router", "find_approaches"]
