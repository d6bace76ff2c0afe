"""Measurements: what each kind sees, its noise, and its simulation."""

from calib.arm_view import Setup
from calib.measurement.base import Measurement
from calib.measurement.data import Measurements, touch_ups
from calib.measurement.read_off import CameraPose, Distance, Point, Pose
from calib.measurement.touch_up import PlaneContact, TouchUp, ViewLine

KINDS = {
    kind.name: kind for kind in (TouchUp, ViewLine, PlaneContact, Point, Pose, CameraPose, Distance)
}

__all__ = [
    "KINDS",
    "CameraPose",
    "Distance",
    "Measurement",
    "Measurements",
    "PlaneContact",
    "Point",
    "Pose",
    "Setup",
    "TouchUp",
    "ViewLine",
    "touch_ups",
]
