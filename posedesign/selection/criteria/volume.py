"""D: the volume of the confidence ellipsoid, of all parameters or of those of interest."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria.base import Criterion, Objective, covariance_of_root
from posedesign.selection.information import Informations
from posedesign.selection.information_state import Ledger, log_det_of_root
from posedesign.selection.products import products_by_pairs, root_of
from posedesign.selection.relaxation import MeanCertificate, Relaxation
from posedesign.selection.relaxation.barrier import relax_smooth
from posedesign.selection.relaxation.relaxation import Smooth


class Volume(Criterion):
    """D-optimality: the geometric mean of the variances along the axes of the ellipsoid.

    With parameters of interest the others are nuisances, and are marginalised (D_s-optimality).

    ``interest`` (p, k): combinations of the parameters that are of interest, as columns; all by
    default.
    """

    smaller_is_better = False

    def __init__(
        self,
        interest: FloatArray | None = None,
        name: str = "D",
        title: str = "det(information)^(1/p)",
    ) -> None:
        self.interest, self.name, self.title = interest, name, title

    def on(self, candidates: Candidates) -> VolumeObjective:
        K = np.eye(candidates.p) if self.interest is None else self.interest
        return VolumeObjective(candidates, K / candidates.scale[:, None])

    def shown(self, cost: float) -> float:
        """``det(information)^(1/p)``, as :func:`posedesign.selection.indices.d_optimality`."""
        return 1.0 / cost if cost > 0.0 else np.inf

    def cost_of(self, value: float) -> float:
        return 1.0 / value if value > 0.0 else np.inf


class RootVolume(Volume):
    """O1 of Borm and Menq 1991: the root of D, over the root of the number of poses.

    ``count``: poses to be chosen.
    """

    falls_with_poses = False

    def __init__(self, count: int) -> None:
        super().__init__(None, "O1", "geometric mean of the singular values over sqrt(poses)")
        self._count = count

    def shown(self, cost: float) -> float:
        return float(np.sqrt(super().shown(cost) / self._count))

    def cost_of(self, value: float) -> float:
        return super().cost_of(value**2 * self._count)


class VolumeObjective(Objective):
    """D on one pool.

    ``K`` (p, k): combinations of interest, in scaled parameters.
    """

    def __init__(self, candidates: Candidates, K: FloatArray) -> None:
        super().__init__(candidates)
        self.K = K
        self._all = K.shape[1] == candidates.p

    @property
    def width(self) -> int:
        return self.candidates.m * (self.candidates.m + 2 * int(self.K.shape[1]) * (not self._all))

    def cost(self, rows: IntArray) -> float:
        C = covariance_of_root(self.candidates.root(rows))
        return np.inf if C is None else self._of(C)

    def _of(self, C: FloatArray) -> float:
        _, log_det = np.linalg.slogdet(self.K.T @ C @ self.K)
        return float(np.exp(log_det / self.K.shape[1]))

    def costs(self, ledger: Ledger, part: slice | IntArray, sign: float) -> FloatArray:
        lost = log_det_of_root(ledger.root_of_change(part, sign))
        gain = np.zeros_like(lost)
        if not self._all:
            moved = self.candidates.J[part] @ root_of(self._seen(ledger.C))
            rest = ledger.S[:, :, part] - np.einsum("nar,nbr->abn", moved, moved)
            gain = _log_det(sign * rest)
        return np.asarray(self._of(ledger.C) * np.exp((gain - lost) / self.K.shape[1]))

    def of_choices(self, choices: IntArray) -> FloatArray:
        informations = Informations(self.candidates, choices)
        C, seen = informations.covariance
        log_det = np.linalg.slogdet(self.K.T @ C @ self.K)[1]
        return np.where(seen, np.exp(log_det / self.K.shape[1]), np.inf)

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
        return Smooth(self._of(C), P / k, curvature / k)

    def certificate_of(self, smooth: Smooth) -> MeanCertificate:
        """The proof that the derivative at some weights gives."""
        return MeanCertificate(smooth.Z, self.K, 0.0)

    def relax(self, count: int, tolerance: float) -> Relaxation:
        return relax_smooth(self, self.candidates, count, tolerance)


def _log_det(change: FloatArray) -> FloatArray:
    """Logarithm ``(n,)`` of the determinants of ``1 + change`` (m, m, n)."""
    inner = np.moveaxis(change, -1, 0) + np.eye(len(change))
    return np.asarray(np.linalg.slogdet(inner)[1])
