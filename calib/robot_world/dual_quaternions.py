"""Dual quaternions of transforms: ``q + ε q'`` with ``q' = ½ p q`` (Li 2010 later prints ½ q p)."""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import apply_matrix, conjugate, right_matrix
from calib.se3 import FloatArray


def dual_part(translation: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Dual parts ½ p q ``(..., 4)`` of translations ``(..., 3)`` and quaternions ``(..., 4)``."""
    return 0.5 * apply_matrix(right_matrix(quaternion)[..., 1:], translation)


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

    Parameters
    ----------
    real, dual : ndarray (T, 2, k)
        Real and dual parts of two solutions, k numbers each.

    Notes
    -----
    ``real·dual = 0`` is a quadratic equation for the ratio of the weights; the scale is free. Of
    its two solutions the one with the larger real part is meant: the other belongs to a dual part
    alone, which has no rotation. Where noise leaves no real solution, the nearest is taken.
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
