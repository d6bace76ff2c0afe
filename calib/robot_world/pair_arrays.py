"""Pairs of many problems as arrays, and their sums: what any method begins with."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from calib.batch_last import columns_of, turn_back
from calib.errors import InputError
from calib.robot_world import algebra
from calib.se3 import BoolArray, FloatArray


class PairArrays:
    """Pairs of T problems ``A_i X = Z B_i``, all with N pairs.

    Parameters
    ----------
    A, B : ndarray (T, N, 4, 4)
        Rigid transforms with rotations orthonormal to rounding, in any unit of length.
    tentative : bool
        Whether a solution is one of many to be tried: no trouble is then taken where the closed
        form has none that is worth it.
    columns : (ndarray or None, ndarray or None)
        Columns ``(4, 4, S)`` of A and of B where they are there already.

    Notes
    -----
    What is done for each pair stands with the pair as the last index, S = T N of them, set after
    set: see :mod:`calib.batch_last`.
    """

    def __init__(
        self,
        A: FloatArray,
        B: FloatArray,
        *,
        tentative: bool = False,
        columns: tuple[FloatArray | None, FloatArray | None] = (None, None),
    ) -> None:
        for T, name in ((A, "A"), (B, "B")):
            if not isinstance(T, np.ndarray) or T.ndim != 4 or T.shape[-2:] != (4, 4):
                shape = f"has shape {np.shape(T)}" if isinstance(T, np.ndarray) else "is no array"
                raise InputError(f"{name} {shape}, not (T, N, 4, 4)", name=name)
        if A.shape != B.shape:
            raise InputError(f"A has shape {A.shape} and B has {B.shape}", name="B")
        self.A, self.B, self.tentative = A, B, tentative
        self.T, self.N = A.shape[:2]
        self._given = columns

    @cached_property
    def R_A(self) -> FloatArray:
        """Columns ``(3, 3, S)`` of the rotations of A."""
        return _rotations(self.A, self._given[0])

    @cached_property
    def R_B(self) -> FloatArray:
        """Columns ``(3, 3, S)`` of the rotations of B."""
        return _rotations(self.B, self._given[1])

    @cached_property
    def p_A(self) -> FloatArray:
        """Translations ``(3, S)`` of A."""
        return _translations(self.A, self._given[0])

    @cached_property
    def p_B(self) -> FloatArray:
        """Translations ``(3, S)`` of B."""
        return _translations(self.B, self._given[1])

    @cached_property
    def mean_R_A(self) -> FloatArray:
        """Means ``(3, 3, T)`` of the rotations of A, as columns."""
        return self.mean(self.R_A)

    def spread(self, values: FloatArray) -> FloatArray:
        """Values of the sets ``(..., T)`` for each of their pairs, ``(..., S)``.

        Of a single set ``(..., 1)``, which all pairs share.
        """
        return values if self.T == 1 else np.repeat(values, self.N, axis=-1)

    def mean(self, values: FloatArray) -> FloatArray:
        """Means over the pairs of each set ``(..., T)`` of values ``(..., S)``."""
        sums = values.reshape(*values.shape[:-1], self.T, self.N).sum(axis=-1)
        return np.asarray(sums / self.N)

    def mean_turned_back(self, vector: FloatArray) -> FloatArray:
        """Means ``(3, T)`` of vectors ``(3, S)``, seen in the axes that A maps from."""
        if self.T == 1:
            return np.asarray(self.R_A.reshape(3, -1) @ vector.reshape(-1, 1) / self.N)
        return self.mean(turn_back(self.R_A, vector))

    @cached_property
    def size(self) -> FloatArray:
        """How far the origins of A and B are from their means, rms ``(T,)``; 1 if they all stand.

        Not from the origins of base and target, which may be anywhere.
        """
        return np.where(self.moves, np.sqrt(self._square_moved), 1.0)

    @property
    def moves(self) -> BoolArray:
        """Whether any origin moves from pair to pair ``(T,)``."""
        return self._square_moved > 0.0

    @cached_property
    def _square_moved(self) -> FloatArray:
        each = (p.reshape(3, self.T, self.N) for p in (self.p_A, self.p_B))
        moved = (p - p.sum(axis=-1, keepdims=True) / self.N for p in each)
        return sum(((d * d).sum(axis=(0, 2)) / self.N for d in moved), np.zeros(self.T))

    @cached_property
    def kronecker_mean(self) -> FloatArray:
        """See :func:`calib.robot_world.algebra.kronecker_mean`."""
        if self.T == 1:
            return algebra.kronecker_mean_of_columns(self.R_A, self.R_B)[None]
        return algebra.kronecker_mean(self.A, self.B)


def _rotations(T: FloatArray, columns: FloatArray | None) -> FloatArray:
    """Columns ``(3, 3, S)`` of the rotations of transforms."""
    if columns is not None:
        return columns[:3, :3]
    if shared(T):
        return np.tile(columns_of(T[0, :, :3, :3]), len(T))
    return columns_of(T.reshape(-1, 4, 4)[:, :3, :3])


def shared(T: FloatArray) -> bool:
    """Whether all sets have the same transforms ``(T, N, 4, 4)``, one array for all."""
    return len(T) > 1 and T.strides[0] == 0


def _translations(T: FloatArray, columns: FloatArray | None) -> FloatArray:
    """Translations ``(3, S)`` of transforms."""
    p = T[..., :3, 3].reshape(-1, 3).T if columns is None else columns[3, :3]
    return np.ascontiguousarray(p)
