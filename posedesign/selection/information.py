"""Information matrices of many choices at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from calib.se3 import BoolArray, FloatArray

SEEN = 1e-11
"""Smallest eigenvalue, columns of unit length, from which a choice is taken to see everything; the
information is a square, and has lost half of the digits already."""


class Informations:
    """Of choices of poses.

    Parameters
    ----------
    M : ndarray (T, p, p)
        Scaled.
    largest : callable
        Gives the largest absolute entry ``(T, p)`` of each column of the regressor.
    """

    def __init__(self, M: FloatArray, largest: Callable[[], FloatArray]) -> None:
        self.M = M
        self._largest = largest

    @cached_property
    def length(self) -> FloatArray:
        """Of the columns ``(T, p)``; 1 where it is zero."""
        squares = np.einsum("tpp->tp", self.M)
        return np.asarray(np.sqrt(np.where(squares > 0.0, squares, 1.0)))

    @cached_property
    def covariance(self) -> tuple[FloatArray, BoolArray]:
        """Covariances ``(T, p, p)``, and which of the choices ``(T,)`` see all parameters."""
        unit = self.length[:, :, None] * self.length[:, None, :]
        values, vectors = np.linalg.eigh(self.M / unit)
        seen = values[:, 0] > SEEN
        half = vectors / np.sqrt(np.where(seen[:, None], values, 1.0))[:, None, :]
        return half @ np.swapaxes(half, 1, 2) / unit, seen

    @cached_property
    def largest(self) -> FloatArray:
        """Largest absolute entry of each column ``(T, p)``; 1 where all are zero."""
        found = self._largest()
        return np.where(found > 0.0, found, 1.0)
