"""Identification: what the data can tell, the fit, and its result."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.identification.candidate import Candidate as Candidate
    from calib.identification.candidate import ExpectedError as ExpectedError
    from calib.identification.candidate import Reference as Reference
    from calib.identification.candidate import Workplace as Workplace
    from calib.identification.candidate import fit_reference as fit_reference
    from calib.identification.comparison import Comparison as Comparison
    from calib.identification.comparison import Trial as Trial
    from calib.identification.comparison import compare as compare
    from calib.identification.evidence import PriorGroup as PriorGroup
    from calib.identification.evidence import TunedPriors as TunedPriors
    from calib.identification.evidence import tune_priors as tune_priors
    from calib.identification.identifiability import Reduction as Reduction
    from calib.identification.identifiability import check_enough as check_enough
    from calib.identification.identifiability import check_identifiable as check_identifiable
    from calib.identification.identifiability import covariance_of as covariance_of
    from calib.identification.identifiability import is_identifiable as is_identifiable
    from calib.identification.identifiability import reduce as reduce
    from calib.identification.least_squares import minimise as minimise
    from calib.identification.prediction import Against as Against
    from calib.identification.prediction import Carried as Carried
    from calib.identification.prediction import part_of as part_of
    from calib.identification.prediction import predict_accuracy as predict_accuracy
    from calib.identification.prediction import tool_motion as tool_motion
    from calib.identification.result import DISPLAY as DISPLAY
    from calib.identification.result import IdentificationResult as IdentificationResult
    from calib.identification.result import KindNoise as KindNoise
    from calib.identification.solver import identify as identify
    from calib.identification.solver import identify_batch as identify_batch
else:
    __getattr__ = load_when_asked(__name__)
