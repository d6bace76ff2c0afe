"""What the methods share: quaternion products as matrices, batched least squares, projections.

Everything here works on batches: T problems of N pose pairs each, in arrays ``(T, N, ...)``.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.se3 import FloatArray


def left_matrix(quaternion: FloatArray) -> FloatArray:
    """Matrix of multiplication from the left: ``left_matrix(p) @ q`` is the product p q.

    Parameters
    ----------
    quaternion : ndarray (..., 4)
        In the order w, x, y, z; of any norm.

    Returns
    -------
    ndarray (..., 4, 4)
        The matrix that Li et al. 2010 write ã (after Eq. 11).
    """
    return _product_matrix(quaternion, 1.0)


def right_matrix(quaternion: FloatArray) -> FloatArray:
    """Matrix of multiplication from the right: ``right_matrix(q) @ p`` is the product p q.

    Parameters
    ----------
    quaternion : ndarray (..., 4)
        In the order w, x, y, z; of any norm.

    Returns
    -------
    ndarray (..., 4, 4)
        The matrix that Li et al. 2010 write b̃ (after Eq. 11, where the tilde is missing).
    """
    return _product_matrix(quaternion, -1.0)


def _product_matrix(q: FloatArray, handedness: float) -> FloatArray:
    out = np.empty((*q.shape, 4))
    out[..., 0, 0] = q[..., 0]
    out[..., 0, 1:] = -q[..., 1:]
    out[..., 1:, 0] = q[..., 1:]
    out[..., 1:, 1:] = q[..., :1, None] * np.eye(3) + handedness * se3.skew(q[..., 1:])
    return out


def conjugate(quaternion: FloatArray) -> FloatArray:
    """Conjugate ``(..., 4)``: the inverse of a unit quaternion."""
    return np.asarray(quaternion * [1.0, -1.0, -1.0, -1.0])


def apply_matrix(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Product of matrices ``(..., m, n)`` and vectors ``(..., n)``, batch dimensions broadcast."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def triangle(matrix: FloatArray) -> FloatArray:
    """Factor R ``(..., n, n)`` of the QR factorisations of ``(..., m, n)``, m >= n.

    It has the singular values and right singular vectors of the whole, at a fraction of the size.
    """
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def least_squares(matrix: FloatArray, right_side: FloatArray) -> FloatArray:
    """Least-squares solutions ``(T, n)`` of ``matrix (T, m, n) @ u = right_side (T, m)``, m > n.

    A QR factorisation of the matrix with the right side appended keeps the condition number where
    the normal equations would square it. The triangle is inverted by its singular values, so that
    one problem without a unique solution cannot stop the whole batch: it gets the shortest one.
    """
    n = matrix.shape[-1]
    R = triangle(np.concatenate([matrix, right_side[..., None]], axis=-1))
    inverse = np.asarray(np.linalg.pinv(R[..., :n, :n]), dtype=float)
    return apply_matrix(inverse, R[..., :n, n])


def kronecker(A: FloatArray, B: FloatArray) -> FloatArray:
    """``R_A ⊗ R_B`` of each pair: ``(..., 4, 4)`` to ``(..., 9, 9)``."""
    R_A, R_B = A[..., :3, :3], B[..., :3, :3]
    product = R_A[..., :, None, :, None] * R_B[..., None, :, None, :]
    return np.asarray(product.reshape(*product.shape[:-4], 9, 9))


def kronecker_mean(A: FloatArray, B: FloatArray) -> FloatArray:
    """Mean over the pairs of ``R_A ⊗ R_B`` ``(T, 9, 9)``, without an array of all of them.

    With row-major vec, ``R_Z = R_A R_X R_Bᵀ`` reads ``vec(R_Z) = (R_A ⊗ R_B) vec(R_X)``, so the
    matrix has a singular value 1 with the singular vectors ``vec(R_Z)`` and ``vec(R_X)`` where
    the data are free of noise. No quaternion, hence no sign, is involved.
    """
    T, N = A.shape[:2]
    R_A, R_B = A[..., :3, :3].reshape(T, N, 9), B[..., :3, :3].reshape(T, N, 9)
    blocks = np.asarray(np.swapaxes(R_A, 1, 2) @ R_B / N).reshape(T, 3, 3, 3, 3)
    return blocks.transpose(0, 1, 3, 2, 4).reshape(T, 9, 9)


def kronecker_mean_of_columns(R_A: FloatArray, R_B: FloatArray) -> FloatArray:
    """The same ``(9, 9)`` of one set of rotations as columns ``(3, 3, N)``."""
    blocks = (R_A.reshape(9, -1) @ R_B.reshape(9, -1).T / R_A.shape[-1]).reshape(3, 3, 3, 3)
    return np.asarray(blocks.transpose(1, 3, 0, 2).reshape(9, 9))
