"""Solutions by quaternions: A X = Z B (Dornaika and Horaud 1998), A X = X B (the same, 1995).

A X = Z B in closed form: ``Σ |a x - z b|²`` over unit quaternions x and z. With M the mean of the
matrices M_i of ``a_i x b_i*``, this is ``2N - 2N zᵀ M x``, so z and x are the leading singular
vectors of M. The translations are linear after that. The iteration of Hirsh et al. 2001 ends in the
same place.

All at once: ``Σ |R_A R_X - R_Z R_B|² + |R_A p_X + p_A - R_Z p_B - p_Z|²``, by iteration from the
closed form. The paper weighs both sums by 1 and iterates over matrices, which it keeps near
rotations by two penalties of weight 1e6. Here the unknowns are rotations, so there is nothing to
penalise: this is the limit of large penalties. The sum adds numbers and squares of lengths, so the
answer depends on the unit of length: metres make the translations count for little, millimetres
for nearly all.

A X = X B in closed form (1995): the axes of the motions of flange and camera are turned into each
other by X: ``n_P = R_X n_Q``. The paper minimises ``Σ |n_P - R_X n_Q|²`` over unit quaternions, the
smallest eigenvector of a 4 x 4 matrix, and solves the translation linearly after that.

Printed, the n are unit axes, so a motion by a hair, whose axis is nothing but noise, counts as much
as a large one: with all pairs of poses there are such motions. ``estimate_motions_literal`` does
that. ``estimate_motions`` puts the quaternions p and q of the motions in their place, as OpenCV and
others do::

    Σ |p x - x q|²

so that the axes weigh as sin²(θ/2). Summed over all pairs of poses this has a closed form without
a sum over pairs. With M_i the matrix of ``a_i x b_i*``, p x - x q has the norm of (M_i - M_j) x,
and the sum is N times ``Σ |(M_i - M) x|²``, M being the mean: the rotation of X is exactly the one
of the closed form for A X = Z B, and where the iteration of Hirsh et al. ends.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import (
    apply_matrix,
    conjugate,
    left_matrix,
    right_matrix,
    triangle,
)
from calib.robot_world.certificate import Weights, minimise
from calib.robot_world.closed_form import assemble
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods.relative_motions import (
    centred,
    complete,
    rotation_between_axes,
)
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

_NO_AXIS = 1e-12
"""Sine of half an angle below which a motion has no axis but rounding, and is left out."""

PAPER_WEIGHTS = Weights(rotation=1.0, translation=1.0)
"""Weights of the paper, translations in the unit of length of the data."""


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once in closed form, the rotations first, then the translations."""
    return Estimate(*assemble(pairs, *rotations(pairs)))


def estimate_nonlinear(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, rotations and translations together, by iteration."""
    found = minimise(pairs.A, pairs.B, *rotations(pairs), PAPER_WEIGHTS)
    return Estimate(found.X, found.Z, found.iterations, found.converged)


def rotations(pairs: PairSets) -> tuple[FloatArray, FloatArray]:
    """Rotations of X and Z ``(T, 3, 3)`` that minimise ``Σ |a x - z b|²``.

    Notes
    -----
    x is the last right singular vector of all ``M_i - M`` stacked, since the M_i are orthogonal
    matrices: ``Σ |(M_i - M) x|² = N (1 - |M x|²)``. In a narrow cone this keeps the digits that
    the singular values of M, all near 1, have lost.
    """
    a, b = pairs.quaternions
    M_i = left_matrix(a) @ right_matrix(conjugate(b))
    stacked = centred(M_i).reshape(pairs.T, 4 * pairs.N, 4)
    x = np.asarray(np.linalg.svd(triangle(stacked))[2])[:, 3]
    z = apply_matrix(M_i.mean(axis=1), x)
    return se3.rotation_from_quaternion(x), se3.rotation_from_quaternion(z)


def estimate_motions(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, by the quaternions of the motions of all pairs of poses."""
    R_X, _ = rotations(pairs)
    return complete(pairs, R_X)


def estimate_motions_literal(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once as printed, by the unit axes of the motions."""
    R_X = rotation_between_axes(pairs, _unit)
    return complete(pairs, R_X)


def _unit(sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """One, divided by the sine of half the angle."""
    seen = sine > _NO_AXIS
    return np.where(seen, 1.0 / np.where(seen, sine, 1.0), 0.0)
