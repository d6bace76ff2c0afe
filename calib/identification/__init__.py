"""Identification: what the data can tell, the fit, and its result."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.identification.candidate import Candidate, Reference, Trial, fit_reference
    from calib.identification.comparison import Comparison, compare
    from calib.identification.evidence import PriorGroup, TunedPriors, tune_priors
    from calib.identification.identifiability import (
        Reduction,
        check_enough,
        check_identifiable,
        covariance_of,
        is_identifiable,
        reduce,
    )
    from calib.identification.least_squares import minimise
    from calib.identification.prediction import (
        Against,
        Carried,
        ExpectedError,
        Workplace,
        part_of,
        predict_accuracy,
        tool_motion,
    )
    from calib.identification.result import DISPLAY, IdentificationResult, KindNoise
    from calib.identification.solver import finite_difference_jacobian, identify, identify_batch
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "DISPLAY",
    "Against",
    "Candidate",
    "Carried",
    "Comparison",
    "ExpectedError",
    "IdentificationResult",
    "KindNoise",
    "PriorGroup",
    "Reduction",
    "Reference",
    "Trial",
    "TunedPriors",
    "Workplace",
    "check_enough",
    "check_identifiable",
    "compare",
    "covariance_of",
    "finite_difference_jacobian",
    "fit_reference",
    "identify",
    "identify_batch",
    "is_identifiable",
    "minimise",
    "part_of",
    "predict_accuracy",
    "reduce",
    "tool_motion",
    "tune_priors",
]
