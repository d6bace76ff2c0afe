"""Weighted least squares for many trials at once: Gauss-Newton, damped where it has to be.

The steps are solved for from the normal equations, their columns scaled to unit length: units do
not matter, and what the squared condition number costs a step in digits, the next one makes up,
because residuals and gradient are exact. Trials go in batches that stay in the cache of a core, so
cost grows linearly with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray

ITERATIONS = 60
"""Steps after which a fit has failed; calibrations take three to six."""

STEP_TOLERANCE = 1e-7
"""Change of the predictions, in standard deviations of the noise or of the residuals where these
are larger, of the last step. No parameter then moves by more than this part of its own standard
deviation, whatever its unit; and since the last step is taken too, what is left is smaller still.
A step after which the next one would be below it, at the rate at which they shrink, is the last one
as well.
"""

_SMALL = 1e-2
"""Change of the predictions from which on a step tells how large the next one will be."""

_AT_ONCE = 3000
"""Measurements of all trials that are linearised at once."""

MISFIT_TOLERANCE, MISFIT = 1e-2, 10.0
"""The same where the residuals are so many times the noise: no model that is as wrong as that is
worth more digits, and its minimum is approached slowly."""

_WORSE, _FREE_STEPS, _STRICT = 10.0, 15, 1.0 + 1e-6
"""Growth of the sum of squares beyond which a step is taken back and damped. The first steps may
make it somewhat worse: the valleys of poor measuring sets are narrow and bent, and a step along
them climbs a side before the next one comes down."""

_FIRST_DAMPING, _LEAST_DAMPING = 1e-7, 1e-10
"""Added to the unit diagonal of the scaled normal matrix; below the least one, none is."""

_RIDGE = 1e-14
"""Always added: keeps a matrix that is singular in double precision solvable."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the iteration ended, for each of T trials."""

    x: FloatArray  # (T, p) [SI]
    cost: FloatArray
    """(T,): sum of the squared rows over their noise, of what is known besides included; before the
    last step, which changes no digit of it."""
    change: FloatArray
    """(T,): of the predictions in the last step, in standard deviations of noise or residuals."""
    converged: BoolArray  # (T,)
    iterations: int  # the most that a trial took


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of T trials: matrix (T, p, p), right side (T, p), sum of squares (T,)."""

    matrix: FloatArray
    right: FloatArray
    cost: FloatArray

    def chosen(self, new: BoolArray, other: _Normal) -> _Normal:
        """Those of ``other`` where ``new``, else these."""
        return _Normal(
            np.where(new[:, None, None], other.matrix, self.matrix),
            np.where(new[:, None], other.right, self.right),
            np.where(new, other.cost, self.cost),
        )


def minimise(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    *,
    weights: FloatArray | None = None,
    free: BoolArray | None = None,
    weighted: bool = True,
    iterations: int = ITERATIONS,
) -> Fit:
    """Least squares from parameters ``(T, p)`` for postures ``(T, N, n)``.

    Parameters
    ----------
    data : Measurements
        With a leading dimension of T trials.
    x : array (T, p)
    weights : array (T, N), optional
        Of the squares of each measurement, besides its noise.
    free : array (p,) of bool, optional
        Parameters to move; all by default.
    weighted : bool
        Divide the rows by the noise, or all by the same number.
    """
    trials = len(x)
    size = max(1, _AT_ONCE // max(data.count, 1))
    x, cost, change = x.copy(), np.full(trials, np.inf), np.full(trials, np.inf)
    converged = np.zeros(trials, dtype=bool)
    most = 0
    with np.errstate(all="ignore"):  # a trial that runs away is told by not converging
        for start in range(0, trials, size):
            part = slice(start, start + size)
            own = data.trials(part)
            w = None if weights is None else weights[part]
            fit = _minimise(model, own, x[part], w, free, weighted, iterations)
            x[part], cost[part] = fit.x, fit.cost
            change[part], converged[part] = fit.change, fit.converged
            most = max(most, fit.iterations)
    return Fit(x, cost, change, converged, most)


def _minimise(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray | None,
    free: BoolArray | None,
    weighted: bool,
    iterations: int,
) -> Fit:
    here = _normal(model, data, x, weights, weighted)
    equations = max(model.equations(data.setup), 1)
    damping = np.zeros(len(x))
    before = change = np.full(len(x), np.inf)
    done = np.zeros(len(x), dtype=bool)
    count = 0
    while count < iterations:
        count += 1
        step, change = _step(here, damping, free)
        misfit = np.sqrt(np.maximum(here.cost / equations, 1.0))
        change /= misfit
        done = change < np.where(misfit > MISFIT, MISFIT_TOLERANCE, STEP_TOLERANCE)
        # steps shrink at a rate that only gets better: what would follow this one is known
        following = change * np.minimum(change / before, 1.0)
        done |= (change < _SMALL) & (following < STEP_TOLERANCE)
        before = change
        if done.all() or not np.isfinite(change).any():
            x = x + step
            break
        there = _normal(model, data, x + step, weights, weighted)
        most = _WORSE if count <= _FREE_STEPS else _STRICT
        good = done | (there.cost <= most * here.cost + STEP_TOLERANCE)
        x = np.where(good[:, None], x + step, x)
        here = here.chosen(good, there)
        damping = np.where(good, damping / 10.0, np.maximum(10.0 * damping, _FIRST_DAMPING))
        damping[damping < _LEAST_DAMPING] = 0.0
    return Fit(x, here.cost, change, done, count)


def _step(
    normal: _Normal, damping: FloatArray, free: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Step ``(T, p)`` [SI], and by how much it moves the predictions ``(T,)``."""
    H, g = normal.matrix, normal.right
    if free is not None:
        H, g = H[:, free][:, :, free], g[:, free]
    length = np.sqrt(np.diagonal(H, axis1=1, axis2=2))
    scale = np.where(length > 0, length, 1.0)
    scaled = H / (scale[:, :, None] * scale[:, None, :])
    p = scaled.shape[1]
    scaled[:, np.arange(p), np.arange(p)] += (_RIDGE + damping)[:, None]
    right = g / scale
    try:
        found = np.linalg.solve(scaled, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one trial that has run away would stop them all
        found = np.full(right.shape, np.nan)
        for t in range(len(scaled)):
            if np.isfinite(scaled[t]).all() and np.linalg.matrix_rank(scaled[t]) == p:
                found[t] = np.linalg.solve(scaled[t], right[t])
    # |J step|² = stepᵀ H step; for an undamped step that is stepᵀ g, without the rounding of H
    change = np.sqrt(np.maximum(np.einsum("tp,tp->t", found, right), 0.0))
    step = -found / scale
    if free is not None:
        whole = np.zeros((len(step), len(free)))
        whole[:, free] = step
        step = whole
    return step, np.where(damping > 0, np.maximum(change, 1.0), change)


def _normal(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray | None,
    weighted: bool,
) -> _Normal:
    linear = model.linearise_at(data, x)
    rows, J = linear.over_noise_last(weighted)
    trials, count = len(x), data.count
    if weights is not None:
        root = np.sqrt(weights).ravel()
        rows, J = rows * root, J * root
    p, m, _ = J.shape
    A = J.reshape(p, m, trials, count).transpose(2, 0, 1, 3).reshape(trials, p, m * count)
    r = rows.reshape(m, trials, count).transpose(1, 0, 2).reshape(trials, m * count)
    matrix = A @ np.swapaxes(A, 1, 2)
    right = (A @ r[..., None])[..., 0]
    cost = np.einsum("tk,tk->t", r, r)
    known, K = model.known(x)
    if known.shape[1]:
        matrix += np.swapaxes(K, 1, 2) @ K
        right += np.einsum("tkp,tk->tp", K, known)
        cost += np.einsum("tk,tk->t", known, known)
    return _Normal(matrix, right, cost)


def column_lengths(columns: FloatArray) -> FloatArray:
    """Lengths ``(p,)`` of columns ``(M, p)``, 1 for columns of noughts."""
    length = np.linalg.norm(columns, axis=0)
    return np.where(length > 0, length, 1.0)


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span those ``(M, p)``, whatever their units."""
    return np.linalg.qr(columns / column_lengths(columns))[0]
