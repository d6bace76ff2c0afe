"""The deviation of the arm from where it says, new at every stop and shared by all measured there.

An arm does not stop exactly where it says, and no parameter describes all of what it is off. The
deviation of a stop is a shift [m] and a turn [rad] of the tip, in base axes, normally distributed
about zero. All measurements at the stop are off together: the reflectors of a tool, the points of a
board, the pictures of two cameras. It is integrated out: with ``A`` the derivative of the rows of a
stop, over their own noise, by a deviation of one standard deviation, these rows have the covariance
``1 + A Aᵀ``. Its inverse root is ``1 - A V f Vᵀ Aᵀ`` with ``Aᵀ A = V λ Vᵀ`` and
``f = (1 - 1/√(1 + λ))/λ``, its root the same with ``f = (1 - √(1 + λ))/λ``: a matrix of six rows
for each stop, however many rows were measured there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.model.context import MeasurementContext
from calib.se3 import FloatArray, IntArray

_FEW_ROWS = 3
"""Rows of a measurement up to which their inverse root itself takes less than its factors."""


@dataclass(frozen=True, eq=False)
class SharedDeviation:
    """Effect of the deviations of G stops on the rows of S measurements, over their own noise."""

    A: FloatArray  # (m, 6, S): of a deviation of one standard deviation in each direction
    values: FloatArray  # (G, 6)
    vectors: FloatArray  # (G, 6, 6): values, vectors: ``Aᵀ A = V λ Vᵀ`` of each stop
    stop: IntArray | None  # (S,): stop of each measurement; None where each has its own

    @classmethod
    def of(cls, A: FloatArray, view: MeasurementContext) -> SharedDeviation:
        """Take the squares of ``A`` (m, 6, S) together at the stops of a view."""
        squares, stop = np.einsum("ris,rjs->sij", A, A, optimize=True), None
        if view.setup.shares_stops:
            stop = stops_of(view)
            squares = summed(squares, stop)
        there = np.isfinite(squares).all(axis=(1, 2))  # a fit that runs away has none
        values, vectors = np.linalg.eigh(np.where(there[:, None, None], squares, 0.0))
        values[~there] = np.nan
        return cls(A, np.maximum(values, 0.0), vectors, stop)

    def whiten(self, white: FloatArray) -> FloatArray:
        """Return rows ``(..., m, S)`` over their own noise without what stops have in common."""
        if self._root is not None:
            return np.asarray(np.einsum("rqs,...qs->...rs", self._root, white))
        return self._times(white, self._whitening)

    @cached_property
    def _root(self) -> FloatArray | None:
        """Inverse root ``(m, m, S)`` of the covariance of few rows that share with no others."""
        rows, count = len(self.A), self.A.shape[-1]
        if self.stop is not None or rows > _FEW_ROWS:
            return None
        every = np.broadcast_to(np.eye(rows)[..., None], (rows, rows, count))
        return self._times(every, self._whitening).swapaxes(0, 1)

    def colour(self, white: FloatArray) -> FloatArray:
        """Return the inverse of :meth:`whiten`: draws with what stops have in common."""
        return self._times(white, self._weight(-1.0 / (1.0 + np.sqrt(1.0 + self.values))))

    @cached_property
    def _whitening(self) -> FloatArray:
        root = np.sqrt(1.0 + self.values)
        return self._weight(1.0 / (root * (1.0 + root)))  # (1 - 1/root)/λ, without 0/0

    def _weight(self, factor: FloatArray) -> FloatArray:
        """Return ``V f Vᵀ`` of each stop, ``(6, 6, G)``."""
        weight = (self.vectors * factor[:, None]) @ np.swapaxes(self.vectors, 1, 2)
        return np.ascontiguousarray(weight.transpose(1, 2, 0))

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant of the covariance over the own noise."""
        return float(np.log1p(self.values).sum())

    def _times(self, white: FloatArray, weight: FloatArray) -> FloatArray:
        inner = np.einsum("rts,...rs->...ts", self.A, white, optimize=True)
        if self.stop is not None:
            together = np.zeros((*inner.shape[:-1], weight.shape[-1]))
            np.add.at(together.T, self.stop, inner.T)
            inner = together
        inner = np.einsum("ijs,...js->...is", weight, inner, optimize=True)
        if self.stop is not None:
            inner = inner[..., self.stop]
        return np.asarray(white - np.einsum("rts,...ts->...rs", self.A, inner, optimize=True))


def stops_of(view: MeasurementContext) -> IntArray:
    """Return the stop ``(S,)`` of each posture, the stops of each trial apart."""
    stops = view.setup.stops
    trials = view.q.shape[1] // max(view.setup.count, 1)
    each = int(stops.max(initial=-1)) + 1
    return np.asarray((stops + each * np.arange(trials)[:, None]).ravel())


def summed(each: FloatArray, stops: IntArray) -> FloatArray:
    """Return the sums ``(G, ...)`` over the measurements of each stop, of ``(N, ...)``."""
    out = np.zeros((int(stops.max(initial=-1)) + 1, *each.shape[1:]))
    np.add.at(out, stops, each)
    return out
