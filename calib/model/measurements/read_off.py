"""Measurements that are read off an instrument while the arm stands: points, poses, distances."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib.batch_last import along, cross, matrices_of, turn_back
from calib.model.context import MeasurementContext
from calib.model.measurements.base import Measurement
from calib.se3 import FloatArray, inverse_left_jacobian, rotation_exp, rotation_log


class Point(Measurement):
    """Place of a point of the tool in the frame of a tracker or a measuring arm.

    Parameters
    ----------
    sigma : float, array_like (3,) or None
        Standard deviations [m] along the axes of the instrument.
    """

    name = "point"
    rows = 3

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`."""
        return view.in_target(view.error)

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`: velocities are those against the turning frame."""
        return view.in_target(motion[:, :3])


class Pose(Measurement):
    """Pose of the tool in the frame of a tracker: place, then rotation vector.

    Residuals of the rotation are the turn from what was read to what is predicted, in the axes of
    the instrument.

    Parameters
    ----------
    sigma : float, array_like (6,) or None
        Standard deviations along [m] and about [rad] the axes of the instrument.
    """

    name = "pose"
    rows = 6
    turns = 3
    sees_rotation = True

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`."""
        vector = rotation_log(matrices_of(view.in_target(view.tool))).T
        return np.concatenate([view.in_target(view.error), vector])

    def difference(self, predicted: FloatArray, observed: FloatArray) -> FloatArray:
        """See :meth:`Measurement.difference`: on the manifold."""
        return _pose_difference(predicted, observed)

    def disturb(self, readings: FloatArray, noise: FloatArray) -> FloatArray:
        """See :meth:`Measurement.disturb`."""
        return _pose_disturbed(readings, noise)

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`."""
        turned = _log_derivative(view.in_target(motion[:, 3:]), rows)
        return np.concatenate([view.in_target(motion[:, :3]), turned], axis=1)


class CameraPose(Measurement):
    """Pose of the target as a camera on the tool sees it: place, then rotation vector.

    Parameters
    ----------
    sigma : float, array_like (6,) or None
        Standard deviations along [m] and about [rad] the axes of the camera.
    """

    name = "camera-pose"
    rows = 6
    turns = 3
    sees_rotation = True

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`."""
        target = np.broadcast_to(view.target, view.tool.shape)
        vector = rotation_log(matrices_of(turn_back(view.tool, target))).T
        return np.concatenate([turn_back(view.tool, -view.error), vector])

    def difference(self, predicted: FloatArray, observed: FloatArray) -> FloatArray:
        """See :meth:`Measurement.difference`: on the manifold."""
        return _pose_difference(predicted, observed)

    def disturb(self, readings: FloatArray, noise: FloatArray) -> FloatArray:
        """See :meth:`Measurement.disturb`."""
        return _pose_disturbed(readings, noise)

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`: the target goes against the tool."""
        place = cross(motion[:, 3:], view.error) - motion[:, :3]
        turned = _log_derivative(turn_back(view.tool, -motion[:, 3:]), rows)
        return np.concatenate([turn_back(view.tool, place), turned], axis=1)


class Distance(Measurement):
    """Distance of the tool point from the target: a ball bar, or a wire.

    Parameters
    ----------
    sigma : float or None
        Standard deviation [m].
    """

    name = "distance"
    rows = 1
    is_distance = True

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`: the distance, and what the instrument shows more."""
        length = view.distance()[0].copy()
        for label, more in view.errors.lengths.items():
            mask = view.tiled(view.setup.target, view.targets.index(label))
            length += more if mask is None else mask * more
        return length[None]

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`."""
        return along(view.distance()[1], motion[:, :3])[:, None]


def _pose_difference(predicted: FloatArray, observed: FloatArray) -> FloatArray:
    # by quaternions: a tenth of the time that matrices take
    shown, read = (Rotation.from_rotvec(rows[3:].T) for rows in (predicted, observed))
    return np.concatenate([predicted[:3] - observed[:3], (shown * read.inv()).as_rotvec().T])


def _pose_disturbed(readings: FloatArray, noise: FloatArray) -> FloatArray:
    R = rotation_exp(noise[3:].T) @ rotation_exp(readings[3:].T)
    return np.concatenate([readings[:3] + noise[:3], rotation_log(R).T])


def _log_derivative(turning: FloatArray, rows: FloatArray) -> FloatArray:
    """Change ``(p, 3, S)`` of residual rotation vectors for turns ``(p, 3, S)`` of the prediction.

    Both in the axes of the instrument.
    """
    J = inverse_left_jacobian(rows[3:].T).transpose(1, 2, 0)  # rows, columns, S
    out = np.empty(turning.shape)
    for k in range(3):
        out[:, k] = along(J[k], turning)
    return out
