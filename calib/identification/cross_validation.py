"""Poses and targets left out: what is said of them by what was identified from the others."""

from __future__ import annotations

import numpy as np

from calib.identification.least_squares import column_lengths, minimise, orthonormal
from calib.identification.result import IdentificationResult
from calib.model import CalibrationModel, Linearisation
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray

FEWEST_TARGETS = 3
"""Targets from which one can be left out: the others still stand apart."""

_NOTHING_LEFT = 1e-9
"""Singular value of I - H of a pose left out, or share of the information on a place that is left
without it, below which nothing but the pose holds some parameter."""


def leave_one_out(linear: Linearisation, groups: IntArray, *, weighted: bool = True) -> FloatArray:
    """Rows ``(N, m)`` [m, rad] of each measurement, predicted from the fit to the other groups.

    In closed form from one fit: ``(I - H_gg)⁻¹ r_g`` with H the hat matrix and g all rows of one
    group. Exact where the model is linear, and calibrations are nearly so at their solution. A
    group without which the parameters cannot be identified gives NaN. Groups are told by the index
    ``(N,)`` of each measurement: those of one pose are left out together.
    """
    rows, J = linear.stacked(weighted=weighted)
    (count, m), p = linear.rows.shape, J.shape[1]
    rows = rows[: count * m].reshape(count, m)
    Q = (orthonormal(J) if p else J)[: count * m].reshape(count, m, p)
    out = np.full((count, m), np.nan)
    sizes = np.bincount(groups)
    for size in np.unique(sizes[sizes > 0]):  # groups of one size at a time
        members = np.argsort(groups, kind="stable")
        members = members[np.isin(groups[members], np.flatnonzero(sizes == size))].reshape(-1, size)
        own = Q[members].reshape(len(members), size * m, p)
        out[members] = _predicted(own, rows[members].reshape(len(members), -1, 1)).reshape(
            len(members), size, m
        )
    return linear.coloured(out, weighted=weighted)


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


def targets_left_out(
    model: CalibrationModel,
    data: Measurements,
    result: IdentificationResult,
    *,
    weighted: bool = True,
) -> FloatArray:
    """Rows ``(N, m)`` [m, rad] at each target, predicted by an arm identified from all others.

    The place of that target is not known to them. It is fitted to the measurements of it in other
    poses than the one predicted, so that a row has no say in its own prediction. NaN throughout
    where there are fewer than ``FEWEST_TARGETS`` free points, for a target whose absence leaves the
    arm unidentified, and for a pose without which the place of its target is not known: that of a
    target measured in one pose only.

    Parameters
    ----------
    result : IdentificationResult
        Of all of them: where the fits start, which measurements count and with what noise.
    """
    out = np.full((data.count, model.rows), np.nan)
    places = measured_points(model, data)
    if len(places) < FEWEST_TARGETS:
        return out
    noisy = with_noise_of(model, result)
    weights = np.stack([result.weights * (data.setup.target != k) for k in places])
    start = np.tile(result.values, (len(places), 1))
    others = minimise(noisy, data.repeated(len(places)), start, weights=weights, weighted=weighted)
    for row, (k, part) in enumerate(places.items()):
        if not others.converged[row]:
            continue
        place = np.zeros(model.p, dtype=bool)
        place[part] = True
        # whether measurements of the other targets hold all parameters but that target's place
        linear = noisy.linearise_at(data, others.x[row]).weighed(weights[row])
        held = linear.stacked()[1][:, ~place]
        if not held.any(axis=0).all():
            continue
        if np.linalg.matrix_rank(held / column_lengths(held), tol=1e-9) < held.shape[1]:
            continue
        own: IntArray = np.flatnonzero(data.setup.target == k)
        share = result.weights[own]
        out[own] = _placed_by_others(noisy, data, own, others.x[row], place, share, weighted)
    return out


def with_noise_of(model: CalibrationModel, result: IdentificationResult) -> CalibrationModel:
    """The model with the noise that a fit to the same kinds of measurement used."""
    return model.with_measurements(
        [
            kind.with_deviation(None)
            .with_noise(noise.sigma / kind.sigma)
            .with_deviation(noise.arm_sigma)
            for kind, noise in zip(model.measurements, result.noise, strict=True)
        ]
    )


def measured_points(model: CalibrationModel, data: Measurements) -> dict[int, slice]:
    """Columns of the places of targets measured that are free points, by index of the target."""
    measured = set(data.setup.target.tolist())
    points = {model.targets.index(label): part for label, part in model.free_points.items()}
    return {k: part for k, part in points.items() if k in measured}


def _placed_by_others(
    model: CalibrationModel,
    data: Measurements,
    own: IntArray,
    x: FloatArray,
    place: BoolArray,
    weights: FloatArray,
    weighted: bool,
) -> FloatArray:
    """Rows ``(k, m)`` of one target, whose place is fitted to those of its other poses each time.

    In closed form from one fit of the place to all of them, which is exact since it enters
    linearly: without the group g the place moves by ``(A - A_g)⁻¹ b_g`` with A = JᵀJ of all of
    them, and b = Jᵀr. The residual of a mean of n comes out n/(n-1) times as large.
    """
    some = data[own]
    placed = minimise(
        model, some.trials(None), x[None], weights=weights[None], free=place, weighted=weighted
    ).x[0]
    if not np.isfinite(placed).all():
        return np.full((len(own), model.rows), np.nan)
    linear = model.linearise_at(some, placed)
    rows, J = map(linear.view.posture_first, linear.over_noise_last(weighted))
    J = J[..., place]
    known = model.known(placed[None])[1][0][:, place]
    group = np.unique(data.groups[own], return_inverse=True)[1]
    information = np.zeros((group.max() + 1, 3, 3))
    gradient = np.zeros((group.max() + 1, 3))
    np.add.at(information, group, np.einsum("k,kmi,kmj->kij", weights, J, J))
    np.add.at(gradient, group, np.einsum("k,kmi,km->ki", weights, J, rows))
    whole = information.sum(axis=0) + known.T @ known
    left = whole - information
    held = np.linalg.eigvalsh(left)[:, 0] > _NOTHING_LEFT * np.linalg.eigvalsh(whole)[-1]
    left[~held] = np.eye(3)
    step = np.linalg.solve(left, gradient[..., None])[..., 0]
    step[~held] = np.nan
    predicted = rows + np.einsum("kmi,ki->km", J, step[group])
    return linear.coloured(predicted, weighted=weighted)
