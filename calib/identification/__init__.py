"""Identification: what the data can tell, the fit, and its result."""

from calib.identification.checks import check_enough
from calib.identification.covariance import covariance_of
from calib.identification.identifiability import check_identifiable, is_identifiable
from calib.identification.result import IdentificationResult
from calib.identification.solver import (
    finite_difference_jacobian,
    identify,
    identify_batch,
)

__all__ = [
    "IdentificationResult",
    "check_enough",
    "check_identifiable",
    "covariance_of",
    "finite_difference_jacobian",
    "identify",
    "identify_batch",
    "is_identifiable",
]
