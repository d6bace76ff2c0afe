"""Better multipliers where those of least norm do not make S positive definite.

The change ``K = quadratic - S`` is measured in units of the quadratic term: S is positive definite
when the largest eigenvalue τ of ``quadratic^-½ K quadratic^-½`` is below 1. That does not depend
on how well conditioned the motion is, while the norm of K does.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.certificate.barrier import minimise_first
from calib.robot_world.certificate.constraints import rotation_constraints
from calib.robot_world.certificate.dual import lagrangian, least_multipliers
from calib.robot_world.certificate.polynomial import QuadraticForm
from calib.se3 import FloatArray

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

    Parameters
    ----------
    form : QuadraticForm
        Of one problem, T = 1.
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

    Parameters
    ----------
    form : QuadraticForm
        Of one problem, T = 1, whose quadratic term is positive definite.
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
