"""Identification: what the data can tell, the fit, and its result."""

from calib.identification.checks import check_enough
from calib.identification.comparison import Candidate, Comparison, compare
from calib.identification.covariance import covariance_of
from calib.identification.evidence import PriorGroup, TunedPriors, tune_priors
from calib.identification.identifiability import check_identifiable, is_identifiable
from calib.identification.reduction import Reduction, reduce
from calib.identification.result import IdentificationResult
from calib.identification.solver import (
    finite_difference_jacobian,
    identify,
    identify_batch,
)

__all__ = [
    "Candidate",
    "Comparison",
    "IdentificationResult",
    "PriorGroup",
    "Reduction",
    "TunedPriors",
    "check_enough",
    "check_identifiable",
    "compare",
    "covariance_of",
    "finite_difference_jacobian",
    "identify",
    "identify_batch",
    "is_identifiable",
    "reduce",
    "tune_priors",
]
