"""Residuals and their derivative: the blocks that everything but the model works on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from calib.model.context import MeasurementContext
from calib.se3 import FloatArray

if TYPE_CHECKING:
    from calib.model.calibration_model import CalibrationModel


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals of measurements and their derivative, at one or many sets of parameters.

    Attributes
    ----------
    model : CalibrationModel
    view : MeasurementContext
    rows_last : array (m, S)
        Prediction less reading [m, rad], posture last.
    jacobian_last : array (p, m, S)
    motion : array (p, 6, S)
        Twists of the tool against its target, see :meth:`ParameterBlock.move`.
    root : array (S,), optional
        What whitened rows are multiplied by: square roots of the weights of measurements.
    """

    model: CalibrationModel
    view: MeasurementContext
    rows_last: FloatArray
    jacobian_last: FloatArray
    motion: FloatArray
    root: FloatArray | None = None

    @property
    def rows(self) -> FloatArray:
        """Residuals ``(..., N, m)`` [m, rad]."""
        return self.view.posture_first(self.rows_last)

    @property
    def jacobian(self) -> FloatArray:
        """Blocks ``(..., N, m, p)``."""
        return self.view.posture_first(self.jacobian_last)

    @cached_property
    def white_last(self) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(m, S)`` and blocks ``(p, m, S)`` over the noise, posture last."""
        rows, J = self.model.whiten_last(self.rows_last, self.view), self._white_jacobian()
        if self.root is not None:
            return rows * self.root, J * self.root
        return rows, J

    def _white_jacobian(self) -> FloatArray:
        model, J = self.model, self.jacobian_last
        out = np.zeros_like(J)
        for kind, columns, part in model.by_kind(self.view):
            k, motion = kind.rows, self.motion[:, :, columns]
            rows = self.rows_last[:k, columns]
            white = kind.whiten_derivative(J[:, :k, columns], motion, part, rows)
            if len(model.measurements) == 1:
                return white
            out[:, :k, columns] = white
        return out

    @property
    def white_rows(self) -> FloatArray:
        """Residuals ``(..., N, m)`` over the noise: of unit variance where the model is right."""
        return self.view.posture_first(self.white_last[0])

    @property
    def white_jacobian(self) -> FloatArray:
        """Blocks ``(..., N, m, p)`` over the noise."""
        return self.view.posture_first(self.white_last[1])

    @property
    def noise_root(self) -> FloatArray:
        """Square roots ``(..., N, m, m)`` of the covariance of each measurement's rows."""
        m, width = self.rows_last.shape
        unit = np.broadcast_to(np.eye(m)[:, :, None], (m, m, width))
        if len(self.model.measurements) == 1:
            return self.view.posture_first(self.model.measurement.colour(unit, self.view))
        out = np.zeros((m, m, width))
        for kind, columns, part in self.model.by_kind(self.view):
            k = kind.rows
            out[:k, :k, columns] = kind.colour(unit[:k, :k, columns], part)
        return self.view.posture_first(out)
