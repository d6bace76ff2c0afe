"""Rotations from the rotations of the pairs alone, translations by least squares, and what is left.

Most methods take some of these steps, and every solution is judged by them. They are written for
many sets at once: numpy calls its linear algebra once for each small matrix, which takes longer
than the products of all of them together.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.batch_last import (
    columns_of,
    matrices_of,
    product,
    rotation_log,
    transposed,
    turn,
)
from calib.robot_world.algebra import apply_matrix, kronecker, least_squares, triangle
from calib.robot_world.pair_arrays import PairArrays
from calib.se3 import BoolArray, FloatArray

_MANY = 24
"""Sets from which on it pays to avoid a factorisation of each."""

_SQUARINGS, _STEPS = 8, 8
"""A step multiplies by up to the 256th power of KᵀK: the error shrinks by (σ2/σ1)^512."""

_ONE_LEADS = 0.7
"""Sum of the squares of the eigenvalues of that power, over the square of their sum, from which on
the first is far ahead of all others and the steps arrive, instead of creeping."""

_SETTLED = 1e-24
"""Squared change of a unit vector that counts as none: what is left then is smaller still."""

_CLOSE = 0.98
"""Second singular value, of the first, from which on the digits lost count: the square root of
their distance is the tilt of the poses, here 11 deg."""

_FLAT = 0.5
"""Determinant of a leading vector, over that of a rotation, below which it is not near one."""

_ALTERNATIONS = 15

_HALF_TURNS = 2.0 * np.eye(3)[:, :, None] * np.eye(3)[:, None] - np.eye(3)
_THIRD_TURNS = np.stack([np.roll(np.eye(3), shift, axis=0) for shift in (1, 2)])

_NEWTON_STEPS = 8
_ORTHONORMAL = 1e-14

_WELL_CONDITIONED, _TURNED = 1e-2, 1e-3
"""Determinant of the normal matrix of the translations, over the cube of its mean eigenvalue, and
this, two thirds of the mean square rotation, above which its inverse is as good as an orthogonal
factorisation."""


def rotations(pairs: PairArrays, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations of X and Z ``(T, 3, 3)`` from those of the pairs alone.

    The vectors of :func:`leading` ``(T, 9)``, made orthonormal: the minimum of
    ``Σ |R_A R_X - R_Z R_B|²`` over matrices of fixed norm.
    """
    both = np.stack([x, z]).reshape(2, -1, 3, 3)
    volume = 27.0**0.5 * np.linalg.det(both)
    # A pair of singular vectors is defined up to one common sign: that of a rotation.
    both *= np.where(volume[1] < 0.0, -1.0, 1.0)[:, None, None]
    R_X, R_Z = nearest_rotations(both.reshape(-1, 3, 3)).reshape(both.shape)
    flat = np.abs(volume).min(axis=0) < _FLAT
    if flat.any() and not pairs.tentative:
        R_X[flat], R_Z[flat] = _alternated(pairs.kronecker_mean[flat], R_X[flat])
    return R_X, R_Z


def _alternated(K: FloatArray, R_X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations X and Z ``(T, 3, 3)`` for which ``<R_Z, K R_X>`` is largest.

    Where several singular values are equal, or nearly so, a leading vector may be of any rank, and
    says little of the rotations next to it. One is made the best for the other in turn, from
    several starts, since such problems have several maxima.
    """
    starts = np.concatenate([np.eye(3)[None], _HALF_TURNS, _THIRD_TURNS])
    X = R_X[:, None] @ starts
    flat = np.repeat(K, len(starts), axis=0)
    X, Z = _in_turn(flat, X.reshape(-1, 3, 3), _ALTERNATIONS)
    value = (Z.reshape(-1, 9) * apply_matrix(flat, X.reshape(-1, 9))).sum(axis=-1)
    best = value.reshape(len(K), -1).argmax(axis=1) + len(starts) * np.arange(len(K))
    return _in_turn(K, X[best], 2 * _ALTERNATIONS)


def _in_turn(K: FloatArray, R_X: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    for _ in range(count):
        R_Z = se3.project_to_rotation(apply_matrix(K, R_X.reshape(-1, 9)).reshape(-1, 3, 3))
        back = apply_matrix(np.swapaxes(K, -1, -2), R_Z.reshape(-1, 9))
        R_X = se3.project_to_rotation(back.reshape(-1, 3, 3))
    return R_X, R_Z


def leading(pairs: PairArrays) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular vectors ``(T, 9)``, right and left, of the largest singular values ``(T,)``.

    Of :attr:`PairArrays.kronecker_mean`, and these values.
    """
    K = pairs.kronecker_mean
    x, z, close = leading_vectors(K)
    if close.any():
        x[close], z[close] = _by_deviations(pairs, close)
    return x, z, (apply_matrix(K, x) * z).sum(axis=-1)


def leading_vectors(K: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Right and left singular vectors ``(T, n)`` of the largest singular values of ``(T, n, n)``.

    Of many matrices by powers of KᵀK. Also those ``(T,)`` whose second value is close, so that the
    vectors have lost digits.
    """
    if len(K) < _MANY:
        U, values, Vt = np.linalg.svd(K)
        return Vt[:, 0].copy(), U[:, :, 0].copy(), values[:, 1] > _CLOSE * values[:, 0]
    power = np.swapaxes(K, -1, -2) @ K
    for _ in range(_SQUARINGS):
        power /= np.trace(power, axis1=1, axis2=2)[:, None, None]
        power = power @ power
        total = np.trace(power, axis1=1, axis2=2)
        leads = (power * power).sum(axis=(1, 2)) > _ONE_LEADS * total**2
        if leads.all():
            break
    largest = np.diagonal(power, axis1=1, axis2=2).argmax(axis=-1)
    x = np.take_along_axis(power, largest[:, None, None], axis=2)[..., 0]
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    for _ in range(_STEPS):
        new = apply_matrix(power, x)
        new /= np.linalg.norm(new, axis=-1, keepdims=True)
        close = ~(((new - x) ** 2).sum(axis=-1) < _SETTLED)
        x = new
        if not close[leads].any():
            break
    close |= ~leads
    z = apply_matrix(K, x)
    return x, z / np.linalg.norm(z, axis=-1, keepdims=True), close


def _by_deviations(pairs: PairArrays, sets: BoolArray) -> tuple[FloatArray, FloatArray]:
    """The same vectors ``(count, 9)`` of some sets, with the digits that close values lose.

    With K_i the products and K their mean, x is the last right singular vector of all ``K_i - K``
    stacked, since the K_i are orthogonal matrices. Where the poses hardly tilt, the leading
    singular values of K are nearly equal, and tell the square of what these tell.
    """
    every = kronecker(pairs.A[sets], pairs.B[sets])
    K = every.mean(axis=1)
    stacked = (every - K[:, None]).reshape(len(K), 9 * pairs.N, 9)
    x = np.asarray(np.linalg.svd(triangle(stacked))[2])[:, 8]
    z = apply_matrix(K, x)
    return x, z / np.linalg.norm(z, axis=-1, keepdims=True)


def nearest_rotations(matrix: FloatArray) -> FloatArray:
    """Rotations nearest to matrices ``(T, 3, 3)`` that are nearly multiples of rotations.

    As :func:`calib.se3.project_to_rotation`, by Newton's iteration where there are many.
    """
    if len(matrix) < _MANY:
        return se3.project_to_rotation(matrix)
    C = columns_of(matrix)
    C *= np.sqrt(3.0 / (C * C).sum(axis=(0, 1)))
    for _ in range(_NEWTON_STEPS):
        gram = product(transposed(C), C)
        deviation = gram.copy()
        for k in range(3):
            deviation[k, k] -= 1.0
        if not (np.abs(deviation).max() > _ORTHONORMAL):
            break
        C = C - 0.5 * product(C, deviation)
    R = matrices_of(C)
    far = np.abs(deviation).max(axis=(0, 1)) > _ORTHONORMAL
    far |= ~(np.linalg.det(R) > 0.0)
    if far.any():
        R[far] = se3.project_to_rotation(matrix[far])
    return R


def assemble(pairs: PairArrays, R_X: FloatArray, R_Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(T, 4, 4)`` from their rotations ``(T, 3, 3)``, translations by least squares.

    Minimises ``Σ |R_A p_X + p_A - R_Z p_B - p_Z|²`` (Eq. 16 of Li et al. 2010). p_Z is the mean
    of what the rest leaves over; the equations less their mean give p_X.
    """
    return assemble_with_rest(pairs, R_X, R_Z)[:2]


def assemble_with_rest(
    pairs: PairArrays, R_X: FloatArray, R_Z: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Like :func:`assemble`, and the root mean square distance ``(T,)`` that is left.

    The normal matrix of p_X is that of the rotations less their mean, ``1 - meanᵀ mean``.
    """
    offset = turn(pairs.spread(columns_of(R_Z)), pairs.p_B) - pairs.p_A
    R_mean, offset_mean = pairs.mean_R_A, pairs.mean(offset)
    d = offset - pairs.spread(offset_mean)
    normal = -product(transposed(R_mean), R_mean)
    for k in range(3):
        normal[k, k] += 1.0
    inverse, poor = _inverted(normal)
    p_X = turn(inverse, pairs.mean_turned_back(d))
    if poor.any():
        p_X[:, poor] = _by_factorisation(pairs, d, poor)
    left = d - turn(pairs.R_A, pairs.spread(p_X)) + pairs.spread(turn(R_mean, p_X))
    p_Z = turn(R_mean, p_X) - offset_mean
    rest = np.sqrt(pairs.mean((left * left).sum(axis=0)))
    return se3.transform(R_X, p_X.T), se3.transform(R_Z, p_Z.T), rest


def _inverted(normal: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Inverses ``(3, 3, T)`` of symmetric matrices, and which of them lack digits."""
    mean = (normal[0, 0] + normal[1, 1] + normal[2, 2]) / 3.0
    if len(mean) < _MANY:
        matrices = normal.transpose(2, 0, 1)
        poor = _are_poor(mean, np.linalg.det(matrices))
        inverses = np.linalg.inv(np.where(poor[:, None, None], np.eye(3), matrices))
        return np.ascontiguousarray(inverses.transpose(1, 2, 0)), poor
    cofactor = np.empty_like(normal)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        cofactor[k, k] = normal[i, i] * normal[j, j] - normal[i, j] ** 2
        off = normal[i, k] * normal[j, k] - normal[i, j] * normal[k, k]
        cofactor[i, j] = cofactor[j, i] = off
    determinant = (normal[0] * cofactor[0]).sum(axis=0)
    poor = _are_poor(mean, determinant)
    return cofactor / np.where(poor, 1.0, determinant), poor


def _are_poor(mean: FloatArray, determinant: FloatArray) -> BoolArray:
    """Whether normal matrices lack digits, by their mean eigenvalues and determinants ``(T,)``."""
    return ~((mean > _TURNED) & (determinant > _WELL_CONDITIONED * mean**3))


def _by_factorisation(pairs: PairArrays, d: FloatArray, sets: BoolArray) -> FloatArray:
    """p_X ``(3, count)`` of some sets, whatever their condition."""
    T, N = pairs.T, pairs.N
    R_A = pairs.A[sets, :, :3, :3]
    rows = (R_A - R_A.mean(axis=1, keepdims=True)).reshape(-1, 3 * N, 3)
    right = d.reshape(3, T, N).transpose(1, 2, 0)[sets].reshape(-1, 3 * N)
    return least_squares(rows, right).T


def residual_rows(pairs: PairArrays, X: FloatArray, Z: FloatArray) -> FloatArray:
    """Residuals ``(6, S)`` of X and Z ``(T, 4, 4)``; see :func:`results.residuals`."""
    R_X, R_Z = (pairs.spread(columns_of(M[:, :3, :3])) for M in (X, Z))
    turned = product(product(pairs.R_A, R_X), transposed(product(R_Z, pairs.R_B)))
    return np.concatenate([rotation_log(turned), _gaps(pairs, X, Z, R_Z)])


def rest_of_rotations(pairs: PairArrays, R_X: FloatArray, R_Z: FloatArray) -> FloatArray:
    """Root mean square residual angle ``(T,)`` [rad] of :func:`rotations`, as if all were small.

    By the mean of ``|R_A R_X - R_Z R_B|²``, twice the square of a small angle. What rounding leaves
    is 3e-8.
    """
    shown = apply_matrix(pairs.kronecker_mean, R_X.reshape(-1, 9))
    square = 3.0 - (shown * R_Z.reshape(-1, 9)).sum(axis=-1)
    return np.asarray(np.sqrt(np.clip(square, 0.0, None)))


def residual_rms(pairs: PairArrays, X: FloatArray, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Root mean square residual angle [rad] and distance [m] ``(T,)`` of X and Z ``(T, 4, 4)``.

    The chord of a rotation by θ is ``|R - 1|_F = √8 sin(θ/2)``.
    """
    R_X, R_Z = (pairs.spread(columns_of(M[:, :3, :3])) for M in (X, Z))
    chord = product(pairs.R_A, R_X) - product(R_Z, pairs.R_B)
    half_sine = np.sqrt(np.minimum((chord * chord).sum(axis=(0, 1)) / 8.0, 1.0))
    angle = 2.0 * np.arcsin(half_sine)
    gap = _gaps(pairs, X, Z, R_Z)
    return np.sqrt(pairs.mean(angle**2)), np.sqrt(pairs.mean((gap * gap).sum(axis=0)))


def _gaps(pairs: PairArrays, X: FloatArray, Z: FloatArray, R_Z: FloatArray) -> FloatArray:
    """Origins of A X less those of Z B ``(3, S)``."""
    p_X, p_Z = (pairs.spread(M[:, :3, 3].T) for M in (X, Z))
    return turn(pairs.R_A, p_X) + pairs.p_A - turn(R_Z, pairs.p_B) - p_Z
