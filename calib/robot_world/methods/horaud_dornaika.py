"""Hand-eye calibration in closed form by quaternions (Horaud and Dornaika 1995).

The axes of the motions of flange and camera are turned into each other by X: ``n_P = R_X n_Q``. The
paper minimises ``Σ |n_P - R_X n_Q|²`` over unit quaternions, the smallest eigenvector of a 4 x 4
matrix, and solves the translation linearly after that.

Printed, the n are unit axes, so a motion by a hair, whose axis is nothing but noise, counts as
much as a large one: with all pairs of poses there are such motions. ``estimate_literal`` does that.
``estimate`` puts the quaternions p and q of the motions in their place, as OpenCV and others do::

    Σ |p x - x q|²

so that the axes weigh as sin²(θ/2). Summed over all pairs of poses this has a closed form without
a sum over pairs. With M_i the matrix of ``a_i x b_i*``, p x - x q has the norm of (M_i - M_j) x,
and the sum is N times ``Σ |(M_i - M) x|²``, M being the mean: the rotation of X is exactly the one
that Dornaika and Horaud 1998 find for A X = Z B, and where the iteration of Hirsh et al. ends.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.estimate import Estimate
from calib.robot_world.methods import dornaika_horaud
from calib.robot_world.methods.relative_motions import (
    complete,
    rotation_between_axes,
    translation,
)
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

_NO_AXIS = 1e-12
"""Sine of half an angle below which a motion has no axis but rounding, and is left out."""


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, by the quaternions of the motions of all pairs of poses."""
    R_X, _ = dornaika_horaud.rotations(pairs)
    return complete(pairs, R_X, translation(pairs, R_X))


def estimate_literal(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once as printed, by the unit axes of the motions."""
    R_X = rotation_between_axes(pairs, _unit)
    return complete(pairs, R_X, translation(pairs, R_X))


def _unit(sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """One, divided by the sine of half the angle."""
    seen = sine > _NO_AXIS
    return np.where(seen, 1.0 / np.where(seen, sine, 1.0), 0.0)
