"""What the methods share: quaternion products as matrices, batched least squares, projections.

Everything here works on batches: T problems of N pose pairs each, in arrays ``(T, N, ...)``.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.se3 import FloatArray

LEAST_SQUARE = 1e-2
"""Square of a singular value, of that of the largest one, from which on its direction is told by
sums of products as well as by an orthogonal factorisation: to 1e-14."""


def left_matrix(quaternion: FloatArray) -> FloatArray:
    """Matrix ``(..., 4, 4)`` of multiplication from the left: ``left_matrix(p) @ q`` is p q.

    Of quaternions w, x, y, z ``(..., 4)`` of any norm. Li et al. 2010 write ã (after Eq. 11).
    """
    return _product_matrix(quaternion, 1.0)


def right_matrix(quaternion: FloatArray) -> FloatArray:
    """Matrix ``(..., 4, 4)`` of multiplication from the right: ``right_matrix(q) @ p`` is p q.

    Li et al. 2010 write b̃ (after Eq. 11, where the tilde is missing).
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


def unit_diagonal(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Symmetric matrices ``(..., n, n)`` scaled to a unit diagonal, and the scales ``(..., n)``.

    Radians and metres differ by the unit of length. A row of zeros stays, with the scale 1.
    """
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return np.asarray(matrix / (size[..., :, None] * size[..., None, :])), size


_LARGEST_INVERSE = 1e14
"""Element of the inverse of an information of unit diagonal beyond which that is singular."""


def inverse_information(information: FloatArray) -> FloatArray:
    """Covariances ``(T, n, n)``; of a singular information by its pseudo-inverse."""
    scaled, size = unit_diagonal(information)
    seen = np.asarray(np.isfinite(scaled).all(axis=(1, 2)))
    if not seen.all():
        scaled = np.where(seen[:, None, None], scaled, 0.0)
    try:
        inverse = np.linalg.inv(scaled)
        poor = ~(np.abs(inverse).max(axis=(1, 2)) < _LARGEST_INVERSE)
    except np.linalg.LinAlgError:
        inverse, poor = np.empty_like(scaled), np.ones(len(scaled), dtype=bool)
    if poor.any():
        inverse[poor] = np.linalg.pinv(scaled[poor], hermitian=True)
    return np.asarray(inverse / (size[:, :, None] * size[:, None, :]))


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


def dual_part(translation: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Dual parts ½ p q ``(..., 4)`` of translations ``(..., 3)`` and quaternions ``(..., 4)``."""
    products = translation[..., :, None] * quaternion[..., None, :]
    return np.asarray(products.reshape(*products.shape[:-2], 12) @ _DUAL)


def transforms(real: FloatArray, dual: FloatArray) -> FloatArray:
    """Transforms ``(T, 4, 4)`` of dual quaternions of any scale: p = vec(2 q' q*) / |q|².

    Without a real part there is no transform: the identity takes its place, so that one problem
    without an answer cannot stop the whole batch.
    """
    norm = np.linalg.norm(real, axis=-1, keepdims=True)
    none = norm == 0.0
    safe = np.where(none, 1.0, norm)
    q = np.where(none, [1.0, 0.0, 0.0, 0.0], real / safe)
    p = 2.0 * apply_matrix(right_matrix(conjugate(q)), np.where(none, 0.0, dual) / safe)[..., 1:]
    return se3.transform(se3.rotation_from_quaternion(q), p)


def transform_in_plane(real: FloatArray, dual: FloatArray) -> FloatArray:
    """Weights ``(T, 2)`` by which two solutions add up to one whose real and dual part are normal.

    Of real and dual parts ``(T, 2, k)``, k numbers each. ``real·dual = 0`` is a quadratic equation
    for the ratio of the weights; the scale is free. Of its two solutions the one with the larger
    real part is meant: the other belongs to a dual part alone, which has no rotation. Where noise
    leaves no real solution, the nearest is taken.
    """
    product = real @ np.swapaxes(dual, -1, -2)
    form = product + np.swapaxes(product, -1, -2)
    values, axes = np.linalg.eigh(form)  # ascending: -, + wherever there is a solution
    # values[0] c0² + values[1] c1² = 0; clipped where noise leaves no real solution.
    c0, c1 = np.sqrt(np.maximum(values[:, 1], 0.0)), np.sqrt(np.maximum(-values[:, 0], 0.0))
    choices = np.stack([np.stack([c0, c1], axis=-1), np.stack([c0, -c1], axis=-1)], axis=1)
    weights = choices @ np.swapaxes(axes, -1, -2)  # (T, 2 choices, 2)
    size = ((weights @ real) ** 2).sum(axis=-1)
    best = np.take_along_axis(weights, size.argmax(axis=-1)[:, None, None], axis=1)
    return np.asarray(best[:, 0])


LEFT, RIGHT = left_matrix(np.eye(4)), right_matrix(np.eye(4))
"""Matrices ``(4, 4, 4)`` of the units 1, i, j, k: those of a quaternion are linear in it."""

_DUAL = 0.5 * LEFT[1:].transpose(0, 2, 1).reshape(12, 4)
"""Dual parts ``(12, 4)`` of translations and quaternions along the units."""
