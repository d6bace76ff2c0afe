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
from calib.errors import InputError
from calib.robot_world.algebra import apply_matrix
from calib.robot_world.noise import PairNoise
from calib.se3 import BoolArray, FloatArray

_OPERATIONS = 64
"""Roundings in a residual, generously: two products of transforms and a difference. A sum over N
pairs adds N at most."""

_SINGULAR = 1e-12
"""Part of the largest eigenvalue of the normal equations of p_X below which rounding may have
made it: a spread of the axes of 1e-6."""


@dataclass(frozen=True)
class Weights:
    """Factors of the squared norms of the cost."""

    rotation: float  # w_R, of ``|R_A R_X - R_Z R_B|²`` (Frobenius norm)
    translation: float  # w_p, of ``|R_A p_X + p_A - R_Z p_B - p_Z|²`` [1/m²]


def cost_weights(noise: PairNoise) -> Weights:
    """Weights for which the cost is chi² of a noise on one side.

    Raises
    ------
    InputError
        Noise on both sides, or a standard deviation of zero.
    """
    if noise.on == "both":
        raise InputError(
            "noise on A and B at once makes the cost no polynomial in the rotations: "
            "the rotation of A's noise moves the origin of X",
            hint="take the noise of the side that has more of it",
            name="on",
            value=noise.on,
        )
    for name in ("rotation_rad", "translation_m"):
        if getattr(noise, name) == 0.0:
            raise InputError(
                f"{name} of the noise is 0, which gives its residuals no finite weight",
                hint="give a standard deviation above 0",
                name=name,
                value=0.0,
                bound=0.0,
            )
    return Weights(0.5 / noise.rotation_rad**2, 1.0 / noise.translation_m**2)


@dataclass(frozen=True, eq=False)
class QuadraticForm:
    """Cost of T problems over the offsets of both rotations from a reference."""

    X: FloatArray
    Z: FloatArray  # X, Z (T, 4, 4): the reference
    quadratic: FloatArray  # (T, 18, 18)
    linear: FloatArray  # (T, 18)
    constant: FloatArray
    """(T,): ``constant + 2 linear·u + uᵀ quadratic u`` is the least cost over the translations."""
    translation_map: FloatArray
    """(T, 6, 19): by it, (u, 1) gives the offsets of the translations from the reference that go
    with u."""
    rounding: FloatArray
    constant_rounding: FloatArray
    """rounding, constant_rounding (T,): by how much rounding may have changed ``quadratic``
    (spectral norm) or ``linear`` (Euclidean norm), and ``constant``. Infinite where the motion
    leaves a translation free: all rotations of A about one axis, or none."""

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
        """X and Z ``(T, 4, 4)`` turned from the reference by rotations ``I + U`` and ``I + V``.

        With the translations that fit best.
        """
        u = join(turn_X - np.eye(3), turn_Z - np.eye(3))
        moved = apply_matrix(self.translation_map[..., :18], u) + self.translation_map[..., 18]
        return (
            self.X @ se3.transform(turn_X, moved[:, :3]),
            self.Z @ se3.transform(turn_Z, moved[:, 3:]),
        )


def join(U: FloatArray, V: FloatArray) -> FloatArray:
    """The vector (vec U, vec V) ``(..., 18)``, row by row, of matrices ``(..., 3, 3)``."""
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
    """
    moved = se3.inverse(Z)[:, None] @ A @ X[:, None]  # what B would be without noise
    turns = weights.rotation * _rotation_terms(moved, B)
    shifts, least, free = _translation_terms(moved, B)
    whole = turns + weights.translation * shifts
    constant = whole[:, 18, 18]

    N = A.shape[1]
    unit = (N + _OPERATIONS) * np.finfo(float).eps
    size = _size(A, B, X, Z, weights) + np.sqrt(3.0 * N * weights.translation) * np.linalg.norm(
        least[:, :3], axis=(1, 2)
    )
    size = np.where(free, np.inf, size)
    return QuadraticForm(
        X=X,
        Z=Z,
        quadratic=whole[:, :18, :18],
        linear=whole[:, 18, :18],
        constant=constant,
        translation_map=least,
        rounding=unit * size**2,
        # of the residuals |r|² themselves, whose length is off by up to unit * size
        constant_rounding=unit * (constant + 2.0 * size * np.sqrt(np.abs(constant)))
        + (unit * size) ** 2,
    )


def _size(
    A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, weights: Weights
) -> FloatArray:
    """Length ``(T,)`` of all that is subtracted in the residuals, weighted: what rounding is of."""
    reach = sum(np.square(T[..., :3, 3]).sum(axis=-1) for T in (A, B, X[:, None], Z[:, None]))
    turns = 6.0 * A.shape[1] * weights.rotation
    return np.asarray(np.sqrt(turns + weights.translation * np.sum(reach, axis=1)))


def _rotation_terms(moved: FloatArray, B: FloatArray) -> FloatArray:
    """Form ``(T, 19, 19)`` in (u, 1) of ``|E + R U - V P|²``, summed; E = R - P."""
    T, N = B.shape[:2]
    R, P = moved[..., :3, :3], B[..., :3, :3]
    E = R - P
    products = np.swapaxes(R.reshape(T, N, 9), 1, 2) @ P.reshape(T, N, 9)
    whole: FloatArray = np.tile(N * np.eye(19), (T, 1, 1))
    # <R U, V P> is the sum of R_ab P_dc U_bc V_ad
    cross = products.reshape(T, 3, 3, 3, 3).transpose(0, 2, 4, 1, 3).reshape(T, 9, 9)
    whole[:, :9, 9:18] = -cross
    whole[:, 9:18, :9] = -np.swapaxes(cross, 1, 2)
    by_U = (np.swapaxes(R, -1, -2) @ E).sum(axis=1)
    by_V = -(E @ np.swapaxes(P, -1, -2)).sum(axis=1)
    whole[:, 18, :18] = whole[:, :18, 18] = join(by_U, by_V)
    whole[:, 18, 18] = (E * E).sum(axis=(1, 2, 3))
    return whole


def _translation_terms(
    moved: FloatArray, B: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Form ``(T, 19, 19)`` in (u, 1) of ``|e + R p_x - V p - p_z|²``, least over p_x and p_z.

    p_z takes the mean off everything; the normal equations of p_x give the rest. Also their map
    ``(T, 6, 19)``, and where p_x is not unique ``(T,)``.
    """
    T, N = B.shape[:2]
    R, p = moved[..., :3, :3], B[..., :3, 3]
    e = moved[..., :3, 3] - p
    R_mean, p_mean, e_mean = R.mean(axis=1), p.mean(axis=1), e.mean(axis=1)
    R, p, e = R - R_mean[:, None], p - p_mean[:, None], e - e_mean[:, None]
    p_t, stacked = np.swapaxes(p, 1, 2), R.reshape(T, 3 * N, 3)

    to_u = np.zeros((T, 3, 19))  # products of the columns of p_x with those of (u, 1)
    R_p = np.swapaxes(R.reshape(T, N, 9), 1, 2) @ p  # sums of R_ac p_b
    to_u[..., 9:18] = -R_p.reshape(T, 3, 3, 3).transpose(0, 2, 1, 3).reshape(T, 3, 9)
    to_u[..., 18] = (np.swapaxes(stacked, 1, 2) @ e.reshape(T, 3 * N, 1))[..., 0]
    solved, free = _solve_normal(np.swapaxes(stacked, 1, 2) @ stacked, to_u)

    whole = np.zeros((T, 19, 19))
    least = np.zeros((T, 6, 19))
    least[:, :3] = -solved
    least[:, 3:] = -R_mean @ solved
    least[:, 3:, 18] += e_mean
    for row in range(3):
        block = slice(9 + 3 * row, 12 + 3 * row)
        whole[:, block, block] = p_t @ p
        least[:, 3 + row, block] -= p_mean
    whole[:, 18, 9:18] = whole[:, 9:18, 18] = -(np.swapaxes(e, 1, 2) @ p).reshape(T, 9)
    whole[:, 18, 18] = (e * e).sum(axis=(1, 2))
    taken = np.swapaxes(to_u, 1, 2) @ solved
    return np.asarray(whole - 0.5 * (taken + np.swapaxes(taken, 1, 2))), least, free


def _solve_normal(normal: FloatArray, right_side: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Solutions ``(T, 3, 19)`` of normal equations ``(T, 3, 3)``, and where they are not unique.

    A direction along which the rotations do not differ gets no component: the cost is the same
    all along it.
    """
    values, axes = np.linalg.eigh(normal)
    live = values > _SINGULAR * values[:, 2:]
    inverse = np.where(live, 1.0 / np.where(live, values, 1.0), 0.0)
    along = np.swapaxes(axes, 1, 2) @ right_side
    return np.asarray((axes * inverse[:, None, :]) @ along), np.asarray(~live.all(axis=-1))
