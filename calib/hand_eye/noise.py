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
from calib.model import CalibrationModel, Linearisation
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


def deviations(
    model: CalibrationModel, data: Measurements, x: FloatArray, linear: Linearisation | None = None
) -> Deviations:
    """Deviations at parameters ``(p,)``, of views of boards by a model of one kind, as linearised.

    Raises
    ------
    ConvergenceError
        At these parameters no deviation can be told from the pictures: a fit has run away.
    """
    kind = model.measurement
    if not isinstance(kind, BoardView):
        raise TypeError("deviations are those of views of boards")
    linear = model.linearise_at(data, x) if linear is None else linear
    sigma = kind.sigma_of(linear.view).T
    rows, J = linear.rows / sigma, linear.jacobian / sigma[..., None]
    D = model.by_deviation(linear.view).transpose(2, 0, 1)
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


def restricted(
    parts: Deviations,
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """Restricted likelihood of logarithms ``(L, 2)`` of the arm's deviations [m, rad].

    Of its logarithm minus the double ``(L,)``, the slope of that ``(L, 2)`` and its curvature
    ``(L, 2, 2)``: ``log |V| + log |A| + yᵀV⁻¹y - bᵀA⁻¹b``, with ``A`` and ``b`` of the normal
    equations of the parameters (Harville, J. Am. Stat. Assoc. 72, 1977). The curvature is the
    mean of what is expected and what is observed (Gilmour, Thompson and Cullis, Biometrics 51,
    1995).
    """
    y, H = parts.off, parts.by_parameters
    within = parts.within_blocks.sum(axis=0) + parts.known_block
    unit = np.sqrt(np.maximum(np.einsum("nip,nip->p", H, H), np.diag(within) * 1e-12))
    unit = np.where(unit > 0, unit, 1.0)
    H, within = H / unit, within / np.outer(unit, unit)
    right = (parts.within_right.sum(axis=0) + parts.known_right) / unit
    N, _, p = H.shape
    rows = H.reshape(-1, p)
    part = np.repeat(np.eye(2), 3, axis=0)  # (6, 2): which of the six are of which deviation

    def unlikely(log_sigma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        variance = np.exp(2.0 * log_sigma)
        V = parts.covariance + (variance @ part.T)[:, None, None, :] * np.eye(6)
        inverse = np.linalg.inv(V)  # (L, N, 6, 6)
        white, columns = inverse @ y[..., None], (inverse @ H).reshape(-1, 6 * N, p)
        A = rows.T @ columns + within
        b = white.reshape(-1, 6 * N) @ rows + right
        values, vectors = np.linalg.eigh(A)
        kept = values > 1e-12 * values[:, -1:]
        values = np.where(kept, values, 1.0)
        root = np.where(kept[:, None], vectors / np.sqrt(values)[:, None], 0.0)
        along = np.swapaxes(root, 1, 2) @ b[..., None]
        log_det = np.linalg.slogdet(V)[1].sum(axis=1) + np.log(values).sum(axis=1)
        columns = columns @ root
        off = white.reshape(-1, 6 * N, 1) - columns @ along
        own = np.diagonal(inverse, axis1=2, axis2=3).reshape(-1, 6 * N)
        own = own - (columns**2).sum(axis=2) - off[..., 0] ** 2
        slope = 2.0 * variance * (own.reshape(-1, N, 6).sum(axis=1) @ part)
        # what a change of each of the two variances does to the rows
        moved = 2.0 * variance[:, None] * np.tile(part, (N, 1)) * off
        taken = np.swapaxes(columns, 1, 2) @ moved
        whole = (inverse @ moved.reshape(-1, N, 6, 2)).reshape(moved.shape)
        curvature = np.swapaxes(moved, 1, 2) @ whole - np.swapaxes(taken, 1, 2) @ taken
        value = log_det + (white[..., 0] * y).sum(axis=(1, 2)) - (along**2).sum(axis=(1, 2))
        return value, slope, curvature

    return unlikely


AS_LIKELY = 0.2
"""Twice the logarithm of a likelihood by which another deviation has to be likelier than the one
at hand: of two that are as likely, each would follow from the fit with the other, without end."""

_MOST_STEPS, _LONGEST, _ARRIVED = 60, 3.0, 1e-6
"""Steps to the likeliest deviation; their longest, and the one that counts as none (logarithms)."""


def arm_deviation(parts: Deviations, now: tuple[float, float] | None = None) -> tuple[float, float]:
    """Standard deviations of where the tip stops: along each axis [m], about each axis [rad].

    Zero where the pixels' noise explains all of it. By Newton's steps from several starts at once.

    Parameters
    ----------
    now : tuple of float, optional
        The deviation at hand; that near it is kept where no other is likelier.
    """
    y, unlikely = parts.off, restricted(parts)
    scatter = y[:, :3].std() / 2, y[:, 3:].std() / 2
    starts = [scatter, (scatter[0], LEAST_ARM[1]), (LEAST_ARM[0], scatter[1])]
    if now is not None:
        starts.insert(0, now)
    low, high = np.log(LEAST_ARM), np.log(_MOST_ARM)
    x = np.clip(np.log(np.maximum(starts, LEAST_ARM)), low, high)
    damping = np.zeros(len(x))
    value, slope, curvature = unlikely(x)
    for _ in range(_MOST_STEPS):
        # at a bound only the way back is free
        free = ~(((x <= low) & (slope >= 0.0)) | ((x >= high) & (slope <= 0.0)))
        own = np.einsum("lii->li", curvature)
        matrix = curvature * free[:, :, None] * free[:, None]
        more = damping[:, None] * own + np.finfo(float).tiny
        matrix[:, [0, 1], [0, 1]] = np.where(free, own + more, 1.0)
        step = -np.linalg.solve(matrix, np.where(free, slope, 0.0)[..., None])[..., 0]
        new = np.clip(x + np.clip(step, -_LONGEST, _LONGEST), low, high)
        if (np.abs(new - x) < _ARRIVED).all():
            break
        there = unlikely(new)
        good = there[0] <= value + 1e-12 * np.abs(value)
        x = np.where(good[:, None], new, x)
        value, slope = np.where(good, there[0], value), np.where(good[:, None], there[1], slope)
        curvature = np.where(good[:, None, None], there[2], curvature)
        damping = np.where(good, damping / 10.0, np.maximum(10.0 * damping, 0.1))
    best = int(np.argmin(value))
    if now is not None and value[0] <= value[best] + AS_LIKELY:
        best = 0
    sigma = np.exp(x[best])
    m, rad = np.where(sigma < 2.0 * np.array(LEAST_ARM), 0.0, sigma).tolist()
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
