"""Components of variance: the noise of a kind of measurement, and the deviation of the arm.

Rows that are measured at one stop of the arm scatter about the best shift and turn of the tip: that
is the noise of their kinds. From stop to stop these shifts and turns differ from what arm and
set-up say: by that noise, and by the deviation of the arm. The deviation is found by restricted
maximum likelihood (Patterson and Thompson, Biometrika 58, 1971): without the restriction the
parameters would take their share of it.

Where the rows of some stop do not tell a turn of the tip from a shift, as those of one point, the
deviation is a shift alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.chance import f_tail
from calib.errors import ConvergenceError
from calib.identification.robust import LEAST_NOISE
from calib.model import CalibrationModel, Linearisation
from calib.model.deviation import summed
from calib.se3 import BoolArray, FloatArray, IntArray

LEAST_ARM = (1e-7, 1e-7)
"""Deviation of an arm below which it counts as none [m, rad]."""

_TOLD = 1e-6
"""The same above which turns are looked for besides shifts."""

_MOST_ARM = (0.05, 0.05)

_FLATTEST = 1e-12
"""Least effect of a direction of the deviation on the rows of a stop, over the largest, squared:
with less, nothing of it is left by rounding. Boards in pictures are above 1e-7."""


@dataclass(frozen=True, eq=False)
class Deviations:
    """Rows of N measurements at M stops, apart: explained by a deviation of the stop, and the rest.

    A stop has one measurement or several: pictures of two cameras, reflectors of a tool. The
    deviation has k = 6 components, or 3 where only shifts can be told.
    """

    stops: IntArray  # (N,): stop of each measurement
    off: FloatArray
    """(M, k): shift [m] and turn [rad] of the tip for the best fit of the rows of each stop, base
    axes."""
    by_parameters: FloatArray  # (M, k, p): the same by the parameters
    covariance: FloatArray  # (M, k, k): of ``off``, by the noise of the model alone
    left: FloatArray  # (N, m): rows over their noise without the deviation of their stop
    left_jacobian: FloatArray  # (N, m, p): derivative of ``left``
    free: FloatArray  # (N, m): redundancy that the deviation leaves to each row
    known_block: FloatArray  # (p, p)
    known_right: FloatArray
    """(p,): known_block, known_right: ``KᵀK`` and ``Kᵀk`` of what is known besides."""

    def at_stops(self, of_each: FloatArray) -> FloatArray:
        """Return sums ``(M, ...)`` over the measurements of each stop, of ``(N, ...)``."""
        return summed(of_each, self.stops)

    @cached_property
    def within(self) -> FloatArray:
        """Sums of the squares ``(N,)`` that are left in each measurement, over the noise."""
        return np.asarray(np.sum(self.left**2, axis=1))

    @cached_property
    def within_rows(self) -> FloatArray:
        """Redundancy ``(N,)`` that the deviation leaves to each measurement."""
        return np.asarray(self.free.sum(axis=1))

    @cached_property
    def within_blocks(self) -> FloatArray:
        """Information ``(N, p, p)`` of the rows without the deviation: of a lens above all."""
        return np.asarray(np.swapaxes(self.left_jacobian, 1, 2) @ self.left_jacobian)

    @cached_property
    def within_right(self) -> FloatArray:
        """Right sides ``(N, p)`` that belong to ``within_blocks``."""
        return np.asarray(np.einsum("nmp,nm->np", self.left_jacobian, self.left))

    @property
    def scatter(self) -> FloatArray:
        """Mean square ``(N,)`` of what is left in each measurement over the noise."""
        return np.asarray(self.within / np.maximum(self.within_rows, 1.0))

    def of_noise(self, scale: FloatArray) -> Deviations:
        """Return the same for measurements of a noise ``(N,)`` times that of the model.

        Approximately where the factors differ within a stop.
        """
        squares = scale**2
        mean = self.at_stops(squares) / np.maximum(self.at_stops(np.ones(len(squares))), 1.0)
        return replace(
            self,
            covariance=self.covariance * mean[:, None, None],
            left=self.left / scale[:, None],
            left_jacobian=self.left_jacobian / scale[:, None, None],
        )


def deviations(linear: Linearisation, *, turns: bool | None = None) -> Deviations:
    """Return the deviations of one set, linearised at its parameters.

    Parameters
    ----------
    turns : bool, optional
        Look for turns besides shifts; by default where every stop tells them.

    Raises
    ------
    ConvergenceError
        At these parameters no deviation can be told from the rows of a stop.
    """
    model, setup = linear.model, linear.view.setup
    bare = linear.by(model.with_deviation(None))
    rows, J = bare.white_rows, bare.white_jacobian
    D = model.by_deviation(bare.view).transpose(2, 0, 1)
    if bare.root is not None:
        D = D * bare.root[:, None, None]
    stops = setup.stops
    if turns is None:
        turns = _are_told(D, stops)
    D = D if turns else D[..., :3]
    scale = np.linalg.norm(D, axis=(0, 1))
    D = D / np.where(scale > 0, scale, 1.0)
    squares = summed(np.swapaxes(D, 1, 2) @ D, stops)
    inner = summed(np.einsum("nmt,nm->nt", D, rows), stops)
    inner_J = summed(np.swapaxes(D, 1, 2) @ J, stops)
    size = np.linalg.eigvalsh(squares)
    if not (size[:, 0] > _FLATTEST * size[:, -1]).all():
        raise ConvergenceError(
            "the estimate has not converged: what was measured at a stop does not tell where the "
            "arm stood",
            hint="are all lengths in the units that are said?",
        )
    inverse = np.linalg.inv(squares)
    off = -(inverse @ inner[..., None])[..., 0]
    by_parameters = -inverse @ inner_J
    seen = setup.seen
    if seen is None:
        seen = np.arange(model.rows) < model.rows_read(setup)[:, None]
    known, K = (part[0] for part in model.known(linear.values[:, :1].T))
    return Deviations(
        stops=stops,
        off=off / scale,
        by_parameters=by_parameters / scale[:, None],
        covariance=inverse / np.outer(scale, scale),
        left=rows + np.einsum("nmt,nt->nm", D, off[stops]),
        left_jacobian=J + D @ by_parameters[stops],
        free=seen - np.einsum("nmt,nmt->nm", D, D @ inverse[stops]),
        known_block=K.T @ K,
        known_right=K.T @ known,
    )


def _are_told(D: FloatArray, stops: IntArray) -> bool:
    """Return True if the rows of every stop tell six directions of a deviation apart."""
    length = np.linalg.norm(D, axis=(0, 1))
    D = D / np.where(length > 0, length, 1.0)
    size = np.linalg.eigvalsh(summed(np.swapaxes(D, 1, 2) @ D, stops))
    return bool((size[:, 0] > _TOLD * size[:, -1]).all())


def noise_within(parts: Deviations, some: BoolArray | None = None) -> tuple[float, float]:
    """Return the noise over that of the model, and the freedom that tells it.

    By the rows without the deviations of their stops, the parameters fitted to them: squares of
    what is left over their share of the freedom (Förstner, Ein Verfahren zur Schätzung von
    Varianz- und Kovarianzkomponenten, Allgemeine Vermessungs-Nachrichten 86, 1979).

    Parameters
    ----------
    some : array (N,) or (N, m) of bool, optional
        Measurements of one noise, the pictures of a camera, or rows of them; all by default.
    """
    weight = np.ones_like(parts.left)
    if some is not None:
        weight = weight * (some if some.ndim == 2 else some[:, None])
    H, g = parts.within_blocks.sum(axis=0), parts.within_right.sum(axis=0)
    scale = np.sqrt(np.diag(H))
    used = scale > 1e-9 * scale.max(initial=1e-300)
    squares, freedom = float(np.sum(weight * parts.left**2)), float(np.sum(weight * parts.free))
    if used.any():
        J = parts.left_jacobian[..., used] / scale[used]
        unit = np.outer(scale[used], scale[used])
        inverse = np.linalg.pinv(H[np.ix_(used, used)] / unit, rcond=1e-9, hermitian=True)
        step = -inverse @ (g[used] / scale[used])
        own = np.einsum("nmp,nm,nmq->pq", J, weight, J, optimize=True)
        right = np.einsum("nmp,nm,nm->p", J, weight, parts.left, optimize=True)
        squares += float(step @ (2.0 * right + own @ step))
        freedom -= float(np.sum(inverse * own))
    return float(np.sqrt(max(squares, 0.0) / max(freedom, 1.0))), freedom


def restricted(
    parts: Deviations,
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the restricted likelihood of logarithms ``(L, 2)`` of the deviations [m, rad].

    Minus twice its logarithm ``(L,)``, the slope of that ``(L, 2)`` and its curvature
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
    N, k, p = H.shape
    rows = H.reshape(-1, p)
    part = np.repeat(np.eye(2), 3, axis=0)[:k]  # (k, 2): components of shift and of turn

    def unlikely(log_sigma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        variance = np.exp(2.0 * log_sigma)
        V = parts.covariance + (variance @ part.T)[:, None, None, :] * np.eye(k)
        inverse = np.linalg.inv(V)  # (L, N, k, k)
        white, columns = inverse @ y[..., None], (inverse @ H).reshape(-1, k * N, p)
        A = rows.T @ columns + within
        b = white.reshape(-1, k * N) @ rows + right
        values, vectors = np.linalg.eigh(A)
        kept = values > 1e-12 * values[:, -1:]
        values = np.where(kept, values, 1.0)
        root = np.where(kept[:, None], vectors / np.sqrt(values)[:, None], 0.0)
        along = np.swapaxes(root, 1, 2) @ b[..., None]
        log_det = np.linalg.slogdet(V)[1].sum(axis=1) + np.log(values).sum(axis=1)
        columns = columns @ root
        off = white.reshape(-1, k * N, 1) - columns @ along
        own = np.diagonal(inverse, axis1=2, axis2=3).reshape(-1, k * N)
        own = own - (columns**2).sum(axis=2) - off[..., 0] ** 2
        slope = 2.0 * variance * (own.reshape(-1, N, k).sum(axis=1) @ part)
        # what a change of each of the two variances does to the rows
        moved = 2.0 * variance[:, None] * np.tile(part, (N, 1)) * off
        taken = np.swapaxes(columns, 1, 2) @ moved
        whole = (inverse @ moved.reshape(-1, N, k, 2)).reshape(moved.shape)
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
    """Return the standard deviations of where the tip stops: along each axis [m], about each [rad].

    Zero where the noise of the kinds explains all of it. By Newton's steps from several starts at
    once.

    Parameters
    ----------
    now : tuple of float, optional
        The deviation at hand; that near it is kept where no other is likelier.
    """
    y, unlikely = parts.off, restricted(parts)
    turned = y[:, 3:].std() / 2 if y.shape[1] > 3 else 0.0
    scatter = y[:, :3].std() / 2, turned
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


def chance_of(parts: Deviations) -> float:
    """Return the probability of stops that differ as much by the noise within them alone.

    By the F test of the squares between the stops, the parameters fitted, over those within them:
    exact for one noise, known or not.
    """
    L = np.linalg.cholesky(parts.covariance)
    y = np.linalg.solve(L, parts.off[..., None]).ravel()
    H = np.linalg.solve(L, parts.by_parameters)
    p = H.shape[-1]
    A = np.einsum("mkp,mkq->pq", H, H, optimize=True) + parts.known_block
    A = A + parts.within_blocks.sum(axis=0)
    b = H.reshape(-1, p).T @ y + parts.known_right + parts.within_right.sum(axis=0)
    unit = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(A / np.outer(unit, unit))
    told = values > 1e-12 * values[-1]
    along = vectors[:, told].T @ (b / unit) / np.sqrt(values[told])
    known = np.linalg.matrix_rank(parts.known_block)
    inside, freedom = noise_within(parts)
    between = float(y @ y + np.sum(parts.left**2) - along @ along) - inside**2 * freedom
    more = float(y.size + parts.free.sum() + known - told.sum()) - freedom
    if more < 1.0 or freedom < 1.0 or not inside > 0.0:
        return 1.0
    return float(f_tail(between / more / inside**2, more, freedom))


SURELY = 1e-3
"""Probability that measurements of an arm that stops where it says show a deviation."""

FEWEST_WITHIN = 10.0
"""Redundancy within the stops from which the noise of a kind is told apart from the deviation."""


def components(linear: Linearisation, shares: FloatArray) -> CalibrationModel | None:
    """Return the model with the noise and the deviation of the arm that the measurements show.

    None where stops show no deviation, or where hardly any stop has several measurements.

    Parameters
    ----------
    linear : Linearisation
        Of one set at a fit, its set-up with the stop of each measurement.
    shares : array (N,)
        Weights of the squares of the measurements in the fit.
    """
    model, setup = linear.model, linear.view.setup
    try:
        parts = deviations(linear.weighed(shares))
    except ConvergenceError:
        return None
    kinds, scale = [], np.ones(setup.count)
    told = False
    for k, kind in enumerate(model.measurements):
        own, factor = setup.kind == k, np.ones(kind.rows)
        for part in (slice(0, kind.rows - kind.turns), slice(kind.rows - kind.turns, kind.rows)):
            some = np.zeros(parts.left.shape, dtype=bool)
            some[own, part] = True
            within, freedom = noise_within(parts, some)
            if freedom >= FEWEST_WITHIN and within > 0.0:
                factor[part], told = np.maximum(within, LEAST_NOISE / kind.sigma[part]), True
        scale[own] = np.sqrt(np.mean(factor**2))
        kinds.append(kind.with_deviation(None).with_noise(factor).of_unknown_noise())
    if not told:
        return None
    parts = parts.of_noise(scale)
    if chance_of(parts) > SURELY:
        return None
    sigma = arm_deviation(parts, model.arm_sigma)
    return model.with_measurements(kinds).with_deviation(sigma)
