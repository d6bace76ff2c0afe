"""Pictures and points that the noise of pixels and arm does not explain."""

from __future__ import annotations

import numpy as np

from calib.identification.deviations import Deviations
from calib.se3 import BoolArray, FloatArray

BLURRED = 2.0
"""Mean square of what is left in a picture over the noise of all, from which on it has more."""


def squares_of_pictures(
    parts: Deviations, arm_sigma: tuple[float, float], used: BoolArray | None = None
) -> FloatArray:
    """Squares ``(N,)`` of the deviation of each picture over its noise: χ² of six.

    Parameters
    ----------
    used : array (N,) of bool, optional
        From which of them the parameters are. These are off less by what the parameters took of
        them, the others more by what the parameters leave unknown. Without, the parameters are
        the true ones.
    """
    # a blurred picture scatters more than the others, and places the board less surely
    scatter = parts.at_stops(parts.within) / np.maximum(parts.at_stops(parts.within_rows), 1.0)
    more = np.where(scatter > BLURRED, scatter, 1.0)[:, None, None]
    V = more * parts.covariance + np.diag(np.repeat(np.array(arm_sigma) ** 2, 3))
    L = np.linalg.cholesky(V)
    y = np.linalg.solve(L, parts.off[..., None])[..., 0]
    if used is None:
        return np.asarray(np.sum(y**2, axis=1))
    H = np.linalg.solve(L, parts.by_parameters)
    information = np.einsum("nip,niq->pq", H[used], H[used]) + parts.known_block
    information += parts.within_blocks[used[parts.stops]].sum(axis=0)
    unit = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    C = np.linalg.pinv(information / np.outer(unit, unit), rcond=1e-12, hermitian=True)
    shares, axes = np.linalg.eigh(H / unit @ C @ np.swapaxes(H / unit, 1, 2))
    variance = 1.0 + np.where(used, -1.0, 1.0)[:, None] * shares
    along = np.einsum("nik,ni->nk", axes, y) ** 2
    told = variance > _NOTHING_LEFT
    return np.asarray(np.sum(np.where(told, along / np.where(told, variance, 1.0), 0.0), axis=1))


_NOTHING_LEFT = 1e-3
"""Share of the noise left to a direction, below which the parameters took all that it says."""


def wrong_points(parts: Deviations, seen: BoolArray) -> BoolArray:
    """Points ``(N, K)`` that lie far beside where all others of their picture say that they are.

    A corner at the edge of something in front of the board, say. How far the others scatter is
    taken from their median, of all pictures or of that one if it scatters more.
    """
    far = np.linalg.norm(parts.left.reshape(*seen.shape, 2), axis=-1)
    own = np.where(seen, far, np.nan)
    # the median of the length of a vector of two normal numbers
    usual = np.nanmedian(own) / _MEDIAN_OF_TWO
    with np.errstate(all="ignore"):
        each = np.nanmedian(own, axis=1, keepdims=True) / _MEDIAN_OF_TWO
    return np.asarray(seen & (far > FAR_BESIDE * np.fmax(usual, each)))


FAR_BESIDE = 7.0
"""Standard deviations beyond which a point is in a wrong place: of a billion points noise takes
none as far."""

_MEDIAN_OF_TWO = float(np.sqrt(2.0 * np.log(2.0)))
