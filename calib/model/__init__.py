"""The calibration model: from postures and parameters to what is measured, and its derivative."""

from calib.model.calibration_model import CalibrationModel, KnownDistance, Linearisation
from calib.model.context import Setup
from calib.model.simulation import simulate, touch

__all__ = [
    "CalibrationModel",
    "KnownDistance",
    "Linearisation",
    "Setup",
    "simulate",
    "touch",
]
