"""How certain an identification is: before measuring from the plan, and after it from the data."""

from __future__ import annotations

import numpy as np

from calib.errors import InputError
from calib.identification.identifiability import is_identifiable
from calib.identification.least_squares import equal_sigma, white_rows
from calib.model import CalibrationModel, Linearisation, Setup
from calib.se3 import FloatArray, IntArray

_NOTHING_LEFT = 1e-9
"""Smallest singular value of I - H of a pose left out, below which nothing but it holds some
parameter."""


def covariance_of(
    model: CalibrationModel,
    q: FloatArray,
    x: FloatArray | None = None,
    setup: Setup | None = None,
    *,
    weighted: bool = True,
) -> FloatArray:
    """Covariance ``(p, p)`` [SI] that the noise of the measurement gives, before measuring.

    Weighted: ``(JᵀJ)⁻¹`` of the whitened Jacobian with what is known besides: the Cramér-Rao
    bound. Unweighted: the scatter of the paper's estimate (Eq. 8), ``G⁺ Σ G⁺ᵀ``, under the same
    noise. Infinite throughout where the postures do not identify all parameters.

    Raises
    ------
    InputError
        Priors or known distances in an unweighted estimate: there is nothing to weigh them by.
    """
    values = model.nominal if x is None else x
    linear = model.linearise(q, values, setup)
    return covariance_at(linear, values, weighted=weighted)


def covariance_at(
    linear: Linearisation,
    x: FloatArray,
    *,
    weighted: bool = True,
    noise: FloatArray | None = None,
) -> FloatArray:
    """The same from a linearisation that is there already, of one set at parameters ``(p,)``.

    Parameters
    ----------
    linear : Linearisation
    x : array (p,)
    weighted : bool
    noise : array (K,), optional
        What the noise of each kind really is, over the one that the estimate is weighed by.
    """
    model = linear.model
    white = triangle(information_root(linear, x))
    if not is_identifiable(white):
        return np.full((model.p, model.p), np.inf)
    each = np.ones(linear.view.setup.count)
    if noise is not None:
        each = noise[linear.view.setup.kind]
    if weighted:
        root = np.linalg.inv(white)
        best = root @ root.T
        if noise is None:
            return np.asarray(best)
        known = model.known(np.atleast_2d(x))[1][0]
        rows = (linear.white_jacobian * each[:, None, None]).reshape(linear.rows_last.size, model.p)
        spread = best @ np.concatenate([rows, known]).T
        return np.asarray(spread @ spread.T)
    check_unweighted(model)
    J = linear.jacobian
    gain = np.linalg.pinv(J.reshape(linear.rows_last.size, model.p)).reshape(model.p, *J.shape[:2])
    root = linear.noise_root * each[:, None, None]
    spread = np.einsum("pim,imk->pik", gain, root).reshape(model.p, gain.shape[1] * gain.shape[2])
    return np.asarray(spread @ spread.T)


def check_unweighted(model: CalibrationModel) -> None:
    """Refuse what an estimate that takes all rows alike cannot use.

    Raises
    ------
    InputError
    """
    if model.knows_besides:
        raise InputError(
            "priors and known distances need rows that are weighted by their noise",
            hint="weight them, or leave these out",
            name="weighted",
        )


def information_root(linear: Linearisation, x: FloatArray) -> FloatArray:
    """Rows ``(M, p)`` over their noise of all that is known: its square is the information."""
    measured = linear.white_jacobian.reshape(linear.rows_last.size, linear.model.p)
    _, known = linear.model.known(np.atleast_2d(x))
    return np.concatenate([measured, known[0]])


def triangle(rows: FloatArray) -> FloatArray:
    """Rows ``(p, p)`` that say the same as ``(M, p)``: fewer where there are more than columns."""
    return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows


def leave_one_out(
    linear: Linearisation, x: FloatArray, groups: IntArray, *, weighted: bool = True
) -> FloatArray:
    """Rows ``(N, m)`` [m, rad] of each measurement, predicted from the fit to the other groups.

    In closed form from one fit: ``(I - H_gg)⁻¹ r_g`` with H the hat matrix and g all rows of one
    group. Exact where the model is linear, and calibrations are nearly so at their solution. A
    group without which the parameters cannot be identified gives NaN.

    Parameters
    ----------
    linear : Linearisation
        Of one set, at its solution.
    x : array (p,)
        The solution.
    groups : array (N,)
        Index of the group that each measurement belongs to: those of one pose are left out
        together.
    weighted : bool
        As in the fit.
    """
    rows_last, J_last = white_rows(linear, weighted)
    rows, J = linear.view.posture_first(rows_last), linear.view.posture_first(J_last)
    count, m, p = J.shape
    known = linear.model.known(np.atleast_2d(x))[1][0] if weighted else np.zeros((0, p))
    stacked = np.concatenate([J.reshape(count * m, p), known])
    Q = np.linalg.qr(stacked / column_lengths(stacked))[0] if p else stacked
    Q = Q[: count * m].reshape(count, m, p)
    out = np.full((count, m), np.nan)
    sizes = np.bincount(groups)
    for size in np.unique(sizes[sizes > 0]):  # groups of one size at a time
        members = np.argsort(groups, kind="stable")
        members = members[np.isin(groups[members], np.flatnonzero(sizes == size))].reshape(-1, size)
        own = Q[members].reshape(len(members), size * m, p)
        out[members] = _predicted(own, rows[members].reshape(len(members), -1, 1)).reshape(
            len(members), size, m
        )
    if weighted:
        return np.asarray((linear.noise_root @ out[..., None])[..., 0])
    return out * equal_sigma(linear.model)


def _predicted(own: FloatArray, rows: FloatArray) -> FloatArray:
    """``(I - Q Qᵀ)⁻¹ r`` of groups ``(G, k, p)`` with rows ``(G, k, 1)``; NaN where singular.

    Of groups with more rows than parameters as ``r + Q (I - Qᵀ Q)⁻¹ Qᵀ r``, whose matrix does not
    grow with the group: a pose that is measured thousands of times is one.
    """
    many = own.shape[1] > own.shape[2]
    turned = np.swapaxes(own, 1, 2)
    left = np.eye(min(own.shape[1:])) - (turned @ own if many else own @ turned)
    alone = np.linalg.svd(left, compute_uv=False).min(axis=-1, initial=1.0) < _NOTHING_LEFT
    left[alone] = np.eye(left.shape[-1])
    found = (
        rows + own @ np.linalg.solve(left, turned @ rows) if many else np.linalg.solve(left, rows)
    )
    found[alone] = np.nan
    return np.asarray(found)


def column_lengths(columns: FloatArray) -> FloatArray:
    """Lengths ``(p,)`` of columns ``(M, p)``, 1 for columns of noughts."""
    length = np.linalg.norm(columns, axis=0)
    return np.where(length > 0, length, 1.0)
