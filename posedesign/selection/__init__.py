"""Choosing poses out of a pool, from their blocks alone: arrays ``(N, m, p)``, no robot."""

from posedesign.selection.candidates import Candidates, shortened
from posedesign.selection.criteria import (
    CRITERIA,
    criterion_by_name,
    largest_deviation,
    mean_deviation,
    wanted_deviations,
)
from posedesign.selection.criterion import Criterion
from posedesign.selection.indices import PER_MRAD_AND_MM, Indices, condition_inf, evaluate
from posedesign.selection.search import METHODS
from posedesign.selection.select import Fewest, Selection, select, select_fewest

__all__ = [
    "CRITERIA",
    "METHODS",
    "PER_MRAD_AND_MM",
    "Candidates",
    "Criterion",
    "Fewest",
    "Indices",
    "Selection",
    "condition_inf",
    "criterion_by_name",
    "evaluate",
    "largest_deviation",
    "mean_deviation",
    "select",
    "select_fewest",
    "shortened",
    "wanted_deviations",
]
