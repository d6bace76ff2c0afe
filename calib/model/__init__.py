"""The calibration model: from postures and parameters to what is measured, and its derivative."""

from calib.model.calibration_model import CalibrationModel
from calib.model.context import Setup
from calib.model.linearisation import Linearisation
from calib.model.priors import KnownDistance
from calib.model.simulation import simulate
from calib.model.touching import touch

__all__ = [
    "CalibrationModel",
    "KnownDistance",
    "Linearisation",
    "Setup",
    "simulate",
    "touch",
]
