"""Choosing poses out of a pool, from their blocks alone: arrays ``(N, m, p)``, no robot."""

from posedesign.selection.greedy import select_fewest
from posedesign.selection.selection import Selection

__all__ = ["Selection", "select_fewest"]
