"""What a method finds for T problems A X = Z B, and what that leaves of the pairs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from calib.robot_world.algebra import inverse_information
from calib.robot_world.closed_form import residual_rows
from calib.robot_world.pair_arrays import PairArrays
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class _OfSets:
    """Arrays of T sets, which stand along the first axis but for those named."""

    _sets_axis: ClassVar[Mapping[str, int]] = {}

    def of(self, trials: IntArray) -> Self:
        """The same of some of the sets."""
        values: dict[str, Any] = {}
        for name, axis, value in self._arrays():
            if isinstance(value, _OfSets):
                values[name] = value.of(trials)
            else:
                values[name] = None if value is None else np.take(value, trials, axis=axis)
        return type(self)(**values)

    def with_others(self, trials: IntArray, others: Self) -> Self:
        """The same with what others have, in the place of some of the sets."""
        values = {}
        for name, axis, value in self._arrays():
            other = getattr(others, name)
            if isinstance(value, _OfSets) and other is not None:
                value = value.with_others(trials, other)
            elif value is not None and other is not None:
                value = np.moveaxis(value.copy(), axis, 0)
                value[trials] = np.moveaxis(other, axis, 0)
                value = np.moveaxis(value, 0, axis)
            values[name] = value
        return type(self)(**values)

    def _arrays(self) -> list[tuple[str, int, Any]]:
        return [
            (part.name, self._sets_axis.get(part.name, 0), getattr(self, part.name))
            for part in fields(self)
        ]


@dataclass(frozen=True, eq=False)
class Fit(_OfSets):
    """Where the adjustment of T sets of N pairs ended."""

    X: FloatArray
    Z: FloatArray  # X, Z (T, 4, 4)
    cost: FloatArray
    """(T,): sum of the squares of the white rows: χ² of 6 N - 12 degrees of freedom."""
    white: FloatArray  # (6, T, N): white rows of each pair
    jacobian: FloatArray
    """(12, 6, T, N): their derivatives by the errors of X (rotation, translation) and Z."""
    information: FloatArray  # (T, 12, 12): inverse of the covariance of X and Z
    iterations: IntArray  # (T,)
    converged: BoolArray  # (T,)

    _sets_axis: ClassVar = {"white": 1, "jacobian": 2}

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariances ``(T, 12, 12)`` of X and Z, to first order."""
        return inverse_information(self.information)

    def rows(self, trial: int, used: BoolArray) -> tuple[FloatArray, FloatArray]:
        """White rows ``(n, 6)`` of the pairs used ``(N,)`` of one set, derivatives ``(n, 6, 12)``.

        Derivatives are ``(n, 6, 13)`` where the scale is one of the unknowns.
        """
        white = self.white[:, trial, used].T
        return white, self.jacobian[:, :, trial, used].transpose(2, 1, 0)


@dataclass(frozen=True, eq=False)
class Estimate(_OfSets):
    """What one method returns for T problems."""

    X: FloatArray
    Z: FloatArray  # X, Z (T, 4, 4): the transforms
    iterations: IntArray | None = None  # (T,): where the method iterates, the cycles it took
    converged: BoolArray | None = None
    """(T,): where the method iterates, whether it arrived within its limit."""
    fit: Fit | None = None  # where the method is an adjustment, its rows and information
    sigma: FloatArray | None = None
    """(2, T): where the method estimates the noise, the standard deviations of rotation and
    translation."""
    weights: FloatArray | None = None
    """(T, N): where the method leaves pairs out, 0 for these and 1 for the others."""
    scale: FloatArray | None = None  # (T,): where it was estimated, the factor of B's translations

    _sets_axis: ClassVar = {"sigma": 1}

    def used(self, count: int) -> BoolArray:
        """Pairs ``(T, N)`` that it is made from, of N."""
        if self.weights is None:
            return np.ones((len(self.X), count), dtype=bool)
        return np.asarray(self.weights > 0)


def residuals(A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray) -> FloatArray:
    """What A X differs from Z B by ``(..., N, 6)``: rotation vector [rad], then translation [m].

    Both in the axes of the frame that A maps to (eye in hand: the base): the rotation vector is
    ``log(R_A R_X (R_Z R_B)ᵀ)``, the translation that of A X less that of Z B.

    Parameters
    ----------
    A, B : ndarray (..., N, 4, 4)
        Measured transforms.
    X, Z : ndarray (..., 4, 4)
        The solution.
    """
    *sets, N = np.broadcast_shapes(A.shape[:-2], B.shape[:-2], (*X.shape[:-2], 1))
    A, B = (np.broadcast_to(T, (*sets, N, 4, 4)).reshape(-1, N, 4, 4) for T in (A, B))
    X, Z = (np.broadcast_to(T, (*sets, 4, 4)).reshape(-1, 4, 4) for T in (X, Z))
    rows = residual_rows(PairArrays(A, B), X, Z)
    return np.ascontiguousarray(rows.T).reshape(*sets, N, 6)
