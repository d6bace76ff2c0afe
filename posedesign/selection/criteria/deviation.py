"""Predicted standard deviations: mean (A, I) or largest (G) of any linear functions of parameters.

Function k takes the parameters to ``L_k x`` with ``r`` rows, such as the position of the tool point
at a place of the task box; its mean square error is ``trace(L_k C L_kᵀ)``. One function is the
criterion A (all parameters), I (the whole box) or c (one named parameter); the largest of several
is G. A test pose (Klimchik et al. 2015) is a box of one point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria.base import Criterion, Objective, covariance_of_root
from posedesign.selection.information import Informations
from posedesign.selection.information_state import Ledger
from posedesign.selection.products import products_by_pairs
from posedesign.selection.relaxation import MeanCertificate, Relaxation
from posedesign.selection.relaxation.barrier import relax_by, relax_smooth
from posedesign.selection.relaxation.minimax import Errors, minimise_largest
from posedesign.selection.relaxation.relaxation import Smooth

SHARPNESS = (2.0, 8.0, 32.0)
"""Powers of the errors whose mean stands in for the largest, one exchange after the other: the
larger, the nearer to the largest, and the less does it say of how to lower the others."""


class Deviation(Criterion):
    """Largest of the root mean square errors of linear functions of the parameters.

    ``functions`` (K, r, p): rows of each; where there is one only, it is that which is made small.
    ``squared``: show the mean square in place of its root, as A-optimality is known.
    """

    smaller_is_better = True

    def __init__(
        self, functions: FloatArray, name: str, title: str, *, squared: bool = False
    ) -> None:
        self.functions = np.asarray(functions, dtype=float)
        if self.functions.ndim != 3 or 0 in self.functions.shape:
            raise InputError(
                f"functions of the parameters have shape (K, r, p), not {self.functions.shape}",
                name=name,
            )
        if not np.isfinite(self.functions).all() or not self.functions.any(axis=(1, 2)).all():
            raise InputError("a function of the parameters is zero or not finite", name=name)
        self.name, self.title, self._squared = name, title, squared

    def on(self, candidates: Candidates) -> DeviationObjective:
        if self.functions.shape[2] != candidates.p:
            raise InputError(
                f"functions of {self.functions.shape[2]} parameters, blocks of {candidates.p}",
                name=self.name,
            )
        return DeviationObjective(candidates, _shortened(self.functions / candidates.scale))

    def shown(self, cost: float) -> float:
        """Root mean square error, in the units of the functions."""
        return cost if self._squared else float(np.sqrt(cost))

    def cost_of(self, value: float) -> float:
        return value if self._squared else value**2


class DeviationObjective(Objective):
    """Mean square errors on one pool.

    ``L`` (K, r, p): functions, of scaled parameters. ``power``: of the mean square errors in their
    mean.
    """

    def __init__(self, candidates: Candidates, L: FloatArray, power: float = np.inf) -> None:
        super().__init__(candidates)
        self.L = L
        self._power = power if len(L) > 1 else np.inf

    @property
    def width(self) -> int:
        return self.candidates.m * 3 * len(self.L) * int(self.L.shape[1])

    @property
    def rugged(self) -> bool:
        return len(self.L) > 1

    @property
    def stages(self) -> Sequence[DeviationObjective]:
        if len(self.L) == 1:
            return (self,)
        return [DeviationObjective(self.candidates, self.L, s) for s in (*SHARPNESS, np.inf)]

    def cost(self, rows: IntArray) -> float:
        C = covariance_of_root(self.candidates.root(rows))
        return np.inf if C is None else float(self._mean(self.squares(C)))

    def squares(self, C: FloatArray) -> FloatArray:
        """Mean square error ``(K,)`` of each function."""
        rows = self.L.reshape(-1, self.L.shape[2])
        return np.asarray(((rows @ C) * rows).reshape(len(self.L), -1).sum(axis=1))

    def _mean(self, squares: FloatArray) -> FloatArray:
        """Of mean square errors ``(K, ...)``."""
        largest = np.max(squares, axis=0)
        if np.isinf(self._power):
            return np.asarray(largest)
        with np.errstate(invalid="ignore"):
            parts = (squares / largest) ** self._power
        return np.asarray(largest * np.mean(parts, axis=0) ** (1.0 / self._power))

    def costs(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        K, r, p = self.L.shape
        moved, _ = ledger.change(part, sign, self.L.reshape(-1, p).T)
        change = np.square(moved, out=moved).sum(axis=0).reshape(K, r, -1).sum(axis=1)  # (K, n)
        found = self._mean(self.squares(ledger.C)[:, None] - sign * change)
        return np.asarray(np.where(np.isfinite(found), found, np.inf))

    def of_choices(self, choices: IntArray) -> FloatArray:
        informations = Informations(self.candidates, choices)
        C, seen = informations.covariance
        K, r, p = self.L.shape
        rows = self.L.reshape(-1, p)
        squares = ((C @ rows.T) * rows.T).sum(axis=1).reshape(-1, K, r).sum(axis=2)
        return np.where(seen, self._mean(squares.T), np.inf)

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost of weights ``(n,)``, where there is one function only."""
        return self.lagrangian(candidates, weights, np.ones(1))

    def errors(self, candidates: Candidates, weights: FloatArray) -> Errors:
        """Mean square errors of weights ``(n,)``, with the derivatives of their logarithms."""
        C = np.asarray(np.linalg.inv(candidates.weighted(weights)))
        return self._errors(candidates, C)

    def _errors(self, candidates: Candidates, C: FloatArray) -> Errors:
        v = self.squares(C)
        n, (K, r, p) = candidates.N, self.L.shape
        moved = candidates.J.reshape(-1, p) @ (self.L.reshape(-1, p) @ C).T
        moved = np.square(moved, out=moved).reshape(n, candidates.m, K, r)
        return Errors(v, moved.sum(axis=(1, 3)) / v)

    def lagrangian(self, candidates: Candidates, weights: FloatArray, shares: FloatArray) -> Smooth:
        """The largest error, with the derivatives of the mean of the logarithms by ``shares``."""
        C = np.asarray(np.linalg.inv(candidates.weighted(weights)))
        now = self._errors(candidates, C)
        parts = shares / now.squares
        half = (self.L @ C * np.sqrt(parts)[:, None, None]).reshape(-1, candidates.p)
        P = half.T @ half
        curvature = 2.0 * products_by_pairs(candidates, P, C)
        curvature -= (now.slopes * shares) @ now.slopes.T
        return Smooth(float(now.squares.max()), P, curvature, weights_of_functions=parts)

    def certificate_of(self, smooth: Smooth) -> MeanCertificate:
        """The proof that the derivative at some weights gives.

        The largest of the functions is never below any mean of them.
        """
        parts = smooth.weights_of_functions
        share = np.ones(len(self.L)) if parts is None else parts / parts.sum()
        weighted = (self.L * np.sqrt(share)[:, None, None]).reshape(-1, self.candidates.p)
        return MeanCertificate(smooth.Z, weighted.T, 1.0, total=True)

    def relax(self, count: int, tolerance: float) -> Relaxation:
        if len(self.L) == 1:
            return relax_smooth(self, self.candidates, count, tolerance)

        def minimise(part: Candidates, sharp: float) -> tuple[FloatArray, Smooth]:
            return minimise_largest(self, part, count, sharp)

        return relax_by(minimise, self.certificate_of, self.candidates, count, tolerance)


def _shortened(L: FloatArray) -> FloatArray:
    """Functions ``(K, r, p)`` with at most p rows each and the same mean square errors."""
    if L.shape[1] <= L.shape[2]:
        return L
    return np.asarray(np.linalg.qr(L, mode="r"))
