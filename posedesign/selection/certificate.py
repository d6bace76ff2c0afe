"""Proofs that no choice of n candidates can beat a bound, checked apart from how they were found.

A mean variance. Let ``Σ = Kᵀ M⁻¹ K`` (k x k) and the cost be the mean of order r of its eigenvalues
(r = 0: D; 1: A; inf: E). For every positive semidefinite Z

    cost >= k φ(Kᵀ Z K) / trace(Z M),    φ: the mean of order r / (1 + r) of the eigenvalues,

because ``M >= K Σ⁻¹ Kᵀ`` and by Hölder's inequality for matrix means (Pukelsheim, Optimal Design of
Experiments, 1993, sections 3.21 and 6.11). The right side is smallest where ``trace(Z M)`` is
largest, and over all choices of n that is a sum of n largest numbers.

A condition number. For positive semidefinite Y, Z, any choice S and any positive diagonal E

    largest / smallest eigenvalue of E^-1/2 M E^-1/2
        >= trace(Z M) / sum(Z_jj E_j)  *  sum(Y_jj E_j) / trace(Y M),

and each of the two factors is smallest over its own range by sorting alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from calib.se3 import FloatArray
from posedesign.selection.candidates import Candidates

ROUNDING = 1e-9
"""Part by which a bound is weakened, so that rounding never claims more than there is."""

_MOST_STEPS = 100
"""Steps to the smallest ratio; a handful is seen. Where they do not do, nothing is claimed."""


@dataclass(frozen=True, eq=False)
class Smooth:
    """Cost of weighted candidates, and the derivatives of its logarithm."""

    cost: float
    Z: FloatArray
    """(p, p): less the derivative by the information: ``trace(Z Jᵀ J)`` is by how much a candidate
    lowers the logarithm."""
    curvature: FloatArray  # (n, n): second derivatives by the weights
    weights_of_functions: FloatArray | None = None
    """(K,): of the functions of the parameters of which the largest counts."""


@dataclass(frozen=True, eq=False)
class Relaxation:
    """The best that fractions of candidates can be."""

    weights: FloatArray  # (N,): from 0 to 1; their sum is the number of poses
    cost: float  # of these weights
    certificate: Certificate | None
    """Proof that no weights, and so no choice, cost less than ``bound``; None where the bound is
    put together from several, or where all choices were tried: the weights are then those of the
    best."""
    bound: float

    @property
    def gap(self) -> float:
        """How far the proven bound is below the cost of the weights, as a part of it."""
        return 1.0 - self.bound / self.cost if self.cost > 0.0 else 0.0


def sum_of_largest(scores: FloatArray, count: int) -> float:
    """Sum of the ``count`` largest of ``scores`` (N,): the best that any choice can gather."""
    if count >= len(scores):
        return float(scores.sum())
    return float(np.partition(scores, len(scores) - count)[len(scores) - count :].sum())


class Certificate(ABC):
    """A proof that can be evaluated on any pool."""

    @abstractmethod
    def bound(self, candidates: Candidates, count: int) -> float:
        """Cost that no choice of ``count`` of the candidates, with the known, is below."""


@dataclass(frozen=True, eq=False)
class MeanCertificate(Certificate):
    """Proof for a mean variance."""

    Z: FloatArray  # (p, p): any positive semidefinite matrix [scaled parameters]
    K: FloatArray  # (p, k): combinations of interest
    order: float  # of the mean: 0 geometric, 1 arithmetic, infinite: the largest
    total: bool = False  # the cost is the sum of the variances in place of their mean

    def bound(self, candidates: Candidates, count: int) -> float:
        return self.bound_by(candidates, partial(sum_of_largest, count=count))

    def bound_by(self, candidates: Candidates, gathered: Callable[[FloatArray], float]) -> float:
        """Cost that no allowed choice is below, by what they gather of scores ``(N,)`` at most."""
        root = _root_of(self.Z)
        scores, known, error = _seen_by(candidates, root, gathered)
        most = known + gathered(scores)
        return float((1.0 - error / most) * self._strength(root) / most) if most > error else 0.0

    def _strength(self, root: FloatArray) -> float:
        # of a volume the units are taken out first: they have nothing to do with the digits
        length = np.linalg.norm(self.K, axis=0) if self.order == 0.0 else np.ones(self.K.shape[1])
        # singular values of a root, not eigenvalues: what is zero stays zero under the root below
        k = len(length)
        found = np.linalg.svd(root.T @ (self.K / length), compute_uv=False)
        rounding = 2.0 * len(self.K) * np.finfo(float).eps * found.max(initial=0.0)
        roots = np.pad(np.maximum(found - rounding, 0.0), (0, k - len(found)))
        if self.order == 0.0:
            with np.errstate(divide="ignore"):
                mean = float(np.exp(2.0 * np.mean(np.log(roots) + np.log(length))))
        else:
            power = 1.0 if np.isinf(self.order) else self.order / (1.0 + self.order)
            mean = float(np.mean(roots ** (2.0 * power)) ** (1.0 / power))
        return float(k * mean * (k if self.total else 1))


@dataclass(frozen=True, eq=False)
class ConditionCertificate(Certificate):
    """Proof for the ratio of extreme eigenvalues of the information, its parameters rescaled."""

    Y: FloatArray
    Z: FloatArray
    """Y, Z (p, p): any positive semidefinite matrices: near the directions of least and of most
    information."""
    lowest: FloatArray
    highest: FloatArray
    """lowest, highest (p,): between which the squares of the scales of the parameters lie, whatever
    is chosen."""
    root: bool = False

    def bound(self, candidates: Candidates, count: int) -> float:
        ratio = self.of_ratio(candidates, count)
        return float(np.sqrt(ratio)) if self.root else ratio

    def of_ratio(self, candidates: Candidates, count: int) -> float:
        """The ratio that no choice is below."""
        Y, Z = _root_of(self.Y), _root_of(self.Z)
        ratio = self._of_choice(candidates, count, Y, Z) * self._of_scales(Y, Z)
        return max(1.0, ratio)

    def _of_choice(self, candidates: Candidates, count: int, Y: FloatArray, Z: FloatArray) -> float:
        """Smallest ``trace(Z M) / trace(Y M)`` over all choices, of roots of Y and Z."""
        gathered = partial(sum_of_largest, count=count)
        y, y_known, y_error = _seen_by(candidates, Y, gathered)
        z, z_known, z_error = _seen_by(candidates, Z, gathered)
        most = y_known + float(y.sum())
        if not most > 0.0:
            return 0.0
        ratio = (z_known + float(z.sum())) / most
        before = None
        for _ in range(_MOST_STEPS):  # Dinkelbach 1967
            rows = np.sort(np.argsort(z - ratio * y, kind="stable")[:count])
            below, above = z_known + z[rows].sum(), y_known + y[rows].sum()
            if above <= y_error or below <= z_error:
                return 0.0
            if before is not None and np.array_equal(rows, before):
                # the same choice again: no other has a smaller ratio
                error = z_error / below + y_error / above
                return float(max(0.0, 1.0 - error) * below / above)
            before, ratio = rows, below / above
        return 0.0

    def _of_scales(self, Y: FloatArray, Z: FloatArray) -> float:
        """Smallest ``sum(Y_jj E_j) / sum(Z_jj E_j)`` over the range of the scales."""
        y, z = np.square(Y).sum(axis=1), np.square(Z).sum(axis=1)
        if not z.any():
            return 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            own = np.where(z > 0.0, y / z, np.inf)
        if np.isinf(self.highest).any():
            return float(own.min())  # all weight on the one scale where the ratio is least
        # parameters of small ratio at their upper end, the others at their lower one
        order = np.argsort(own)
        best = np.inf
        for k in range(len(order) + 1):
            E = self.lowest.copy()
            E[order[:k]] = self.highest[order[:k]]
            if z @ E > 0.0:
                best = min(best, float(y @ E / (z @ E)))
        return best


def _root_of(Z: FloatArray) -> FloatArray:
    """A root ``(p, r)`` of the nearest positive semidefinite matrix.

    What a solver leaves below zero is cut off, and what is rounding of zero. The proof is that of
    the product of the root with itself, whatever was cut.
    """
    values, vectors = np.linalg.eigh((Z + Z.T) / 2.0)
    kept = values > np.finfo(float).eps * max(values[-1], 0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def _seen_by(
    candidates: Candidates, root: FloatArray, gathered: Callable[[FloatArray], float]
) -> tuple[FloatArray, float, float]:
    """``trace(Z Jᵀ J)`` of each candidate ``(N,)`` and of the known, Z by its root.

    With how far what an allowed choice gathers of them may be off by rounding: products of long
    vectors that are nearly orthogonal have few digits.
    """
    scores, known = candidates.scores_of_root(root), candidates.known_by_root(root)
    size = float(np.trace(candidates.known)) + gathered(candidates.lengths)
    most = known + gathered(scores)
    rounding = 4.0 * candidates.p * np.finfo(float).eps
    length = float(np.square(root).sum()) * size
    return scores, known, ROUNDING * most + rounding * float(np.sqrt(length * most))
