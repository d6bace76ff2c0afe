"""The robot identified from a cell's measurements, and corrected with what was identified."""

from posedesign.identification.comparison import Identified, identify_models
from posedesign.identification.file import results_as_dict

__all__ = ["Identified", "identify_models", "results_as_dict"]
