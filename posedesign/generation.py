"""Candidate poses: orientations varied while the tool point stays on the target."""

from __future__ import annotations

from itertools import product

import numpy as np

from calib.se3 import FloatArray, rotation_exp, rotation_from_wpr, transform

GRID = np.array(list(product((-1, 0, 1), repeat=3)), dtype=float)
"""i_W, i_P, i_R of Eq. 13 of Watanabe et al. 2006, ``(27, 3)``."""


def wpr_rotations(base_wpr: FloatArray, variation: FloatArray) -> FloatArray:
    """Orientations of Eq. 13: W, P, R each varied by -D, 0, +D, ``(27, 3, 3)``.

    Nine where one D is zero, three where two are.

    Parameters
    ----------
    base_wpr : array (3,)
        W, P, R of the base pose [rad].
    variation : array (3,)
        D_W, D_P, D_R [rad].
    """
    return rotation_from_wpr(base_wpr + np.unique(GRID * variation, axis=0))


def cone_rotations(
    R_base: FloatArray, tilt: float, count: int, rng: np.random.Generator
) -> FloatArray:
    """Orientations ``(count, 3, 3)`` tilted up to an angle, rolled freely about the tool's z.

    Parameters
    ----------
    R_base : array (3, 3)
        Orientation in the middle of the cone.
    tilt : float
        Largest angle between the tool's z and that of the base pose [rad].
    count : int
    rng : numpy.random.Generator
        Directions are spread evenly over the cone, rolls over the full turn.
    """
    cosine = rng.uniform(np.cos(tilt), 1.0, count)
    sine = np.sqrt(1.0 - cosine**2)
    heading, roll = rng.uniform(-np.pi, np.pi, (2, count))
    axis = np.stack([np.cos(heading), np.sin(heading), np.zeros(count)], axis=-1)
    tilted = rotation_exp(axis * np.arctan2(sine, cosine)[:, None])
    rolled = rotation_exp(np.stack([0 * roll, 0 * roll, roll], axis=-1))
    return np.asarray(R_base @ tilted @ rolled)


def touching_poses(R_base_tip: FloatArray, tool_m: FloatArray, target_m: FloatArray) -> FloatArray:
    """Tip poses ``(N, 4, 4)`` of orientations with the tool point (tip frame) on the target [m]."""
    return transform(R_base_tip, target_m - R_base_tip @ tool_m)
