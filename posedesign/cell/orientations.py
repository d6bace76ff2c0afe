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
    draws = rng.random(count), *rng.random((2, count))
    return cone_rotations_at(R_base, tilt, np.stack(draws, axis=-1))


def cone_rotations_at(R_base: FloatArray, tilt: float, points: FloatArray) -> FloatArray:
    """Orientations ``(N, 3, 3)`` of a cone at points of the unit cube that it is made of.

    Points spread evenly give directions spread evenly over the cone (their cosine is uniform) and
    rolls spread evenly over the full turn.

    Parameters
    ----------
    R_base : array (3, 3)
        Orientation in the middle of the cone.
    tilt : float
        Largest angle between the tool's z and that of the base pose [rad].
    points : array (N, 3)
        Place between the rim and the middle of the cone, heading and roll, each from 0 to 1.
    """
    rim = np.cos(tilt)
    cosine = rim + (1.0 - rim) * points[:, 0]
    sine = np.sqrt(1.0 - cosine**2)
    heading, roll = -np.pi + 2.0 * np.pi * points[:, 1:].T
    axis = np.stack([np.cos(heading), np.sin(heading), np.zeros(len(points))], axis=-1)
    tilted = rotation_exp(axis * np.arctan2(sine, cosine)[:, None])
    rolled = rotation_exp(np.stack([0 * roll, 0 * roll, roll], axis=-1))
    return np.asarray(R_base @ tilted @ rolled)


def touching_poses(R_base_tip: FloatArray, tool_m: FloatArray, target_m: FloatArray) -> FloatArray:
    """Tip poses ``(N, 4, 4)`` of orientations with the tool point (tip frame) on the target [m]."""
    return transform(R_base_tip, target_m - R_base_tip @ tool_m)
