"""C_G, cond_2, O2 and O4: how evenly a choice sees the parameters, whatever the noise.

They are no information functions: poses more can make them worse, and they depend on how the
columns are scaled, which for C_G and cond_2 depends on the choice itself (see
:mod:`posedesign.selection.indices`).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.certificate import Relaxation
from posedesign.selection.criterion import Criterion, Objective
from posedesign.selection.indices import condition_2, condition_inf, o2, o4
from posedesign.selection.information import SEEN, Informations, InformationState
from posedesign.selection.semidefinite import relax_condition
from posedesign.selection.variances import SpectrumObjective

Kind = Literal["C_G", "cond_2", "O2", "O4"]

TITLES = {
    "C_G": "C_G of Watanabe et al. 2006",
    "cond_2": "cond_2 of G, columns of unit length",
    "O2": "smallest over largest singular value",
    "O4": "square of the smallest over the largest singular value",
}

_LOW_ENDS = 3
"""Axes of least information that candidates are looked at along before any is tried: one that adds
much along the first may still be held back by the next."""

_ROWS = 2
"""Rows of the largest sums that are computed for all candidates, for the same reason."""


def conditioning(kind: Kind) -> Criterion:
    """A condition number, or an index akin to one."""

    def shown(cost: float) -> float:
        if kind in ("C_G", "cond_2"):
            return cost
        return 1.0 / cost if cost > 0.0 else np.inf

    return Criterion(
        kind,
        TITLES[kind],
        kind in ("C_G", "cond_2"),
        lambda candidates: ConditioningObjective(candidates, kind),
        shown,
        shown,
        falls_with_poses=False,
    )


class ConditioningObjective(Objective):
    """A condition number on one pool."""

    rugged = has_floor = True

    def __init__(self, candidates: Candidates, kind: Kind) -> None:
        super().__init__(candidates)
        self._kind = kind
        self.width = candidates.p * (4 * candidates.p + 2 * candidates.m)

    def cost(self, rows: IntArray) -> float:
        G = self.candidates.root(rows)
        if self._kind == "C_G":
            return condition_inf(G)
        if self._kind == "cond_2":
            return condition_2(G)
        value = (o2 if self._kind == "O2" else o4)(G * self.candidates.scale)
        return 1.0 / value if value > 0.0 else np.inf

    def costs(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        if self._kind == "C_G":
            found = self._by_largest(state, part, sign)
        else:
            J = self.candidates.J[part]
            found = self._of_spectrum(state.M + sign * np.swapaxes(J, 1, 2) @ J)
        return np.asarray(np.where(np.isfinite(found), found, np.inf))

    def _scales(self, diagonal: FloatArray) -> FloatArray:
        """What the columns are divided by, of diagonals ``(..., p)`` of the information."""
        if self._kind == "cond_2":
            return np.asarray(np.sqrt(np.maximum(diagonal, np.finfo(float).tiny)))
        return np.broadcast_to(1.0 / self.candidates.scale, diagonal.shape)

    def _of_spectrum(self, M: FloatArray, seen: float = 0.0) -> FloatArray:
        """Of informations ``(n, p, p)``; infinite where the ratio is not above ``seen``."""
        scale = self._scales(np.einsum("npp->np", M))
        values = np.linalg.eigvalsh(M / scale[:, :, None] / scale[:, None, :])
        least = np.where(values[:, 0] > seen * values[:, -1], values[:, 0], 0.0)
        return self._ratio(least, values[:, -1])

    def _ratio(self, least: NDArray[np.floating], most: NDArray[np.floating]) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.sqrt(most) / (least if self._kind == "O4" else np.sqrt(least))
        return np.asarray(np.where(least > 0.0, ratio, np.inf))

    def at_least(
        self, state: InformationState, part: slice | IntArray, near: int | None
    ) -> FloatArray:
        """No eigenvalue is beyond what any vector shows of it, and no norm below any row's sum.

        Those of the choice so far, or with one candidate, are tried on all.
        """
        if self._kind == "C_G":
            return self._floor_of_rows(state, part, near)
        M = state.M
        if near is not None:
            M = M + self.candidates.J[near].T @ self.candidates.J[near]
        scale = self._scales(np.diag(M))
        _, vectors = np.linalg.eigh(M / scale / scale[:, None])
        ends = 1 if near is not None else min(_LOW_ENDS, self.candidates.p)
        V = np.column_stack([vectors[:, :ends], vectors[:, -1:]]) / scale[:, None]
        known = np.einsum("pk,pq,qk->k", V, state.M, V, optimize=True)
        moved = V.T @ self.candidates.by_row[:, :, part]
        squares = known[:, None] + np.square(moved, out=moved).sum(axis=0)  # (ends + 1, n)
        if self._kind == "cond_2":
            diagonal = np.diag(state.M) + self.candidates.squares[part]
            lengths = (V**2).T @ diagonal.T
        else:
            lengths = np.square(V / self.candidates.scale[:, None]).sum(axis=0)[:, None]
        shown = squares / lengths
        return self._ratio(shown[:-1].min(axis=0), shown[-1])

    def _floor_of_rows(
        self, state: InformationState, part: slice | IntArray, near: int | None
    ) -> FloatArray:
        M, C = state.M, state.C
        size = self._largest_so_far(state)
        if near is not None:
            own, _ = state.change(np.array([near]), 1.0)
            C = C - own[:, :, 0].T @ own[:, :, 0]
            M = M + self.candidates.J[near].T @ self.candidates.J[near]
            size = np.maximum(size, self.candidates.largest[near])
        size = np.where(size > 0.0, size, 1.0)
        rows = np.argsort(np.abs(M / size).sum(axis=1) / size)[-_ROWS:]
        columns = np.argsort(np.abs(C * size).sum(axis=1) * size)[-_ROWS:]
        moved, possible = state.change(part, 1.0)  # (m, p, n)
        J = self.candidates.by_row[:, :, part]
        size = np.ascontiguousarray(self._largest(state, part, 1.0).T)  # (p, n)
        size[size == 0.0] = np.nan
        high, low = np.zeros(size.shape[1]), np.zeros(size.shape[1])
        for k in rows:
            row = state.M[k][:, None] + (J[:, k, None] * J).sum(axis=0)
            high = np.fmax(high, (np.abs(row) / size).sum(axis=0) / size[k])
        for k in columns:
            row = state.C[k][:, None] - (moved[:, k, None] * moved).sum(axis=0)
            low = np.fmax(low, (np.abs(row) * size).sum(axis=0) * size[k])
        return np.asarray(np.where(possible, high * low, np.inf))

    def _by_largest(
        self, state: InformationState, part: slice | IntArray, sign: float
    ) -> FloatArray:
        J = self.candidates.J[part]
        M = state.M + sign * np.swapaxes(J, 1, 2) @ J
        moved, _ = state.change(part, sign)
        columns = moved.transpose(2, 1, 0)  # (n, p, m)
        C = state.C - sign * columns @ np.swapaxes(columns, 1, 2)
        size = self._largest(state, part, sign)
        size = np.where(size > 0.0, size, np.nan)
        return _c_g(M, C, size)

    def of_choices(self, choices: IntArray) -> FloatArray:
        informations = Informations(self.candidates, choices)
        if self._kind != "C_G":
            return self._of_spectrum(informations.M, SEEN)
        C, seen = informations.covariance
        return np.where(seen, _c_g(informations.M, C, informations.largest), np.inf)

    def _largest(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        """Largest absolute entry of each column ``(n, p)`` after each change."""
        known, each = self.candidates.largest_known, self.candidates.largest
        if sign > 0.0:
            return np.maximum(each[part], self._largest_so_far(state))
        rows = state.rows
        chosen = np.vstack([each[rows], known, np.zeros_like(known)])
        order = np.argsort(chosen, axis=0)
        columns = np.arange(chosen.shape[1])
        most, second = chosen[order[-1], columns], chosen[order[-2], columns]
        return np.asarray(np.where(each[part] >= most, second, most))

    def _largest_so_far(self, state: InformationState) -> FloatArray:
        known, each = self.candidates.largest_known, self.candidates.largest
        return np.asarray(np.max(each[state.rows], axis=0, initial=0.0).clip(min=known))

    def relax(self, count: int, tolerance: float) -> Relaxation:
        candidates = self.candidates
        if self._kind == "O4":
            return self._relax_product(count, tolerance)
        if self._kind == "O2":
            lowest = highest = candidates.scale**-2.0
        elif self._kind == "C_G":
            # n poses have an entry as large as the n-th smallest of all, and as the known ones
            last = np.partition(candidates.largest, count - 1, axis=0)[count - 1]
            lowest = np.maximum(last, candidates.largest_known) ** 2
            highest = np.maximum(candidates.largest.max(axis=0), candidates.largest_known) ** 2
            lowest = np.minimum(lowest, highest)
        else:
            lowest, highest = np.zeros(candidates.p), np.full(candidates.p, np.inf)
        # cond_2 and O2 are of G; the proof is of its square
        return relax_condition(
            candidates, count, tolerance, lowest, highest, root=self._kind != "C_G"
        )

    def _relax_product(self, count: int, tolerance: float) -> Relaxation:
        """O4 is O2 times the smallest singular value: no better than the best of both."""
        even = ConditioningObjective(self.candidates, "O2").relax(count, tolerance)
        scale = self.candidates.scale
        smallest = SpectrumObjective(self.candidates, np.diag(1.0 / scale), np.inf)
        large = smallest.relax(count, tolerance)
        weighted = self.candidates.weighted(large.weights)
        values = np.linalg.eigvalsh(weighted * np.outer(scale, scale))
        cost = float(self._ratio(values[:1], values[-1:])[0])
        return Relaxation(large.weights, cost, None, float(even.bound * np.sqrt(large.bound)))


def _c_g(M: FloatArray, C: FloatArray, size: FloatArray) -> FloatArray:
    """C_G ``(n,)`` of informations, their inverses ``(n, p, p)`` and the scales ``(n, p)``."""
    rows = (np.abs(M) / size[:, None, :]).sum(axis=-1) / size
    inverse = (np.abs(C) * size[:, None, :]).sum(axis=-1) * size
    return np.asarray(rows.max(axis=-1) * inverse.max(axis=-1))
