"""Measurements: what each kind sees, its noise, and its simulation."""

from calib.model.context import Setup as Setup
from calib.model.measurements.board_view import BoardShape as BoardShape
from calib.model.measurements.board_view import BoardView as BoardView
from calib.model.measurements.board_view import BoardViews as BoardViews
from calib.model.measurements.board_view import board_views as board_views
from calib.model.measurements.data import Measurements as Measurements
from calib.model.measurements.data import touch_ups as touch_ups
from calib.model.measurements.kinds import CameraPose as CameraPose
from calib.model.measurements.kinds import Distance as Distance
from calib.model.measurements.kinds import Measurement as Measurement
from calib.model.measurements.kinds import PlaneContact as PlaneContact
from calib.model.measurements.kinds import Point as Point
from calib.model.measurements.kinds import Pose as Pose
from calib.model.measurements.kinds import TouchUp as TouchUp
from calib.model.measurements.kinds import ViewLine as ViewLine

KINDS = {
    kind.name: kind for kind in (TouchUp, ViewLine, PlaneContact, Point, Pose, CameraPose, Distance)
}
