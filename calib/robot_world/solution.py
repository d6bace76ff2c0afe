"""What one method makes of one set of pairs, and what is wrong with these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from calib.chance import f_bound
from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import identifiability
from calib.robot_world.accuracy import Likeliest
from calib.robot_world.adjustment import adjust, linear_rows
from calib.robot_world.closed_form import residual_rows
from calib.robot_world.components import SURELY, Component, allowed, explain, settled
from calib.robot_world.diagnosis import standing_out, suspicions
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods import Method, find_method
from calib.robot_world.methods.maximum_likelihood import as_estimate, with_estimated_noise
from calib.robot_world.methods.robust import CHANCE, widening
from calib.robot_world.noise import Noise, PairNoise, difference
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets
from calib.robot_world.poses import Poses, is_first, near_pairs, poses_of, restricted
from calib.robot_world.scale import (
    by_rotations_first,
    depth_columns,
    likeliest,
    scale_column,
    scaled,
)
from calib.robot_world.sequence import Change, Sequence
from calib.robot_world.sizes import estimated_model
from calib.se3 import BoolArray, FloatArray, IntArray

_BACK_ROUNDS = 3
"""Times that a robust method takes poses back."""

_SCALE_ROUNDS = 4
"""Times that a robust method leaves pairs out and the scale is estimated from the others."""


@dataclass(frozen=True, eq=False)
class Solution:
    """X and Z of one set by a method."""

    method: Method
    pairs: PairSets  # with the scale of B corrected where that was estimated
    noise: Noise | None  # by which the pairs were weighed
    found: Estimate
    used: BoolArray  # (N,)
    motion: identifiability.Motion  # of the pairs used
    doubts: tuple[str, ...] = ()  # what is wrong with the pairs whatever X and Z are
    others: tuple[identifiability.Other, ...] = ()  # solutions that fit as well
    factor: float | None = None  # the scale of B's translations where it was estimated
    poses: Poses | None = None  # where pairs of the same pose share a deviation
    copies: BoolArray | None = None  # (N,): pairs that repeat others number by number

    @property
    def is_sound(self) -> bool:
        """Whether there is one answer, and nothing is wrong with the pairs so far."""
        return not (self.doubts or self.others) and self.verdict[0] == "ok"

    @cached_property
    def verdict(self) -> tuple[str, str]:
        """Status and message by the iteration and the residuals."""
        found, motion = self.found, self.motion
        if found.converged is not None and not found.converged[0]:
            return "not converged", (
                f"still moving after {found.iterations[0] if found.iterations is not None else 0} "
                "cycles: X and Z are the last iterate"
            )
        # the likeliest X and Z fit best by their own measure, whatever rotations alone would leave,
        # unless there are several places to look for them
        asked = found.fit is None or bool(motion.degenerate[0])
        if asked and motion.is_misfit(*motion.pairs.residual_rms(found.X, found.Z))[0]:
            return "misfit", (
                f"the residuals are several times the {np.degrees(motion.residual_rad[0]):.2g} deg "
                f"and {1e3 * motion.residual_m[0]:.2g} mm that rotations first, then translations "
                "leave: this method has failed on these data, take another"
            )
        return "ok", f"solved from {motion.pairs.N} pairs"

    @cached_property
    def likeliest(self) -> Likeliest:
        """The likeliest X and Z of the pairs used, whatever the method found."""
        found, poses = self.found, self.poses
        if found.fit is None:
            found, poses = _likeliest(self.pairs, self.used.tobytes())
        fit = found.fit
        if fit is None:
            raise ValueError("maximum likelihood has no fit")
        if found.sigma is not None:
            return Likeliest(fit, estimated_model(self.pairs, found.sigma), poses)
        if self.noise is None:
            raise ValueError("neither noise nor its size is known")
        return Likeliest(fit, self.noise.model(self.pairs), poses)

    @cached_property
    def sequence(self) -> Sequence:
        """The pairs used in the order in which they were measured."""
        best = self.likeliest
        return Sequence.of(best.fit, 0, self.used, self.pairs, best.errors, best.poses)

    @cached_property
    def scale_changes(self) -> tuple[Change, ...]:
        """The scale of B's translations, and of its depth, as changes of the pairs.

        Without those that X and Z take up.
        """
        best, one = self.likeliest, self.sequence
        if one.is_rounding or self.factor is not None:
            return ()
        at = self.pairs, best.errors, best.fit.X, best.fit.Z
        columns = [("B", "scale", scale_column(*at))]
        columns += [(name, "depth", rows) for name, rows in depth_columns(*at).items()]
        changes = (
            Change(one, name, kind, rows[:, 0, self.used].T[..., None])
            for name, kind, rows in columns
        )
        return tuple(change for change in changes if change.is_seen)

    @cached_property
    def causes(self) -> tuple[Change, ...]:
        """Changes along the sequence, and scales, that the pairs show.

        None where something is wrong with them anyway; several where these pairs do not tell them
        apart.
        """
        if self.doubts or self.others or self.sequence.is_rounding:
            return ()
        told = self.sequence.told(*self.scale_changes)
        if not any(change.is_of_scale for change in told):
            return told
        # seen from one place the scale is far from linear: errors of the arm then make any
        scale = likeliest(self.pairs, self.motion.pairs, self.used, self.noise)
        return told if scale.is_told else tuple(one for one in told if not one.is_of_scale)

    @property
    def is_grave(self) -> bool:
        """Return True if a cause moves X or Z so far that they are not to be trusted."""
        return any(one.finding.grade == "not to be trusted" for one in self.causes)

    @cached_property
    def residuals(self) -> FloatArray:
        """Rotation vector [rad] and translation [m] ``(N, 6)`` by which A X differs from Z B."""
        return np.ascontiguousarray(residual_rows(self.pairs, self.found.X, self.found.Z).T)

    def sizes(self, noise: Noise | None) -> list[FloatArray]:
        """How far off each pair ``(N,)`` is: in standard deviations where the noise is known."""
        if noise is None or (isinstance(noise, PairNoise) and not noise.is_positive):
            error = self.residuals
            return [np.linalg.norm(part, axis=-1) for part in (error[:, :3], error[:, 3:])]
        model = noise.model(self.pairs)
        white, _ = linear_rows(self.pairs, model, self.found.X, self.found.Z)
        return [np.linalg.norm(white[:, 0], axis=0)]

    def other_noise(self) -> Component | None:
        """Noise that the residuals show, where it is not that of B alike in all directions.

        None where the pairs do not belong together, where a cause explains as much of what noise of
        B leaves, where a few pairs that are far off show it alone, and where the translations of B
        may have another scale: what that leaves is no noise, though it grows with the distance.
        """
        X, Z, used = self.found.X, self.found.Z, self.used
        explained = self._explained()
        if not self.is_sound or explained is None or self._has_rival(explained):
            return None
        shown = settled(self.pairs, X, Z, used, widening() if self.method.robust else 1.0)
        if shown is None:
            return None
        far = standing_out(self.sizes(None), used)
        if far.any():
            others = self._explained(~far)
            if others is None or others.by_distance != shown.by_distance:
                return None
        scale = likeliest(self.pairs, self.motion.pairs, used, shown.noise)
        wrong = not scale.is_one if shown.by_distance else scale.is_named
        return None if wrong else shown

    @cached_property
    def by_other_noises(self) -> tuple[tuple[str, FloatArray], ...]:
        """Other noises that the residuals allow, and how far ``(12,)`` X and Z move by each."""
        X, Z, weights = self.found.X, self.found.Z, self.used[None].astype(float)
        moved = []
        for other in allowed(self.pairs.A[0], self.pairs.B[0], X[0], Z[0], self._of_poses):
            model = other.noise.model(self.pairs)
            fit = adjust(self.pairs, model, X, Z, weights=weights)
            off = np.concatenate([difference(fit.X[0], X[0]), difference(fit.Z[0], Z[0])])
            moved.append((other.name, off))
        return tuple(moved)

    def _has_rival(self, noise: Component) -> bool:
        """Return True if a cause may have made the residuals that another noise explains.

        A wrong scale makes residuals that look like noise of depth in every respect but one: the
        pairs tell the scale. A step, a drift or a delay has to explain as much as the noise.
        """
        return any(one.is_of_scale or one.gain > noise.gain - SURELY for one in self.causes)

    @property
    def _of_poses(self) -> BoolArray:
        """Pairs used ``(N,)``, one of each pose."""
        if self.poses is None:
            return self.used
        each = np.zeros_like(self.used)
        each[self.poses.member.argmax(axis=1)] = True
        return self.used & each

    def _explained(self, some: BoolArray | None = None) -> Component | None:
        """Return the noise that residuals show, of one pair of each pose."""
        used = self._of_poses if some is None else self._of_poses & some
        X, Z = self.found.X[0], self.found.Z[0]
        return explain(self.pairs.A[0], self.pairs.B[0], X, Z, used)


@lru_cache(maxsize=2)  # of the same pairs by one method after the other
def _likeliest(pairs: PairSets, used: bytes) -> tuple[Estimate, Poses | None]:
    """The likeliest X and Z of the pairs used of one set, and the noise of B."""
    kept = np.frombuffer(used, dtype=bool)
    method = find_method("ml")
    found = method.run(PairSets(pairs.A[:, kept], pairs.B[:, kept]), None)
    if not kept.all():
        found = refitted(method, pairs, None, found, kept)
    (near,) = near_pairs(pairs.A)
    return found, deviation_of_poses(method, found, kept, near)


def find_solution(
    method: Method, pairs: PairSets, noise: Noise | None, *, estimate_scale: bool
) -> Solution:
    """Solve one set by noise that is given, or else by that of B alike in all directions."""
    factor = None
    if estimate_scale:
        factor = _factor(method, pairs, noise)
        pairs = scaled(pairs, factor)
    (near,) = near_pairs(pairs.A)
    first = is_first(pairs.A[0], pairs.B[0], near)
    once = first if first.sum() >= FEWEST_PAIRS else np.ones_like(first)
    distinct = pairs if once.all() else PairSets(pairs.A[:, once], pairs.B[:, once])
    found, used = None, once
    if method.robust:
        found, agree = _robust(method, distinct, noise)
        used = once.copy()
        used[once] = agree
    kept = pairs if used.all() else PairSets(pairs.A[:, used], pairs.B[:, used])
    motion = identifiability.examine(kept)
    doubts = suspicions(pairs, used, motion)
    others: tuple[identifiability.Other, ...] = ()
    if motion.degenerate[0]:
        if doubts and not motion.rank_deficient[0]:
            raise InputError("the pairs do not fit together: " + "; ".join(doubts), name="pairs")
        others = identifiability.half_turns(kept, motion, kept.rotations[0][0])
        if not others:
            raise identifiability.not_identifiable(motion, kept.A[0], kept.B[0])
        kept = identifiability.turned_by_translations(kept, others)
        motion = identifiability.examine(kept)
    if found is None:
        found = method.run(kept, noise)
    if others:
        others = tuple(
            (text, X, Z)
            for text, X, Z in identifiability.half_turns(kept, motion, found.X[0, :3, :3])
            if not motion.is_misfit(*kept.residual_rms(X[None], Z[None]))[0]
        )
    poses = None
    if method.likelihood and near.size:
        if not once.all():
            found = refitted(method, pairs, noise, found, used)
        poses = deviation_of_poses(method, found, used, near)
        if method.robust and poses is not None:
            found, poses, used = with_poses_back(
                method, pairs, noise, found, used, near, poses, once
            )
            motion = identifiability.examine(PairSets(pairs.A[:, used], pairs.B[:, used]))
    return Solution(
        method, pairs, noise, found, used, motion, doubts, others, factor, poses, ~first
    )


def with_poses_back(
    method: Method,
    pairs: PairSets,
    noise: Noise | None,
    found: Estimate,
    used: BoolArray,
    near: IntArray,
    poses: Poses,
    once: BoolArray,
) -> tuple[Estimate, Poses | None, BoolArray]:
    """Take poses back whose pairs were all left out, where the deviation of a pose explains them.

    Pairs of one pose are off together, so that a pose which is off by its usual deviation looks
    like as many wrong pairs.
    """
    every = poses_of(near, once)
    shared: Poses | None = poses
    for _ in range(_BACK_ROUNDS):
        fit = found.fit
        if every is None or shared is None or fit is None:
            break
        sigma, missing = found.sigma, ~(every.member * used).any(axis=1)
        model = noise.model(pairs) if sigma is None and noise is not None else None
        if sigma is not None:
            model = estimated_model(pairs, sigma)
        if model is None or not missing.any():
            break
        part = every.member[missing] / every.counts[missing][:, None]
        white, J = linear_rows(pairs, model, fit.X, fit.Z)
        means, slopes = part @ white[:, 0].T, np.einsum("gn,pan->gap", part, J[:, :, 0])
        C = fit.covariance[0]
        C = C @ shared.information(fit.jacobian[:, :, 0]) @ C
        spread = slopes @ C @ np.swapaxes(slopes, 1, 2)
        own = np.repeat(shared.share, 3) + 1.0 / every.counts[missing][:, None]
        own = own * np.repeat(shared.own, 3) ** 2
        spread += own[:, :, None] * np.eye(6)
        square = (means * np.linalg.solve(spread, means[..., None])[..., 0]).sum(axis=1)
        bound = 6.0 * f_bound(CHANCE, 6.0, max(6.0 * len(shared.counts) - 12.0, 1.0))
        back = every.member[missing][square <= float(bound)].any(axis=0)
        if not back.any():
            break
        used = used | back
        found = refitted(method, pairs, noise, found, used)
        shared = deviation_of_poses(method, found, used, near)
    return found, shared, used


def refitted(
    method: Method, pairs: PairSets, noise: Noise | None, found: Estimate, used: BoolArray
) -> Estimate:
    """Adjust one set again from the pairs used ``(N,)``, with rows for all of its pairs."""
    weights = used[None].astype(float)
    sigma = None
    if noise is None:
        larger = widening() if method.robust else 1.0
        fit, sigma = with_estimated_noise(pairs, found.X, found.Z, weights, larger)
    else:
        fit = adjust(pairs, noise.model(pairs), found.X, found.Z, weights=weights)
    return as_estimate(fit, sigma, weights)


def deviation_of_poses(
    method: Method, found: Estimate, used: BoolArray, near: IntArray
) -> Poses | None:
    """Estimate the deviation that pairs of one pose share; None where there is none.

    Parameters
    ----------
    found : Estimate
        The likeliest X and Z of one set by independent errors.
    used : ndarray of bool (N,)
        Pairs that count.
    near : ndarray (k, 2)
        See :func:`~calib.robot_world.poses.near_pairs`.
    """
    poses, fit = poses_of(near, used), found.fit
    if poses is None or fit is None:
        return None
    white, jacobian = fit.white[:, 0], fit.jacobian[:, :, 0]
    if found.sigma is None:
        return restricted(white, jacobian, poses=poses, own=False)
    larger = widening() if method.robust else 1.0
    return restricted(larger * white, larger * jacobian, poses=poses, own=True)


def enough_agree(used: BoolArray) -> BoolArray:
    """Whether the pairs ``(..., N)`` that a robust method kept are half of all, and enough."""
    count = used.sum(axis=-1)
    return np.asarray((2 * count >= used.shape[-1]) & (count >= FEWEST_PAIRS))


def _robust(method: Method, pairs: PairSets, noise: Noise | None) -> tuple[Estimate, BoolArray]:
    """What a robust method finds, and which pairs ``(N,)`` it used."""
    found = method.run(pairs, noise)
    used = found.used(pairs.N)[0]
    left_out = int((~used).sum())
    if not enough_agree(used):
        raise InputError(
            f"{left_out} of {pairs.N} pairs contradict the others: which of them are right cannot "
            "be told",
            hint="are the pairs in the same order, and is B given from the right side?",
            name="pairs",
            value=left_out,
            bound=pairs.N // 2,
        )
    return found, used


def _factor(method: Method, pairs: PairSets, noise: Noise | None) -> float:
    """Scale of B's translations of one set, by least squares or as likely as X and Z are found."""
    factor = float(by_rotations_first(pairs)[0])
    used = np.ones(pairs.N, dtype=bool)
    if not np.isfinite(likeliest(pairs, pairs, used, noise).sigma):
        raise NotIdentifiableError(
            ["the scale of B's translations"],
            ["X and Z take up any change of it where the origin of A hardly moves"],
            hint="measure poses that move the flange as well as turn it, or leave the scale alone",
        )
    for _ in range((_SCALE_ROUNDS if method.robust else 1) if method.likelihood else 0):
        if method.robust:
            _, used = _robust(method, scaled(pairs, factor), noise)
        kept = PairSets(pairs.A[:, used], pairs.B[:, used])
        factor = likeliest(pairs, kept, used, noise).value
    return factor
