"""How the errors of A and B enter the equation of a pair, and the rows that this makes alike.

At true transforms ``A X = Z B`` holds. Small errors of them leave, in the axes of the base::

    e_R = a + R_A x - R_Z b - z
    e_p = α + R_A ξ - R_Z β - ζ + a × R_A p_X - z × R_Z p_B

with (a, α), (b, β), (x, ξ) and (z, ζ) the errors (w, v) of A, B, X and Z, each a rotation from the
left and a translation: the rotation of A moves the origin of X as well. The errors of A and B give
(e_R, e_p) a covariance; rows are white where that has been taken out of them. Everything is laid
out with the pair as the last index, see :mod:`calib.batch_last`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.batch_last import cross, matrices_of, turn
from calib.se3 import FloatArray

_IDENTITY = np.eye(3)[None]


def derivatives(R_A: FloatArray, q: FloatArray) -> FloatArray:
    """Derivatives ``(12, 6, S)`` of (e_R, e_p) by the errors of X and Z: x, ξ, z, ζ.

    R_A are columns ``(3, 3, S)``, q ``(3, S)`` is ``R_Z p_B``.
    """
    J = np.zeros((12, 6, q.shape[-1]))
    J[0:3, 0:3] = J[3:6, 3:6] = R_A
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        J[6 + k, k] = J[9 + k, 3 + k] = -1.0
        J[6 + k, 3 + i], J[6 + k, 3 + j] = q[j], -q[i]
    return J


def left_over(a: FloatArray, b: FloatArray, m: FloatArray, R_Z: FloatArray) -> FloatArray:
    """What errors (a, α) and (b, β) ``(6, S)`` of A and B leave: (e_R, e_p) ``(6, S)``."""
    e_p = a[3:] + cross(a[:3], m) - turn(R_Z, b[3:])
    return np.concatenate([a[:3] - turn(R_Z, b[:3]), e_p])


@dataclass(frozen=True, eq=False)
class Isotropic:
    """Errors that are the same in all directions."""

    sigma: FloatArray
    """(4, 1) or (4, S): standard deviations of each component of a [rad], α [m], b [rad] and β
    [m]."""

    @property
    def on_A(self) -> bool:
        return bool(self.sigma[:2].any())

    @property
    def on_B(self) -> bool:
        return bool(self.sigma[2:].any())

    def at(self, m: FloatArray, R_Z: FloatArray) -> _IsotropicErrors:
        """Errors where ``R_A p_X`` is m ``(3, S)``."""
        return _IsotropicErrors(self, m)


class _IsotropicErrors:
    """In closed form: e_p less its share in e_R is independent of that, and of two sizes."""

    def __init__(self, model: Isotropic, m: FloatArray) -> None:
        self._m = m
        turn_a, shift_a, turn_b, shift_b = model.sigma**2
        self._of_A = turn_a, shift_a
        self._sigma_R = np.sqrt(turn_a + turn_b)
        self._share = turn_a / (turn_a + turn_b)
        self._sigma_along = np.sqrt(shift_a + shift_b)
        self._sigma_across: FloatArray | None = None
        if model.on_A:
            self._m2 = (m * m).sum(axis=0)
        if model.on_A and model.on_B:
            self._sigma_across = np.sqrt(shift_a + shift_b + self._share * turn_b * self._m2)

    def whiten(self, e: FloatArray) -> FloatArray:
        """Rows ``(..., 6, S)`` as independent numbers of unit variance."""
        out = np.empty(e.shape)
        e_R, e_p = e[..., :3, :], e[..., 3:, :]
        np.divide(e_R, self._sigma_R, out=out[..., :3, :])
        if self._share.any():
            e_p = e_p - self._share * cross(e_R, self._m)
        out[..., 3:, :] = self._scaled(e_p)
        return out

    def errors_of_A(self, white: FloatArray) -> FloatArray:
        """Likeliest errors (a, α) ``(6, S)`` of A behind white rows ``(6, S)``."""
        f_p = self._scaled(white[3:])
        lever = cross(self._m, f_p)
        f_R = white[:3] / self._sigma_R - self._share * lever
        turn_a, shift_a = self._of_A
        return np.concatenate([turn_a * (f_R + lever), shift_a * f_p])

    def _scaled(self, e_p: FloatArray) -> FloatArray:
        """Translations ``(..., 3, S)`` over their standard deviations along m and across it."""
        if self._sigma_across is None:
            return np.asarray(e_p / self._sigma_along)
        part = (e_p * self._m).sum(axis=-2, keepdims=True)
        part = part / np.where(self._m2 > 0.0, self._m2, 1.0)
        difference = 1.0 / self._sigma_along - 1.0 / self._sigma_across
        return np.asarray(e_p / self._sigma_across + (difference * part) * self._m)


@dataclass(frozen=True, eq=False)
class General:
    """Errors with any covariance."""

    A: FloatArray | None
    B: FloatArray | None
    """A, B (S, 6, 6) or (1, 6, 6): covariances of (a, α) and (b, β) [rad, m]; None where that side
    has no errors."""

    @property
    def on_A(self) -> bool:
        return self.A is not None

    @property
    def on_B(self) -> bool:
        return self.B is not None

    def at(
        self,
        m: FloatArray,
        R_Z: FloatArray,
        turn: FloatArray = _IDENTITY,
        lever: FloatArray = _IDENTITY,
    ) -> _GeneralErrors:
        """Errors where ``R_A p_X`` is m ``(3, S)`` and the rotation of Z is R_Z ``(3, 3, S)``.

        The rotation vector a enters e_R as ``turn a`` and e_p as ``(lever a) × m``, both matrices
        ``(S, 3, 3)``: identities where the errors are small.
        """
        S = m.shape[-1]
        covariance, of_A = np.zeros((2, S, 6, 6))
        if self.A is not None:
            G = np.tile(np.eye(6), (S, 1, 1))
            G[:, :3, :3] = turn
            G[:, 3:, :3] = -se3.skew(m.T) @ lever
            of_A = self.A @ np.swapaxes(G, -1, -2)
            covariance += G @ of_A
        if self.B is not None:
            R = np.zeros((S, 6, 6))
            R[:, :3, :3] = R[:, 3:, 3:] = matrices_of(R_Z)
            covariance += R @ self.B @ np.swapaxes(R, -1, -2)
        return _GeneralErrors(np.linalg.inv(np.linalg.cholesky(covariance)), of_A)


@dataclass(frozen=True, eq=False)
class _GeneralErrors:
    """By a Cholesky factor of each pair; see :class:`_IsotropicErrors`."""

    inverse_root: FloatArray
    of_A: FloatArray
    """inverse_root, of_A (S, 6, 6): inverse of the factor, and covariance of the errors of A with
    (e_R, e_p)."""

    def whiten(self, e: FloatArray) -> FloatArray:
        columns = e.reshape(-1, 6, e.shape[-1]).transpose(2, 1, 0)
        white = (self.inverse_root @ columns).transpose(2, 1, 0)
        return np.ascontiguousarray(white).reshape(e.shape)

    def errors_of_A(self, white: FloatArray) -> FloatArray:
        forces = np.swapaxes(self.inverse_root, -1, -2) @ white.T[..., None]
        return np.ascontiguousarray((self.of_A @ forces)[..., 0].T)


ErrorModel = Isotropic | General
"""What is known of the errors of A and B."""

Errors = _IsotropicErrors | _GeneralErrors
"""Covariance of (e_R, e_p) at some X and Z, and the errors of A behind them."""
