"""Pose pairs as they are measured in a cell, and all that goes wrong with them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib import se3
from calib.robot_world.simulation import Problems
from calib.se3 import FloatArray


def viewing_pairs(
    rng: np.random.Generator,
    count: int,
    *,
    tilt_deg: float = 25.0,
    roll_deg: float = 30.0,
    distance_m: tuple[float, float] = (0.5, 1.0),
) -> Problems:
    """One problem of a camera on the flange that looks at a target, without noise.

    From about one distance, which changes by a tenth; its axis at most so far from the normal of
    the target and turned about it by plus and minus the roll. The target stays within some
    centimetres of one place in the view. The poses are in the order of a tour.
    """
    X = se3.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3))
    Z = se3.transform(
        Rotation.random(rng=rng).as_matrix(), np.array([1.0, 0.0, 0.3]) + rng.uniform(-0.3, 0.3, 3)
    )
    tilt = np.radians(tilt_deg) * np.sqrt(rng.random(count))
    around = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    away = np.stack(
        [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=-1
    )
    far = rng.uniform(*distance_m) * rng.uniform(0.9, 1.1, (count, 1))
    B = se3.transform(
        _looking_along(-away, np.radians(roll_deg) * rng.uniform(-1.0, 1.0, count)),
        far * away + rng.uniform(-0.03, 0.03, (count, 3)),
    )
    A = Z @ B @ se3.inverse(X)
    return Problems(A[None], B[None], X[None], Z[None])


def _looking_along(axis: FloatArray, roll_rad: FloatArray) -> FloatArray:
    """Rotations ``(N, 3, 3)`` with their z along unit vectors ``(N, 3)``, rolled about them."""
    x = np.cross([0.0, 1.0, 0.0], axis)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    upright = np.stack([x, np.cross(axis, x), axis], axis=-1)
    return upright @ se3.rotation_exp(roll_rad[:, None] * [0.0, 0.0, 1.0])
