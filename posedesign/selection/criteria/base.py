"""A criterion, and what it comes to on one pool of candidates.

Every criterion is brought to a *cost* that is made small. For all but the condition numbers the
cost is a mean variance: geometric (D), arithmetic (A, I), largest (E, G). Its inverse is then a
concave, homogeneous function of the information, an information function in the sense of
Pukelsheim, Optimal Design of Experiments, 1993, chapter 5, and a bound that no choice of the pool
can beat follows from any positive semidefinite matrix: see
:mod:`posedesign.selection.relaxation.certificate`.
The efficiency of a choice is the bound over its cost: .97 says that the best that can be had from
any n poses of the pool takes at least .97 n poses' worth of measuring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import RANK_TOLERANCE, Candidates
from posedesign.selection.information_state import Ledger

if TYPE_CHECKING:
    from posedesign.selection.relaxation import Relaxation

FIRST_BATCH, LARGEST_BATCH = 32, 1024
"""Candidates whose costs are computed at once where those that cannot be best are left out."""


class Criterion(ABC):
    """What is made best.

    ``title``: in words. ``smaller_is_better``: of the value that is shown. ``falls_with_poses``:
    more poses never cost more: of variances, not of condition numbers.
    """

    name: str
    title: str
    smaller_is_better: bool
    falls_with_poses: bool = True

    @abstractmethod
    def on(self, candidates: Candidates) -> Objective:
        """The objective that it comes to on a pool."""

    @abstractmethod
    def shown(self, cost: float) -> float:
        """The value that people know the criterion by, of a cost."""

    @abstractmethod
    def cost_of(self, value: float) -> float:
        """The cost of a value that is shown."""


class Objective(ABC):
    """The cost of choices out of one pool; the smaller the better, infinite where not all is seen."""

    def __init__(self, candidates: Candidates) -> None:
        self.candidates = candidates

    @property
    def has_floor(self) -> bool:
        """Whether :meth:`at_least` takes much less time than :meth:`costs`."""
        return False

    @property
    def rugged(self) -> bool:
        """Whether the cost has edges: exchanges then end in many places that are not best."""
        return False

    @property
    def stages(self) -> Sequence[Objective]:
        """Objectives for the exchange, one after the other: smoother ones first."""
        return (self,)

    def ledger(self, rows: IntArray, count: int) -> Ledger:
        """A ledger of a choice, ``count`` of which are to be chosen in the end."""
        return Ledger(self.candidates, rows, count)

    @abstractmethod
    def cost(self, rows: IntArray) -> float:
        """Of a choice, computed without squaring its condition where that can be helped."""

    @abstractmethod
    def costs(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        """Of the ledger's choice with each of some candidates ``(n,)`` taken in, or put back.

        ``part``: of the candidates. ``sign``: +1: taken in; -1: put back.
        """

    @abstractmethod
    def of_choices(self, choices: IntArray) -> FloatArray:
        """Cost ``(T,)`` of choices ``(T, n)`` of a small pool, all at once.

        To fewer digits than :meth:`cost`; infinite where few digits would be left.
        """

    @abstractmethod
    def relax(self, count: int, tolerance: float) -> Relaxation:
        """The best that fractions of candidates, ``count`` in all, can be, with its proof."""

    @property
    @abstractmethod
    def width(self) -> int:
        """Numbers of temporaries for each candidate in :meth:`costs`."""

    def costs_with_each(self, ledger: Ledger) -> FloatArray:
        """Cost ``(N,)`` of the choice with each candidate besides; infinite for those in it."""
        out = np.empty(self.candidates.N)
        for part in self.candidates.chunks(self.width):
            out[part] = self.costs(ledger, part, 1.0)
        out[ledger.chosen] = np.inf
        return out

    def at_least(self, ledger: Ledger, part: slice | IntArray, near: int | None) -> FloatArray:
        """Numbers ``(n,)`` that the costs with each of some candidates are not below.

        Worth having where they take much less time than the costs.

        ``near``: they are to be sharp for candidates like this one; for the ledger's choice as it
        is by default.
        """
        return np.zeros(self.candidates.N)[part]

    def best_with_each(self, ledger: Ledger, limit: float = np.inf) -> int | None:
        """The candidate that costs least besides the choice.

        Most candidates are far from the best: they are left out by what they cost at least, the
        others are tried in the order of it until none that is left can be better.

        ``limit``: None where no candidate costs less.
        """
        if not self.has_floor:
            costs = self.costs_with_each(ledger)
            best = int(np.argmin(costs))
            return best if costs[best] < limit else None
        floor = np.empty(self.candidates.N)
        for part in self.candidates.chunks(self.width):
            floor[part] = self.at_least(ledger, part, None)
        floor[ledger.chosen] = np.inf
        found: int | None = None
        left, size = np.flatnonzero(floor < limit), FIRST_BATCH
        left = left[np.argsort(floor[left], kind="stable")]
        while len(left):
            batch, left = left[:size], left[size:]
            costs = self.costs(ledger, batch, 1.0)
            best = int(np.argmin(costs))
            if costs[best] < limit:
                found, limit = int(batch[best]), float(costs[best])
            left = left[floor[left] < limit]
            if len(left) > size:
                # once more, sharp where the best of this batch is
                floor[left] = np.maximum(floor[left], self.at_least(ledger, left, int(batch[best])))
                left = left[floor[left] < limit]
                left = left[np.argsort(floor[left], kind="stable")]
            size = min(2 * size, LARGEST_BATCH)
        return found

    def costs_without(self, ledger: Ledger, rows: IntArray) -> FloatArray:
        """Cost ``(n,)`` of the choice without each of some of its candidates."""
        return self.costs(ledger, rows, -1.0)


def covariance_of_root(root: FloatArray) -> FloatArray | None:
    """Covariance ``(p, p)`` of rows ``(M, p)`` of information; None where not all is seen."""
    length = np.linalg.norm(root, axis=0)
    if len(root) < len(length) or not length.all():
        return None
    _, values, Vt = np.linalg.svd(root / length, full_matrices=False)
    if values[-1] <= RANK_TOLERANCE * values[0]:
        return None
    half = Vt / values[:, None] / length
    return np.asarray(half.T @ half)
