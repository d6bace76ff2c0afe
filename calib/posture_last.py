"""Vectors and rotations of many postures at once, with the posture as the last index.

What is done for each posture is a handful of products. Laid out with the posture last they are
products of long rows, which a processor does many of at a time.

A vector is ``(..., 3, S)``; a rotation is ``(3, 3, S)``, its three columns and then their rows.
S may be 1 where all postures share the value.
"""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector products of ``(..., 3, S)`` and ``(..., 3, S)``."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[..., i, :], b[..., j, :], out=out[..., k, :])
        out[..., k, :] -= a[..., j, :] * b[..., i, :]
    return out


def turn(columns: FloatArray, vector: FloatArray) -> FloatArray:
    """``R v``: vectors ``(..., 3, S)`` in the axes of a frame, seen from outside."""
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
