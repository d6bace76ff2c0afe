"""Measurements: what each kind sees, its noise, and its simulation."""

from calib.model.context import Setup
from calib.model.measurements.board_view import BoardShape, BoardView, BoardViews, board_views
from calib.model.measurements.data import Measurements, touch_ups
from calib.model.measurements.kinds import (
    CameraPose,
    Distance,
    Measurement,
    PlaneContact,
    Point,
    Pose,
    TouchUp,
    ViewLine,
)

KINDS = {
    kind.name: kind for kind in (TouchUp, ViewLine, PlaneContact, Point, Pose, CameraPose, Distance)
}

__all__ = [
    "KINDS",
    "BoardShape",
    "BoardView",
    "BoardViews",
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
    "board_views",
    "touch_ups",
]
