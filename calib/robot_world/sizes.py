"""Sizes of the noise of B, estimated together with X and Z.

The noise is the same in all directions. Its size of rotation is what the residual rotations show
over the share of them that X and Z have not taken up, and its size of translation likewise
(variance components, Förstner 1979). These are the estimates of restricted maximum likelihood.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.algebra import inverse_information
from calib.robot_world.errors_of_pairs import ErrorModel, Isotropic
from calib.robot_world.estimate import residuals
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray, FloatArray

_ROUNDS = 4
"""Rounds of the sizes at one linearisation of the residuals. The next linearisation continues."""

SETTLED = 1e-6
"""Relative change of the sizes that counts as none."""

_FEWEST_FOR_BOTH = 4
"""Pairs from which on both sizes are estimated. Of fewer pairs the ratio of the two is that of the
closed form: three pairs have as many rows of translation as unknowns that these can decide, and
the likelihood then grows without limit as their noise goes to zero."""

_MOST = 10.0
"""Largest noise of translation that is estimated, as part of the translations; of rotation, π."""

_LEAST = 1e-9
"""Least noise that is estimated: of rotation [rad], and of translation as part of the translations.
Data without noise have rounding left, which is not independent from pair to pair."""


class Sizes:
    """Standard deviations of rotation and translation of T sets, as far as they are estimated.

    Parameters
    ----------
    pairs : PairSets
        The pairs of T sets.
    X, Z : ndarray (T, 4, 4)
        A first solution. Its residuals give the first sizes.
    counted : ndarray (T, N)
        1 for pairs that count, 0 for the others.
    widening : float
        Factor of the sizes where pairs were chosen by their residuals.
    """

    def __init__(
        self,
        pairs: PairSets,
        X: FloatArray,
        Z: FloatArray,
        counted: FloatArray,
        widening: float = 1.0,
    ) -> None:
        self._pairs, self._counted, self._widening = pairs, counted, widening
        least = _least(pairs)
        self._bounds = least, np.stack([np.full(pairs.T, np.pi), _MOST * pairs.size])
        square = residuals(pairs.A, pairs.B, X, Z) ** 2
        sums = np.stack([square[..., :3].sum(axis=-1), square[..., 3:].sum(axis=-1)])
        freedom = self._freedom(np.array([[6.0], [6.0]]))
        sigma = np.sqrt((counted * sums).sum(axis=-1) / freedom)
        self.sigma = np.clip(sigma, *self._bounds)  # (2, T)

    @property
    def model(self) -> ErrorModel:
        """Errors of the pairs by these sizes."""
        return estimated_model(self._pairs, self.sigma)

    def renew(
        self, white: FloatArray, jacobian: FloatArray, moving: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Estimate the sizes of the sets that move from their white rows.

        Parameters
        ----------
        white, jacobian : ndarray (6, S), (12, 6, S)
            White rows by the present sizes, and their derivatives by the errors of X and Z.
        moving : ndarray of bool (T,)
            Sets whose sizes may change, so that no set depends on its company.

        Returns
        -------
        ratio : ndarray (2, T)
            Former sizes over new ones.
        settled : ndarray of bool (T,)
            True for the sets whose sizes no longer change.
        """
        T, N = self._pairs.T, self._pairs.N
        J = jacobian.reshape(12, 2, 3, T, N).transpose(1, 3, 0, 2, 4).reshape(2, T, 12, 3 * N)
        r = white.reshape(2, 3, T, N).transpose(0, 2, 1, 3).reshape(2, T, 3 * N, 1)
        own, right, square = J @ np.swapaxes(J, -1, -2), J @ r, (r**2).sum(axis=(2, 3))
        count = self._counted.sum(axis=-1)
        few = count < _FEWEST_FOR_BOTH
        first = new = self.sigma
        for _ in range(_ROUNDS):
            ratio = (first / new) ** 2
            each = ratio[..., None, None]
            covariance = inverse_information((each * own).sum(axis=0))
            step = -covariance @ (each * right).sum(axis=0)
            rows = np.maximum(square + ((2.0 * right + own @ step) * step).sum(axis=(2, 3)), 0.0)
            taken = (each * own * covariance).sum(axis=(2, 3))
            rows, freedom = ratio * rows, self._freedom(taken)
            # of few pairs X and Z may take up one of the two whole: there the ratio stays
            rows = np.where(few, rows.sum(axis=0), rows)
            freedom = np.where(few, np.maximum(6.0 * count - 12.0, 1.0), freedom)
            found = np.clip(new * self._widening * np.sqrt(rows / freedom), *self._bounds)
            change = np.abs(found / new - 1.0).max(axis=0)
            new = np.where(moving, found, new)
            if not (change[moving] > SETTLED).any():
                break
        self.sigma = new
        total = np.abs(new / first - 1.0).max(axis=0)
        return first / new, total <= SETTLED

    def _freedom(self, taken: FloatArray) -> FloatArray:
        """Degrees of freedom ``(2, T)`` of the rows of rotation and of translation."""
        return np.asarray(np.maximum(3.0 * self._counted.sum(axis=-1) - taken, 1.0))


def estimated_model(pairs: PairSets, sigma: FloatArray) -> ErrorModel:
    """Errors of B alone, of rotation and translation ``(2, T)``, no smaller than rounding."""
    sigma = np.maximum(sigma, _least(pairs))
    return Isotropic(pairs.spread(np.concatenate([np.zeros_like(sigma), sigma])))


def _least(pairs: PairSets) -> FloatArray:
    """Least sizes ``(2, T)``."""
    return np.stack([np.full(pairs.T, _LEAST), _LEAST * pairs.size])
