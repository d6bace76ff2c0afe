"""The way of the noise through a method to X and Z, by the derivatives of the method itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.robot_world.noise import Noise, difference, perturb
from calib.robot_world.pairs import PairSets, own_order
from calib.robot_world.results import Estimate
from calib.se3 import FloatArray

Estimator = Callable[[PairSets], Estimate]

_STEP = 1e-5
"""Step of the central differences [rad, parts of the translations]: its square, the share that the
next order takes, and the rounding of a solution divided by it are both far below a thousandth."""

_EACH_ERROR, _DIRECTIONS = 100, 600
"""Pairs up to which the derivatives by each error are taken, and directions in their place."""

_MOST_PAIRS = 500
"""Pairs that the method is differentiated at: of more, so many of all kinds stand for them."""

_PAIRS_AT_ONCE = 20_000
"""Pairs that one call of the method sees: bounds the memory to some 100 MB."""


def propagate(
    estimate: Estimator, A: FloatArray, B: FloatArray, noise: Noise, excess: float = 1.0
) -> FloatArray:
    """Mean square error of X and Z: the scatter that noise makes, and the bias.

    Parameters
    ----------
    estimate : callable
        The method, for sets of pairs.
    A, B : ndarray (N, 4, 4)
        Measured transforms.
    noise : PairNoise or PairCovariances
        Their noise.
    excess : float
        How many times larger than this the errors are.

    Returns
    -------
    ndarray (12, 12) or (13, 13)
        In the order and frames of :class:`~calib.robot_world.results.RobotWorldResult`; last the
        scale of B's translations, where the method estimates it.

    Notes
    -----
    The derivatives of (X, Z) by the errors of the pairs are central differences of the method. Of
    up to 100 pairs by each of their six errors a side; of more, whose number of problems would grow
    with the square of N, by 600 random directions of all errors at once, always the same ones: the
    standard deviations then have an error of 3 % of their own. Of more than 500 pairs 500 are
    taken, every so many in the order of their rotations, and the scatter is as much smaller as
    there are more: the time does not grow with N then, and the error of the standard deviations
    is some 5 %.

    Half the second derivatives, summed over the errors, are the bias to second order. Methods that
    solve linear equations with noise in their coefficients have one that does not shrink with the
    number of pairs: where a target stays in one place of the view, that of Andreff's method is
    several standard deviations.
    """
    whole = len(A)
    roots = noise.roots(A, B)
    if whole > _MOST_PAIRS:
        some = own_order(A)[np.linspace(0, whole - 1, _MOST_PAIRS).astype(np.intp)]
        A, B = A[some], B[some]
        every = [r if r is None or len(r) == 1 else r[some] for r in roots]
        roots = every[0], every[1]
    N = len(A)
    sides = [root is not None for root in roots]
    size = 6 * N * sum(sides)
    order = own_order(A)
    if N > _EACH_ERROR:
        drawn = np.random.default_rng(0).standard_normal((_DIRECTIONS, sum(sides), N, 6))
        directions = np.empty_like(drawn)
        directions[:, :, order] = drawn / np.sqrt(_DIRECTIONS)
    else:
        directions = np.eye(size).reshape(size, sum(sides), N, 6)
    errors = iter(np.moveaxis(directions, 1, 0))
    both = [None if root is None else _turned(root, next(errors)) for root in roots]
    J, bias = _derivatives(estimate, A, B, both[0], both[1])
    J, bias = excess * J, excess**2 * bias
    return np.asarray(J @ J.T * (N / whole) + np.outer(bias, bias))


def _turned(root: FloatArray, white: FloatArray) -> FloatArray:
    """Errors ``(K, N, 6)`` of one side by directions of white numbers ``(K, N, 6)``."""
    return np.asarray((root @ white[..., None])[..., 0])


def _derivatives(
    estimate: Estimator,
    A: FloatArray,
    B: FloatArray,
    errors_A: FloatArray | None,
    errors_B: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Derivatives ``(12, K)`` of the errors of X and Z along directions ``(K, N, 6)`` of errors.

    And half the sum ``(12,)`` of the second ones; 13 with the scale. Steps are as long as their
    largest component allows.
    """
    given = [errors for errors in (errors_A, errors_B) if errors is not None]
    count, N = given[0].shape[:2]
    unit = np.repeat([1.0, float(PairSets(A[None], B[None]).size[0])], 3)
    largest = np.max([np.abs(errors / unit).max(axis=(1, 2)) for errors in given], axis=0)
    # a side without errors, or a part of one, has steps of no length, whatever they are divided by
    scale = _STEP / np.where(largest > 0.0, largest, _STEP)
    at_once = max(1, _PAIRS_AT_ONCE // (2 * N))
    found, curved = [], []
    for first in range(0, count, at_once):
        rows = slice(first, first + at_once)
        size = scale[rows, None, None]
        ends = estimate(PairSets(_ends(A, errors_A, rows, size), _ends(B, errors_B, rows, size)))
        length = scale[rows, None]
        moved = np.concatenate([difference(T, T[-1]) for T in (ends.X, ends.Z)], axis=-1)
        if ends.scale is not None:
            moved = np.column_stack([moved, ends.scale - ends.scale[-1]])
        there, back, _ = np.split(moved, [len(length), 2 * len(length)])
        found.append((there - back) / (2.0 * length))
        curved.append((there + back) / (2.0 * length**2))
    return np.concatenate(found).T, np.concatenate(curved).sum(axis=0)


def _ends(T: FloatArray, errors: FloatArray | None, rows: slice, size: FloatArray) -> FloatArray:
    """Transforms ``(2K + 1, N, 4, 4)`` moved by some errors, there and back, and where they are."""
    if errors is None:
        return np.broadcast_to(T, (2 * len(size) + 1, *T.shape))
    step = size * errors[rows]
    return perturb(T, np.concatenate([step, -step, np.zeros_like(step[:1])]))
