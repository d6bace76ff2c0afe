"""Motions between poses: their order, what is in their way, and how long the tour takes."""

from posedesign.motion.known_motions import KnownMotions, find_approaches
from posedesign.motion.route import Route, Router

__all__ = ["KnownMotions", "Route", "Router", "find_approaches"]
