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
    length. The signs of the quaternions are made consistent first, which the paper omits. Where
    noise makes Eq. 14 unsolvable the method fails: its residuals show it.

    Eq. 14a-d are four equations in two unknowns, the weights of the last two singular vectors, and
    under noise nothing satisfies them all. The sum of 14b and 14d (right side 0 in both),
    ``x·x' + z·z' = 0``, gives the ratio; the scale follows when x and z are normalised.
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
    v = plane.reshape(T, 2, 2, 2, 4)  # vector, X or Z, real or dual, component
    weights = transform_in_plane(v[..., 0, :].reshape(T, 2, 8), v[..., 1, :].reshape(T, 2, 8))
    x, z = np.moveaxis((weights[:, None] @ plane).reshape(T, 2, 2, 4), 1, 0)
    return Estimate(transforms(x[:, 0], x[:, 1]), transforms(z[:, 0], z[:, 1]))
