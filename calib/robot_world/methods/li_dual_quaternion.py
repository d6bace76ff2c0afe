"""Linear solution of A X = Z B by dual quaternions (Li, Wang and Wu 2010).

A transform is the dual quaternion ``q + ε q'`` with ``q' = ½ p q`` (the text's later ½ q p is a
misprint). With ``z + ε z'`` for Z, which the paper forgets to define, Eq. 10 is linear in
(x, x', z, z')::

    [ ã   0  -b̃   0 ]
    [ ã'  ã  -b̃' -b̃ ]  (x, x', z, z') = 0        Eq. 12, corrected

ã being the matrix of multiplication from the left and b̃ from the right. The 8N x 16 matrix of all
pairs has a null space of dimension two, since (0, x, 0, z) solves it as well; Eq. 14 picks the
answer in it.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.algebra import (
    dual_part,
    left_matrix,
    right_matrix,
    transform_in_plane,
    transforms,
    triangle,
)
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate
from calib.se3 import FloatArray


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, rotations and translations together.

    Parameters
    ----------
    pairs : PairSets
        Measured pairs, N >= 3. Eq. 12 adds rows with and without a length, unweighted: the
        answer depends on the unit of length.

    Returns
    -------
    Estimate
        X and Z ``(T, 4, 4)``.

    Notes
    -----
    The signs of the quaternions are made consistent first, which the paper omits. Under noise no
    point of the plane spanned by the last two singular vectors satisfies Eq. 14a-d; see
    :func:`_unit_combination` for the choice. Where noise makes Eq. 14 unsolvable the method fails:
    its residuals show it.
    """
    A, B, T, N = pairs.A, pairs.B, pairs.T, pairs.N
    a, b = pairs.quaternions
    rows = np.zeros((T, N, 8, 16))
    L, R = left_matrix(a), right_matrix(b)
    rows[..., :4, 0:4] = rows[..., 4:, 4:8] = L
    rows[..., :4, 8:12] = rows[..., 4:, 12:16] = -R
    rows[..., 4:, 0:4] = left_matrix(dual_part(A[..., :3, 3], a))
    rows[..., 4:, 8:12] = -right_matrix(dual_part(B[..., :3, 3], b))
    plane = np.linalg.svd(triangle(rows.reshape(T, 8 * N, 16)))[2][..., 14:, :]  # (T, 2, 16)
    solution = _unit_combination(plane).reshape(T, 4, 4)
    return Estimate(
        transforms(solution[:, 0], solution[:, 1]), transforms(solution[:, 2], solution[:, 3])
    )


def _unit_combination(plane: FloatArray) -> FloatArray:
    """Solution ``(T, 16)`` in the planes ``(T, 2, 16)`` by Eq. 14, corrected.

    Eq. 14a-d are four equations in two unknowns. The sum of 14b and 14d (right side 0 in both),
    ``x·x' + z·z' = 0``, gives the ratio of the two unknowns; the scale follows when x and z are
    normalised.
    """
    v = plane.reshape(-1, 2, 4, 4)  # vector, one of x x' z z', component
    real, dual = v[:, :, 0::2].reshape(-1, 2, 8), v[:, :, 1::2].reshape(-1, 2, 8)
    weights = transform_in_plane(real, dual)
    return np.asarray((weights[:, None] @ plane)[:, 0])
