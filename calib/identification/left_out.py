"""Targets left out: what an arm identified from the others says of them."""

from __future__ import annotations

import numpy as np

from calib.identification.least_squares import column_lengths, minimise
from calib.identification.result import IdentificationResult
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.model.parameters import Frames
from calib.se3 import BoolArray, FloatArray, IntArray

FEWEST_TARGETS = 3
"""Targets from which one can be left out: the others still stand apart."""

_NOTHING_LEFT = 1e-9
"""Share of the information on a place that is left without a pose, below which nothing is left."""


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
    places = free_points(model, data)
    if len(places) < FEWEST_TARGETS:
        return out
    noisy = with_noise_of(model, result)
    weights = np.stack([result.weights * (data.setup.target != k) for k in places])
    start = np.tile(result.values, (len(places), 1))
    others = minimise(noisy, data.repeated(len(places)), start, weights=weights, weighted=weighted)
    for row, (k, columns) in enumerate(places.items()):
        own: IntArray = np.flatnonzero(data.setup.target == k)
        x, root = others.x[row], np.sqrt(result.weights[own])
        if others.converged[row] and _is_held(noisy, data, x, weights[row], columns):
            out[own] = _placed_by_others(noisy, data, own, x, columns, root, weighted)
    return out


def with_noise_of(model: CalibrationModel, result: IdentificationResult) -> CalibrationModel:
    """The model with the noise that a fit to the same kinds of measurement used."""
    return model.with_measurements(
        [
            kind.with_noise(noise.sigma / kind.sigma)
            for kind, noise in zip(model.measurements, result.noise, strict=True)
        ]
    )


def free_points(model: CalibrationModel, data: Measurements) -> dict[int, BoolArray]:
    """For each target measured that is a free point, which parameters ``(p,)`` are its place."""
    found = {}
    for block, part in zip(model.parameters, model.slices, strict=True):
        if not isinstance(block, Frames) or not block.targets or set(block.units) != {"m"}:
            continue
        each = block.size // len(block.labels)
        for k, label in enumerate(block.labels):
            columns = np.zeros(model.p, dtype=bool)
            columns[part.start + k * each : part.start + (k + 1) * each] = True
            index = model.targets.index(label)
            if each == 3 and (data.setup.target == index).any():
                found[index] = columns
    return found


def _is_held(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray,
    place: BoolArray,
) -> bool:
    """Whether measurements of the other targets hold all parameters but that target's place."""
    linear = model.linearise(data.postures, x, data.setup, data.observed)
    held = linear.weighed(weights).stacked(x)[1][:, ~place]
    if not held.any(axis=0).all():
        return False
    rank = np.linalg.matrix_rank(held / column_lengths(held), tol=1e-9)
    return bool(rank == held.shape[1])


def _placed_by_others(
    model: CalibrationModel,
    data: Measurements,
    own: IntArray,
    x: FloatArray,
    place: BoolArray,
    root: FloatArray,
    weighted: bool,
) -> FloatArray:
    """Rows ``(k, m)`` of one target, whose place is fitted to those of its other poses each time.

    In closed form from one fit of the place to all of them, which is exact since it enters
    linearly: without the group g the place moves by ``(A - A_g)⁻¹ b_g`` with A = JᵀJ of all of
    them, and b = Jᵀr. The residual of a mean of n comes out n/(n-1) times as large.
    """
    some = data[own]
    weights = root[None] ** 2
    placed = minimise(
        model, some.trials(None), x[None], weights=weights, free=place, weighted=weighted
    ).x[0]
    if not np.isfinite(placed).all():
        return np.full((len(own), model.rows), np.nan)
    linear = model.linearise(some.postures, placed, some.setup, some.observed)
    rows, J = map(linear.view.posture_first, linear.over_noise_last(weighted))
    J = J[..., place]
    known = model.known(placed[None])[1][0][:, place]
    group = np.unique(data.groups[own], return_inverse=True)[1]
    information = np.zeros((group.max() + 1, 3, 3))
    gradient = np.zeros((group.max() + 1, 3))
    np.add.at(information, group, np.einsum("k,kmi,kmj->kij", weights[0], J, J))
    np.add.at(gradient, group, np.einsum("k,kmi,km->ki", weights[0], J, rows))
    whole = information.sum(axis=0) + known.T @ known
    left = whole - information
    held = np.linalg.eigvalsh(left)[:, 0] > _NOTHING_LEFT * np.linalg.eigvalsh(whole)[-1]
    left[~held] = np.eye(3)
    step = np.linalg.solve(left, gradient[..., None])[..., 0]
    step[~held] = np.nan
    predicted = rows + np.einsum("kmi,ki->km", J, step[group])
    return linear.coloured(predicted, weighted=weighted)
