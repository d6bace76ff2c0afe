"""E, O3 and O5: means of the variances along the axes of the confidence ellipsoid.

The mean of order infinity is the largest variance (E; O3 is the root of its inverse), that of order
one half belongs to O5 of Sun and Hollerbach 2008.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria.base import Criterion, Objective, covariance_of_root
from posedesign.selection.information import Informations
from posedesign.selection.information_state import Ledger
from posedesign.selection.relaxation import MeanCertificate, Relaxation
from posedesign.selection.relaxation.barrier import relax_smooth
from posedesign.selection.relaxation.cone import relax_smallest
from posedesign.selection.relaxation.relaxation import Smooth

SHARPNESS = (2.0, 8.0, 32.0)
"""Orders of the means that stand in for the largest, one exchange after the other."""

Shown = Callable[[float], float]


class Spectrum(Criterion):
    """A mean of the variances along the axes of the ellipsoid.

    ``order``: of the mean; infinite: the largest. ``shown``, ``cost_of``: from the cost, a
    variance, to the value that is shown, and back. ``interest`` (p, k): combinations of the
    parameters that are of interest, as columns; all by default.
    """

    smaller_is_better = False

    def __init__(
        self,
        order: float,
        name: str,
        title: str,
        shown: Shown,
        cost_of: Shown,
        interest: FloatArray | None = None,
    ) -> None:
        self.name, self.title, self.interest = name, title, interest
        self._order, self._shown, self._cost_of = order, shown, cost_of

    def on(self, candidates: Candidates) -> SpectrumObjective:
        K = np.eye(candidates.p) if self.interest is None else self.interest
        return SpectrumObjective(candidates, K / candidates.scale[:, None], self._order)

    def shown(self, cost: float) -> float:
        return self._shown(cost) if cost > 0.0 else np.inf

    def cost_of(self, value: float) -> float:
        return self._cost_of(value) if value > 0.0 else np.inf


class SpectrumObjective(Objective):
    """A mean of variances on one pool.

    ``K`` (p, k): combinations of interest, in scaled parameters.
    """

    def __init__(self, candidates: Candidates, K: FloatArray, order: float) -> None:
        super().__init__(candidates)
        self.K = K
        self._order = order

    @property
    def width(self) -> int:
        k = int(self.K.shape[1])
        return k * (2 * k + 2 * self.candidates.m)

    @property
    def rugged(self) -> bool:
        return bool(np.isinf(self._order))

    @property
    def stages(self) -> Sequence[SpectrumObjective]:
        orders = (*SHARPNESS, np.inf) if np.isinf(self._order) else (self._order,)
        return [SpectrumObjective(self.candidates, self.K, order) for order in orders]

    def _mean(self, variances: NDArray[np.floating]) -> FloatArray:
        """Of variances ``(..., k)``."""
        values = np.maximum(variances, 0.0)
        if np.isinf(self._order):
            return np.asarray(values.max(axis=-1))
        return np.asarray(np.mean(values**self._order, axis=-1) ** (1.0 / self._order))

    def cost(self, rows: IntArray) -> float:
        C = covariance_of_root(self.candidates.root(rows))
        return np.inf if C is None else float(self._mean(np.linalg.eigvalsh(self.K.T @ C @ self.K)))

    def costs(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        moved, possible = ledger.change(part, sign, self.K)
        moved[:, :, ~possible] = 0.0
        columns = moved.transpose(2, 1, 0)  # (n, k, m)
        change = columns @ np.swapaxes(columns, 1, 2)
        found = self._mean(np.linalg.eigvalsh(self.K.T @ ledger.C @ self.K - sign * change))
        return np.asarray(np.where(possible, found, np.inf))

    def of_choices(self, choices: IntArray) -> FloatArray:
        informations = Informations(self.candidates, choices)
        C, seen = informations.covariance
        return np.where(seen, self._mean(np.linalg.eigvalsh(self.K.T @ C @ self.K)), np.inf)

    @property
    def has_floor(self) -> bool:
        return self._order >= 1.0

    def at_least(self, ledger: Ledger, part: slice | IntArray, near: int | None) -> FloatArray:
        """A diagonal is less spread than the eigenvalues.

        So its mean of an order above one is not above theirs (Schur 1923).
        """
        C = ledger.C
        if near is not None:
            own, _ = ledger.change(np.array([near]), 1.0)
            C = C - own[:, :, 0].T @ own[:, :, 0]
        U = self.K @ np.linalg.eigh(self.K.T @ C @ self.K)[1]
        moved, possible = ledger.change(part, 1.0, U)
        lost = np.square(moved, out=moved).sum(axis=0).T  # (n, k)
        found = self._mean(((U.T @ ledger.C) * U.T).sum(axis=1) - lost)
        return np.asarray(np.where(possible, found, np.inf))

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost of weights ``(n,)``, of all parameters, with its derivatives."""
        r = self._order
        CK = np.linalg.inv(candidates.weighted(weights)) @ self.K
        variances, V = np.linalg.eigh(self.K.T @ CK)
        # what is known far better than the rest is rounding, and counts for nothing
        values = 1.0 / np.maximum(variances, np.finfo(float).eps * variances[-1])
        parts = values**-r
        total = parts.sum()
        moved = CK @ (V * values)
        Z = (moved * (values ** (-r - 1.0) / total)) @ moved.T
        rows = candidates.J @ moved  # (n, m, p)
        each = np.swapaxes(rows, 1, 2) @ rows
        slopes = np.einsum("npp,p->n", each, values ** (-r - 1.0) / total)
        flat = each.reshape(candidates.N, -1)
        divided = -_divided_differences(values, -r - 1.0) / total
        curvature = (flat * divided.ravel()) @ flat.T - r * np.outer(slopes, slopes)
        return Smooth(float(self._mean(1.0 / values)), Z, curvature)

    def certificate_of(self, smooth: Smooth) -> MeanCertificate:
        """The proof that the derivative at some weights gives."""
        return MeanCertificate(smooth.Z, self.K, self._order)

    def relax(self, count: int, tolerance: float) -> Relaxation:
        if np.isinf(self._order):
            return relax_smallest(self.candidates, self.K, count, tolerance)
        return relax_smooth(self, self.candidates, count, tolerance)


def _divided_differences(values: FloatArray, power: float) -> FloatArray:
    """First divided differences ``(p, p)`` of ``x^power``; its derivative where values are near."""
    a, b = values[:, None], values[None]
    difference = a - b
    near = np.abs(difference) < 1e-6 * (a + b)
    middle = (a + b) / 2.0
    apart = (a**power - b**power) / np.where(near, 1.0, difference)
    return np.asarray(np.where(near, power * middle ** (power - 1.0), apart))
