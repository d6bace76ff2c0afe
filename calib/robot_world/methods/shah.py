"""Closed form of A X = Z B by the Kronecker product, rotations first (Shah 2013).

``R_A R_X = R_Z R_B`` reads ``(R_A ⊗ R_B) vec R_X = vec R_Z`` with row-major vec. Least squares over
all pairs, ``Σ |R_A R_X - R_Z R_B|²`` with vec R_X and vec R_Z of fixed norm, is the leading pair of
singular vectors of ``Σ R_A ⊗ R_B``. Its singular value is N where there is no noise. The 3 x 3
matrices that they make up are replaced by the nearest rotations: Shah scales them to determinant
1 first, which does not change which rotation is nearest, and takes the sign for which the
determinant is positive. The translations are then linear (as Eq. 16 of Li et al. 2010).

Against Li's own Kronecker form the translations have no say in the rotations, and are solved for
rotations that are orthonormal already: the answer does not depend on the unit of length.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import apply_matrix, assemble, kronecker, triangle
from calib.robot_world.methods.relative_motions import centred
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate
from calib.se3 import FloatArray


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, the rotations first, then the translations.

    Parameters
    ----------
    pairs : PairSets
        Measured pairs, N >= 3, in any unit of length.

    Returns
    -------
    Estimate
        X and Z ``(T, 4, 4)``.
    """
    return Estimate(*assemble(pairs.A, pairs.B, *_rotations(pairs)))


def _rotations(pairs: PairSets) -> tuple[FloatArray, FloatArray]:
    """Rotations of X and Z ``(T, 3, 3)``: those of ``pairs.rotations``, with more digits.

    With K_i the products and K their mean, vec R_X is the last right singular vector of all
    ``K_i - K`` stacked, since the K_i are orthogonal matrices. Where the poses hardly tilt, the
    leading singular values of K are nearly equal, and tell the square of what these tell.
    """
    stacked = centred(kronecker(pairs.A, pairs.B)).reshape(pairs.T, 9 * pairs.N, 9)
    vec_X = np.asarray(np.linalg.svd(triangle(stacked))[2])[:, 8]
    X = vec_X.reshape(-1, 3, 3)
    Z = apply_matrix(pairs.kronecker_mean, vec_X).reshape(-1, 3, 3)
    sign = np.where(np.linalg.det(Z) < 0.0, -1.0, 1.0)[:, None, None]
    return se3.project_to_rotation(sign * X), se3.project_to_rotation(sign * Z)
