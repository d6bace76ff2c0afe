"""Solve A X = Z B by any of the methods: one problem, or many at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world.accuracy import (
    GoodnessOfFit,
    covariance_of,
    goodness,
    judged,
    left_out_residuals,
    noise_shown,
    propagate,
    rank_of,
    widening,
)
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.closed_form import residual_rms, residual_rows
from calib.robot_world.components import FEWEST_PAIRS as FEWEST_FOR_NOISE
from calib.robot_world.components import ShownNoise, explain, settled, shown_noise
from calib.robot_world.diagnosis import (
    ALIEN,
    copies,
    drifting,
    few_for_the_noise,
    outstanding,
    standing_out,
    suspicions,
)
from calib.robot_world.identifiability import (
    Motion,
    examine,
    half_turns,
    not_identifiable,
    turned_by_translations,
)
from calib.robot_world.methods import Method, find_method
from calib.robot_world.methods.robust import WIDENING
from calib.robot_world.noise import Noise, NoiseShown, PairNoise, check_asked_noise
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets, checked_pairs, checked_problem
from calib.robot_world.results import Estimate, RobotWorldBatch, RobotWorldResult
from calib.robot_world.scale import Scale, by_rotations_first, likeliest, scaled
from calib.robot_world.verdict import (
    HARDLY,
    alone,
    is_named,
    is_one,
    judge,
    scale_doubts,
    too_uncertain,
)
from calib.se3 import BoolArray, FloatArray

_FEWEST_FOR_SIGMA = 6
"""Pairs up to which the noise that they show is a rough guess."""

_PAIRS_AT_ONCE = 20_000
"""Pairs that one call of a method sees: bounds its memory to some 100 MB."""


_SCALE_ROUNDS = 4
"""Times that a robust method leaves pairs out and the scale is estimated from the others."""


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
    pairs = checked_problem(A, B)
    check_asked_noise(noise, pairs.N)
    known = None if isinstance(noise, str) else noise
    if noise == "shown" and not chosen.likelihood:
        known = shown_noise(pairs.A[0], pairs.B[0])
    solution = _solved(chosen, pairs, known, estimate_scale)
    made = ""
    if chosen.likelihood and noise in (None, "shown"):
        shown = _other_noise(chosen, solution)
        if shown is not None:
            known, made = shown.noise, shown.name
            solution = _solved(chosen, pairs, known, estimate_scale)
    return _result(
        chosen, solution, known, estimated=noise is None or isinstance(noise, str), made=made
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    """What a method makes of one set of pairs, and what is wrong with these.

    Attributes
    ----------
    pairs : PairSets
        With the scale of B corrected where that was estimated.
    used : ndarray of bool (N,)
    motion : Motion
        Of the pairs used.
    others : tuple of (str, X, Z)
        Solutions that fit as well.
    factor : float or None
        The scale of B's translations where it was estimated.
    """

    pairs: PairSets
    found: Estimate
    used: BoolArray
    motion: Motion
    doubts: tuple[str, ...]
    others: tuple[tuple[str, FloatArray, FloatArray], ...]
    factor: float | None

    @property
    def is_sound(self) -> bool:
        """Whether there is one answer, and nothing is wrong with the pairs so far."""
        return not (self.doubts or self.others) and _verdict(self.found, self.motion)[0] == "ok"


def _solved(
    chosen: Method, pairs: PairSets, noise: Noise | None, estimate_scale: bool
) -> _Solution:
    """Solve one set by noise that is given, or else by that of B alike in all directions."""
    factor = None
    if estimate_scale:
        factor = _factor(chosen, pairs, noise)
        pairs = scaled(pairs, factor)
    if chosen.robust:
        found, used = _robust(chosen, pairs, noise)
        kept = PairSets(pairs.A[:, used], pairs.B[:, used])
    else:
        found, used, kept = None, np.ones(pairs.N, dtype=bool), pairs
    motion = examine(kept)
    doubts = suspicions(pairs, used, motion)
    others: tuple[tuple[str, FloatArray, FloatArray], ...] = ()
    if motion.degenerate[0]:
        if doubts and not motion.rank_deficient[0]:
            raise InputError("the pairs do not fit together: " + "; ".join(doubts), name="pairs")
        others = half_turns(kept, motion, kept.rotations[0][0])
        if not others:
            raise not_identifiable(motion, kept.A[0], kept.B[0])
        kept = turned_by_translations(kept, others)
        motion = examine(kept)
    if found is None:
        found = chosen.run(kept, noise)
    if others:
        others = tuple(
            (text, X, Z)
            for text, X, Z in half_turns(kept, motion, found.X[0, :3, :3])
            if not motion.is_misfit(*residual_rms(kept, X[None], Z[None]))[0]
        )
    return _Solution(pairs, found, used, motion, doubts, others, factor)


def _other_noise(chosen: Method, one: _Solution) -> ShownNoise | None:
    """Noise that the residuals show, where it is not that of B alike in all directions.

    None where the pairs do not belong together, where a few of them that are far off show it
    alone, and where the translations of B may have another scale: what that leaves is no noise,
    though it grows with the distance.
    """
    found, used = one.found, one.used
    if not one.is_sound:
        return None
    shown = settled(one.pairs, found.X, found.Z, used, WIDENING if chosen.robust else 1.0)
    if shown is None:
        return None
    far = standing_out(_sizes(one.pairs, found, None, _residuals(one.pairs, found)), used)
    if far.any():
        others = explain(one.pairs.A[0], one.pairs.B[0], found.X[0], found.Z[0], used & ~far)
        if others is None or others.by_distance != shown.by_distance:
            return None
    scale = likeliest(one.pairs, one.motion.pairs, used, shown.noise)
    wrong = not is_one(scale) if shown.by_distance else is_named(scale)
    return None if wrong else shown


def _factor(chosen: Method, pairs: PairSets, noise: Noise | None) -> float:
    """Scale of B's translations of one set, by least squares or as likely as X and Z are found."""
    factor = float(by_rotations_first(pairs)[0])
    used = np.ones(pairs.N, dtype=bool)
    if not np.isfinite(likeliest(pairs, pairs, used, noise).sigma):
        raise NotIdentifiableError(
            ["the scale of B's translations"],
            ["X and Z take up any change of it where the origin of A hardly moves"],
            hint="measure poses that move the flange as well as turn it, or leave the scale alone",
        )
    for _ in range((_SCALE_ROUNDS if chosen.robust else 1) if chosen.likelihood else 0):
        if chosen.robust:
            _, used = _robust(chosen, scaled(pairs, factor), noise)
        kept = PairSets(pairs.A[:, used], pairs.B[:, used])
        factor = likeliest(pairs, kept, used, noise).value
    return factor


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
    chosen = find_method(method)
    A, B = checked_pairs(A, B, dimensions=4)
    T, N = A.shape[:2]
    check_asked_noise(noise, N)
    at_once = max(1, _PAIRS_AT_ONCE // N)
    parts = [
        _batch(chosen, PairSets(A[first : first + at_once], B[first : first + at_once]), noise)
        for first in range(0, T, at_once)
    ]
    return parts[0] if len(parts) == 1 else RobotWorldBatch.joined(parts)


def _batch(chosen: Method, pairs: PairSets, asked: Noise | NoiseShown | None) -> RobotWorldBatch:
    """Solve some problems, whatever their motion."""
    noise = None if isinstance(asked, str) else asked
    motion = examine(pairs)
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
        if chosen.likelihood and asked in (None, "shown"):
            found, noises = _with_other_noise(chosen, kept, found)
        X[usable], Z[usable] = found.X, found.Z
        if iterations is not None and found.iterations is not None:
            iterations[usable] = found.iterations
        if found.converged is not None:
            converged[usable] = found.converged
        if covariance is not None and found.fit is not None:
            covariance[usable] = found.fit.covariance
            used = np.ones((usable.size, pairs.N)) if found.weights is None else found.weights
            excess = np.ones(usable.size)
            if chi2 is not None:
                chi2[usable] = found.fit.cost
                _, excess = judged(found.fit.cost, 6 * used.sum(axis=-1) - 12)
            factor = widening(found.fit, used > 0, excess, noise_known=noise is not None)
            factor *= excess[:, None]
            covariance[usable] *= factor[:, :, None] * factor[:, None]
            uncertain[usable] = too_uncertain(covariance[usable], kept.size) | [
                bool(drifting(kept, found, own > 0, noises[trial], trial))
                for trial, own in enumerate(used)
            ]
        if found.weights is not None:
            rank_deficient, degenerate, doubtful = _judged_by_used(pairs, found.weights > 0)
            X[rank_deficient] = Z[rank_deficient] = np.nan
        elif found.fit is None:
            sizes = np.zeros((2, pairs.T))
            sizes[:, usable] = residual_rms(kept, found.X, found.Z)
            misfit = motion.is_misfit(*sizes) & ~rank_deficient
    return RobotWorldBatch(
        X,
        Z,
        chosen.name,
        iterations,
        converged,
        rank_deficient,
        degenerate,
        misfit,
        doubtful | uncertain,
        covariance,
        chi2,
    )


def _with_other_noise(
    chosen: Method, pairs: PairSets, found: Estimate
) -> tuple[Estimate, list[Noise | None]]:
    """Estimates with those in place whose residuals show other noise, and that noise of each."""
    noises: list[Noise | None] = [None] * pairs.T
    own: list[tuple[int, Estimate]] = []
    used = np.ones((pairs.T, pairs.N)) if found.weights is None else found.weights
    for trial in np.flatnonzero(used.sum(axis=1) >= FEWEST_FOR_NOISE).tolist():
        one = found.of(trial)
        kept = used[trial] > 0
        sets = PairSets(pairs.A[trial][None], pairs.B[trial][None])
        motion = examine(PairSets(sets.A[:, kept], sets.B[:, kept]))
        if motion.degenerate[0] or not _enough_agree(kept):
            continue
        doubts = suspicions(sets, kept, motion)
        shown = _other_noise(chosen, _Solution(sets, one, kept, motion, doubts, (), None))
        if shown is not None:
            noises[trial] = shown.noise
            own.append((trial, chosen.run(sets, shown.noise)))
    return found.with_others(own), noises


def _judged_by_used(pairs: PairSets, used: BoolArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Rank deficient, degenerate, doubtful ``(T,)`` by the pairs ``(T, N)`` that were kept."""
    rank_deficient, degenerate, doubtful = np.zeros((3, pairs.T), dtype=bool)
    enough = _enough_agree(used)
    rank_deficient[~enough] = used[~enough].sum(axis=1) < FEWEST_PAIRS
    degenerate[~enough] = True
    for trial in np.flatnonzero(enough):
        kept = used[trial]
        motion = examine(PairSets(pairs.A[trial, kept][None], pairs.B[trial, kept][None]))
        rank_deficient[trial], degenerate[trial] = motion.rank_deficient[0], motion.degenerate[0]
        doubtful[trial] = motion.misfit[0] > ALIEN
    return rank_deficient, degenerate, doubtful


def _enough_agree(used: BoolArray) -> BoolArray:
    """Whether the pairs ``(..., N)`` that a robust method kept are half of all, and enough."""
    count = used.sum(axis=-1)
    return np.asarray((2 * count >= used.shape[-1]) & (count >= FEWEST_PAIRS))


def _robust(chosen: Method, pairs: PairSets, noise: Noise | None) -> tuple[Estimate, BoolArray]:
    """What a robust method finds, and which pairs ``(N,)`` it used."""
    found = chosen.run(pairs, noise)
    used = np.ones(pairs.N, dtype=bool) if found.weights is None else found.weights[0] > 0
    left_out = int((~used).sum())
    if not _enough_agree(used):
        raise InputError(
            f"{left_out} of {pairs.N} pairs contradict the others: which of them are right cannot "
            "be told",
            hint="are the pairs in the same order, and is B given from the right side?",
            name="pairs",
            value=left_out,
            bound=pairs.N // 2,
        )
    return found, np.asarray(used)


def _result(
    chosen: Method, one: _Solution, noise: Noise | None, *, estimated: bool, made: str
) -> RobotWorldResult:
    """All that is said of one solution.

    Parameters
    ----------
    noise : PairNoise or PairCovariances, optional
        By which the pairs were weighed.
    estimated : bool
        Whether it was not given.
    made : str
        How it is made, in words, where the residuals show one that is not of B alike in all
        directions.
    """
    pairs, found, used, motion = one.pairs, one.found, one.used, one.motion
    others = one.others
    status, message = _verdict(found, motion)
    fit: GoodnessOfFit | None = None
    if status == "ok" and noise is not None and not estimated:
        fit = goodness(pairs, found, used, noise)
        if fit is not None and fit.excess > 1.0:
            message += (
                f"; the least residuals are {fit.excess:.1f} times the noise given: standard "
                "deviations are scaled up to them, which does not cover a bias of A or B"
            )
    if made:
        message += f"; noise as the residuals show it: {made}"
    if not used.all():
        rows = ", ".join(str(i + 1) for i in np.flatnonzero(~used))
        message += f"; left out as contradicting the others: {rows} (counted from 1)"
    if motion.degenerate[0] and status == "ok" and not others:
        message += "; rotations leave a choice of half turns, which the translations decide"
    if others and status == "ok":
        status = "ambiguous"
        message += (
            "; all rotations between the poses are about one axis or half turns, which leave a "
            "choice: add a pose that turns otherwise, or pick X by where the camera looks"
        )
    if one.doubts and status == "ok":
        status = "doubtful"
        message += f"; {HARDLY}"
    excess = fit.excess if fit else 1.0
    return RobotWorldResult(
        X=found.X[0],
        Z=found.Z[0],
        method=chosen.name,
        scale_estimated=one.factor is not None,
        iterations=None if found.iterations is None else int(found.iterations[0]),
        used=used,
        noise_estimated=estimated,
        noise_made=made,
        chi2=fit.chi2 if fit else None,
        freedom=6 * int(used.sum()) - 12,
        chi2_probability=fit.probability if fit else None,
        ambiguities=tuple(text for text, _, _ in others),
        alternatives=tuple((X, Z) for _, X, Z in others),
        _residuals=partial(_residuals, pairs, found),
        _noise=partial(_noise, found, used, noise, status),
        _drift=partial(_drift, one, noise),
        _doubts=partial(_doubts, chosen, one, noise, estimated, made),
        _rank=partial(rank_of, pairs, found.X, found.Z, used),
        _spread=partial(covariance_of, chosen, pairs, found, used, excess, not estimated),
        _leave_out=partial(left_out_residuals, chosen, pairs, found, used, noise),
        _scale=partial(_scale, chosen, one, noise, excess, status),
        _judged=partial(judge, status=status, message=message, motion=motion),
    )


def _scale(
    chosen: Method,
    one: _Solution,
    noise: Noise | None,
    excess: float,
    status: str,
    result: RobotWorldResult,
) -> Scale | None:
    """Scale of B's translations that is left in pairs, times the factor that they have already."""
    if status not in ("ok", "doubtful") or result.noise is None:
        return None
    used = result.used
    if one.factor is None or chosen.likelihood:
        scale = likeliest(one.pairs, one.motion.pairs, used, noise)
    else:
        A, B = one.pairs.A[0, used], one.pairs.B[0, used]
        covariance = propagate(partial(_with_scale, chosen), A, B, result.noise, excess)
        sigma = float(np.sqrt(covariance[12, 12]))
        scale = Scale(1.0, sigma, result.X, result.Z, covariance, 6 * int(used.sum()) - 13)
    return scale if one.factor is None else scale.times(one.factor)


def _with_scale(chosen: Method, pairs: PairSets) -> Estimate:
    """What a method without a likelihood finds when the scale is estimated as well."""
    factor = by_rotations_first(pairs)
    return replace(chosen.estimate(scaled(pairs, factor)), scale=factor)


def _residuals(pairs: PairSets, found: Estimate) -> FloatArray:
    return np.ascontiguousarray(residual_rows(pairs, found.X, found.Z).T)


def _noise(
    found: Estimate, used: BoolArray, given: Noise | None, status: str, error: FloatArray
) -> Noise | None:
    """Noise given, or shown by the residuals ``(N, 6)``; none of a solution that is none."""
    if status in ("misfit", "not converged"):
        return None
    return noise_shown(found, error, used) if given is None else given


def _drift(one: _Solution, noise: Noise | None) -> tuple[str, ...]:
    """What changes along the sequence of pairs that nothing else is wrong with."""
    if one.doubts or one.others:
        return ()
    return drifting(one.pairs, one.found, one.used, noise)


def _doubts(
    chosen: Method,
    one: _Solution,
    noise: Noise | None,
    estimated: bool,
    made: str,
    result: RobotWorldResult,
) -> tuple[str, ...]:
    """What seems to be wrong with the pairs of a solution."""
    pairs, found, used, motion = one.pairs, one.found, one.used, one.motion
    doubts = one.doubts or result.drift
    if not doubts:
        doubts = scale_doubts(result) + alone(result, motion)
        if not chosen.robust:
            doubts += outstanding(_sizes(pairs, found, noise, result.residuals), used)
    doubts += copies(pairs, used)
    N = int(used.sum())
    if estimated and N < _FEWEST_FOR_SIGMA:
        part = 100.0 / np.sqrt(2.0 * (6 * N - 12))
        doubts += (
            f"{N} pairs show the noise to {part:.0f} %, and so much at least the standard "
            "deviations may be off: measure more, or give the noise",
        )
    if estimated and chosen.likelihood and not made:
        other = explain(pairs.A[0], pairs.B[0], found.X[0], found.Z[0], used)
        if other is not None:
            doubts += (
                "residuals show other noise than the one of B that is the same in all directions, "
                f"which was taken: {other.name}",
            )
    return doubts + few_for_the_noise(motion)


def _sizes(
    pairs: PairSets, found: Estimate, noise: Noise | None, error: FloatArray
) -> list[FloatArray]:
    """How far off each pair ``(N,)`` is: in standard deviations where the noise is known."""
    if noise is None or (isinstance(noise, PairNoise) and not noise.is_positive):
        return [np.linalg.norm(part, axis=-1) for part in (error[:, :3], error[:, 3:])]
    white, _ = linear_rows(pairs, noise.model(pairs), found.X, found.Z)
    return [np.linalg.norm(white[:, 0], axis=0)]


def _verdict(found: Estimate, motion: Motion) -> tuple[str, str]:
    """Status and message of one solution."""
    if found.converged is not None and not found.converged[0]:
        return "not converged", (
            f"still moving after {found.iterations[0] if found.iterations is not None else 0} "
            "cycles: X and Z are the last iterate"
        )
    # the likeliest X and Z fit best by their own measure, whatever rotations alone would leave,
    # unless there are several places to look for them
    asked = found.fit is None or bool(motion.degenerate[0])
    if asked and motion.is_misfit(*residual_rms(motion.pairs, found.X, found.Z))[0]:
        return "misfit", (
            f"the residuals are several times the {np.degrees(motion.residual_rad[0]):.2g} deg and "
            f"{1e3 * motion.residual_m[0]:.2g} mm that rotations first, then translations leave: "
            "this method has failed on these data, take another"
        )
    return "ok", f"solved from {motion.pairs.N} pairs"
