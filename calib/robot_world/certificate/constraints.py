"""Every quadratic equation that holds on a pair of rotations, written about the identity.

A rotation matrix satisfies ``Rᵀ R = I`` and ``R Rᵀ = I`` (columns and rows orthonormal) and
``cof R = R`` (each column, and each row, is the cross product of the other two: right-handed).
These are 21 equations with one dependency, the trace of the first two: 20 in all, and every
quadratic polynomial that vanishes on SO(3) is a combination of them: ten numbers (R, 1) make 55
products, and only 1 + 9 + 25 functions of degree two or less are different on SO(3). None mixes
two rotations. What is redundant for a rotation is not so for its relaxation: without them it is
not tight.

With R = I + U, each reads ``2 slope·vec U + vec Uᵀ bend vec U = 0``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from calib.se3 import FloatArray

_PER_ROTATION = 20
"""Independent equations of one rotation."""

_RANK_TOLERANCE = 1e-9
"""Singular values of matrices of small whole numbers are zero below this, or order one."""


@dataclass(frozen=True, eq=False)
class Constraints:
    """The equations of one rotation, split by what a stationary point fixes.

    Attributes
    ----------
    bends, slopes : ndarray (20, 9, 9), (20, 9)
        The equations; the bends are orthonormal in the Frobenius norm.
    balance : ndarray (20, 9)
        Multipliers of least norm by which the slopes balance a force: ``slopesᵀ (balance f)`` is
        the part of f that is normal to SO(3) at the identity.
    flat : ndarray (14, 9, 9)
        Orthonormal bends of the combinations without slope: they can be added at will.
    """

    bends: FloatArray
    slopes: FloatArray
    balance: FloatArray
    flat: FloatArray


@cache
def rotation_constraints() -> Constraints:
    """The equations of one rotation about the identity."""
    quadratic, linear = _equations()
    slopes = apply_to_identity(quadratic) + linear
    # An orthonormal basis of the bends: no equation has a slope alone, so the slopes follow.
    U, size, Vt = np.linalg.svd(quadratic.reshape(len(quadratic), 81), full_matrices=False)
    keep = size > _RANK_TOLERANCE
    bends = Vt[keep].reshape(-1, 9, 9)
    slopes = (U[:, keep] / size[keep]).T @ slopes
    W, strength, Ft = np.linalg.svd(slopes)
    normal = int(np.sum(strength > _RANK_TOLERANCE))
    balance = (W[:, :normal] / strength[:normal]) @ Ft[:normal]
    flat = np.einsum("kj,kab->jab", W[:, normal:], bends)
    return Constraints(bends, slopes, balance, flat)


def apply_to_identity(quadratic: FloatArray) -> FloatArray:
    """Products ``(..., 9)`` of matrices ``(..., 9, 9)`` with vec I."""
    return np.asarray(quadratic[..., [0, 4, 8]].sum(axis=-1))


def _equations() -> tuple[FloatArray, FloatArray]:
    """Matrices M ``(21, 9, 9)`` and vectors m ``(21, 9)``: ``rᵀ M r + 2 m·r`` is the same number
    for the vec r, row by row, of all rotations.
    """
    quadratic, linear = [], []
    for j in range(3):
        for k in range(j, 3):
            pair = np.zeros((3, 3))
            pair[j, k] += 0.5
            pair[k, j] += 0.5
            quadratic += [np.kron(np.eye(3), pair), np.kron(pair, np.eye(3))]
            linear += [np.zeros(9), np.zeros(9)]
    for i in range(3):
        for j in range(3):
            (a, b), (c, d) = ((i + 1) % 3, (i + 2) % 3), ((j + 1) % 3, (j + 2) % 3)
            minor = np.zeros((9, 9))
            minor[3 * a + c, 3 * b + d] += 0.5
            minor[3 * a + d, 3 * b + c] -= 0.5
            entry = np.zeros(9)
            entry[3 * i + j] = -0.5
            quadratic.append(minor + minor.T)
            linear.append(entry)
    return np.array(quadratic), np.array(linear)
