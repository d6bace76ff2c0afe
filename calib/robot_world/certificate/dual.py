"""Lower bounds of the cost over all rotations, by Lagrangian duality.

The equations of two rotations (:mod:`~calib.robot_world.certificate.constraints`), each times any
multiplier, can be added to the cost without changing it on rotations::

    f(u) = constant + 2 ρ·u + uᵀ S u,    ρ = linear - Σ λ slope,   S = quadratic - Σ λ bend

Where S is positive definite the right-hand side is convex, and its least value over *all* u bounds
the cost from below. At the reference u = 0 the cost is the constant; so where it is stationary
(ρ = 0 is solvable then: the linear term is normal to the rotations) and S can be made positive
definite, the reference is the only global minimum, with no gap at all but rounding. Small residuals
need small multipliers, hence small changes of a positive definite matrix: below some noise the
proof always exists.

Whatever the multipliers, the bound holds: how they were found is no part of the proof.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.robot_world.algebra import apply_matrix
from calib.robot_world.certificate.constraints import rotation_constraints
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
    """Bounds of the costs of T problems.

    Attributes
    ----------
    value : ndarray (T,)
        No rotations have a lower cost: the allowance for rounding is taken off. Not below zero.
    smallest_eigenvalue : ndarray (T,)
        Of S, as computed [cost].
    convex : ndarray of bool (T,)
        S is positive definite beyond rounding: one pair of rotations at most reaches the bound.
    """

    value: FloatArray
    smallest_eigenvalue: FloatArray
    convex: BoolArray


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
