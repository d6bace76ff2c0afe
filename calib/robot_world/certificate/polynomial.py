"""The maximum-likelihood cost of A X = Z B as a polynomial of the second degree.

With noise on B alone, isotropic (Langevin) in rotation and normal in translation, twice the
negative logarithm of the likelihood is, but for a constant::

    chi² = Σ  w_R |R_A R_X - R_Z R_B|²  +  w_p |R_A p_X + p_A - R_Z p_B - p_Z|²
    w_R = 1 / (2 σ_R²),   w_p = 1 / σ_p²

Two rotations θ apart differ by 8 sin²(θ/2) = 2 θ² + ... in the squared Frobenius norm, hence the
2: every term is the square of a residual over its standard deviation, in each of three axes, and
the sum over N pairs has about 6 N - 12 degrees of freedom. The cost here is this chi² itself,
not half of it.

Least squares gives p_X and p_Z exactly, so that the rotations alone are left. They are written as
offsets from a reference, ``X = X₀ (I + U)``, ``Z = Z₀ (I + V)``, which makes the cost ``constant +
2 linear·u + uᵀ quadratic u`` with u = (vec U, vec V), row by row, 18 numbers. In terms of the
rotations themselves, a small cost would be the difference of numbers as large as the data over
the noise. With the reference at the solution, nothing cancels: the constant is the cost, made
from the residuals. The form takes O(N) to build, and nothing after that depends on N. It has no
unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.robot_world.algebra import apply_matrix
from calib.se3 import FloatArray


@dataclass(frozen=True)
class Weights:
    """Factors of the squared norms of the cost.

    Attributes
    ----------
    rotation : float
        w_R, of ``|R_A R_X - R_Z R_B|²`` (Frobenius norm).
    translation : float
        w_p, of ``|R_A p_X + p_A - R_Z p_B - p_Z|²`` [1/m²].
    """

    rotation: float
    translation: float


@dataclass(frozen=True, eq=False)
class QuadraticForm:
    """Cost of T problems over the offsets of both rotations from a reference.

    Attributes
    ----------
    X, Z : ndarray (T, 4, 4)
        The reference.
    quadratic, linear, constant : ndarray (T, 18, 18), (T, 18), (T,)
        ``constant + 2 linear·u + uᵀ quadratic u`` is the least cost over the translations.
    translation_map : ndarray (T, 6, 19)
        By it, (u, 1) gives the offsets of the translations from the reference that go with u.
    translation_condition : ndarray (T,)
        Condition of the equations that gave p_X; infinite where the rotations of A are all alike.
    """

    X: FloatArray
    Z: FloatArray
    quadratic: FloatArray
    linear: FloatArray
    constant: FloatArray
    translation_map: FloatArray
    translation_condition: FloatArray

    def offset(self, R_X: FloatArray, R_Z: FloatArray) -> FloatArray:
        """Offsets u ``(..., T, 18)`` of rotations ``(..., T, 3, 3)`` from the reference."""
        U = np.swapaxes(self.X[:, :3, :3], -1, -2) @ R_X - np.eye(3)
        V = np.swapaxes(self.Z[:, :3, :3], -1, -2) @ R_Z - np.eye(3)
        return join(U, V)

    def cost(self, u: FloatArray) -> FloatArray:
        """Least cost ``(..., T)`` over the translations at offsets ``(..., T, 18)``."""
        slope = apply_matrix(self.quadratic, u) + 2.0 * self.linear
        return np.asarray(self.constant + (u * slope).sum(axis=-1))

    def transforms(self, turn_X: FloatArray, turn_Z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """X and Z ``(T, 4, 4)`` turned from the reference, with the translations that fit best.

        Parameters
        ----------
        turn_X, turn_Z : ndarray (T, 3, 3)
            Rotations ``I + U`` and ``I + V`` from the reference.
        """
        u = join(turn_X - np.eye(3), turn_Z - np.eye(3))
        moved = apply_matrix(self.translation_map[..., :18], u) + self.translation_map[..., 18]
        return (
            self.X @ se3.transform(turn_X, moved[:, :3]),
            self.Z @ se3.transform(turn_Z, moved[:, 3:]),
        )


def join(U: FloatArray, V: FloatArray) -> FloatArray:
    """u = (vec U, vec V) ``(..., 18)``, row by row, of matrices ``(..., 3, 3)``."""
    return np.concatenate(
        [U.reshape(*U.shape[:-2], 9), V.reshape(*V.shape[:-2], 9)],
        axis=-1,
    )


def quadratic_form(
    A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, weights: Weights
) -> QuadraticForm:
    """The cost about a reference, translations eliminated.

    Parameters
    ----------
    A, B : ndarray (T, N, 4, 4)
        Measured transforms, rotations orthonormal to rounding; noise on B.
    X, Z : ndarray (T, 4, 4)
        The reference; numbers are most accurate where it is close to the solution.
    weights : Weights
        Of the two kinds of residual.

    Returns
    -------
    QuadraticForm
        For T problems.
    """
    T, N = A.shape[:2]
    moved = se3.inverse(Z)[:, None] @ A @ X[:, None]  # what B would be without noise
    R, P = moved[..., :3, :3], B[..., :3, :3]
    quadratic = np.zeros((T, 18, 18))
    linear = np.zeros((T, 18))

    # Rotations: |E + R U - V P|² with E = R - P
    E = R - P
    w = weights.rotation
    products = np.swapaxes(R.reshape(T, N, 9), 1, 2) @ P.reshape(T, N, 9)  # Σ R_ab P_dc
    cross = products.reshape(T, 3, 3, 3, 3).transpose(0, 2, 4, 1, 3).reshape(T, 9, 9)
    quadratic[:, :9, 9:] = -w * cross  # bc, ad
    quadratic[:, 9:, :9] = np.swapaxes(quadratic[:, :9, 9:], 1, 2)
    diagonal = np.arange(18)
    quadratic[:, diagonal, diagonal] = w * N
    linear[:, :9] = w * np.einsum("tnab,tnac->tbc", R, E).reshape(T, 9)
    linear[:, 9:] = -w * np.einsum("tnac,tndc->tad", E, P).reshape(T, 9)
    constant = w * np.einsum("tnab,tnab->t", E, E)
    return _with_translations(moved, B, X, Z, weights, quadratic, linear, constant)


def _with_translations(
    moved: FloatArray,
    B: FloatArray,
    X: FloatArray,
    Z: FloatArray,
    weights: Weights,
    quadratic: FloatArray,
    linear: FloatArray,
    constant: FloatArray,
) -> QuadraticForm:
    """Add the terms ``|e + R p_x - V p - p_z|²`` of the translations, least over p_x and p_z.

    p_z takes the mean off everything; the 3 x 3 normal equations of p_x then give the rest.
    """
    T = len(X)
    R, p = moved[..., :3, :3], B[..., :3, 3]
    e = moved[..., :3, 3] - p
    R_mean, p_mean, e_mean = R.mean(axis=1), p.mean(axis=1), e.mean(axis=1)
    R, p, e = R - R_mean[:, None], p - p_mean[:, None], e - e_mean[:, None]
    w = weights.translation
    normal = w * np.einsum("tnab,tnac->tbc", R, R)
    to_u = np.zeros((T, 3, 19))  # products of the columns of p_x with those of (u, 1)
    to_u[..., 9:18] = -w * np.einsum("tnac,tnb->tcab", R, p).reshape(T, 3, 9)
    to_u[..., 18] = w * np.einsum("tnab,tna->tb", R, e)
    values, axes = np.linalg.eigh(normal)
    smallest, largest = values[:, 0], values[:, 2]
    usable = values > np.finfo(float).eps * largest[:, None]
    inverse = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
    solved = (axes * inverse[:, None, :]) @ (np.swapaxes(axes, 1, 2) @ to_u)

    second = w * np.einsum("tnb,tnc->tbc", p, p)
    for row in range(3):
        block = slice(9 + 3 * row, 12 + 3 * row)
        quadratic[:, block, block] += second
    linear[:, 9:] -= w * np.einsum("tna,tnb->tab", e, p).reshape(T, 9)
    constant = constant + w * np.einsum("tna,tna->t", e, e)
    taken = np.swapaxes(to_u, 1, 2) @ solved
    quadratic = quadratic - 0.5 * (taken + np.swapaxes(taken, 1, 2))[:, :18, :18]
    linear = linear - taken[:, :18, 18]
    constant = constant - taken[:, 18, 18]

    translation_map = np.zeros((T, 6, 19))
    translation_map[:, :3] = -solved
    translation_map[:, 3:] = -R_mean @ solved
    translation_map[:, 3:, 18] += e_mean
    for row in range(3):
        translation_map[:, 3 + row, 9 + 3 * row : 12 + 3 * row] -= p_mean
    singular = smallest <= np.finfo(float).eps * largest
    condition = np.where(singular, np.inf, largest / np.where(singular, 1.0, smallest))
    return QuadraticForm(X, Z, quadratic, linear, constant, translation_map, condition)
