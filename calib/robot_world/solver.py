"""Solve A X = Z B by any of the methods: one problem, or many at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import check_type
from calib.robot_world.accuracy import judged, widening
from calib.robot_world.components import FEWEST_PAIRS as FEWEST_FOR_NOISE
from calib.robot_world.components import explain, shown_noise
from calib.robot_world.diagnosis import ALIEN, suspicions
from calib.robot_world.estimate import Estimate
from calib.robot_world.identifiability import Motion, examine
from calib.robot_world.methods import Method, find_method
from calib.robot_world.noise import Noise, NoiseShown, check_noise
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets, checked_pairs, checked_problem
from calib.robot_world.poses import Poses, is_first, near_pairs
from calib.robot_world.results import RobotWorldResult, too_uncertain
from calib.robot_world.sequence import FEWEST_FOR_STEPS, may_drift
from calib.robot_world.solution import (
    Solution,
    deviation_of_poses,
    enough_agree,
    find_solution,
    refitted,
    with_poses_back,
)
from calib.se3 import BoolArray, FloatArray, IntArray

_PAIRS_AT_ONCE = 20_000
"""Pairs that one call of a method sees: bounds its memory to some 100 MB."""


def solve(
    A: ArrayLike,
    B: ArrayLike,
    method: str = "ml",
    noise: Noise | NoiseShown | None = None,
    *,
    estimate_scale: bool = False,
) -> RobotWorldResult:
    """Solve ``A_i X = Z B_i`` for X and Z.

    Eye in hand, ``A = T_base_flange``, ``B = T_target_camera``, ``X = T_flange_camera`` and
    ``Z = T_base_target``. Eye to hand, ``B = T_camera_target``, ``X = T_flange_target`` and
    ``Z = T_base_camera``.

    Parameters
    ----------
    A, B : array_like (N, 4, 4)
        Measured transforms [m], N >= 3, pair by pair.
    method : str
        One of :data:`~calib.robot_world.METHODS`.
    noise : PairNoise, PairCovariances, "B" or "shown", optional
        Noise of the transforms. Without it the residuals say how large it is. ``"B"``: it counts as
        that of B, the same in all directions, as for all methods but those of maximum likelihood.
        These take it as the residuals of twenty pairs or more show it, where they show another
        and nothing else is wrong with the pairs; ``"shown"``: so do the standard deviations of the
        others.
    estimate_scale : bool
        Whether to estimate the scale of B's translations with X and Z, and to correct B by it:
        where the size of the target is not sure, say. Lengths of A count as true; the noise is
        that of B corrected.

    Returns
    -------
    RobotWorldResult
        X, Z, residuals and covariance. Look at its ``status``: an iteration may not have
        converged, and a method may have failed on data that another one solves. Look at its
        ``warnings``: they say what is wrong with the pairs.

    Raises
    ------
    InputError
        Unknown method, shapes that differ, fewer than three pairs, matrices that are not rigid
        transforms, or pairs that do not fit together.
    NotIdentifiableError
        The rotations between the poses are all about one axis, or there are none, or the noise
        hides what there is besides. Half turns that leave a choice are no error: the translations
        decide, or else the status is ``"ambiguous"``.
    """
    chosen = find_method(method)
    return solve_problem(checked_problem(A, B), chosen, noise, estimate_scale=estimate_scale)


def solve_problem(
    pairs: PairSets, chosen: Method, noise: Noise | NoiseShown | None, *, estimate_scale: bool
) -> RobotWorldResult:
    """Solve one problem that is checked, as :func:`solve` does: by many methods, say."""
    check_noise(noise, pairs.N)
    known = None if isinstance(noise, str) else noise
    if noise == "shown" and not chosen.likelihood:
        known = shown_noise(pairs.A[0], pairs.B[0])
    solution = find_solution(chosen, pairs, known, estimate_scale=estimate_scale)
    made = ""
    if chosen.likelihood and noise in (None, "shown"):
        shown = solution.other_noise()
        if shown is not None:
            made = shown.name
            solution = find_solution(chosen, pairs, shown.noise, estimate_scale=estimate_scale)
    estimated = noise is None or isinstance(noise, str)
    return RobotWorldResult.of(solution, noise_estimated=estimated, noise_made=made)


@dataclass(frozen=True, eq=False)
class RobotWorldBatch:
    """Solutions of T problems A X = Z B by one method."""

    X: FloatArray
    Z: FloatArray
    """X, Z (T, 4, 4): the transforms; NaN in the trials whose motion identifies no X at all
    (``rank_deficient``)."""
    method: str  # name of the method
    iterations: IntArray | None
    """(T,): cycles of an iterative method, 0 where it was not run; None for the others."""
    converged: BoolArray
    """(T,): False where an iteration did not arrive; True for the methods that do not iterate."""
    rank_deficient: BoolArray
    """(T,): the rotations between the poses do not identify X: all about one axis, or none, or half
    turns."""
    degenerate: BoolArray
    """(T,): the same, or not to be told from it in the noise that the residuals show. X and Z are
    numbers there, since statistics over random problems need them, but ``ok`` is False."""
    misfit: BoolArray
    """(T,): the residuals are several times those of the closed form: the method has failed."""
    doubtful: BoolArray
    """(T,): what is left is of the size of the motion itself: A and B do not belong together."""
    covariance: FloatArray | None = None
    """(T, 12, 12): of X and Z, by the methods of maximum likelihood; see
    :attr:`RobotWorldResult.covariance`."""
    chi2: FloatArray | None = None
    """(T,): by these methods, where a noise was given; see :attr:`RobotWorldResult.chi2`."""

    @classmethod
    def joined(cls, parts: Sequence[RobotWorldBatch]) -> RobotWorldBatch:
        """Batches of the same method as one."""
        values: dict[str, Any] = {}
        for part in fields(cls):
            each = [getattr(batch, part.name) for batch in parts]
            values[part.name] = np.concatenate(each) if isinstance(each[0], np.ndarray) else each[0]
        return cls(**values)

    @property
    def ok(self) -> BoolArray:
        """Trials ``(T,)`` that converged, on motions that identify X and Z, with a fair fit."""
        return self.converged & ~self.degenerate & ~self.misfit & ~self.doubtful


def solve_batch(
    A: ArrayLike,
    B: ArrayLike,
    method: str = "ml",
    noise: Noise | Literal["B"] | None = None,
) -> RobotWorldBatch:
    """Solve T problems ``A_i X = Z B_i`` at once, as Monte Carlo studies need it.

    Parameters
    ----------
    A, B : array_like (T, N, 4, 4)
        Measured transforms of T problems with N >= 3 pairs each.
    method : str
        One of :data:`~calib.robot_world.METHODS`.
    noise : PairNoise, PairCovariances or "B", optional
        Noise of the transforms, for the methods that weigh by it; as :func:`solve` takes it.

    Returns
    -------
    RobotWorldBatch
        X and Z ``(T, 4, 4)``. A single bad trial does not stop the others, so degenerate motion
        is a mask here, not an error: X and Z are NaN where nothing identifies them, and ``ok``
        is False wherever :func:`solve` would raise or give a status other than ``"ok"``, but for
        what takes many solutions of one problem: residuals of pairs left out, the scale of B, and
        the covariance of methods that are no maximum likelihood.

    Raises
    ------
    InputError
        As :func:`solve`.
    """
    return solve_batch_by_each(A, B, (method,), noise)[method]


def solve_batch_by_each(
    A: ArrayLike,
    B: ArrayLike,
    methods: Sequence[str],
    noise: Noise | Literal["B"] | None = None,
) -> dict[str, RobotWorldBatch]:
    """Solve T problems by several methods, which share what all of them need of the pairs.

    Parameters, results and errors are those of :func:`solve_batch`.
    """
    check_type(methods, (tuple, list), "methods")
    chosen = [find_method(method) for method in methods]
    A, B = checked_pairs(A, B, dimensions=4)
    T, N = A.shape[:2]
    check_noise(noise, N)
    at_once = max(1, _PAIRS_AT_ONCE // N)
    parts: list[list[RobotWorldBatch]] = []
    for first in range(0, T, at_once):
        motion = examine(PairSets(A[first : first + at_once], B[first : first + at_once]))
        parts.append([_batch(method, motion, noise) for method in chosen])
    joined = (
        found[0] if len(parts) == 1 else RobotWorldBatch.joined(found)
        for found in zip(*parts, strict=True)
    )
    return dict(zip(methods, joined, strict=True))


def _batch(chosen: Method, motion: Motion, asked: Noise | NoiseShown | None) -> RobotWorldBatch:
    """Solve some problems, whatever their motion."""
    noise = None if isinstance(asked, str) else asked
    pairs = motion.pairs
    every = np.arange(pairs.T)
    usable = every if chosen.robust else np.flatnonzero(~motion.rank_deficient)
    X, Z = np.full((2, pairs.T, 4, 4), np.nan)
    converged, misfit = np.ones(pairs.T, dtype=bool), np.zeros(pairs.T, dtype=bool)
    iterations = np.zeros(pairs.T, dtype=np.intp) if chosen.iterative else None
    covariance = np.full((pairs.T, 12, 12), np.nan) if chosen.likelihood else None
    chi2 = np.full(pairs.T, np.nan) if chosen.likelihood and noise is not None else None
    degenerate, rank_deficient = motion.degenerate, motion.rank_deficient
    doubtful, uncertain = motion.misfit > ALIEN, np.zeros(pairs.T, dtype=bool)
    if usable.size:
        kept = pairs if usable.size == pairs.T else PairSets(pairs.A[usable], pairs.B[usable])
        found = chosen.run(kept, noise)
        noises: list[Noise | None] = [noise] * kept.T
        poses: dict[int, Poses] = {}
        used = found.used(pairs.N)
        if chosen.likelihood:
            found, used, poses = _by_poses(chosen, kept, noise, found, used)
        if chosen.likelihood and asked in (None, "shown"):
            found, noises = _with_other_noise(chosen, kept, found, used, poses)
        X[usable], Z[usable] = found.X, found.Z
        if iterations is not None and found.iterations is not None:
            iterations[usable] = found.iterations
        if found.converged is not None:
            converged[usable] = found.converged
        if covariance is not None and found.fit is not None:
            covariance[usable] = found.fit.covariance
            excess = np.ones(usable.size)
            if chi2 is not None:
                chi2[usable] = found.fit.cost
                _, excess = judged(found.fit.cost, 6 * used.sum(axis=-1) - 12)
            factor = widening(found.fit, used, excess, noise_known=noise is not None, poses=poses)
            factor *= excess[:, None]
            covariance[usable] *= factor[:, :, None] * factor[:, None]
            uncertain[usable] = too_uncertain(covariance[usable], kept.size)
            asked_of = (
                np.arange(kept.T)
                if pairs.N >= FEWEST_FOR_STEPS
                else np.flatnonzero(may_drift(found.fit, used))
            )
            for trial in asked_of.tolist():
                one = _one(chosen, kept, found, used, noises, poses, trial)
                uncertain[usable[trial]] |= any(
                    change.finding.grade == "not to be trusted" for change in one.sequence.told()
                )
        if found.weights is not None:
            rank_deficient, degenerate, doubtful = _judged_by_used(pairs, found.used(pairs.N))
            X[rank_deficient] = Z[rank_deficient] = np.nan
        elif found.fit is None:
            sizes = np.zeros((2, pairs.T))
            sizes[:, usable] = kept.residual_rms(found.X, found.Z)
            misfit = motion.is_misfit(*sizes) & ~rank_deficient
    masks = (converged, rank_deficient, degenerate, misfit, doubtful | uncertain)
    return RobotWorldBatch(X, Z, chosen.name, iterations, *masks, covariance, chi2)


def _by_poses(
    chosen: Method, pairs: PairSets, noise: Noise | None, found: Estimate, used: BoolArray
) -> tuple[Estimate, BoolArray, dict[int, Poses]]:
    """Estimates with those in place whose poses come back, pairs used, and these poses by trial."""
    poses: dict[int, Poses] = {}
    for trial, near in enumerate(near_pairs(pairs.A)):
        if not near.size:
            continue
        first = is_first(pairs.A[trial], pairs.B[trial], near)
        if (used[trial] & first).sum() >= FEWEST_PAIRS:
            used[trial] &= first
        own = np.array([trial])
        sets = PairSets(pairs.A[trial][None], pairs.B[trial][None])
        again = found.of(own)
        if not first.all():
            again = refitted(chosen, sets, noise, again, used[trial])
        shared = deviation_of_poses(chosen, again, used[trial], near)
        if chosen.robust and shared is not None:
            again, shared, used[trial] = with_poses_back(
                chosen, sets, noise, again, used[trial], near, shared, first
            )
        found = found.with_others(own, again)
        if shared is not None:
            poses[trial] = shared
    return found, used, poses


def _one(
    chosen: Method,
    pairs: PairSets,
    found: Estimate,
    used: BoolArray,
    noises: list[Noise | None],
    poses: dict[int, Poses],
    trial: int,
    motion: Motion | None = None,
    doubts: tuple[str, ...] = (),
) -> Solution:
    """One trial as a solution."""
    sets = PairSets(pairs.A[trial][None], pairs.B[trial][None])
    own, kept = found.of(np.array([trial])), used[trial]
    if motion is None:
        motion = examine(PairSets(sets.A[:, kept], sets.B[:, kept]))
    shared = poses.get(trial)
    return Solution(chosen, sets, noises[trial], own, kept, motion, doubts, poses=shared)


def _with_other_noise(
    chosen: Method,
    pairs: PairSets,
    found: Estimate,
    used: BoolArray,
    poses: dict[int, Poses],
) -> tuple[Estimate, list[Noise | None]]:
    """Estimates with those in place whose residuals show other noise, and that noise of each."""
    noises: list[Noise | None] = [None] * pairs.T
    others = found
    for trial in np.flatnonzero(used.sum(axis=1) >= FEWEST_FOR_NOISE).tolist():
        own, kept = np.array([trial]), used[trial]
        if explain(pairs.A[trial], pairs.B[trial], found.X[trial], found.Z[trial], kept) is None:
            continue
        sets = PairSets(pairs.A[trial][None], pairs.B[trial][None])
        motion = examine(PairSets(sets.A[:, kept], sets.B[:, kept]))
        if motion.degenerate[0] or not enough_agree(kept):
            continue
        doubts = suspicions(sets, kept, motion)
        one = _one(chosen, pairs, found, used, noises, poses, trial, motion, doubts)
        shown = one.other_noise()
        if shown is not None:
            again = find_solution(chosen, sets, shown.noise, estimate_scale=False)
            noises[trial] = shown.noise
            others = others.with_others(own, again.found)
            poses.pop(trial, None)
            if again.poses is not None:
                poses[trial] = again.poses
    return others, noises


def _judged_by_used(pairs: PairSets, used: BoolArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Rank deficient, degenerate, doubtful ``(T,)`` by the pairs ``(T, N)`` that were kept."""
    rank_deficient, degenerate, doubtful = np.zeros((3, pairs.T), dtype=bool)
    enough = enough_agree(used)
    rank_deficient[~enough] = used[~enough].sum(axis=1) < FEWEST_PAIRS
    degenerate[~enough] = True
    for trial in np.flatnonzero(enough):
        kept = used[trial]
        motion = examine(PairSets(pairs.A[trial, kept][None], pairs.B[trial, kept][None]))
        rank_deficient[trial], degenerate[trial] = motion.rank_deficient[0], motion.degenerate[0]
        doubtful[trial] = motion.misfit[0] > ALIEN
    return rank_deficient, degenerate, doubtful
