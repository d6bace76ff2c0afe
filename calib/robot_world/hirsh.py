"""Alternating quaternion averages for A X = Z B (Hirsh, DeSouza and Kak 2001).

The paper's A = X B Y with ``A = T_camera_world``, ``B = T_flange_base``, ``Y = T_base_world`` and
``X = T_camera_flange`` is our equation with the world as target. One cycle takes a guess z, gets
from every pair the x that fits it, averages these, gets from every pair the z that fits the
average, and averages again (section 3).

With the signs of the pairs made consistent, both averages are linear. With L and R the matrices of
multiplication from the left and the right::

    M = mean L(a_i) R(b_i*),   x ∝ Mᵀ z,   z ∝ M x

so a cycle is one step of the power iteration on M Mᵀ. It converges to the leading singular vectors
of M, which is the closed form of Dornaika and Horaud 1998, and shrinks the error by (σ2/σ1)² a
cycle.

The paper's averaging of translations alternates in the same way between the p_X and the p_Z that
minimise ``Σ |R_A p_X + p_A - R_Z p_B - p_Z|²``. Its only fixed point is that least-squares
solution, which is therefore computed at once: the same numbers without a second iteration.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import (
    apply_matrix,
    assemble,
    conjugate,
    consistent_quaternions,
    left_matrix,
    right_matrix,
)
from calib.robot_world.results import Estimate
from calib.se3 import BoolArray, FloatArray, IntArray

TOLERANCE_RAD = 1e-12
"""Half-angle error at which an iteration has arrived: what double precision can still hold."""

CYCLE_LIMIT = 1_000_000
"""Cycles after which an iteration counts as not converged. A 10 deg cone with n = 3 needs some
ten thousand, so what does not arrive by then is next to degenerate."""

LITERAL_CYCLE_LIMIT = 400
"""Cycles allowed to the printed form: it has long settled by then, rightly or wrongly."""

_ORTHOGONAL_START = 1e-6
"""Share of the answer in the identity below which another start is taken, as the paper advises
for Z half a turn away from the guess."""


def estimate(A: FloatArray, B: FloatArray) -> Estimate:
    """X and Z of T problems at once, by the iteration with consistent signs.

    Parameters
    ----------
    A, B : ndarray (T, N, 4, 4)
        Measured transforms, N >= 3, in any unit of length.

    Returns
    -------
    Estimate
        X and Z ``(T, 4, 4)``, and the cycles that bring the half-angle error of z from its start,
        the identity, below :data:`TOLERANCE_RAD`.
    """
    U, s, Vt, share = _decompose(A, B)
    count, converged = _count_cycles(s, share, TOLERANCE_RAD)
    z = apply_matrix(U, _errors(s, share, count))
    # x ∝ Mᵀ z, with M = U S Vᵀ
    x = apply_matrix(np.swapaxes(Vt, -1, -2), s * apply_matrix(np.swapaxes(U, -1, -2), z))
    R_X, R_Z = se3.rotation_from_quaternion(x), se3.rotation_from_quaternion(z)
    return Estimate(*assemble(A, B, R_X, R_Z), iterations=count, converged=converged)
