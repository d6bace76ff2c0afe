"""The calibration model: from postures and parameters to what is measured, and its derivative."""

from calib.model.calibration_model import CalibrationModel
from calib.model.priors import KnownDistance

__all__ = ["CalibrationModel", "KnownDistance"]
