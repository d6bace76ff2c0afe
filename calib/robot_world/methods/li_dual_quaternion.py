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
    LEAST_SQUARE,
    LEFT,
    RIGHT,
    dual_part,
    transform_in_plane,
    transforms,
    triangle,
)
from calib.robot_world.estimate import Estimate
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray


def _rows() -> FloatArray:
    """Eq. 12 ``(16, 8, 16)`` of each of the units of a, a', b and b'."""
    rows = np.zeros((4, 4, 8, 16))
    rows[0, :, :4, 0:4] = rows[0, :, 4:, 4:8] = rows[1, :, 4:, 0:4] = LEFT
    rows[2, :, :4, 8:12] = rows[2, :, 4:, 12:16] = rows[3, :, 4:, 8:12] = -RIGHT
    return rows.reshape(16, 8, 16)


_ROWS = _rows()
_PRODUCTS = np.einsum("prc,qrd->pqcd", _ROWS, _ROWS).reshape(256, 256)
"""Sums of products of columns of Eq. 12, by products of the numbers of a, a', b and b'."""


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, rotations and translations together.

    Eq. 12 adds rows with and without a length, unweighted: the answer depends on the unit of
    length. The signs of the quaternions are made consistent first, which the paper omits. Under
    noise no point of the plane spanned by the last two singular vectors satisfies Eq. 14a-d; see
    :func:`_unit_combination` for the choice. Where noise makes Eq. 14 unsolvable the method fails:
    its residuals show it.
    """
    A, B, T, N = pairs.A, pairs.B, pairs.T, pairs.N
    a, b = pairs.quaternions
    dual_a, dual_b = dual_part(A[..., :3, 3], a), dual_part(B[..., :3, 3], b)
    both = np.concatenate([a, dual_a, b, dual_b], axis=-1)
    gram = (np.swapaxes(both, -1, -2) @ both).reshape(T, 256) @ _PRODUCTS
    values, vectors = np.linalg.eigh(gram.reshape(T, 16, 16))
    plane = np.swapaxes(vectors[..., :2], -1, -2)  # (T, 2, 16)
    poor = ~(values[:, 2] > LEAST_SQUARE * values[:, -1])
    if poor.any():
        rows = np.tensordot(both[poor], _ROWS, 1).reshape(-1, 8 * N, 16)
        plane[poor] = np.linalg.svd(triangle(rows))[2][..., 14:, :]
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
