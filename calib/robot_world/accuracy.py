"""How certain a solution of A X = Z B is, and whether the noise given explains its residuals.

Errors that follow each other along a sequence of poses, and what they do to the deviations.

Poses are measured one after the other, along a path, and what is off at one of them is off in much
the same way at the next: a lens, a print, an arm, a filter. Standard deviations that count every
pair as a witness of its own are then too small, on real pairs by a factor of two to five. Where
residuals of neighbours are more alike than chance makes them, X and Z are compared without runs of
consecutive pairs (the jackknife over blocks: Künsch, Ann. Statist. 17, 1989), which counts whatever
makes the pairs of a run alike, noise that is not the same everywhere and errors of the model
included. The larger of this and of the covariance by the noise is what is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calib.batch_last import columns_of, turn
from calib.chance import chi2_tail, normal_quantile
from calib.robot_world.adjustment import adjust
from calib.robot_world.algebra import inverse_information, unit_diagonal
from calib.robot_world.errors_of_pairs import ErrorModel, derivatives
from calib.robot_world.estimate import Estimate, Fit, residuals
from calib.robot_world.identifiability import examine
from calib.robot_world.methods import Method
from calib.robot_world.noise import (
    LEAST_NOISE,
    Noise,
    PairCovariances,
    PairNoise,
    difference,
    perturb,
)
from calib.robot_world.pairs import PairSets, own_order
from calib.robot_world.poses import Poses
from calib.se3 import BoolArray, FloatArray

NOISE_DOUBT = 1e-4
"""Probability of residuals as large as those found below which the noise does not explain them."""

_RANK_TOLERANCE = 1e-12
"""Eigenvalue of the information, scaled to a unit diagonal, that counts as none."""


def least_chi2(pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise) -> float | None:
    """Sum of the squares of the residuals of one set in units of the noise given.

    At its likeliest X and Z, whatever method has found others: what a method leaves more than
    these says nothing of the noise. None where the noise has no likelihood, a part of it being 0.
    """
    if isinstance(noise, PairNoise) and not noise.is_positive:
        return None
    fit = found.fit
    if fit is None:
        X, Z = pairs.rotations_first
        fit = adjust(pairs, noise.model(pairs), X, Z, weights=used[None].astype(float))
    return float(fit.cost[0])


def judged(chi2: FloatArray, freedom: FloatArray | int) -> tuple[FloatArray, FloatArray]:
    """Probabilities of values of χ² as large ``(T,)``, and how many times the noise they are.

    1 where chance may have made them as large.
    """
    probability = chi2_tail(chi2, freedom)
    return probability, np.where(probability > NOISE_DOUBT, 1.0, np.sqrt(chi2 / freedom))


def noise_shown(found: Estimate, residual: FloatArray, used: BoolArray) -> PairNoise:
    """Noise of B as the residuals ``(N, 6)`` of one solution show it, or as the method found it.

    Rotations and translations have six unknowns each.
    """
    if found.sigma is not None:
        turn_rad, shift_m = found.sigma[:, 0].tolist()
    else:
        square = (residual[used] ** 2).sum(axis=0).reshape(2, 3).sum(axis=-1)
        turn_rad, shift_m = np.sqrt(square / (3 * int(used.sum()) - 6)).tolist()
    return PairNoise(max(turn_rad, LEAST_NOISE), max(shift_m, LEAST_NOISE), "B")


def covariance_of(
    chosen: Method,
    pairs: PairSets,
    found: Estimate,
    used: BoolArray,
    excess: float,
    noise: Noise,
    likeliest: Likeliest,
    *,
    given: bool,
) -> FloatArray:
    """Covariance ``(12, 12)`` of one solution, the residuals being ``excess`` times the noise.

    By the noise, given or not, by the deviations that pairs of one pose share, and by runs of pairs
    whose errors follow each other: see :func:`widening`. The last two widen what any method says by
    as much as maximum likelihood.
    """
    fit = likeliest.fit
    poses = {} if likeliest.poses is None else {0: likeliest.poses}
    if found.fit is not None:
        more = np.array([excess])
        factor = widening(fit, used[None], more, noise_known=given, poses=poses)[0]
        return np.asarray(fit.covariance[0] * excess**2 * np.outer(factor, factor))
    factor = widening(fit, used[None], poses=poses)[0]
    C = propagate(chosen.estimate, pairs.A[0, used], pairs.B[0, used], noise, excess)
    return C * np.outer(factor, factor)


_OF_WEIGHTS = 2.0
"""Degrees of freedom that it costs to weigh rotations and translations by sizes that are estimated
from the same residuals: by simulation of 4 to 12 pairs."""


@dataclass(frozen=True, eq=False)
class Likeliest:
    """The likeliest X and Z of one set, by which the answers of all methods are judged."""

    fit: Fit  # of all pairs, those that do not count with the weight 0
    errors: ErrorModel
    poses: Poses | None

    def freedom(self, used: BoolArray) -> FloatArray:
        """Degrees of freedom ``(12,)`` of the standard deviations by the noise that is estimated.

        A variance of X or Z is made of that of rotation and that of translation, each with degrees
        of freedom of its own (Satterthwaite, Biometrics Bull. 2, 1946). Where pairs of one pose
        share a deviation, there are as many independent ones as poses.
        """
        count = int(used.sum()) if self.poses is None else len(self.poses.counts)
        C = self.fit.covariance[0]
        J = self.fit.jacobian[:, :, 0].reshape(12, 2, -1).swapaxes(0, 1)
        parts = C @ (J @ np.swapaxes(J, 1, 2)) @ C
        taken = np.einsum("kia,kia->k", C @ J, J)
        free = np.maximum(3.0 * count - taken - _OF_WEIGHTS, 1.0)
        own = np.diagonal(parts, axis1=1, axis2=2)
        return np.asarray(own.sum(axis=0) ** 2 / (own**2 / free[:, None]).sum(axis=0))


def rank_of(pairs: PairSets, X: FloatArray, Z: FloatArray, used: BoolArray) -> int:
    """Directions of X and Z, of 12, that the pairs of one set see."""
    R_Z = pairs.spread(columns_of(Z[:, :3, :3]))
    J = derivatives(pairs.R_A, turn(R_Z, pairs.p_B))[..., used]
    J[:, 3:] /= pairs.size[0]
    scaled, _ = unit_diagonal(J.reshape(12, -1) @ J.reshape(12, -1).T)
    return int((np.linalg.eigvalsh(scaled) > _RANK_TOLERANCE).sum())


Estimator = Callable[[PairSets], Estimate]

_STEP = 1e-5
"""Step of the central differences [rad, parts of the translations]: its square, the share that the
next order takes, and the rounding of a solution divided by it are both far below a thousandth."""

_EACH_ERROR = 100
"""Pairs up to which the derivatives by each error are taken."""

_MOST_PAIRS = 500
"""Pairs that the method is differentiated at: of more, so many of all kinds stand for them."""

_FIRST_DRAWN, _SAMPLED = 40, 0.03
"""Directions that are drawn at first, and the error of the standard deviations up to which no more
are."""

_SAME = 1e-9
"""Singular value of what pairs have in them, over the largest, that counts as none."""

_PAIRS_AT_ONCE = 20_000
"""Pairs that one call of the method sees: bounds the memory to some 100 MB."""


def propagate(
    estimate: Estimator, A: FloatArray, B: FloatArray, noise: Noise, excess: float = 1.0
) -> FloatArray:
    """Mean square error of X and Z: the scatter that noise makes, and the bias.

    ``(12, 12)`` in the order and frames of :class:`~calib.robot_world.results.RobotWorldResult`;
    last, ``(13, 13)``, the scale of B's translations, where the method estimates it. The errors are
    ``excess`` times as large as the noise.

    The derivatives of (X, Z) by the errors of the pairs are central differences of the method. Of
    up to 100 pairs by each of their six errors a side; of more, whose number of problems would grow
    with the square of N, by directions of all errors at once. An error of a pair moves the answer
    by as much as the pair's own rotation and place tell, most of it linear in these: such
    directions are few, and taken as they are. What is not in them is drawn at random, always the
    same, and as often as its share needs for an error of the standard deviations of 3 % at most.
    Of more than 500 pairs 500 are taken, every so many in the order of their rotations, and the
    scatter is as much smaller as there are more: the time does not grow with N then, and the error
    of the standard deviations is some 5 %.

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
    sides = sum(root is not None for root in roots)

    def along(white: FloatArray, *, back: bool = True) -> tuple[FloatArray, FloatArray]:
        errors = iter(np.moveaxis(white.reshape(len(white), sides, N, 6), 1, 0))
        both = [None if root is None else _turned(root, next(errors)) for root in roots]
        return _derivatives(estimate, A, B, both[0], both[1], back=back)

    if N > _EACH_ERROR:
        scatter, bias = _of_many(along, A, B, sides)
    else:
        J, curved = along(np.eye(6 * N * sides))
        scatter, bias = J @ J.T, curved.sum(axis=1)
    bias = excess**2 * bias
    return np.asarray(excess**2 * scatter * (N / whole) + np.outer(bias, bias))


def _of_many(
    along: Callable[..., tuple[FloatArray, FloatArray]], A: FloatArray, B: FloatArray, sides: int
) -> tuple[FloatArray, FloatArray]:
    """Scatter ``(12, 12)`` and bias ``(12,)`` by few directions of all errors of N pairs.

    ``along`` gives the derivatives ``(12, K)`` along directions ``(K, sides N 6)``, and half the
    second ones unless it is not to go back.
    """
    N = len(A)
    p_B = B[:, :3, 3] / PairSets(A[None], B[None]).size[0]
    told = np.column_stack([np.ones(N), A[:, :3, :3].reshape(N, 9), p_B])
    U, values, _ = np.linalg.svd(told, full_matrices=False)
    U = U[:, values > _SAME * values[0]]
    taken = np.kron(np.eye(sides), np.kron(U.T, np.eye(6)))
    J, _ = along(taken, back=False)
    scatter = J @ J.T
    rng, order = np.random.default_rng(0), own_order(A)
    rest, curved = np.empty((2, len(J), 0))
    count = _FIRST_DRAWN
    while count > 0:
        drawn = np.empty((count, sides, N, 6))
        drawn[:, :, order] = rng.standard_normal(drawn.shape)
        white = drawn.reshape(count, -1)
        slope, bent = along(white)
        rest = np.hstack([rest, slope - J @ (taken @ white.T)])
        curved = np.hstack([curved, bent])
        square = (rest**2).mean(axis=1)
        share = square / np.maximum(square + np.diag(scatter), np.finfo(float).tiny)
        # the mean of K squares is off by sqrt(2 / K), a standard deviation by half of that
        count = int(np.ceil(share.max() ** 2 / (2.0 * _SAMPLED**2))) - rest.shape[1]
    return scatter + rest @ rest.T / rest.shape[1], curved.mean(axis=1)


def _turned(root: FloatArray, white: FloatArray) -> FloatArray:
    """Errors ``(K, N, 6)`` of one side by directions of white numbers ``(K, N, 6)``."""
    if len(root) == 1:
        return np.asarray(white @ root[0].T)
    return np.asarray((root @ white[..., None])[..., 0])


def _derivatives(
    estimate: Estimator,
    A: FloatArray,
    B: FloatArray,
    errors_A: FloatArray | None,
    errors_B: FloatArray | None,
    *,
    back: bool,
) -> tuple[FloatArray, FloatArray]:
    """Derivatives ``(12, K)`` of the errors of X and Z along directions ``(K, N, 6)`` of errors.

    And half the second ones ``(12, K)``, which take a step back, too: without, they are 0. 13 with
    the scale. Steps are as long as their largest component allows.
    """
    given = [errors for errors in (errors_A, errors_B) if errors is not None]
    count, N = given[0].shape[:2]
    unit = np.repeat([1.0, float(PairSets(A[None], B[None]).size[0])], 3)
    largest = np.max([np.abs(errors / unit).max(axis=(1, 2)) for errors in given], axis=0)
    # a side without errors, or a part of one, has steps of no length, whatever they are divided by
    scale = _STEP / np.where(largest > 0.0, largest, _STEP)
    ways = (1.0, -1.0) if back else (1.0,)
    at_once = max(1, _PAIRS_AT_ONCE // (len(ways) * N))
    found, curved = [], []
    for first in range(0, count, at_once):
        rows = slice(first, first + at_once)
        size = scale[rows, None, None] * np.reshape(ways, (-1, 1, 1, 1))
        ends = estimate(PairSets(_ends(A, errors_A, rows, size), _ends(B, errors_B, rows, size)))
        length = scale[rows, None]
        moved = np.concatenate([difference(T, T[-1]) for T in (ends.X, ends.Z)], axis=-1)
        if ends.scale is not None:
            moved = np.column_stack([moved, ends.scale - ends.scale[-1]])
        there = moved[: len(length)]
        other = moved[len(length) : -1] if back else -there
        found.append((there - other) / (2.0 * length))
        curved.append((there + other) / (2.0 * length**2))
    return np.concatenate(found).T, np.concatenate(curved).T


def _ends(T: FloatArray, errors: FloatArray | None, rows: slice, size: FloatArray) -> FloatArray:
    """Transforms ``(K + 1, N, 4, 4)`` moved by some errors times sizes, and where they are."""
    if errors is None:
        return np.broadcast_to(T, (size[..., 0, 0].size + 1, *T.shape))
    step = (size * errors[rows]).reshape(-1, *errors.shape[1:])
    return perturb(T, np.concatenate([step, np.zeros_like(step[:1])]))


FEWEST_PAIRS = 12
"""Pairs from which on runs of them are compared: five runs of more than two."""

CHANCE = 0.01
"""Probability that independent errors are taken for ones that follow each other. Where they are
not, nothing is changed: the runs of a set are few, and the larger of two numbers, one of them that
uncertain, would be too large by a tenth and more."""

_RUNS = (5, 8, 12, 20)
"""Numbers of runs; the one that shows most counts. Runs have to be longer than errors stay alike,
and to be many for what they show to be certain: how long that is, nobody knows beforehand."""

_LEAST_LEFT = 0.1
"""Least part of the information, in any direction, that counts as left without a run: what stays of
a direction that only one run shows is no measure of how far X and Z may be off."""

_ROUNDING = 1e-6
"""Mean square of white rows that are rounding of data without noise."""

_FEWEST_WITNESSES = 4.0
"""Independent pairs that a set is worth at least: of three the noise could not be told."""


def _correlation(white: FloatArray, J: FloatArray, covariance: FloatArray) -> float | None:
    """Correlation of a pair's white rows with those of the next; None where chance may make it.

    Made up for what the fit makes of independent errors. Pairs that are not used stand between no
    neighbours: rows ``(n, 6)`` and derivatives ``(n, 6, 12)`` are those of the others.
    """
    count = len(white)
    variance = float((white**2).sum()) / max(6.0 * count - 12.0, 1.0)
    if count < FEWEST_PAIRS or variance < _ROUNDING:
        return None
    # residuals are what the errors leave: C = s² (1 - H), so that neighbours have -H in common
    taken = float(np.einsum("iak,kl,ial->", J[:-1], covariance, J[1:]))
    alike = float((white[:-1] * white[1:]).sum()) / variance + taken
    products = 6.0 * (count - 1)
    if not alike / np.sqrt(products) > -normal_quantile(CHANCE):
        return None
    return float(np.clip(alike / products, -1.0, 1.0))


def widening(
    fit: Fit,
    used: BoolArray,
    excess: FloatArray | None = None,
    *,
    noise_known: bool = False,
    poses: Mapping[int, Poses] | None = None,
) -> FloatArray:
    """Factors ``(T, 12)`` of the standard deviations of X and Z by errors that are alike.

    By the deviation that pairs of one pose share, and by errors that follow each other. Where the
    deviations leave nothing that follows, runs are not compared: a run of one pose is no witness.

    The same for the three numbers of the rotation, and of the translation, of X and of Z: a
    covariance with rows and columns times these stays one. 1 where residuals do not show any.

    Parameters
    ----------
    used : ndarray of bool (T, N)
        Pairs that count, in the order in which they were measured.
    excess : ndarray (T,), optional
        By how much these standard deviations are scaled up already.
    noise_known : bool
        Whether they are by a noise that was given, not by that of the residuals.
    poses : mapping of int to Poses, optional
        Of the trials in which pairs of one pose share a deviation.
    """
    factors = np.ones((len(fit.X), 12))
    for trial, own in enumerate(used):
        more = 1.0 if excess is None else float(excess[trial])
        rows = *fit.rows(trial, own), fit.covariance[trial]
        shared = None if poses is None else poses.get(trial)
        if shared is not None:
            factors[trial] = np.maximum(_by_poses(fit, trial, shared) / more, 1.0)
            if _correlation(*_decorrelated(fit, trial, own, shared)) is None:
                continue
        correlation = _correlation(*rows)
        if correlation is None:
            continue
        of_runs = np.maximum(_of_runs(*rows) / more, 1.0)
        if more > 1.0 or not noise_known:
            of_runs *= _fewer(correlation, int(own.sum()))
        factors[trial] = np.maximum(factors[trial], of_runs)
    return factors


def _by_poses(fit: Fit, trial: int, poses: Poses) -> FloatArray:
    """Factors ``(12,)`` of standard deviations by what pairs of one pose have in common.

    The same for the three numbers of a rotation or translation.
    """
    C = fit.covariance[trial]
    wider = C @ poses.information(fit.jacobian[:, :, trial]) @ C
    ratio = np.diag(wider) / np.diag(C)
    return np.asarray(np.sqrt(np.repeat(ratio.reshape(4, 3).mean(axis=1), 3)))


def _decorrelated(
    fit: Fit, trial: int, used: BoolArray, poses: Poses
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """White rows ``(n, 6)``, derivatives ``(n, 6, 12)`` and covariance, deviations known.

    At the likeliest X and Z by these.
    """
    unit = np.repeat(poses.own, 3)[:, None]
    white = (poses.decorrelated(fit.white[:, trial]) / unit)[:, used]
    J = (poses.decorrelated(fit.jacobian[:, :, trial]) / unit)[..., used]
    C = inverse_information(np.tensordot(J, J, axes=((1, 2), (1, 2)))[None])[0]
    step = C @ np.tensordot(J, white, axes=2)
    return (white - np.tensordot(step, J, axes=1)).T, J.transpose(2, 1, 0), C


def _of_runs(white: FloatArray, J: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviations ``(12,)`` by the jackknife over runs, over those by the noise."""
    root = _root(covariance)
    # in units in which the information on X and Z is the identity
    scores = np.einsum("lc,ial,ia->ic", root, J, white)
    J = J @ root
    most = np.zeros(12)
    diagonal = (root**2).sum(axis=1)
    for runs in _RUNS:
        if 2 * runs > len(white):
            break
        square = np.zeros(12)
        for part in np.array_split(np.arange(len(white)), runs):
            rows = J[part].reshape(-1, 12)
            values, vectors = np.linalg.eigh(np.eye(12) - rows.T @ rows)
            inverse = vectors / np.maximum(values, _LEAST_LEFT) @ vectors.T
            square += (root @ (inverse @ scores[part].sum(axis=0))) ** 2
        ratio = square * (runs - 1) / runs / np.where(diagonal > 0.0, diagonal, 1.0)
        most = np.maximum(most, np.repeat(ratio.reshape(4, 3).mean(axis=1), 3))
    return np.asarray(np.sqrt(most))


def _fewer(correlation: float, count: int) -> float:
    """Factor for the noise itself, which fewer independent pairs show as too small.

    X and Z take up twelve of the numbers of as many pairs as the set is worth.
    """
    worth = max(count * (1.0 - correlation) / (1.0 + correlation), _FEWEST_WITNESSES)
    return float(np.sqrt((6.0 * count - 12.0) / (6.0 * count) * 6.0 * worth / (6.0 * worth - 12.0)))


def _root(covariance: FloatArray) -> FloatArray:
    """A matrix ``(12, 12)`` whose square is the covariance, also where that is singular."""
    scaled, size = unit_diagonal(covariance)
    values, vectors = np.linalg.eigh(scaled)
    return np.asarray(size[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None)))


_FEWEST = 4
"""With one of three left out, two are left, which identify nothing."""

_FEW = 5
"""Pairs up to which one of them bears so much that a single step without it falls short."""

_GROUPS, _FEWEST_GROUPS, _PAIRS_IN_ALL = 100, 10, 200_000
"""Of more pairs than these, so many groups are left out one after the other, and fewer where all of
them together would have too many pairs: the time is linear in N. Without a tenth of many pairs X
and Z are as good as without one."""

_LEFT_OUT_AT_ONCE = 20_000

_ALL_OF_IT = 1e-9
"""Least part of the information, in any direction, that must be left without a pair."""


def left_out_residuals(
    chosen: Method,
    pairs: PairSets,
    found: Estimate,
    used: BoolArray,
    noise: Noise | None,
    poses: Poses | None = None,
) -> FloatArray:
    """Residuals ``(N, 6)`` of one set, pair by pair, with X and Z from the others.

    NaN where the others do not identify X and Z. A pair that was left out already has its own.
    Pairs that share a deviation of their pose are left out together. Without a likelihood, of more
    than a hundred pairs a hundred groups are left out one by one, and of thousands fewer, ten at
    least.
    """
    residual: FloatArray = residuals(pairs.A, pairs.B, found.X, found.Z)[0]
    if int(used.sum()) < _FEWEST:
        residual[used] = np.nan
        return residual
    each = isinstance(noise, PairCovariances)
    if found.fit is not None and (each or int(used.sum()) > _FEW):
        X, Z = _by_one_step(found.fit, None if poses is None else poses.member)
        error = residuals(pairs.A[0][:, None], pairs.B[0][:, None], X, Z)[:, 0]
        error[np.isnan(error).any(axis=-1)] = np.nan
        residual[used] = error[used]
    else:
        residual[used] = _by_solving(chosen, pairs.A[0, used], pairs.B[0, used], noise)
    return residual


def _by_one_step(fit: Fit, member: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(N, 4, 4)`` without each pair of the first set, or without the pairs of its pose.

    At the least sum of squares the gradient of all rows is zero, so that without a pair it is the
    opposite of that pair's own. One step from there is enough: the next one is smaller by the size
    of the residual rotations in radians.
    """
    white, J = fit.rows(0, np.ones(fit.white.shape[-1], dtype=bool))
    scaled, size = unit_diagonal(fit.information[0])
    J = J / size
    own = np.swapaxes(J, -1, -2) @ J
    gradient = np.swapaxes(J, -1, -2) @ white[..., None]
    if member is not None:
        together = member.T @ member
        own, gradient = (np.tensordot(together, part, axes=1) for part in (own, gradient))
    values, vectors = np.linalg.eigh(scaled - own)
    seen = values[:, 0] > _ALL_OF_IT
    inverse = 1.0 / np.where(values > _ALL_OF_IT, values, 1.0)
    step = (vectors @ (inverse[..., None] * (np.swapaxes(vectors, -1, -2) @ gradient)))[..., 0]
    step = np.where(seen[:, None], step / size, np.nan)
    step[~seen, :3] = step[~seen, 6:9] = 0.0  # rotations stay rotations
    return perturb(fit.X[0], step[:, :6]), perturb(fit.Z[0], step[:, 6:])


def _by_solving(chosen: Method, A: FloatArray, B: FloatArray, noise: Noise | None) -> FloatArray:
    """Residuals ``(N, 6)`` by solving without each pair, or of many without each group."""
    N = len(A)
    order = own_order(A)
    out = np.full((N, 6), np.nan)
    count = min(N, max(_FEWEST_GROUPS, min(_GROUPS, _PAIRS_IN_ALL // N)))
    # every so many: a stretch of the order has poses of one kind, without which the rest is poorer
    every = [order[k::count] for k in range(count)]
    for size in sorted({len(group) for group in every}):
        groups = np.array([group for group in every if len(group) == size])
        inside = np.zeros((len(groups), N), dtype=bool)
        np.put_along_axis(inside, groups, True, axis=1)
        others = np.nonzero(~inside)[1].reshape(len(groups), N - size)
        at_once = max(1, _LEFT_OUT_AT_ONCE // N)
        for first in range(0, len(groups), at_once):
            rows = slice(first, first + at_once)
            sets = PairSets(A[others[rows]], B[others[rows]])
            seen = ~examine(sets).rank_deficient
            if not seen.all():
                sets = PairSets(sets.A[seen], sets.B[seen])
            if seen.any():
                left = chosen.run(sets, noise)
                own = groups[rows][seen].reshape(-1, size)
                out[own] = residuals(A[own], B[own], left.X, left.Z)
    return out
