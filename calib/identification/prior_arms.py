"""Arms as they may be before they are measured, and the error to expect of them afterwards.

Everything that may be off on an arm is a parameter with a prior: how large errors of its kind are
on such arms. Measured by whitened blocks ``J_i`` (m, p), the parameters have the covariance

    C = (P⁻¹ + Σ J_iᵀ J_i)⁻¹,

the information of the prior (P is diagonal, infinite for tool and targets, which nothing is known
of) plus that of the blocks, and the tool point is off at the places ``L_k`` (3, p) of the work by

    E² = mean over k of tr(L_k C L_kᵀ),

the Bayesian form of I-optimality (Chaloner and Verdinelli 1995, Statistical Science 10, 273-304,
section 2.2). It is the error of the posterior mean, which no estimator falls below on average over
arms with these priors.

No two arms are off by the same amount, so the size of the errors of a kind is drawn itself: it is
log-normal about what such arms show. The fit finds the sizes from the measurements
(:mod:`~calib.identification.evidence`), so each drawn arm is fitted with its own. The priors of the
model are the root mean squares over arms. The covariance after measuring is a concave function of
the prior's, which it is the parallel sum of with another (Anderson and Duffin 1969, J. Math. Anal.
Appl. 26, 576-594), so the error by the mean squares is never below the mean over the arms.

What no parameter describes is a deviation of the joints, new at each pose: a stop of the arm is
repeated no better than that. It is shared by all that is read at the pose, and is integrated out of
the pose's block: with ``D`` the columns of the zero offsets times its standard deviation,
``J_i -> (1 + D Dᵀ)^(-1/2) J_i``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.identification.candidate import ExpectedError
from calib.identification.evidence import groups_of
from calib.model import CalibrationModel, Linearisation
from calib.se3 import FloatArray, IntArray

ARMS = 24, 50
"""Sizes drawn, and arms of each: their root mean square is known to some five per cent."""

SHARE = 0.8
"""Share of the arms inside the range that is given before measuring."""


@dataclass(frozen=True)
class UsualSize:
    """Size of the errors of one kind on arms that were measured."""

    share: float  # median over arms, as a share of the prior of the kind
    factor: float  # two arms of three are within this factor of the median

    @property
    def log_sd(self) -> float:
        """Standard deviation of the logarithm."""
        return float(np.log(self.factor))

    @property
    def rms(self) -> float:
        """Root mean square over arms, as a share of the prior: of the log-normal distribution."""
        return float(self.share * np.exp(self.log_sd**2))


@dataclass(frozen=True, eq=False)
class PriorArms:
    """Arms of one description, before they are measured.

    Attributes
    ----------
    model : CalibrationModel
        All that may be off, with priors that are root mean squares over arms.
    kinds : tuple of (array of int, UsualSize)
        Columns of the parameters whose errors are of one size, and that size.
    deviation_rad : float
        Standard deviation of each joint at each pose that no parameter describes [rad].
    """

    model: CalibrationModel
    kinds: tuple[tuple[IntArray, UsualSize], ...] = ()
    deviation_rad: float = 0.0

    @classmethod
    def of(
        cls,
        model: CalibrationModel,
        usual: Mapping[str, UsualSize],
        deviation_rad: float,
    ) -> PriorArms:
        """Arms whose errors have the usual sizes, by the names of :func:`groups_of`.

        ``model``: with the priors that the sizes are shares of. Kinds that are not listed keep
        their priors.
        """
        prior, kinds = model.prior.copy(), []
        for group in sorted(groups_of(model, 1.0, 1.0), key=lambda group: group.name):
            size = usual.get(group.name)
            if size is not None:
                columns = np.array([model.names.index(n) for n in group.parameters], dtype=np.intp)
                prior[columns] *= size.rms
                kinds.append((columns, size))
        return cls(model.with_prior(prior), tuple(kinds), deviation_rad)

    @cached_property
    def joints(self) -> IntArray:
        """Columns of the zero offsets."""
        named = [name.startswith("zero_offset.") for name in self.model.names]
        return np.flatnonzero(named)

    @property
    def known_rows(self) -> FloatArray:
        """Rows ``(K, p)`` of what is known before measuring, over its standard deviation."""
        return self.model.known_rows

    @property
    def must_be_told(self) -> int:
        """Number of parameters that measurements have to tell: nothing else is known of them."""
        return max(0, self.model.p - len(self.known_rows))

    def blocks(self, linear: Linearisation) -> FloatArray:
        """Whitened blocks ``(..., N, m, p)``, the deviation of the joints integrated out."""
        white = linear.white_jacobian
        if not self.deviation_rad or not len(self.joints):
            return white
        D = self.deviation_rad * white[..., self.joints]
        root = np.linalg.cholesky(D @ np.swapaxes(D, -1, -2) + np.eye(D.shape[-2]))
        return np.asarray(np.linalg.solve(root, white))

    def covariance(self, blocks: FloatArray) -> FloatArray:
        """Covariance ``(p, p)`` [SI] after blocks ``(N, m, p)``, which tell tool and targets."""
        half = self._half(self._root(blocks), self.known_rows)
        return np.asarray(half.T @ half)

    def expected_error(self, blocks: FloatArray, functions: FloatArray) -> ExpectedError:
        """Error to expect of the tool point once blocks ``(N, m, p)`` have been measured.

        ``functions`` (K, 3, p): displacements of the tool point at K places by each parameter, the
        base placed anew [m per unit]. The range is that of 80 % of the arms; the draws are always
        the same, so that plans are compared on the same arms.
        """
        root, known, L = self._root(blocks), self.known_rows, functions.reshape(-1, self.model.p)
        rms = float(np.sqrt(np.sum((L @ self._half(root, known).T) ** 2) / len(functions)))
        rng = np.random.default_rng(0)
        sizes, each = ARMS
        squares = []
        for z in rng.standard_normal((sizes, len(self.kinds))):
            less = np.ones(self.model.p)
            for (columns, size), own in zip(self.kinds, z, strict=True):
                less[columns] = np.exp(size.log_sd * own - size.log_sd**2)
            # sums of squares by the singular values are the same in whatever order poses and
            # parameters are, and in whatever units
            s = np.linalg.svd(L @ self._half(root, known / less).T, compute_uv=False)
            squares.append(s**2 @ rng.standard_normal((len(s), each)) ** 2 / len(functions))
        ends = (1.0 - SHARE) / 2.0, 0.5, (1.0 + SHARE) / 2.0
        low, middle, high = np.sqrt(np.quantile(squares, ends))
        return ExpectedError(rms, float(low), float(high), SHARE, float(middle))

    def _root(self, blocks: FloatArray) -> FloatArray:
        """Rows ``(<= p, p)`` of the information of blocks."""
        rows = blocks.reshape(-1, self.model.p)
        return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > self.model.p else rows

    def _half(self, root: FloatArray, known: FloatArray) -> FloatArray:
        """A root ``(p, p)`` of the covariance: its product ``halfᵀ half`` is that."""
        rows = np.vstack([root, known])
        length = np.linalg.norm(rows, axis=0)
        R = np.linalg.qr(rows / length, mode="r")
        return np.asarray(np.linalg.inv(R).T / length)
