"""The poses that a choice is made from, as blocks, and what is known besides them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, NotIdentifiableError
from calib.se3 import FloatArray, IntArray, numbers

RANK_TOLERANCE = 1e-9
"""Smallest singular value, relative to the largest, of columns of unit length that still counts."""

CHUNK = 1 << 20
"""Numbers of temporaries at once: what does not fit the cache takes longer, and much of it would
take the memory that a million candidates need."""

_NAMED = 0.1
"""Parameters whose weight in an invisible combination is below this are not named in it."""


class Candidates:
    """The poses to choose from.

    They are made of whitened blocks ``(N, m, p)``, rows of unit variance (for condition numbers, of
    the identification Jacobian), and of rows of the same kind that are known anyway: poses already
    measured, priors. ``names`` of the parameters are for errors.

    Columns are divided by their root mean square over all, ``scale`` (p,), so that parameters in
    any units meet as equals in the arithmetic. All that takes or gives matrices ``(p, p)`` is in
    these scaled parameters, as are the blocks ``J`` (N, m, p) and the information ``known`` (p, p).
    """

    def __init__(
        self, blocks: ArrayLike, known: ArrayLike | None = None, names: Sequence[str] | None = None
    ) -> None:
        given = numbers(blocks, "blocks")
        if given.ndim != 3 or 0 in given.shape:
            raise InputError(
                f"a pool needs blocks (N, m, p), not an array of shape {given.shape}", name="blocks"
            )
        p = given.shape[2]
        rows = np.zeros((0, p)) if known is None else numbers(known, "known")
        if rows.shape[-1] != p:
            raise InputError(
                f"known rows of shape {rows.shape} for {p} parameters",
                hint="give one column for each parameter",
                name="known",
            )
        rows = rows.reshape(-1, p)
        self.names = tuple(f"column {k + 1}" for k in range(p)) if names is None else tuple(names)
        if len(self.names) != p:
            raise InputError(f"{len(self.names)} names for {p} parameters", name="names")
        most = np.maximum(given.max(axis=(0, 1)), -given.min(axis=(0, 1)))
        if not np.isfinite(most).all():
            bad = ~np.isfinite(given).all(axis=(1, 2))
            raise InputError(
                "the blocks contain numbers that are not finite: "
                f"candidate {int(np.argmax(bad))} is the first of {int(bad.sum())}",
                hint="leave those poses out",
                name="blocks",
            )
        if not np.isfinite(rows).all():
            raise InputError(
                "the known rows contain numbers that are not finite",
                hint="leave those rows out",
                name="known",
            )
        most = np.maximum(most, np.abs(rows).max(axis=0, initial=0.0))
        most = np.where(most > 0.0, most, 1.0)
        # by the largest first: squares of very large or small numbers are no numbers
        self.J = np.ascontiguousarray(given / most)
        self._known_rows = rows / most
        squares = np.einsum("nmp,nmp->p", self.J, self.J) + (self._known_rows**2).sum(axis=0)
        length = np.sqrt(squares / len(given))
        length = np.where(length > 0.0, length, 1.0)
        self.J /= length
        self.J += 0.0  # no negative zeros, which are equal and yet look different
        self._known_rows /= length
        self.scale = most * length
        self.known = self._known_rows.T @ self._known_rows

    @property
    def N(self) -> int:
        """Number of candidates."""
        return len(self.J)

    @property
    def m(self) -> int:
        """Rows of each."""
        return int(self.J.shape[1])

    @property
    def p(self) -> int:
        """Number of parameters."""
        return int(self.J.shape[2])

    def _like(self, J: FloatArray, known_rows: FloatArray) -> Candidates:
        other = object.__new__(Candidates)
        other.names, other.scale, other.J = self.names, self.scale, np.ascontiguousarray(J)
        other._known_rows, other.known = known_rows, self.known
        return other

    def take(self, rows: IntArray) -> Candidates:
        return self._like(self.J[rows], self._known_rows)

    def with_blocks(self, J: FloatArray) -> Candidates:
        """Other blocks ``(N, m, p)`` of the same candidates, in the same scaling."""
        return self._like(J, self._known_rows)

    def knowing(self, rows: IntArray) -> Candidates:
        """The same with some of the candidates taken for known."""
        other = self._like(self.J, np.vstack([self._known_rows, self.J[rows].reshape(-1, self.p)]))
        other.known = other._known_rows.T @ other._known_rows
        return other

    def chunks(self, width: int) -> Iterator[slice]:
        """Slices of candidates whose temporaries of so many numbers each are not too large."""
        size = max(1, CHUNK // max(width, 1))
        return (slice(i, i + size) for i in range(0, self.N, size))

    def information(self, rows: IntArray) -> FloatArray:
        """Of a choice, and of what is known ``(p, p)``."""
        stacked = self.J[rows].reshape(-1, self.p)
        return np.asarray(self.known + stacked.T @ stacked)

    def weighted(self, weights: FloatArray) -> FloatArray:
        """Information ``(p, p)`` of candidates that count by weights ``(N,)``, and of the known."""
        total = self.known.copy()
        for part in self.chunks(2 * self.m * self.p):
            J = self.J[part]
            rows = J.reshape(-1, self.p)
            total += rows.T @ (J * weights[part, None, None]).reshape(-1, self.p)
        return total

    @cached_property
    def whole(self) -> FloatArray:
        """Information ``(p, p)`` of the pool and the known."""
        return self.weighted(np.ones(self.N))

    def root(self, rows: IntArray) -> FloatArray:
        """Rows ``(M, p)`` of a choice and of the known: their product is the information."""
        return np.vstack([self._known_rows, self.J[rows].reshape(-1, self.p)])

    def scores(self, Z: FloatArray) -> FloatArray:
        """``trace(Z Jᵀ J)`` of every candidate ``(N,)``, for a symmetric ``Z`` (p, p)."""
        values, vectors = np.linalg.eigh(Z)
        seen = np.abs(values) > np.finfo(float).eps * np.abs(values).max(initial=0.0)
        V, signs = vectors[:, seen] * np.sqrt(np.abs(values[seen])), np.sign(values[seen])
        return self.scores_of_root(V, signs)

    def scores_of_root(self, root: FloatArray, signs: FloatArray | None = None) -> FloatArray:
        """``|J root|²`` of every candidate ``(N,)``, of a root ``(p, r)``.

        ``root`` (p, r). ``signs`` (r,): by which the squares of each column count; 1 by default.
        """
        out = np.empty(self.N)
        weights = np.ones(root.shape[1]) if signs is None else signs
        for part in self.chunks(self.m * max(root.shape[1], 1)):
            moved = self.J[part] @ root
            out[part] = np.einsum("nmr,nmr,r->n", moved, moved, weights)
        return out

    def known_by_root(self, root: FloatArray) -> float:
        """``|J root|²`` of the known rows."""
        return float(np.square(self._known_rows @ root).sum())

    @cached_property
    def lengths(self) -> FloatArray:
        """Squared length of each block, ``(N,)``."""
        return np.asarray(np.einsum("nmp,nmp->n", self.J, self.J))

    @cached_property
    def by_row(self) -> FloatArray:
        """The blocks with the candidate last, ``(m, p, N)``.

        Sums over parameters then run over long contiguous rows, whatever m and p.
        """
        return np.ascontiguousarray(self.J.transpose(1, 2, 0))

    @cached_property
    def squares(self) -> FloatArray:
        """Squared length of each column in each block, ``(N, p)``."""
        return np.asarray(np.einsum("nmp,nmp->np", self.J, self.J))

    @cached_property
    def largest(self) -> FloatArray:
        """Largest absolute entry of each column in each block, ``(N, p)``."""
        return np.asarray(np.abs(self.J).max(axis=1))

    @cached_property
    def largest_known(self) -> FloatArray:
        """The same of the known rows ``(p,)``."""
        return np.asarray(np.abs(self._known_rows).max(axis=0, initial=0.0))

    def check_identifiable(self) -> None:
        """Check that the whole pool, with the known, tells all parameters apart.

        Raises NotIdentifiableError: parameters that no choice can identify, by name.
        """
        hidden = _hidden(self._triangle())
        if not len(hidden):
            return
        share = np.abs(hidden).max(axis=0)
        blamed = [name for name, part in zip(self.names, share, strict=True) if part > _NAMED]
        raise NotIdentifiableError(
            blamed,
            [f"{len(hidden)} combination(s) of {', '.join(blamed)} change nothing in any pose"],
        )

    def _triangle(self) -> FloatArray:
        """Triangular root ``(p, p)`` of the information of everything, not squared on the way."""
        R = np.linalg.qr(np.vstack([self._known_rows, np.zeros((self.p, self.p))]), mode="r")
        for part in self.chunks(self.m * self.p):
            R = np.linalg.qr(np.vstack([R, self.J[part].reshape(-1, self.p)]), mode="r")
        return np.asarray(R)

    def distinct(self) -> IntArray:
        """The first of each set of equal candidates, ascending."""
        flat = self.J.reshape(self.N, -1)
        # Equal blocks have equal keys; only those that share one are compared entry by entry. Of
        # whole numbers, whose sums are the same in any order: of others the last digit is not.
        rng = np.random.default_rng(0)
        factors = rng.integers(1, 2**63, size=flat.shape[1], dtype=np.uint64) * 2 + 1
        key = flat.view(np.uint64) @ factors
        order = np.lexsort((np.arange(self.N), key))
        run = np.cumsum(np.append(False, key[order[1:]] != key[order[:-1]]))
        keep = np.ones(self.N, dtype=bool)
        shared = np.flatnonzero(np.bincount(run)[run] > 1)
        for members in np.split(shared, np.flatnonzero(np.diff(run[shared])) + 1):
            if len(members):
                rows = np.sort(order[members])
                _, first = np.unique(flat[rows], axis=0, return_index=True)
                keep[rows] = False
                keep[rows[first]] = True
        return np.flatnonzero(keep)


NO_INFORMATION = 1e-12
"""Singular value of a block, over its largest, below which it is rounding: a thousandth of
:data:`RANK_TOLERANCE`, and a thousand times what rounding leaves."""


def shortened(blocks: FloatArray) -> FloatArray:
    """Blocks ``(N, r, p)`` of the same information as ``(N, m, p)``, where these are taller than p.

    With as many rows as the largest rank of them. All that the information of blocks decides stays
    as it is: every criterion but C_G, which is of the entries of the rows themselves.
    """
    N, m, p = blocks.shape
    if m <= p or N == 0:
        return blocks
    R = np.linalg.qr(blocks, mode="r")
    length = np.sqrt(np.einsum("nap,nap->p", R, R))
    length = np.where(length > 0.0, length, 1.0)
    _, s, Vt = np.linalg.svd(R / length)
    rank = max(1, int((s > NO_INFORMATION * s[:, :1]).sum(axis=1).max()))
    return np.asarray(s[:, :rank, None] * Vt[:, :rank] * length)


def _hidden(root: FloatArray) -> FloatArray:
    """Unit combinations ``(h, p)`` of parameters that rows ``(M, p)`` do not see."""
    length = np.linalg.norm(root, axis=0)
    unit = root / np.where(length > 0.0, length, 1.0)
    _, values, Vt = np.linalg.svd(unit)
    return np.asarray(Vt[values <= RANK_TOLERANCE * values[0]])


def products_by_pairs(
    candidates: Candidates, P: FloatArray, Q: FloatArray | None = None
) -> FloatArray:
    """``trace(J_i P J_jᵀ J_j Q J_iᵀ)`` of all pairs of candidates ``(n, n)``; Q is P by default.

    ``P``, ``Q`` (p, p): positive semidefinite.
    """
    by_row = np.moveaxis(candidates.J, 1, 0)  # (m, n, p)
    first = by_row @ root_of(P)
    second = first if Q is None else by_row @ root_of(Q)
    total = np.zeros((candidates.N, candidates.N))
    for a in range(candidates.m):
        for b in range(a, candidates.m):
            products = first[a] @ first[b].T
            products *= products if Q is None else second[a] @ second[b].T
            total += products
            if b > a:  # rows a of i with b of j, and the other way round
                total += products.T
    return total


def root_of(P: FloatArray) -> FloatArray:
    """A root ``(p, p)`` of a positive semidefinite matrix, what is below zero cut off."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
