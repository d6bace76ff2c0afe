"""White rows of the pairs of a network, and their derivatives by the errors of all frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from calib import se3
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.network.graph import Network, of_pairs
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Rows:
    """White rows of all pairs at frames."""

    white: FloatArray  # (N, 6)
    values: FloatArray
    """(N, 6, 18): derivatives by the errors of what is on the flange, of what is around, and of the
    base of the arm."""
    columns: IntArray
    """(N, 18): of these among the errors of all frames; the base that is the frame has zeros."""
    count: int  # of the errors of all frames

    @property
    def jacobian(self) -> sparse.csr_array:
        """Derivatives ``(6 N, count)`` of all rows."""
        N = len(self.white)
        rows = np.repeat(np.arange(6 * N), 18)
        columns = np.repeat(self.columns, 6, axis=0).ravel()
        return sparse.csr_array((self.values.ravel(), (rows, columns)), (6 * N, self.count))

    def of(self, used: BoolArray) -> Rows:
        """Return those of the pairs used."""
        return Rows(self.white[used], self.values[used], self.columns[used], self.count)

    @property
    def cost(self) -> float:
        """Sum of the squares of the white rows."""
        return float(np.sum(self.white**2))

    def taken(self, covariance: FloatArray) -> FloatArray:
        """Share ``(N, 6, 6)`` of the rows of each pair that the frames take up."""
        own = covariance[self.columns[:, :, None], self.columns[:, None]]
        return np.asarray(self.values @ own @ np.swapaxes(self.values, 1, 2))


def rows_at(net: Network, model: ErrorModel, T: FloatArray) -> Rows:
    """White rows at frames ``(F, 4, 4)``."""
    N, K = net.N, len(net.on_flange)
    X, Z, V = of_pairs(net, T)
    each = PairSets(net.A[:, None], net.B[:, None])
    white, J = linear_rows(each, model, X, Z)
    white, J = white[:, :, 0].T, J[:, :, :, 0].transpose(2, 1, 0)  # (N, 6), (N, 6, 12)
    by_Z = J[:, :, 6:]
    inner = np.zeros((N, 6, 6))  # of Z in the base of the arm, by errors of Z where all are
    inner[:, :3, :3] = inner[:, 3:, 3:] = V[:, :3, :3]
    base = net.base_of[net.j]
    own = np.flatnonzero(base >= 0)
    values = np.concatenate([J[:, :, :6], by_Z @ inner, np.zeros((N, 6, 6))], axis=2)
    if len(own):
        lever = np.tile(np.eye(6), (len(own), 1, 1))
        lever[:, 3:, :3] = -se3.skew(Z[own, :3, 3] - V[own, :3, 3])
        values[own, :, 12:] = by_Z[own] @ lever
    frames = np.stack([net.k, K + net.l, np.maximum(base, 0)], axis=1)
    columns = (6 * frames[:, :, None] + np.arange(6)).reshape(N, 18)
    return Rows(white, values, columns, 6 * len(T))
