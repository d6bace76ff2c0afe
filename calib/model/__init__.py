"""The calibration model: from postures and parameters to what is measured, and its derivative."""

from calib.model.calibration_model import CalibrationModel as CalibrationModel
from calib.model.calibration_model import KnownDistance as KnownDistance
from calib.model.calibration_model import Linearisation as Linearisation
from calib.model.context import Setup as Setup
from calib.model.simulation import simulate as simulate
from calib.model.simulation import touch as touch
