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
cycle. A step multiplies the share of the i-th left singular vector in z by σ_i², so any iterate
follows without the ones before: the iterates are those of the paper, but none is walked through.

The paper's averaging of translations alternates in the same way between the p_X and the p_Z that
minimise ``Σ |R_A p_X + p_A - R_Z p_B - p_Z|²``. Its only fixed point is that least-squares
solution, which is therefore computed at once: the same numbers without a second iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.robot_world.algebra import (
    LEAST_SQUARE,
    LEFT,
    RIGHT,
    apply_matrix,
    conjugate,
    left_matrix,
    right_matrix,
    triangle,
)
from calib.robot_world.closed_form import assemble
from calib.robot_world.estimate import Estimate
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray, FloatArray, IntArray

TOLERANCE_RAD = 1e-12
"""Half-angle error at which an iteration has arrived: what double precision can still hold."""

CYCLE_LIMIT = 10**9
"""Cycles after which an iteration counts as not converged: a count in closed form costs nothing,
and only motion next to degenerate needs so many."""

LITERAL_CYCLE_LIMIT = 400
"""Cycles allowed to the printed form: it has long settled by then, rightly or wrongly."""

_ORTHOGONAL_START = 1e-6
"""Share of the answer in the identity below which another start is taken, as the paper advises
for Z half a turn away from the guess."""

_WHOLE = 1.0 - 1e-15
"""Largest loss of a share in one cycle: stands for all of it, whose logarithm is infinite."""


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, by the iteration with consistent signs."""
    iteration = _prepare(pairs)
    count = _count_cycles(iteration, TOLERANCE_RAD)
    z = apply_matrix(iteration.basis, iteration.after(count))
    x = apply_matrix(np.swapaxes(iteration.mean, -1, -2), z)
    R_X, R_Z = se3.rotation_from_quaternion(x), se3.rotation_from_quaternion(z)
    return Estimate(
        *assemble(pairs, R_X, R_Z),
        iterations=count,
        converged=iteration.has_arrived(count, TOLERANCE_RAD),
    )


def estimate_literal(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, by the iteration as printed.

    Section 2.2 takes every quaternion with a scalar part >= 0 and averages these. The proof of
    convergence needs that of the *error* quaternions instead, which are unknown, so that this form
    often settles elsewhere, up to π/2 from the answer, on data without noise.
    """
    x, z, count, converged = iterate_literal(pairs, LITERAL_CYCLE_LIMIT)
    R_X, R_Z = se3.rotation_from_quaternion(x), se3.rotation_from_quaternion(z)
    return Estimate(*assemble(pairs, R_X, R_Z), iterations=count, converged=converged)


def cycles(pairs: PairSets, tolerance_rad: float) -> IntArray:
    """Cycles ``(T,)`` from the identity until z is within a tolerance of where the iteration ends.

    At most :data:`CYCLE_LIMIT`. The tolerance is the paper's measure of error: the angle between
    quaternions as vectors of four numbers, which is half the rotation angle.
    """
    return _count_cycles(_prepare(pairs), tolerance_rad)


def predicted_cycles(pairs: PairSets, tolerance_rad: float) -> FloatArray:
    """Cycles ``(T,)`` after which a rate of (σ2/σ1)² a cycle brings the error below a tolerance.

    Never fewer than :func:`cycles` counts (before rounding up), since no part of the error shrinks
    more slowly. Parameters as there.
    """
    iteration = _prepare(pairs)
    start = np.linalg.norm(iteration.shares[:, 1:], axis=-1) / np.abs(iteration.shares[:, 0])
    with np.errstate(divide="ignore"):  # a start at the answer, or a rate of 1
        needed = np.log(np.tan(tolerance_rad) / start) / iteration.log_rates[:, 1]
    return np.asarray(np.maximum(needed, 0.0))


_MOMENTS = (LEFT[:, None] @ RIGHT * [[[1.0]], [[-1.0]], [[-1.0]], [[-1.0]]]).reshape(16, 16)
"""What M is made of: L(a) R(b*) of the units a and b, in rows."""


@dataclass(frozen=True)
class _Iteration:
    """The power iteration of T problems, in the basis of the left singular vectors of M.

    ``shares`` ``(T, 4)`` are the components of the start, ``log_rates`` ``(T, 4)`` the logarithms
    of (σ_i/σ_1)², by which a cycle multiplies them; the columns of ``basis`` are the vectors.
    """

    mean: FloatArray
    basis: FloatArray
    shares: FloatArray
    log_rates: FloatArray

    def after(self, count: IntArray) -> FloatArray:
        """Iterate z after some cycles ``(T,)``, in the basis ``(T, 4)``, not normalised."""
        return np.asarray(self.shares * np.exp(count[:, None] * self.log_rates))

    def has_arrived(self, count: IntArray, tolerance_rad: float) -> BoolArray:
        """Whether the half-angle error after some cycles ``(T,)`` is within a tolerance."""
        z = self.after(count)
        error = np.linalg.norm(z[:, 1:], axis=-1)
        return np.asarray(error <= np.tan(tolerance_rad) * np.abs(z[:, 0]))


def _prepare(pairs: PairSets) -> _Iteration:
    """Singular vectors and rates of M, and the start of z.

    The left singular vectors of M are those of ``1 - M Mᵀ`` in reversed order, with values
    1 - σ_i². Stacked, the (M_i - M)ᵀ have them as right singular vectors, with values d_i² =
    N (1 - σ_i²): in a narrow cone they keep the digits that 1 - σ_i² loses.
    """
    a, b = pairs.quaternions
    T, N = a.shape[:2]
    M = (np.swapaxes(a, -1, -2) @ b / N).reshape(T, 16) @ _MOMENTS
    M = M.reshape(T, 4, 4)
    rest, basis = np.linalg.eigh(np.eye(4) - M @ np.swapaxes(M, -1, -2))
    narrow = ~(rest[:, 1] > LEAST_SQUARE)
    if narrow.any():
        M_pairs = left_matrix(a[narrow]) @ right_matrix(conjugate(b[narrow]))
        stacked = np.swapaxes(M_pairs - M[narrow, None], -1, -2).reshape(-1, 4 * N, 4)
        _, d, Vt = np.linalg.svd(triangle(stacked))
        rest[narrow], basis[narrow] = d[:, ::-1] ** 2 / N, np.swapaxes(Vt[:, ::-1], -1, -2)
    loss = (rest - rest[:, :1]) / (1.0 - rest[:, :1])
    # Row j of the basis is the start e_j: the identity, or else the nearest half turn.
    nearest = np.abs(basis[:, :, 0]).argmax(axis=-1)
    start = np.where(np.abs(basis[:, 0, 0]) < _ORTHOGONAL_START, nearest, 0)
    shares = np.take_along_axis(basis, start[:, None, None], axis=1)[:, 0]
    return _Iteration(M, basis, shares, np.log1p(-np.minimum(loss, _WHOLE)))


def _count_cycles(iteration: _Iteration, tolerance_rad: float) -> IntArray:
    """Fewest cycles ``(T,)`` to a half-angle error within the tolerance; at most the limit.

    The error never grows from one cycle to the next, so bisection finds the cycle.
    """
    low = np.zeros(len(iteration.shares), dtype=np.intp)
    high = np.full_like(low, CYCLE_LIMIT)
    for _ in range(CYCLE_LIMIT.bit_length()):
        middle = (low + high) // 2
        arrived = iteration.has_arrived(middle, tolerance_rad)
        high = np.where(arrived, middle, high)
        low = np.where(arrived, low, np.minimum(middle + 1, high))
    return high


def iterate_literal(
    pairs: PairSets, limit: int
) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
    """Rotation part of :func:`estimate_literal`: x, z ``(T, 4)``, cycles and convergence ``(T,)``.

    It stops after a limit of cycles.
    """
    a = se3.quaternion_from_rotation(pairs.A[..., :3, :3])
    b = se3.quaternion_from_rotation(pairs.B[..., :3, :3])
    forward = left_matrix(a) @ right_matrix(conjugate(b))  # z_i = a_i x b_i*
    backward = np.swapaxes(forward, -1, -2)  # x_i = a_i* z b_i
    z = np.tile([1.0, 0.0, 0.0, 0.0], (pairs.T, 1))
    x = z.copy()
    count = np.zeros(pairs.T, dtype=np.intp)
    moving = np.arange(pairs.T)
    for _ in range(limit):
        x[moving] = _printed_average(apply_matrix(backward[moving], z[moving, None]))
        new = _printed_average(apply_matrix(forward[moving], x[moving, None]))
        step = np.linalg.norm(new - z[moving], axis=-1)
        z[moving] = new
        count[moving] += 1
        moving = moving[step > TOLERANCE_RAD]
        if not len(moving):
            break
    converged = np.ones(pairs.T, dtype=bool)
    converged[moving] = False
    return x, z, count, converged


def _printed_average(quaternions: FloatArray) -> FloatArray:
    """Average ``(T, 4)`` of quaternions ``(T, N, 4)`` with scalar parts made >= 0 (section 2.2)."""
    sign = np.where(quaternions[..., :1] < 0.0, -1.0, 1.0)
    mean = (sign * quaternions).mean(axis=1)
    size = np.linalg.norm(mean, axis=-1, keepdims=True)
    # Item 4: where the average vanishes, the identity takes its place.
    vanished = size < TOLERANCE_RAD
    return np.where(vanished, [1.0, 0.0, 0.0, 0.0], mean / np.where(vanished, 1.0, size))
