"""Linear hand-eye calibration by the Kronecker product (Andreff, Horaud and Espiau 1999, 2001).

One motion gives twelve equations linear in a matrix V, which stands for R_X, and p_X::

    [ 1 - R_P ⊗ R_Q     0    ] [vec V]   [ 0 ]
    [   1 ⊗ p_Qᵀ     1 - R_P ] [ p_X ] = [p_P]         row-major vec

V is made a rotation afterwards (divided by the cube root of its determinant, then projected: the
projection alone does both), p_X is kept as it comes. Nine rows without unit and three lengths are
added unweighted, so the answer depends on the unit of length.

The rotation rows leave the scale of V free; only the translation rows fix it. They do not where
the target stays in one place c of the camera's view, as in every touch-up: ``p_Q = (1 - R_Q) c``,
and p_X is wrong along R_X c by as much as the scale is, which the misfit of the result shows.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import kronecker, least_squares
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods.relative_motions import centred, complete
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, from the motions of all pairs of poses in both directions."""
    solution = least_squares(*_rows(pairs))
    V = solution[:, :9].reshape(-1, 3, 3)
    sign = np.where(np.linalg.det(V) < 0.0, -1.0, 1.0)[:, None, None]
    return complete(pairs, se3.project_to_rotation(sign * V), solution[:, 9:])


def _rows(pairs: PairSets) -> tuple[FloatArray, FloatArray]:
    """Equations ``(T, 15N, 12)`` and right sides with the sum of squares of all motions, over N.

    Notes
    -----
    Let ``K_i = R_A ⊗ R_B`` of pose i, ``Z_i = R_A V R_Bᵀ`` its product with vec V, and K and Z the
    means. A row of rotations, times R_A and R_Bᵀ of pose j, is ``Z_j - Z_i``. A row of
    translations, times R_A of pose j, is ``(E_i - E_j) - Z_j (d_i - d_j)`` with
    ``E = R_A p_X + p_A`` and ``d = p_B``. Written with what is centred, the sums over all i and j
    of the squares are N times the sums over i of::

        |E_i - Z d_i|² + |E_i - Z_i d_i|² + |Z_i - Z|² of rows weighted by  2 + mean(d dᵀ)

    the last of them, with the Cholesky factor of that 3 x 3 matrix, for both kinds of row.
    """
    A, B, T, N = pairs.A, pairs.B, pairs.T, pairs.N
    R_A, p_A, d = centred(A[..., :3, :3]), centred(A[..., :3, 3]), centred(B[..., :3, 3])
    K_i = kronecker(A, B)
    K = pairs.kronecker_mean
    weight = 2.0 * np.eye(3) + np.swapaxes(d, 1, 2) @ d / N
    factor = np.linalg.cholesky(weight)[:, None, None]
    # Index c of the rows (a, c) of K is the one that multiplies d and the factor.
    turned = np.swapaxes(factor, -1, -2) @ (K_i - K[:, None]).reshape(T, N, 3, 3, 9)
    rows = np.zeros((T, 15, N, 12))
    rows[:, :9, :, :9] = turned.reshape(T, N, 9, 9).swapaxes(1, 2)
    along = d[:, :, None, None, :]
    rows[:, 9:12, :, :9] = -(along @ K.reshape(T, 1, 3, 3, 9))[..., 0, :].swapaxes(1, 2)
    rows[:, 12:, :, :9] = -(along @ K_i.reshape(T, N, 3, 3, 9))[..., 0, :].swapaxes(1, 2)
    rows[:, 9:12, :, 9:] = rows[:, 12:, :, 9:] = R_A.swapaxes(1, 2)
    right_side = np.zeros((T, 15, N))
    right_side[:, 9:12] = right_side[:, 12:] = -p_A.swapaxes(1, 2)
    return rows.reshape(T, 15 * N, 12), right_side.reshape(T, 15 * N)
