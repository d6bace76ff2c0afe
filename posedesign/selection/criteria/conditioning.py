"""C_G, cond_2, O2 and O4: how evenly a choice sees the parameters, whatever the noise.

They are no information functions: poses more can make them worse, and they depend on how the
columns are scaled, which for C_G and cond_2 depends on the choice itself (see
:mod:`posedesign.indices`).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.indices import condition_2, condition_inf, o2, o4
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria.base import Criterion, Objective
from posedesign.selection.criteria.spectrum import Spectrum
from posedesign.selection.ledger import Ledger, solve_root
from posedesign.selection.relaxation.cone import relax_condition
from posedesign.selection.relaxation.relaxation import Relaxation

Kind = Literal["C_G", "cond_2", "O2", "O4"]

TITLES = {
    "C_G": "C_G of Watanabe et al. 2006",
    "cond_2": "cond_2 of G, columns of unit length",
    "O2": "smallest over largest singular value",
    "O4": "square of the smallest over the largest singular value",
}


class Conditioning(Criterion):
    """A condition number, or an index akin to one.

    Parameters
    ----------
    kind : str
    """

    falls_with_poses = False

    def __init__(self, kind: Kind) -> None:
        self._kind = kind
        self.name, self.title = kind, TITLES[kind]
        self.smaller_is_better = kind in ("C_G", "cond_2")

    def on(self, candidates: Candidates) -> ConditioningObjective:
        """See :meth:`Criterion.on`."""
        return ConditioningObjective(candidates, self._kind)

    def shown(self, cost: float) -> float:
        """See :meth:`Criterion.shown`."""
        if self.smaller_is_better:
            return cost
        return 1.0 / cost if cost > 0.0 else np.inf

    def cost_of(self, value: float) -> float:
        """See :meth:`Criterion.cost_of`."""
        return self.shown(value)


class ConditioningObjective(Objective):
    """A condition number on one pool.

    Parameters
    ----------
    candidates : Candidates
    kind : str
    """

    def __init__(self, candidates: Candidates, kind: Kind) -> None:
        super().__init__(candidates)
        self._kind = kind

    @property
    def width(self) -> int:
        """See :attr:`Objective.width`."""
        p = self.candidates.p
        return p * (4 * p + 2 * self.candidates.m)

    def cost(self, rows: IntArray) -> float:
        """See :meth:`Objective.cost`."""
        G = self.candidates.root(rows)
        if self._kind == "C_G":
            return condition_inf(G)
        if self._kind == "cond_2":
            return condition_2(G)
        value = (o2 if self._kind == "O2" else o4)(G * self.candidates.scale)
        return 1.0 / value if value > 0.0 else np.inf

    def costs(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        """See :meth:`Objective.costs`."""
        J = self.candidates.J[part]
        M = ledger.M + sign * np.swapaxes(J, 1, 2) @ J
        if self._kind != "C_G":
            found = self._of_spectrum(M)
        else:
            found = self._by_largest(M, ledger, part, sign)
        return np.asarray(np.where(np.isfinite(found), found, np.inf))

    def _of_spectrum(self, M: FloatArray) -> FloatArray:
        if self._kind == "cond_2":
            scale = 1.0 / np.sqrt(np.maximum(np.einsum("npp->np", M), np.finfo(float).tiny))
        else:
            scale = np.broadcast_to(self.candidates.scale, M.shape[:2])
        values = np.linalg.eigvalsh(M * scale[:, :, None] * scale[:, None, :])
        least, most = values[:, 0], values[:, -1]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.sqrt(most) / (least if self._kind == "O4" else np.sqrt(least))
        return np.asarray(np.where(least > 0.0, ratio, np.inf))

    def _by_largest(
        self, M: FloatArray, ledger: Ledger, part: slice | IntArray, sign: float
    ) -> FloatArray:
        moved = np.moveaxis(self.candidates.J[part] @ ledger.C, 1, 0).copy()  # (m, n, p)
        solve_root(ledger.root_of_change(part, sign), moved)
        possible = np.isfinite(moved).all(axis=(0, 2))
        moved[:, ~possible] = np.nan
        C = ledger.C - sign * np.einsum("mni,mnj->nij", moved, moved, optimize=True)
        size = self._largest(ledger, part, sign)
        size = np.where(size > 0.0, size, np.nan)
        rows = (np.abs(M) / size[:, None, :]).sum(axis=-1) / size
        inverse = (np.abs(C) * size[:, None, :]).sum(axis=-1) * size
        return np.asarray(rows.max(axis=-1) * inverse.max(axis=-1))

    def _largest(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        """Largest absolute entry of each column ``(n, p)`` after each change."""
        known, each = self.candidates.largest_known, self.candidates.largest
        rows = ledger.rows
        if sign > 0.0:
            return np.maximum(each[part], np.max(each[rows], axis=0, initial=0.0, where=True))
        chosen = np.vstack([each[rows], known, np.zeros_like(known)])
        order = np.argsort(chosen, axis=0)
        columns = np.arange(chosen.shape[1])
        most, second = chosen[order[-1], columns], chosen[order[-2], columns]
        return np.asarray(np.where(each[part] >= most, second, most))

    def relax(self, count: int, tolerance: float) -> Relaxation:
        """See :meth:`Objective.relax`."""
        candidates = self.candidates
        if self._kind == "O4":
            return self._relax_product(count, tolerance)
        if self._kind == "O2":
            lowest = highest = candidates.scale**-2.0
        elif self._kind == "C_G":
            # n poses have entries as large as the n-th largest of all, and as the known ones
            last = np.partition(candidates.largest, candidates.N - count, axis=0)
            lowest = np.maximum(last[candidates.N - count], candidates.largest_known) ** 2
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
        large = Spectrum(np.inf, "E", "", float, float).on(self.candidates).relax(count, tolerance)
        bound = even.bound * np.sqrt(large.bound)
        return Relaxation(large.weights, even.cost * np.sqrt(large.cost), None, float(bound))
