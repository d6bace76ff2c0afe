"""Vectors and rotations of many postures at once, with the posture as the last index.

What is done for each posture is a handful of products. Laid out with the posture last they are
products of long rows, which a processor does many of at a time.

A vector is ``(..., 3, S)``; a rotation is ``(3, 3, S)``, its three columns and then their rows.
S may be 1 where all postures share the value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_NEAR_HALF_TURN = -0.9
"""Cosine of the angle from which on its sine no longer tells the axis well."""


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector products of ``(..., 3, S)`` and ``(..., 3, S)``."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[..., i, :], b[..., j, :], out=out[..., k, :])
        out[..., k, :] -= a[..., j, :] * b[..., i, :]
    return out


def turn(columns: FloatArray, vector: FloatArray) -> FloatArray:
    """``R v``: vectors ``(..., 3, S)`` in the axes of a frame, seen from outside.

    Where all postures share one of the two, it is a product of matrices.
    """
    if columns.shape[-1] == 1:
        return np.asarray(columns[..., 0].T @ vector)
    if vector.shape[-1] == 1:
        S = columns.shape[-1]
        return np.asarray(vector[..., 0] @ columns.reshape(3, -1)).reshape(*vector.shape[:-1], S)
    out = columns[0] * vector[..., 0:1, :]
    out += columns[1] * vector[..., 1:2, :]
    out += columns[2] * vector[..., 2:3, :]
    return np.asarray(out)


def turn_back(columns: FloatArray, vector: FloatArray) -> FloatArray:
    """``Rᵀ v``: vectors ``(..., 3, S)`` in the axes of the frame."""
    out = np.empty(np.broadcast_shapes(columns.shape[1:], vector.shape))
    for k in range(3):
        np.multiply(columns[k, 0], vector[..., 0, :], out=out[..., k, :])
        out[..., k, :] += columns[k, 1] * vector[..., 1, :]
        out[..., k, :] += columns[k, 2] * vector[..., 2, :]
    return out


def along(direction: FloatArray, vector: FloatArray) -> FloatArray:
    """Components ``(..., S)`` of vectors ``(..., 3, S)`` along a direction ``(3, S)``."""
    out = direction[0] * vector[..., 0, :]
    out += direction[1] * vector[..., 1, :]
    out += direction[2] * vector[..., 2, :]
    return np.asarray(out)


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Columns of the product of two rotations, both as columns ``(3, 3, S)``."""
    return turn(a, b)


def columns_of(R: FloatArray) -> FloatArray:
    """Columns ``(3, 3, S)`` of rotations ``(S, 3, 3)``."""
    return np.ascontiguousarray(R.transpose(2, 1, 0))


def matrices_of(columns: FloatArray) -> FloatArray:
    """Rotations ``(S, 3, 3)`` of columns ``(3, 3, S)``."""
    return np.ascontiguousarray(columns.transpose(2, 1, 0))


def quaternions_of(columns: FloatArray) -> FloatArray:
    """Unit quaternions (w, x, y, z) ``(4, S)`` of rotations ``(3, 3, S)``, with w >= 0.

    A row of ``4 q qᵀ``, which is linear in the rotation: the one of the largest component.
    """
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = columns
    square = np.stack(
        [1.0 + xx + yy + zz, 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz]
    )
    w = zy - yz, xz - zx, yx - xy
    rows = np.empty((4, 4, columns.shape[-1]))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        rows[0, k + 1] = rows[k + 1, 0] = w[k]
        rows[i + 1, j + 1] = rows[j + 1, i + 1] = columns[i, j] + columns[j, i]
    for k in range(4):
        rows[k, k] = square[k]
    q = np.take_along_axis(rows, square.argmax(axis=0)[None, None], axis=0)[0]
    q *= np.where(q[0] < 0.0, -1.0, 1.0) / np.sqrt((q * q).sum(axis=0))
    return np.asarray(q)


def rotation_log(columns: FloatArray) -> FloatArray:
    """Rotation vectors ``(3, S)`` [rad] of rotations, angle in [0, pi]."""
    twice = np.empty(columns.shape[1:])
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(columns[i, j], columns[j, i], out=twice[k])
    sine = 0.5 * np.sqrt((twice * twice).sum(axis=0))
    cosine = 0.5 * (columns[0, 0] + columns[1, 1] + columns[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    vector = twice * (0.5 * angle / np.where(sine > 0.0, sine, 1.0))
    turned = np.flatnonzero(cosine < _NEAR_HALF_TURN)
    if turned.size:
        # the axis is lost in the sine
        w, *xyz = quaternions_of(columns[..., turned])
        half = np.sqrt(np.square(xyz).sum(axis=0))
        vector[:, turned] = xyz * (2.0 * np.arctan2(half, w) / half)
    return np.asarray(vector)


def rotation_exp(vector: FloatArray) -> FloatArray:
    """Rotations ``(3, 3, S)`` of rotation vectors ``(3, S)`` [rad]."""
    # the sine of what is added is itself: no turn needs no case of its own
    angle = np.sqrt((vector * vector).sum(axis=0)) + 1e-300
    sine = np.sin(angle) / angle
    half = np.sin(0.5 * angle) / angle
    scaled = 2.0 * half * half * vector
    out = np.empty((3, *vector.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[i, i] = 1.0 - scaled[j] * vector[j] - scaled[k] * vector[k]
        product, lever = scaled[i] * vector[j], sine * vector[k]
        np.add(product, lever, out=out[i, j])
        np.subtract(product, lever, out=out[j, i])
    return out


def transposed(columns: FloatArray) -> FloatArray:
    """Columns of the inverse rotations."""
    return columns.transpose(1, 0, 2)
