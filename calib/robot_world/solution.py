"""What one method makes of one set of pairs, and what is wrong with these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import identifiability
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.closed_form import residual_rows
from calib.robot_world.components import Component, explain, settled
from calib.robot_world.diagnosis import standing_out, suspicions
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods import Method
from calib.robot_world.methods.robust import widening
from calib.robot_world.noise import Noise, PairNoise
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets
from calib.robot_world.scale import by_rotations_first, likeliest, scaled
from calib.se3 import BoolArray, FloatArray

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

        None where the pairs do not belong together, where a few of them that are far off show it
        alone, and where the translations of B may have another scale: what that leaves is no noise,
        though it grows with the distance.
        """
        X, Z, used = self.found.X, self.found.Z, self.used
        if not self.is_sound:
            return None
        shown = settled(self.pairs, X, Z, used, widening() if self.method.robust else 1.0)
        if shown is None:
            return None
        far = standing_out(self.sizes(None), used)
        if far.any():
            others = explain(self.pairs.A[0], self.pairs.B[0], X[0], Z[0], used & ~far)
            if others is None or others.by_distance != shown.by_distance:
                return None
        scale = likeliest(self.pairs, self.motion.pairs, used, shown.noise)
        wrong = not scale.is_one if shown.by_distance else scale.is_named
        return None if wrong else shown


def find_solution(
    method: Method, pairs: PairSets, noise: Noise | None, *, estimate_scale: bool
) -> Solution:
    """Solve one set by noise that is given, or else by that of B alike in all directions."""
    factor = None
    if estimate_scale:
        factor = _factor(method, pairs, noise)
        pairs = scaled(pairs, factor)
    if method.robust:
        found, used = _robust(method, pairs, noise)
        kept = pairs if used.all() else PairSets(pairs.A[:, used], pairs.B[:, used])
    else:
        found, used, kept = None, np.ones(pairs.N, dtype=bool), pairs
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
    return Solution(method, pairs, noise, found, used, motion, doubts, others, factor)


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
