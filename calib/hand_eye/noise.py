"""How far pixels scatter, and how far the arm stops from where it says: from the pictures.

Within a picture points scatter about the best pose of the board: that is the noise of the pixels.
From picture to picture these poses are off what arm, camera and board say: by the pixels' noise,
and by the arm. The deviation of the arm is found by restricted maximum likelihood (Patterson and
Thompson, Biometrika 58, 1971): without the restriction the parameters would take their share of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.errors import ConvergenceError
from calib.model import CalibrationModel
from calib.model.measurements import BoardView, Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

LEAST_ARM = (1e-7, 1e-7)
"""Deviation of an arm below which it counts as none [m, rad]."""

BLURRED = 2.0
"""Mean square of what is left in a picture over the noise of all, from which on it has more."""

_MOST_ARM = (0.05, 0.05)

_FLATTEST = 1e-12
"""Least of what the six of a deviation do to a picture, over the most, squared: with less, nothing
of it is left by rounding. Boards in pictures are above 1e-7."""


@dataclass(frozen=True, eq=False)
class Deviations:
    """Each of M stops of the arm taken apart: what its own deviation explains, and what is left.

    A stop has one of the N pictures, or several by several cameras.
    """

    stops: IntArray  # (N,): stop of each picture
    off: FloatArray
    """(M, 6): by how much the tip would have to be shifted [m] and turned [rad] for the best fit of
    the pictures of each stop, base axes."""
    by_parameters: FloatArray  # (M, 6, p): the same by the parameters
    covariance: FloatArray
    """(M, 6, 6): of ``off``, by pixels alone, for pixels of the noise of the model."""
    within: FloatArray  # (N,): squares of what is left in each picture over the pixels' noise
    within_rows: FloatArray  # (N,): its rows less its share of the six that the deviation takes
    within_blocks: FloatArray  # (N, p, p)
    within_right: FloatArray
    """(N, p): what the inside of the pictures says of the parameters, of the lens above all:
    ``JᵀJ`` and ``Jᵀr``."""
    known_block: FloatArray  # (p, p)
    known_right: FloatArray  # (p,): the same of what is known besides
    left: FloatArray  # (N, m): what is left in the rows of each picture over the pixels' noise

    def at_stops(self, of_pictures: FloatArray) -> FloatArray:
        """Sums ``(M, ...)`` over the pictures of each stop, of ``(N, ...)``."""
        return _summed(of_pictures, self.stops)

    @property
    def scatter(self) -> FloatArray:
        """Mean square ``(N,)`` of what is left in each picture over the pixels' noise."""
        return np.asarray(self.within / np.maximum(self.within_rows, 1.0))


def _summed(of_pictures: FloatArray, stops: IntArray) -> FloatArray:
    out = np.zeros((int(stops.max(initial=-1)) + 1, *of_pictures.shape[1:]))
    np.add.at(out, stops, of_pictures)
    return out


def deviations(model: CalibrationModel, data: Measurements, x: FloatArray) -> Deviations:
    """Deviations at parameters ``(p,)``, of views of boards by a model of one kind.

    Raises
    ------
    ConvergenceError
        At these parameters no deviation can be told from the pictures: a fit has run away.
    """
    kind = model.measurement
    if not isinstance(kind, BoardView):
        raise TypeError("deviations are those of views of boards")
    linear = model.linearise(data.postures, x, data.setup, data.observed)
    sigma = kind.sigma_of(linear.view).T
    rows, J = linear.rows / sigma, linear.jacobian / sigma[..., None]
    D = kind.by_deviation(linear.view).transpose(2, 0, 1) / sigma[..., None]
    scale = np.linalg.norm(D, axis=(0, 1))
    D = D / np.where(scale > 0, scale, 1.0)
    stops = data.setup.stops
    squares = _summed(np.swapaxes(D, 1, 2) @ D, stops)
    inner = _summed(np.einsum("nmt,nm->nt", D, rows), stops)
    inner_J = _summed(np.swapaxes(D, 1, 2) @ J, stops)
    size = np.linalg.eigvalsh(squares)
    if not (size[:, 0] > _FLATTEST * size[:, -1]).all():
        raise ConvergenceError(
            "the estimate has not converged: it shows a board that has no place of its own",
            hint="are lengths of the arm and the board in the units that are said?",
        )
    inverse = np.linalg.inv(squares)
    off = -(inverse @ inner[..., None])[..., 0]
    by_parameters = -inverse @ inner_J
    # what is left of the rows once the deviations have taken their part
    left = rows + np.einsum("nmt,nt->nm", D, off[stops])
    left_J = J + D @ by_parameters[stops]
    known, K = (part[0] for part in model.known(x[None]))
    shares = np.einsum("nmt,nmt->n", D, D @ inverse[stops])
    return Deviations(
        stops=stops,
        off=off / scale,
        by_parameters=by_parameters / scale[:, None],
        covariance=inverse / np.outer(scale, scale),
        within=np.sum(left**2, axis=1),
        within_rows=model.rows_read(data.setup) - shares,
        within_blocks=np.swapaxes(left_J, 1, 2) @ left_J,
        within_right=np.einsum("nmp,nm->np", left_J, left),
        known_block=K.T @ K,
        known_right=K.T @ known,
        left=left,
    )


def pixel_scale(parts: Deviations, some: BoolArray | slice = slice(None)) -> float:
    """Noise of the pixels over that of the model: what is left within pictures, lens fitted.

    Of several cameras each has its own: squares of what is left in its pictures over their share
    of the freedom (Förstner, Ein Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten,
    Allgemeine Vermessungs-Nachrichten 86, 1979).

    Parameters
    ----------
    some : array (N,) of bool, optional
        Pictures of the camera that is asked for; all by default.
    """
    H, g = parts.within_blocks.sum(axis=0), parts.within_right.sum(axis=0)
    scale = np.sqrt(np.diag(H))
    used = scale > 1e-9 * scale.max(initial=1e-300)
    squares, freedom = float(parts.within[some].sum()), float(parts.within_rows[some].sum())
    if used.any():
        unit = np.outer(scale[used], scale[used])
        inverse = np.linalg.pinv(H[np.ix_(used, used)] / unit, rcond=1e-9, hermitian=True)
        own = parts.within_blocks[some].sum(axis=0)[np.ix_(used, used)] / unit
        step = -inverse @ (g[used] / scale[used])
        right = parts.within_right[some].sum(axis=0)[used] / scale[used]
        squares += float(step @ (2.0 * right + own @ step))
        freedom -= float(np.sum(inverse * own))
    return float(np.sqrt(max(squares, 0.0) / max(freedom, 1.0)))


def restricted(parts: Deviations) -> Callable[[FloatArray], tuple[float, FloatArray]]:
    """Restricted likelihood of the logarithms ``(2,)`` of the arm's deviations [m, rad].

    Of its logarithm minus the double, and the slope ``(2,)`` of that (Harville, J. Am. Stat. Assoc.
    72, 1977): ``log |V| + log |A| + yᵀV⁻¹y - bᵀA⁻¹b``, with ``A`` and ``b`` of the normal equations
    of the parameters.
    """
    y, H = parts.off, parts.by_parameters
    within = parts.within_blocks.sum(axis=0) + parts.known_block
    unit = np.sqrt(np.maximum(np.einsum("nip,nip->p", H, H), np.diag(within) * 1e-12))
    unit = np.where(unit > 0, unit, 1.0)
    H, within = H / unit, within / np.outer(unit, unit)
    right = (parts.within_right.sum(axis=0) + parts.known_right) / unit
    rows, axes = H.reshape(y.size, -1), np.diag_indices(6)

    def unlikely(log_sigma: FloatArray) -> tuple[float, FloatArray]:
        V = parts.covariance.copy()
        variance = np.exp(2.0 * log_sigma)
        V[:, axes[0], axes[1]] += np.repeat(variance, 3)
        inverse = np.linalg.inv(V)
        white, columns = (inverse @ y[..., None])[..., 0], inverse @ H
        A = rows.T @ columns.reshape(rows.shape) + within
        b = rows.T @ white.ravel() + right
        values, vectors = np.linalg.eigh(A)
        kept = values > 1e-12 * values[-1]
        root = vectors[:, kept] / np.sqrt(values[kept])
        along = b @ root
        log_det = np.linalg.slogdet(V)[1].sum() + np.log(values[kept]).sum()
        off = white - columns @ (root @ along)
        own = inverse[:, axes[0], axes[1]] - ((columns @ root) ** 2).sum(axis=2) - off**2
        slope = 2.0 * variance * own.sum(axis=0).reshape(2, 3).sum(axis=1)
        return float(log_det + np.sum(white * y) - along @ along), slope

    return unlikely


AS_LIKELY = 0.2
"""Twice the logarithm of a likelihood by which another deviation has to be likelier than the one
at hand: of two that are as likely, each would follow from the fit with the other, without end."""


def arm_deviation(parts: Deviations, now: tuple[float, float] | None = None) -> tuple[float, float]:
    """Standard deviations of where the tip stops: along each axis [m], about each axis [rad].

    Zero where the pixels' noise explains all of it.

    Parameters
    ----------
    now : tuple of float, optional
        The deviation at hand; that near it is kept where no other is likelier.
    """
    from scipy.optimize import minimize

    y, unlikely = parts.off, restricted(parts)
    low, high = np.log(LEAST_ARM), np.log(_MOST_ARM)
    start = np.log(np.clip([y[:, :3].std() / 2, y[:, 3:].std() / 2], LEAST_ARM, _MOST_ARM))
    starts = [start, np.array([start[0], low[1]]), np.array([low[0], start[1]])]
    if now is not None:
        starts.insert(0, np.log(np.clip(now, LEAST_ARM, _MOST_ARM)))
    ends = [
        minimize(unlikely, at, jac=True, bounds=list(zip(low, high, strict=True))) for at in starts
    ]
    best = min(ends, key=lambda found: float(found.fun))
    if now is not None and ends[0].fun <= best.fun + AS_LIKELY:
        best = ends[0]
    sigma = np.exp(best.x)
    m, rad = (
        0.0 if value < 2.0 * least else float(value)
        for value, least in zip(sigma, LEAST_ARM, strict=True)
    )
    return m, rad


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
