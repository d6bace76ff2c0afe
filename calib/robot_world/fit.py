"""Where an adjustment of pairs ended: X, Z, the rows there, and the information on them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from calib.se3 import BoolArray, FloatArray, IntArray

_LARGEST_INVERSE = 1e14
"""Element of the inverse of an information of unit diagonal beyond which that is singular."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the adjustment of T sets of N pairs ended.

    Attributes
    ----------
    X, Z : ndarray (T, 4, 4)
    cost : ndarray (T,)
        Sum of the squares of the white rows: χ² of 6 N - 12 degrees of freedom.
    white : ndarray (6, T, N)
        White rows of each pair.
    jacobian : ndarray (12, 6, T, N)
        Their derivatives by the errors of X (rotation, translation) and Z.
    information : ndarray (T, 12, 12)
        Inverse of the covariance of X and Z.
    iterations : ndarray of int (T,)
    converged : ndarray of bool (T,)
    """

    X: FloatArray
    Z: FloatArray
    cost: FloatArray
    white: FloatArray
    jacobian: FloatArray
    information: FloatArray
    iterations: IntArray
    converged: BoolArray

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariances ``(T, 12, 12)`` of X and Z, to first order."""
        diagonal = np.diagonal(self.information, axis1=1, axis2=2)
        size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        scale = size[:, :, None] * size[:, None, :]
        scaled = self.information / scale
        seen = np.isfinite(scaled).all(axis=(1, 2))
        scaled = np.where(seen[:, None, None], scaled, 0.0)
        try:
            inverse = np.linalg.inv(scaled)
            poor = ~(np.abs(inverse).max(axis=(1, 2)) < _LARGEST_INVERSE)
        except np.linalg.LinAlgError:
            inverse, poor = np.empty_like(scaled), np.ones(len(scaled), dtype=bool)
        if poor.any():
            inverse[poor] = np.linalg.pinv(scaled[poor], hermitian=True)
        return np.asarray(inverse / scale)

    def of(self, trials: IntArray) -> Fit:
        """The fits of some of the sets."""
        return Fit(
            **{
                part.name: np.take(getattr(self, part.name), trials, axis=_SETS_AXIS[part.name])
                for part in fields(self)
            }
        )

    def with_others(self, trials: IntArray, others: Fit) -> Fit:
        """These fits with others in the place of some of them."""
        values = {}
        for part in fields(self):
            axis = _SETS_AXIS[part.name]
            value = np.moveaxis(getattr(self, part.name).copy(), axis, 0)
            value[trials] = np.moveaxis(getattr(others, part.name), axis, 0)
            values[part.name] = np.moveaxis(value, 0, axis)
        return Fit(**values)


_SETS_AXIS = {part.name: 0 for part in fields(Fit)} | {"white": 1, "jacobian": 2}
"""Axis of each array of :class:`Fit` along which the sets stand."""
