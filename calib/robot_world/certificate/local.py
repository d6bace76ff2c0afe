"""Local minimum of the cost over both rotations, by Newton's method on the manifold.

Every iteration works on 18 numbers whatever the number of pairs. Steps are rotation vectors from
the left, ``R ← exp([w]) R``. Far from the minimum the Hessian may be indefinite: the absolute
values of its eigenvalues, plus a damping, then make every step one that descends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.robot_world.algebra import apply_matrix
from calib.robot_world.certificate.polynomial import QuadraticForm, Weights, join, quadratic_form
from calib.se3 import BoolArray, FloatArray, IntArray

ARRIVED_RAD = 1e-9
"""Length of an undamped step after which there is no other: Newton squares it."""

ITERATION_LIMIT = 100
"""Quadratic convergence takes some 5 steps, and far starts some 20."""

_LARGEST_STEP_RAD = 1.0
"""Beyond that a model of second order says nothing of a rotation."""

_LEAST_CURVATURE = 1e-12
"""Part of the largest eigenvalue of the Hessian below which a direction counts as flat: nothing
moves along it."""

_GOOD_MODEL = 0.5
"""Decrease of the cost, in units of the one foreseen, from which a step needs no damping."""

_FIRST_DAMPING = 1e-2
"""In units of the largest eigenvalue of the Hessian; where a step fails, ten times as much."""

_MATRICES = np.array([se3.skew(axis) for axis in np.eye(3)])


@dataclass(frozen=True, eq=False)
class LocalMinimum:
    """Stationary points that T descents ended in.

    Attributes
    ----------
    X, Z : ndarray (T, 4, 4)
        The transforms.
    cost : ndarray (T,)
        chi², where the weights are those of the noise.
    iterations : ndarray of int (T,)
        Steps of Newton's method.
    converged : ndarray of bool (T,)
        The last step was one that needs no other.
    """

    X: FloatArray
    Z: FloatArray
    cost: FloatArray
    iterations: IntArray
    converged: BoolArray


def minimise(
    A: FloatArray, B: FloatArray, R_X: FloatArray, R_Z: FloatArray, weights: Weights
) -> LocalMinimum:
    """Descend from given rotations to a stationary point of the cost, as a rule a local minimum.

    Parameters
    ----------
    A, B : ndarray (T, N, 4, 4)
        Measured transforms, rotations orthonormal to rounding; noise on B.
    R_X, R_Z : ndarray (T, 3, 3)
        Where to start, anywhere.
    weights : Weights
        Of the two kinds of residual: those of the noise, or 1 and 1 as in Dornaika and Horaud
        1998.

    Returns
    -------
    LocalMinimum
        For T problems. The first descent ends to the precision that the numbers far from the
        reference have; the second one starts there with the reference at the end of the first.
    """
    none = np.zeros(3)
    form = quadratic_form(A, B, se3.transform(R_X, none), se3.transform(R_Z, none), weights)
    X, Z, first, _ = descend(form)
    form = quadratic_form(A, B, X, Z, weights)
    X, Z, second, converged = descend(form)
    cost = form.cost(form.offset(X[:, :3, :3], Z[:, :3, :3]))
    return LocalMinimum(X, Z, cost, first + second, converged)


def descend(form: QuadraticForm) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
    """X, Z ``(T, 4, 4)``, number of steps and convergence ``(T,)`` from the form's reference."""
    T = len(form.constant)
    turns = np.tile(np.eye(3), (T, 2, 1, 1))  # of X and Z from the reference
    damping = np.zeros(T)
    steps = np.zeros(T, dtype=np.intp)
    converged = np.zeros(T, dtype=bool)
    for _ in range(ITERATION_LIMIT):
        at = np.flatnonzero(~converged)
        if not len(at):
            break
        G, g = form.quadratic[at], form.linear[at]
        slope, curvature = derivatives(G, g, turns[at])
        step, foreseen = _step(slope, curvature, damping[at])
        new = se3.rotation_exp(step.reshape(-1, 2, 3)) @ turns[at]
        old_u = _offset(turns[at])
        change = _offset(new) - old_u
        # the difference itself, since costs far from the minimum would hide it in their rounding
        decrease = -(change * (apply_matrix(G, 2.0 * old_u + change) + 2.0 * g)).sum(axis=-1)
        length = np.linalg.norm(step, axis=-1)
        small = length < ARRIVED_RAD
        accepted = small | (decrease > 0.0)
        turns[at[accepted]] = new[accepted]
        steps[at] += 1
        converged[at] = small & (damping[at] == 0.0)
        good = small | (decrease > _GOOD_MODEL * foreseen)
        more = np.maximum(10.0 * damping[at], _FIRST_DAMPING)
        damping[at] = np.where(good, 0.0, np.where(accepted, damping[at], more))
    X, Z = form.transforms(turns[:, 0], turns[:, 1])
    return X, Z, steps, converged


def derivatives(
    quadratic: FloatArray, linear: FloatArray, turns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gradient ``(T, 6)`` and Hessian ``(T, 6, 6)`` of the cost by (w_X, w_Z).

    Parameters
    ----------
    quadratic, linear : ndarray (T, 18, 18), (T, 18)
        Of the form.
    turns : ndarray (T, 2, 3, 3)
        Rotations of X and Z from the reference, at which to take them, moved by ``exp([w])`` from
        the left.
    """
    T = len(turns)
    D = np.zeros((T, 18, 6))
    moved = _MATRICES @ turns[:, :, None]  # (T, 2, 3, 3, 3): [axis] R
    moved = np.moveaxis(moved.reshape(T, 2, 3, 9), 2, 3)
    D[:, :9, :3], D[:, 9:, 3:] = moved[:, 0], moved[:, 1]
    by_u = 2.0 * (linear + apply_matrix(quadratic, _offset(turns)))
    slope = apply_matrix(np.swapaxes(D, 1, 2), by_u)
    curvature = 2.0 * np.swapaxes(D, 1, 2) @ quadratic @ D
    # exp([w]) = I + [w] + [w]²/2, and the trace of Γᵀ [w]² is wᵀ Γ w - tr Γ |w|²
    force = by_u.reshape(T, 2, 3, 3) @ np.swapaxes(turns, -1, -2)
    trace = np.trace(force, axis1=-2, axis2=-1)[..., None, None]
    bend = 0.5 * (force + np.swapaxes(force, -1, -2)) - trace * np.eye(3)
    curvature[:, :3, :3] += bend[:, 0]
    curvature[:, 3:, 3:] += bend[:, 1]
    return slope, 0.5 * (curvature + np.swapaxes(curvature, 1, 2))


def _step(
    slope: FloatArray, curvature: FloatArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Damped steps ``(T, 6)`` [rad] and the decrease of the cost they promise ``(T,)``."""
    values, axes = np.linalg.eigh(curvature)
    size = np.abs(values)
    largest = size.max(axis=-1, keepdims=True)
    along = apply_matrix(np.swapaxes(axes, 1, 2), slope)
    bound = size + damping[:, None] * largest
    live = bound > _LEAST_CURVATURE * largest
    along_step = np.where(live, -along / np.where(live, bound, 1.0), 0.0)
    length = np.linalg.norm(along_step, axis=-1, keepdims=True)
    shrink = np.minimum(1.0, _LARGEST_STEP_RAD / np.maximum(length, _LARGEST_STEP_RAD))
    along_step = along_step * shrink
    foreseen = -(along_step * along + 0.5 * values * along_step**2).sum(axis=-1)
    return apply_matrix(axes, along_step), foreseen


def _offset(turns: FloatArray) -> FloatArray:
    return join(turns[:, 0] - np.eye(3), turns[:, 1] - np.eye(3))
