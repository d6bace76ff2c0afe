"""Hand-eye calibration by logarithms of rotations (Park and Martin 1994).

With the rotation vectors ``α = log R_P`` and ``β = log R_Q`` of the motions of flange and camera,
``α = R_X β``. With ``M = Σ β αᵀ`` the least squares are ``R_X = (Mᵀ M)^(-1/2) Mᵀ``, and the
translation is linear after that. The formula is the orthogonal matrix nearest to Mᵀ; here it is
the nearest rotation, which is the same as long as det M > 0, and exists where M is singular.

Motions weigh as the square of their angle. Those near half a turn, where a logarithm jumps, are
taken the same way round in A and in B.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.estimate import Estimate
from calib.robot_world.methods.relative_motions import (
    complete,
    rotation_between_axes,
)
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, the rotations first, from the motions of all pairs."""
    R_X = rotation_between_axes(pairs, _angle)
    return complete(pairs, R_X)


def _angle(sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """The rotation angle, divided by the sine of its half."""
    safe = np.where(sine > 0.0, sine, 1.0)
    return np.where(sine > 0.0, 2.0 * np.arctan2(sine, cosine) / safe, 2.0)
