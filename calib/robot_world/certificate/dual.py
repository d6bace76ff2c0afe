"""Lower bounds of the cost over all rotations, by Lagrangian duality.

The equations of two rotations, each times any multiplier, can be added to the cost without changing
it on rotations::

    f(u) = constant + 2 ρ·u + uᵀ S u,    ρ = linear - Σ λ slope,   S = quadratic - Σ λ bend

Where S is positive definite the right-hand side is convex, and its least value over *all* u bounds
the cost from below. At the reference u = 0 the cost is the constant; so where it is stationary
(ρ = 0 is solvable then: the linear term is normal to the rotations) and S can be made positive
definite, the reference is the only global minimum, with no gap at all but rounding. Small residuals
need small multipliers, hence small changes of a positive definite matrix: below some noise the
proof always exists.

Whatever the multipliers, the bound holds: how they were found is no part of the proof.

The equations are all quadratic ones that hold on a pair of rotations, written about the identity.
A rotation satisfies ``Rᵀ R = I`` and ``R Rᵀ = I`` (columns and rows orthonormal) and ``cof R = R``
(each column, and each row, is the cross product of the other two: right-handed). These are 21
equations with one dependency, the trace of the first two: 20 in all, and every quadratic polynomial
that vanishes on SO(3) is a combination of them: ten numbers (R, 1) make 55 products, and only
1 + 9 + 25 functions of degree two or less are different on SO(3). None mixes two rotations. What is
redundant for a rotation is not so for its relaxation: without them it is not tight.

With R = I + U, each reads ``2 slope·vec U + vec Uᵀ bend vec U = 0``.

Where the multipliers of least norm do not make S positive definite, better ones are looked for. The
change ``K = quadratic - S`` is measured in units of the quadratic term: S is positive definite
when the largest eigenvalue τ of ``quadratic^-½ K quadratic^-½`` is below 1. That does not depend
on how well conditioned the motion is, while the norm of K does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from calib.robot_world.algebra import apply_matrix
from calib.robot_world.certificate.polynomial import QuadraticForm
from calib.se3 import BoolArray, FloatArray

LONGEST_OFFSET = 4.0
"""Largest |u|: rotations R have |R - I|² = 6 - 2 tr R, 8 at most, and u holds two of them."""

_CONSTRAINT_ROUNDING = 64.0 * np.finfo(float).eps
"""By how much an equation of unit bend may be off on a rotation, and the sum of products with
multipliers, and an eigenvalue of their sum: all in units of the matrices' norms."""

_SHARES = np.array([0.5, 0.1, 0.01, 0.001])
"""Values of η tried, in units of what the smallest eigenvalue has above rounding: half where ρ is
mere rounding, next to nothing where ρ matters."""


@dataclass(frozen=True, eq=False)
class LowerBound:
    """Bounds of the costs of T problems."""

    value: FloatArray
    """(T,): no rotations have a lower cost: the allowance for rounding is taken off. Not below
    zero."""
    smallest_eigenvalue: FloatArray  # (T,): of S, as computed [cost]
    convex: BoolArray
    """(T,): S is positive definite beyond rounding: one pair of rotations at most reaches the
    bound."""


def least_multipliers(form: QuadraticForm) -> FloatArray:
    """Multipliers ``(T, 40)`` that balance the linear term with the smallest change of S.

    Smallest in the Frobenius norm. What is tangent to the rotations cannot be balanced; it
    vanishes at a stationary point.
    """
    balance = rotation_constraints().balance
    parts = [apply_matrix(balance, form.linear[:, at : at + 9]) for at in (0, 9)]
    return np.concatenate(parts, axis=-1)


def lagrangian(form: QuadraticForm, multipliers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """S ``(T, 18, 18)`` and ρ ``(T, 18)`` of multipliers ``(T, 40)``, those of X first."""
    equations = rotation_constraints()
    S, rho = form.quadratic.copy(), form.linear.copy()
    for side, at in enumerate((slice(0, 9), slice(9, 18))):
        part = multipliers[:, 20 * side : 20 * side + 20]
        S[:, at, at] -= np.tensordot(part, equations.bends, axes=1)
        rho[:, at] -= part @ equations.slopes
    return S, rho


def lower_bound(form: QuadraticForm, multipliers: FloatArray) -> LowerBound:
    """Bound of the cost of T problems from any multipliers ``(T, 40)``.

    On rotations |u| <= 4, so that a slack ε in S, in ρ and in the products with u, which covers
    rounding, takes no more than ``2 ε |u| + ε |u|²`` off the cost. By ``2 ε |u| <= ε²/η + η |u|²``
    with any η > 0, and with the eigenvalues m and eigenvectors v of S, the cost is at least::

        constant - ε²/η - Σ (v·ρ)² / (m - ε - η)     where all denominators are positive
        constant - 8 (|ρ| + ε) + 16 min(m - ε)       where S is not positive definite
    """
    S, rho = lagrangian(form, multipliers)
    m, axes = np.linalg.eigh(S)
    norm = np.linalg.norm(S, axis=(1, 2)) + np.abs(multipliers).sum(axis=-1)
    slack = form.rounding + _CONSTRAINT_ROUNDING * norm
    least = m[:, 0] - slack
    convex = least > 0.0

    eta = _SHARES * np.where(convex, least, 1.0)[:, None]
    room = m[:, None, :] - (slack[:, None] + eta)[..., None]
    along = np.square((rho[:, None, :] @ axes)[:, 0])
    drop = (along[:, None] / np.where(convex[:, None, None], room, 1.0)).sum(axis=-1)
    loss = np.where(convex, np.min(drop + slack[:, None] ** 2 / eta, axis=-1), np.inf)
    force = np.linalg.norm(rho, axis=-1) + slack
    coarse = 2.0 * LONGEST_OFFSET * force - LONGEST_OFFSET**2 * np.minimum(least, 0.0)
    value = form.constant - form.constant_rounding - np.minimum(loss, coarse)
    return LowerBound(np.maximum(value, 0.0), m[:, 0], convex)


def relaxed_minimum(form: QuadraticForm, multipliers: FloatArray) -> FloatArray:
    """Matrices ``(T, 2, 3, 3)`` in place of the turns of X and Z where the Lagrangian is least.

    With the best multipliers of a tight relaxation these are the rotations of the optimum, to
    within the accuracy of the multipliers.
    """
    S, rho = lagrangian(form, multipliers)
    u = -(np.linalg.pinv(S, hermitian=True) @ rho[..., None])
    return np.asarray(np.eye(3) + u.reshape(-1, 2, 3, 3))


_RANK_TOLERANCE = 1e-9
"""Singular values of matrices of small whole numbers are zero below this, or order one."""


@dataclass(frozen=True, eq=False)
class Constraints:
    """The equations of one rotation, split by what a stationary point fixes."""

    bends: FloatArray  # (20, 9, 9)
    slopes: FloatArray  # (20, 9): the equations; the bends are orthonormal in the Frobenius norm
    balance: FloatArray
    """(20, 9): multipliers of least norm by which the slopes balance a force: ``slopesᵀ (balance
    f)`` is the part of f that is normal to SO(3) at the identity."""
    flat: FloatArray
    """(14, 9, 9): orthonormal bends of the combinations without slope: they can be added at
    will."""


@cache
def rotation_constraints() -> Constraints:
    """The equations of one rotation about the identity."""
    quadratic, linear = _equations()
    slopes = quadratic[..., [0, 4, 8]].sum(axis=-1) + linear  # the first times vec I
    # An orthonormal basis of the bends: no equation has a slope alone, so the slopes follow.
    U, size, Vt = np.linalg.svd(quadratic.reshape(len(quadratic), 81), full_matrices=False)
    keep = size > _RANK_TOLERANCE
    bends = Vt[keep].reshape(-1, 9, 9)
    slopes = (U[:, keep] / size[keep]).T @ slopes
    W, strength, Ft = np.linalg.svd(slopes)
    normal = int(np.sum(strength > _RANK_TOLERANCE))
    balance = (W[:, :normal] / strength[:normal]) @ Ft[:normal]
    flat = np.einsum("kj,kab->jab", W[:, normal:], bends)
    return Constraints(bends, slopes, balance, flat)


def _equations() -> tuple[FloatArray, FloatArray]:
    """Matrices M ``(21, 9, 9)`` and vectors m ``(21, 9)``: ``rᵀ M r + 2 m·r`` is the same number
    for the vec r, row by row, of all rotations.
    """
    quadratic, linear = [], []
    for j in range(3):
        for k in range(j, 3):
            pair = np.zeros((3, 3))
            pair[j, k] += 0.5
            pair[k, j] += 0.5
            quadratic += [np.kron(np.eye(3), pair), np.kron(pair, np.eye(3))]
            linear += [np.zeros(9), np.zeros(9)]
    for i in range(3):
        for j in range(3):
            (a, b), (c, d) = ((i + 1) % 3, (i + 2) % 3), ((j + 1) % 3, (j + 2) % 3)
            minor = np.zeros((9, 9))
            minor[3 * a + c, 3 * b + d] += 0.5
            minor[3 * a + d, 3 * b + c] -= 0.5
            entry = np.zeros(9)
            entry[3 * i + j] = -0.5
            quadratic.append(minor + minor.T)
            linear.append(entry)
    return np.array(quadratic), np.array(linear)


_WEIGHT_STEP = 8.0
"""Factor by which the weight of the barrier falls whenever its minimum is near."""

_NEAR = 0.5
"""Newton decrement at which the minimum of the barrier is near: below 1, full steps stay inside."""

_STEP_LIMIT = 300
"""Newton steps; some 20 to 60 are usual."""


def minimise_first(
    constant: FloatArray,
    moves: FloatArray,
    start: FloatArray,
    accuracy: float,
    enough: Callable[[FloatArray], bool] = lambda x: False,
) -> FloatArray:
    """Minimise x_0 while ``constant + Σ x_i move_i`` stays positive definite.

    Follows the minima of ``x_0 / weight - log det`` as the weight falls. At such a minimum, x_0 is
    above the least possible by less than the size of the matrix times the weight.

    Parameters
    ----------
    constant, moves : ndarray (m, m), (n, m, m)
        Symmetric matrices; the first move increases the matrix.
    start : ndarray (n,)
        Where the matrix is positive definite; where it is not, there is nothing to follow and the
        start comes back.
    accuracy : float
        Of x_0.
    enough : callable, optional
        Says of x ``(n,)`` that it will do.

    Returns
    -------
    ndarray (n,)
        The last x.
    """
    size, n = len(constant), len(moves)
    x = start
    if not _is_inside(constant + np.tensordot(x, moves, axes=1)):
        return x
    weight = 0.0
    for _ in range(_STEP_LIMIT):
        matrix = constant + np.tensordot(x, moves, axes=1)
        products = np.linalg.solve(matrix, moves)
        trace = np.trace(products, axis1=1, axis2=2)
        # first the weight for which x_0 is already right
        weight = weight or 1.0 / float(trace[0])
        gradient = -trace
        gradient[0] += 1.0 / weight
        hessian = products.reshape(n, -1) @ np.swapaxes(products, 1, 2).reshape(n, -1).T
        step = -np.linalg.lstsq(hessian, gradient, rcond=None)[0]
        decrement = float(np.sqrt(max(-gradient @ step, 0.0)))
        # the barrier is self-concordant: steps so damped stay inside
        new = x + step / (1.0 + decrement if decrement > _NEAR else 1.0)
        if not _is_inside(constant + np.tensordot(new, moves, axes=1)):
            break  # rounding has taken over
        x = new
        if enough(x) or (decrement <= _NEAR and size * weight < accuracy):
            break
        if decrement <= _NEAR:
            weight /= _WEIGHT_STEP
    return x


def _is_inside(matrix: FloatArray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


GOOD_ENOUGH = 0.9
"""τ at which the search ends: a tenth of the quadratic term is left, far above rounding."""

ACCURACY = 1e-3
"""Of the least τ, where it is above :data:`GOOD_ENOUGH`."""

BOUND_ACCURACY = 1e-7
"""Of the best bound, in units of the cost at the reference."""

_LEAST_CURVATURE = 1e-9
"""Part of the mean eigenvalue of the quadratic term that it has at least, as a measure."""


def balanced_multipliers(form: QuadraticForm) -> FloatArray:
    """Multipliers ``(1, 40)`` for one problem that balance the linear term with the best S.

    First those of least K in the measure of the quadratic term and the Frobenius norm, by linear
    least squares. Where they do not do, the ones of least τ, from a semidefinite problem.
    """
    start = least_multipliers(form)
    K = form.quadratic[0] - lagrangian(form, start)[0][0]
    flat, bends = _flat_directions()
    root = _root(form.quadratic[0])
    K, bends = root.T @ K @ root, root.T @ bends @ root
    y = -np.linalg.lstsq(bends.reshape(len(bends), -1).T, K.ravel(), rcond=None)[0]
    tau = _largest(K + np.tensordot(y, bends, axes=1))
    if tau > GOOD_ENOUGH:
        moves = np.concatenate([np.eye(18)[None], -bends])
        x = np.concatenate([[tau + max(0.1, abs(tau))], y])
        y = minimise_first(
            -K,
            moves,
            x,
            ACCURACY,
            enough=lambda x: _largest(K + np.tensordot(x[1:], bends, axes=1)) < GOOD_ENOUGH,
        )[1:]
    return np.asarray(start + y @ flat)


def best_multipliers(form: QuadraticForm) -> FloatArray:
    """Multipliers ``(1, 40)`` for one problem with the best bound, balanced or not.

    The largest ``constant - ρᵀ S⁻¹ ρ``, which is the value of the relaxed problem: of use where
    the reference is not, or cannot be shown to be, the global minimum. Starts from no multipliers
    at all, the minimum of the form over all matrices.
    The quadratic term has to be positive definite.
    """
    equations = rotation_constraints()
    constant = np.zeros((19, 19))
    constant[:18, :18] = form.quadratic[0]
    constant[18, :18] = constant[:18, 18] = form.linear[0]
    constant[18, 18] = cost = max(float(form.constant[0]), np.finfo(float).tiny)
    moves = np.zeros((41, 19, 19))
    moves[0, 18, 18] = cost  # x_0 is less the bound, in units of the cost
    for side in range(2):
        own, at = slice(1 + 20 * side, 21 + 20 * side), slice(9 * side, 9 * side + 9)
        moves[own, at, at] = -equations.bends
        moves[own, at, 18] = moves[own, 18, at] = -equations.slopes
    scale = np.zeros((19, 19))
    scale[:18, :18] = root = _root(form.quadratic[0])
    scale[18, 18] = 1.0 / np.sqrt(cost)
    constant, moves = scale.T @ constant @ scale, scale.T @ moves @ scale
    size = np.linalg.norm(moves[1:], axis=(1, 2))
    moves[1:] /= size[:, None, None]
    start = np.zeros(41)
    start[0] = 1.0 + float(np.square(root.T @ form.linear[0]).sum()) / cost
    return np.asarray(minimise_first(constant, moves, start, BOUND_ACCURACY)[None, 1:] / size)


def _flat_directions() -> tuple[FloatArray, FloatArray]:
    """Changes ``(28, 40)`` of multipliers without slope, and their bends ``(28, 18, 18)``."""
    equations = rotation_constraints()
    one = np.einsum("jab,kab->jk", equations.flat, equations.bends)
    flat = np.zeros((28, 40))
    flat[:14, :20], flat[14:, 20:] = one, one
    bends = np.zeros((28, 18, 18))
    bends[:14, :9, :9], bends[14:, 9:, 9:] = equations.flat, equations.flat
    return flat, bends


def _root(quadratic: FloatArray) -> FloatArray:
    """Matrix r with ``rᵀ quadratic r = I``, or less where the quadratic term is flat."""
    values, axes = np.linalg.eigh(quadratic)
    floor = _LEAST_CURVATURE * np.trace(quadratic) / len(quadratic)
    return np.asarray(axes / np.sqrt(np.maximum(values, floor)))


def _largest(matrix: FloatArray) -> float:
    return float(np.linalg.eigvalsh(matrix)[-1])
