"""Objectives that are means of predicted variances.

D: the volume of the confidence ellipsoid. E, O3 and O5: means along its axes; that of order
infinity is the largest variance (E; O3 is the root of its inverse), that of order one half belongs
to O5 of Sun and Hollerbach 2008. A, I and G: the error of linear functions of the parameters, such
as the position of the tool point at a place of the task box, in the mean or where it is largest.
Function k takes the parameters to ``L_k x`` with ``r`` rows; its mean square error is
``trace(L_k C L_kᵀ)``. A test pose (Klimchik et al. 2015) is a box of one point.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates, products_by_pairs, root_of
from posedesign.selection.certificate import MeanCertificate, Relaxation, Smooth
from posedesign.selection.criterion import Objective, covariance_of_root
from posedesign.selection.information import (
    ErrorState,
    Informations,
    InformationState,
    log_det_of_root,
)
from posedesign.selection.relaxation import Errors, minimise_largest, minimise_smooth, relax_by
from posedesign.selection.semidefinite import relax_smallest

SHARPNESS = (2.0, 8.0, 32.0)
"""Orders of the means that stand in for the largest, one exchange after the other: the larger, the
nearer to the largest, and the less does it say of how to lower the others."""

INDEPENDENT = 1e-9
"""Singular value, over the largest, from which a combination of functions of scaled parameters
counts: its square is the rounding of their mean square error."""


class _AxesObjective(Objective):
    """Of the ellipsoid of ``Kᵀ x``: ``K`` (p, k) are combinations of interest, scaled."""

    def __init__(self, candidates: Candidates, K: FloatArray) -> None:
        super().__init__(candidates)
        self.K = K

    @abstractmethod
    def _of(self, C: FloatArray) -> FloatArray:
        """Cost ``(...)`` of covariances ``(..., p, p)``."""

    def cost(self, rows: IntArray) -> float:
        C = covariance_of_root(self.candidates.root(rows))
        return np.inf if C is None else float(self._of(C))

    def of_choices(self, choices: IntArray) -> FloatArray:
        C, seen = Informations(self.candidates, choices).covariance
        return np.where(seen, self._of(C), np.inf)


class VolumeObjective(_AxesObjective):
    """The geometric mean of the variances along the axes of the ellipsoid.

    Parameters that are not of interest are nuisances, and are marginalised (D_s-optimality).
    """

    def __init__(self, candidates: Candidates, K: FloatArray) -> None:
        super().__init__(candidates, K)
        self._all = K.shape[1] == candidates.p
        self.width = candidates.m * (candidates.m + 2 * int(K.shape[1]) * (not self._all))

    def _of(self, C: FloatArray) -> FloatArray:
        log_det = np.linalg.slogdet(self.K.T @ C @ self.K)[1]
        return np.asarray(np.exp(log_det / self.K.shape[1]))

    def costs(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        lost = log_det_of_root(state.root_of_change(part, sign))
        gain = np.zeros_like(lost)
        if not self._all:
            moved = self.candidates.J[part] @ root_of(self._seen(state.C))
            rest = sign * (state.leverages(part) - np.einsum("nar,nbr->abn", moved, moved))
            gain = np.linalg.slogdet(np.moveaxis(rest, -1, 0) + np.eye(len(rest)))[1]
        return np.asarray(self._of(state.C) * np.exp((gain - lost) / self.K.shape[1]))

    def _seen(self, C: FloatArray) -> FloatArray:
        """What of the covariance is due to the parameters of interest, ``(p, p)``."""
        CK = C @ self.K
        return np.asarray(CK @ np.linalg.solve(self.K.T @ CK, CK.T))

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost of weights ``(n,)`` on candidates, with its derivatives."""
        k = self.K.shape[1]
        C = np.asarray(np.linalg.inv(candidates.weighted(weights)))
        P = self._seen(C)
        curvature = products_by_pairs(candidates, P)
        if not self._all:
            curvature = 2.0 * products_by_pairs(candidates, P, C) - curvature
        return Smooth(float(self._of(C)), P / k, curvature / k)

    def certificate_of(self, smooth: Smooth) -> MeanCertificate:
        return MeanCertificate(smooth.Z, self.K, 0.0)

    def relax(self, count: int, tolerance: float) -> Relaxation:
        return relax_by(minimise_smooth, self, self.candidates, count, tolerance)


class SpectrumObjective(_AxesObjective):
    """The mean of some order of the variances along the axes; infinite: the largest."""

    def __init__(self, candidates: Candidates, K: FloatArray, order: float) -> None:
        super().__init__(candidates, K)
        k = int(K.shape[1])
        self._order = order
        self.width = k * (2 * k + 2 * candidates.m)
        self.rugged, self.has_floor = bool(np.isinf(order)), order >= 1.0

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

    def _of(self, C: FloatArray) -> FloatArray:
        return self._mean(np.linalg.eigvalsh(self.K.T @ C @ self.K))

    def costs(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        moved, possible = state.change(part, sign, self.K)
        moved[:, :, ~possible] = 0.0
        columns = moved.transpose(2, 1, 0)  # (n, k, m)
        change = columns @ np.swapaxes(columns, 1, 2)
        found = self._mean(np.linalg.eigvalsh(self.K.T @ state.C @ self.K - sign * change))
        return np.asarray(np.where(possible, found, np.inf))

    def at_least(
        self, state: InformationState, part: slice | IntArray, near: int | None
    ) -> FloatArray:
        """A diagonal is less spread than the eigenvalues.

        So its mean of an order above one is not above theirs (Schur 1923).
        """
        C = state.C
        if near is not None:
            own, _ = state.change(np.array([near]), 1.0)
            C = C - own[:, :, 0].T @ own[:, :, 0]
        U = self.K @ np.linalg.eigh(self.K.T @ C @ self.K)[1]
        moved, possible = state.change(part, 1.0, U)
        lost = np.square(moved, out=moved).sum(axis=0).T  # (n, k)
        found = self._mean(((U.T @ state.C) * U.T).sum(axis=1) - lost)
        return np.asarray(np.where(possible, found, np.inf))

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost of weights ``(n,)``, of all parameters, with its derivatives."""
        r = self._order
        CK = np.linalg.inv(candidates.weighted(weights)) @ self.K
        variances, V = np.linalg.eigh(self.K.T @ CK)
        # what is known far better than the rest is rounding, and counts for nothing
        values = 1.0 / np.maximum(variances, np.finfo(float).eps * variances[-1])
        total = (values**-r).sum()
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
        return MeanCertificate(smooth.Z, self.K, self._order)

    def relax(self, count: int, tolerance: float) -> Relaxation:
        if np.isinf(self._order):
            return relax_smallest(self.candidates, self.K, count, tolerance)
        return relax_by(minimise_smooth, self, self.candidates, count, tolerance)


def _divided_differences(values: FloatArray, power: float) -> FloatArray:
    """First divided differences ``(p, p)`` of ``x^power``; its derivative where values are near."""
    a, b = values[:, None], values[None]
    difference = a - b
    near = np.abs(difference) < 1e-6 * (a + b)
    middle = (a + b) / 2.0
    apart = (a**power - b**power) / np.where(near, 1.0, difference)
    return np.asarray(np.where(near, power * middle ** (power - 1.0), apart))


class DeviationObjective(Objective):
    """The largest of mean square errors, or their mean of some power.

    ``L`` (K, r, p): functions, of scaled parameters; where there is one only, it is that which is
    made small.
    """

    def __init__(self, candidates: Candidates, L: FloatArray, power: float = np.inf) -> None:
        super().__init__(candidates)
        if L.shape[1] > L.shape[2]:  # as many rows as are independent, of the same errors
            _, values, rows = np.linalg.svd(np.linalg.qr(L, mode="r"))
            rank = int((values > INDEPENDENT * values[:, :1]).sum(axis=1).max())
            L = np.asarray(values[:, :rank, None] * rows[:, :rank])
        self.L = L
        self._power = power if len(L) > 1 else np.inf
        self.width = candidates.m * 3 * len(L) * int(L.shape[1])
        self.rugged = len(L) > 1

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

    def state(self, rows: IntArray, count: int) -> InformationState:
        # begun with few poses, it would lose its digits with each that is taken in
        if len(self.L) > 1 or self.candidates.m > self.L.shape[1] or len(rows) < count:
            return super().state(rows, count)
        return ErrorState(self.candidates, rows, count, self.L[0].T @ self.L[0])

    def costs(self, state: InformationState, part: slice | IntArray, sign: float) -> FloatArray:
        K, r, p = self.L.shape
        if isinstance(state, ErrorState):
            found = self.squares(state.C)[0] - sign * state.error_changes(part, sign)
            return np.where(np.isfinite(found), found, np.inf)
        moved, _ = state.change(part, sign, self.L.reshape(-1, p).T)
        change = np.square(moved, out=moved).sum(axis=0).reshape(K, r, -1).sum(axis=1)  # (K, n)
        found = self._mean(self.squares(state.C)[:, None] - sign * change)
        return np.asarray(np.where(np.isfinite(found), found, np.inf))

    def of_choices(self, choices: IntArray) -> FloatArray:
        C, seen = Informations(self.candidates, choices).covariance
        K, r, p = self.L.shape
        rows = self.L.reshape(-1, p)
        squares = ((C @ rows.T) * rows.T).sum(axis=1).reshape(-1, K, r).sum(axis=2)
        return np.where(seen, self._mean(squares.T), np.inf)

    def smooth(self, candidates: Candidates, weights: FloatArray) -> Smooth:
        """Logarithm of the cost of weights ``(n,)``, where there is one function only."""
        return self.lagrangian(candidates, weights, np.ones(1))

    def errors(self, candidates: Candidates, weights: FloatArray) -> Errors:
        """Mean square errors of weights ``(n,)``, with the derivatives of their logarithms."""
        return self._errors(candidates, np.asarray(np.linalg.inv(candidates.weighted(weights))))

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
            return relax_by(minimise_smooth, self, self.candidates, count, tolerance)
        return relax_by(minimise_largest, self, self.candidates, count, tolerance)
