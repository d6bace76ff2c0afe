"""Both postures where two branches are about to merge.

Near a singularity two postures of a pose lie on either side of a fold. Newton's steps from one
start lead to one of them, or to none. The second derivative along the direction that hardly moves
the tip gives both.
"""

from __future__ import annotations

import numpy as np

from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import twist_to
from calib.se3 import FloatArray

_DIFFERENCE_RAD = 1e-3
"""Step of the second difference: rounding of 1e-16 leaves 1e-10 of it."""

_FARTHEST_RAD = 1.5
"""Largest step to a start: a parabola says nothing of what is farther away."""

_LEAST = 1e-12


def both_sides(chain: SerialChain, q: FloatArray, T_wanted: FloatArray) -> FloatArray:
    """Return starts ``(2 S, n)`` on both sides of the fold that postures ``(S, n)`` are near to.

    With the error e of the pose, the Jacobian's least singular value s and its vectors u and v, a
    step ``c v`` closes the pose where ``u e = s c + h c² / 2``, in which h is the second derivative
    of the tip along v, seen along u. The other directions take the linear step.
    """
    state = chain.forward(q)
    scale = np.array([1.0 / chain.reach_m] * 3 + [1.0] * 3)
    J = state.jacobian(state.p_base_tip) * scale[:, None]
    e = twist_to(state, T_wanted) * scale
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    v, u = Vt[:, -1], U[:, :, -1]
    ahead, back = (
        twist_to(chain.forward(q + way * _DIFFERENCE_RAD * v), T_wanted) * scale for way in (1, -1)
    )
    h = -_dot(u, ahead + back - 2.0 * e) / _DIFFERENCE_RAD**2
    h = np.where(np.abs(h) < _LEAST, _LEAST, h)
    inside = s[:, -1] ** 2 + 2.0 * h * _dot(u, e)
    apart = np.sqrt(np.abs(inside))
    along = (U[:, :, :-1].transpose(0, 2, 1) @ e[..., None])[..., 0]
    other = along / np.maximum(s[:, :-1], 0.01)
    step = (Vt[:, :-1].transpose(0, 2, 1) @ other[..., None])[..., 0]
    starts = []
    for way in (1.0, -1.0):
        c = np.clip((way * apart - s[:, -1]) / h, -_FARTHEST_RAD, _FARTHEST_RAD)
        starts.append(q + step + c[:, None] * v)
    return np.concatenate(starts)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))
