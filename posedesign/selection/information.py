"""What a choice of poses knows, kept up to date as poses are taken in and put back.

A pose changes the covariance C by an update of as many ranks as it has rows::

    C ∓ C Jᵀ (1 ± J C Jᵀ)⁻¹ J C

With it go the leverages ``J C Jᵀ`` of all candidates, at the cost of one thin product, so that
after every change all candidates can be judged without a matrix of parameters being inverted.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.selection.candidates import Candidates

FAINT = 1e-6
"""Part of the pool's mean information, for each pose chosen, that is there before the first: what
is not yet determined is known a thousand times worse than by the pool, not infinitely badly."""

_AT_ONCE = 16
"""Entries of a diagonal that are multiplied: each is at most what a pose adds to what is faint."""

SEEN = 1e-9
"""Smallest eigenvalue, columns of unit length, from which a choice is taken to see everything; the
information is a square, and has lost half of the digits already."""

_FAINT = 1e-15
"""What is added to the information, columns of unit length: about its rounding."""


class InformationState:
    """A choice out of a pool.

    ``rows`` (n,): the choice to begin with. ``count``: poses to be chosen in the end. ``M``, ``C``
    (p, p): information and covariance of the choice [scaled]. ``S`` (m, m, N): leverages ``J C Jᵀ``
    of the candidates, candidate last. ``chosen`` (N,).
    """

    def __init__(self, candidates: Candidates, rows: IntArray, count: int) -> None:
        self.candidates = candidates
        self.chosen: BoolArray = np.zeros(candidates.N, dtype=bool)
        self.chosen[rows] = True
        self._faint = FAINT * count / candidates.N * candidates.whole
        # the last digits of what has no information at all must not decide
        self._faint[np.diag_indices(candidates.p)] += FAINT**2
        self.refresh()

    @property
    def rows(self) -> IntArray:
        """The choice, ascending."""
        return np.flatnonzero(self.chosen)

    @property
    def snapshot(self) -> tuple[object, ...]:
        """All that changes, to go back to."""
        return self.M, self.C, self.S.copy(), self.chosen.copy()

    @snapshot.setter
    def snapshot(self, before: tuple[Any, ...]) -> None:
        self.M, self.C, self.S, self.chosen = before

    def refresh(self) -> None:
        """Compute everything anew: updates gather rounding."""
        self.M = self.candidates.information(self.rows) + self._faint
        self.C = np.asarray(np.linalg.inv(self.M))
        self._find_leverages()

    def _find_leverages(self) -> None:
        J = self.candidates.J
        N, m, _ = J.shape
        self.S = np.empty((m, m, N))
        for part in self.candidates.chunks(2 * self.candidates.m * self.candidates.p):
            moved = J[part] @ self.C
            self.S[:, :, part] = np.einsum("nap,nbp->abn", moved, J[part])

    def leverages(self, part: slice | IntArray) -> FloatArray:
        """Leverages ``J C Jᵀ`` of some candidates ``(m, m, n)``."""
        return np.asarray(self.S[:, :, part])

    def take(self, row: int) -> None:
        self._change(row, 1.0)

    def drop(self, row: int) -> None:
        self._change(row, -1.0)

    def _change(self, row: int, sign: float) -> None:
        J = self.candidates.J
        own = J[row]  # (m, p)
        inner = np.eye(len(own)) + sign * own @ self.C @ own.T
        values, vectors = np.linalg.eigh(inner)
        U = self.C @ own.T @ (vectors / np.sqrt(np.maximum(values, np.finfo(float).tiny)))
        self.C = self.C - sign * U @ U.T
        self.M = self.M + sign * own.T @ own
        self.chosen[row] = sign > 0.0
        self._follow(U, sign)

    def _follow(self, U: FloatArray, sign: float) -> None:
        """Take a change ``∓ U Uᵀ`` of the covariance into the leverages."""
        for part in self.candidates.chunks(2 * self.candidates.m**2):
            moved = U.T @ self.candidates.by_row[:, :, part]  # (m, m, chunk)
            self.S[:, :, part] -= sign * np.einsum("akn,bkn->abn", moved, moved)

    def change(
        self, part: slice | IntArray, sign: float, right: FloatArray | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """What each of some candidates changes in the covariance, and where it can be made.

        Taken in (``sign`` +1) or put back (-1). The root ``(m, r, n)`` makes the covariance of
        combinations ``right`` (p, r), all parameters by default, ``rightᵀ C right - sign rootᵀ
        root``. It is NaN where the change cannot be made.
        """
        CU = self.C if right is None else self.C @ right
        moved, root = CU.T @ self.candidates.by_row[:, :, part], self.root_of_change(part, sign)
        with np.errstate(invalid="ignore"):
            for a in range(len(root)):
                for b in range(a):
                    moved[a] -= root[a, b] * moved[b]
                moved[a] *= root[a, a]
        possible = np.asarray(np.isfinite(root[-1, -1]))
        if not possible.all():
            moved[:, :, ~possible] = np.nan
        return moved, possible

    def root_of_change(self, part: slice | IntArray, sign: float) -> FloatArray:
        """Triangular roots ``(m, m, n)`` of ``1 ± J C Jᵀ``, with the inverses of their diagonals.

        The last of these is not finite where there is no root.
        """
        A = np.asarray(sign * self.leverages(part))
        m = len(A)
        A[np.arange(m), np.arange(m)] += 1.0
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for a in range(m):
                A[a, a] = 1.0 / np.sqrt(A[a, a])
                A[a + 1 :, a] *= A[a, a]
                for b in range(a + 1, m):
                    A[b:, b] -= A[b:, a] * A[b, a]
        return A


GROWN = 1e-3
"""Part of what is known of a pose's rows that is known without it. Below, what was kept up to date
has lost six digits: it is computed anew, and once more with the next pose that is taken in."""


class ErrorState(InformationState):
    """A choice of which a mean square error ``tr(W C)`` is known with each candidate besides.

    A candidate changes it by ``tr((1 ± J C Jᵀ)⁻¹ J C W C Jᵀ)``. Both matrices are kept up to date
    by thin products, in place of a product with all of C for each choice that is looked at.

    ``W`` (p, p): of scaled parameters. ``H`` (m, m, N): ``J C W C Jᵀ``, candidate last.
    """

    def __init__(self, candidates: Candidates, rows: IntArray, count: int, W: FloatArray) -> None:
        self._W, self._has_grown = W, False
        super().__init__(candidates, rows, count)

    @property
    def snapshot(self) -> tuple[object, ...]:
        """All that changes, to go back to."""
        return self.M, self.C, self.S.copy(), self.chosen.copy(), self.H.copy(), self._has_grown

    @snapshot.setter
    def snapshot(self, before: tuple[Any, ...]) -> None:
        self.M, self.C, self.S, self.chosen, self.H, self._has_grown = before

    def take(self, row: int) -> None:
        super().take(row)
        if self._has_grown:
            self.refresh()

    def drop(self, row: int) -> None:
        left = np.eye(len(self.S)) - self.S[:, :, row]
        super().drop(row)
        if np.linalg.eigvalsh(left)[0] < GROWN:
            self.refresh()
            self._has_grown = True

    def _find_leverages(self) -> None:
        super()._find_leverages()
        self._has_grown = False
        J, D = self.candidates.J, self.C @ self._W @ self.C
        self.H = np.empty_like(self.S)
        for part in self.candidates.chunks(2 * self.candidates.m * self.candidates.p):
            self.H[:, :, part] = np.einsum("nap,nbp->abn", J[part] @ D, J[part])

    def _follow(self, U: FloatArray, sign: float) -> None:
        WU, m = self._W @ U, U.shape[1]
        both = np.vstack([U.T, (self.C @ WU + 0.5 * sign * U @ (U.T @ WU)).T])
        for part in self.candidates.chunks(4 * self.candidates.m**2):
            moved = both @ self.candidates.by_row[:, :, part]  # (m, 2 m, chunk)
            one, other = moved[:, :m], moved[:, m:]
            self.S[:, :, part] -= sign * np.einsum("akn,bkn->abn", one, one)
            change = np.einsum("akn,bkn->abn", one, other)
            self.H[:, :, part] -= sign * (change + change.swapaxes(0, 1))

    def error_changes(self, part: slice | IntArray, sign: float) -> FloatArray:
        """What each of some candidates ``(n,)`` takes off the error, or adds; NaN where it cannot.

        Taken in (``sign`` +1) or put back (-1).
        """
        root = self.root_of_change(part, sign)
        m = len(root)
        inverse = np.zeros_like(root)
        with np.errstate(invalid="ignore"):
            for a in range(m):
                inverse[a, a] = 1.0
                for b in range(a):
                    inverse[a] -= root[a, b] * inverse[b]
                inverse[a] *= root[a, a]
            moved = np.einsum("abn,bcn->acn", inverse, self.H[:, :, part])
            changes = np.einsum("acn,acn->n", moved, inverse)
        return np.where(np.isfinite(root[-1, -1]), changes, np.nan)


class FewAtOnce(InformationState):
    """A choice that is changed often, and of which few candidates are looked at in between.

    Their leverages are found when they are asked for. There is no ``S``.
    """

    def _find_leverages(self) -> None:
        pass

    def _follow(self, U: FloatArray, sign: float) -> None:
        pass

    def leverages(self, part: slice | IntArray) -> FloatArray:
        """Leverages ``J C Jᵀ`` of some candidates ``(m, m, n)``."""
        J = self.candidates.J[part]
        return np.asarray(np.einsum("nap,nbp->abn", J @ self.C, J))


def log_det_of_root(root: FloatArray) -> FloatArray:
    """Logarithm ``(n,)`` of the determinant of what roots of a change ``(m, m, n)`` are those of.

    Minus infinity where there is none.
    """
    diagonal = np.einsum("aan->an", root)
    total = np.zeros(root.shape[2])
    # few logarithms, of products that are too short to overflow
    for a in range(0, len(diagonal), _AT_ONCE):
        total -= np.log(np.prod(diagonal[a : a + _AT_ONCE], axis=0))
    return np.where(np.isfinite(total), 2.0 * total, -np.inf)


class Informations:
    """Of choices of poses.

    ``choices`` (T, n). ``M`` (T, p, p): scaled, with the known.
    """

    def __init__(self, candidates: Candidates, choices: IntArray) -> None:
        self._candidates, self._choices = candidates, choices
        T, p = len(choices), candidates.p
        member = np.zeros((T, candidates.N))
        member[np.arange(T)[:, None], choices] = 1.0
        each = (np.swapaxes(candidates.J, 1, 2) @ candidates.J).reshape(candidates.N, -1)
        self.M = (member @ each).reshape(T, p, p) + candidates.known

    @cached_property
    def length(self) -> FloatArray:
        """Of the columns ``(T, p)``; 1 where it is zero."""
        squares = np.einsum("tpp->tp", self.M)
        return np.asarray(np.sqrt(np.where(squares > 0.0, squares, 1.0)))

    @cached_property
    def covariance(self) -> tuple[FloatArray, BoolArray]:
        """Covariances ``(T, p, p)``, and which of the choices ``(T,)`` see all parameters."""
        unit = self.length[:, :, None] * self.length[:, None, :]
        # what is not seen is seen a little, so that there is an inverse, by which it is known
        inverse = np.linalg.inv(self.M / unit + _FAINT * np.eye(unit.shape[1]))
        trace = np.einsum("tpp->t", inverse)
        seen = (trace > 0.0) & (trace < 1.0 / SEEN)
        inverse[~seen] = np.eye(unit.shape[1])
        return inverse / unit, seen

    @cached_property
    def largest(self) -> FloatArray:
        """Largest absolute entry of each column of the regressor ``(T, p)``; 1 where all are 0."""
        found = np.max(self._candidates.largest[self._choices], axis=1, initial=0.0)
        found = np.maximum(found, self._candidates.largest_known)
        return np.where(found > 0.0, found, 1.0)
