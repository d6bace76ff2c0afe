"""What makes one choice of poses better than another."""

from posedesign.selection.criteria.base import Criterion, Objective
from posedesign.selection.criteria.registry import CRITERIA, criterion_by_name

__all__ = ["CRITERIA", "Criterion", "Objective", "criterion_by_name"]
