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

from calib.robot_world.estimate import Estimate
from calib.robot_world.pairs import PairSets


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, the rotations first, then the translations."""
    return Estimate(*pairs.rotations_first)
