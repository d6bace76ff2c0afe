"""Measurements: what each kind sees, its noise, and its simulation."""

from calib.measurement.base import Measurement
from calib.measurement.data import TouchUps
from calib.measurement.touch_up import TouchUp, ViewLine

__all__ = ["Measurement", "TouchUp", "TouchUps", "ViewLine"]
