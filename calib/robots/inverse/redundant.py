"""Inverse kinematics of seven-axis arms: closed forms along the redundant joint.

A pose leaves such an arm one freedom: its postures lie on curves, the self-motions. Held at one
angle, a well-chosen joint leaves a six-axis arm with a closed form, so the curves are cut at
every angle of a sweep. From the cuts the nearest posture to a reference is walked to
(:func:`move_near`).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calib.robots.bounds import TURN, Bounds, first_per_group, nearest_turns
from calib.robots.chain import SerialChain
from calib.robots.inverse.closed_form import (
    SAME_POSTURE_RAD,
    compare,
    repeated,
)
from calib.robots.inverse.eaik_arm import ZEROS, EaikArm
from calib.robots.inverse.ideal import ideals
from calib.robots.inverse.solutions import CLOSURE_TOLERANCE, InverseKinematics, close_in
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_log

SWEEP_STEP_RAD = np.deg2rad(5.0)
"""Largest step of the swept joint. Halving it doubles time and memory; what it does not cut is a
piece of self-motion inside the limits on which the joint stays within one step, and those are
sought by walking from the cuts nearest to the limits."""

_STARTS = 5
"""Cuts of a pose from which the nearest posture is walked to: the curves of a pose are few, but the
nearest cut need not be on the one that comes nearest."""

_TRIED = 200
"""Random postures at which the joint to sweep is chosen."""

_LEAST_SHARE = 1e-3
"""Of a joint in the self-motion that can be swept: an elbow between two spheres has none."""

_ALMOST = 1e-4
"""Miss [m, rad] of an answer of the closed form that is one, to be closed in on. Its own least
digits suffer where the arm with one joint held is almost singular."""

_POLISHING = 12

_APART_RAD = 0.5
"""Starts that differ by less in every joint lead to the same posture as a rule."""

_SAME_ANGLE_RAD = 1e-9
"""Angles of the swept joint that differ by less are one cut."""


class RedundantArm(InverseKinematics):
    """Every branch of a seven-axis arm at each step of one joint, and the postures nearest by."""

    poses_at_once = 64  # some 100,000 answers before the limits are looked at, 6 MB

    def __init__(self, chain: SerialChain, swept: int, ideal: SerialChain | None = None) -> None:
        super().__init__(chain)
        self._ideal = ideal or chain
        self.swept = swept
        """Index of the joint that is swept."""
        self._sweep = lru_cache(maxsize=8)(self._solvers)

    @classmethod
    def of(cls, chain: SerialChain) -> RedundantArm | None:
        """The solver for a chain, or None where no joint leaves a closed form."""
        if chain.n != 7:
            return None
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_TRIED, 7))
        state = chain.forward(q)
        null = np.abs(np.linalg.svd(state.jacobian(state.p_base_tip))[2][:, -1])
        # a joint that hardly takes part in the self-motion cuts it badly, or never: an elbow
        share = np.quantile(null, 0.25, axis=0)
        for ideal in (chain, *ideals(chain)):
            swept = int(np.argmax(share * [_leaves_closed_form(ideal, j) for j in range(7)]))
            if share[swept] > _LEAST_SHARE and _leaves_closed_form(ideal, swept):
                return cls(chain, swept, ideal)
        return None

    def _solvers(self, lower: float, upper: float) -> list[tuple[float, EaikArm]]:
        """Six-axis arms at each angle [rad] of the swept joint."""
        if upper < lower:  # a margin left it no room: what it would take is told all the same
            lower, upper = -np.pi, np.pi
        span = min(upper - lower, TURN)
        # an even number: in the middle, where arms are straight, pieces of self-motion are short
        steps = 2 * max(int(np.ceil(span / SWEEP_STEP_RAD / 2.0)), 1)
        angles = lower + np.linspace(0.0, span, steps + 1)[: None if span < TURN else -1]
        return [(a, self._held_at(a)) for a in angles.tolist()]

    def _held_at(self, angle: float) -> EaikArm:
        return EaikArm(self._ideal, ZEROS[0], (self.swept, angle))

    def _cuts(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Answers at each angle of the swept joint, ordered by pose; not all of them exact."""
        lower, upper, wanted = (float(v[self.swept]) for v in (bounds.lower, bounds.upper, near))
        solvers = self._sweep(lower, upper)
        away = min(abs(wanted - a) for a, _ in solvers)
        if lower <= wanted <= upper and away > _SAME_ANGLE_RAD:
            solvers = [*solvers, (wanted, self._held_at(wanted))]
        answers = [arm.branches(T_base_tip) for _, arm in solvers if arm.known]
        postures, pose = (np.concatenate(parts) for parts in zip(*answers, strict=True))
        order = np.argsort(pose, kind="stable")
        return postures[order], pose[order]

    def _closed_in(
        self, postures: FloatArray, pose: IntArray, T_base_tip: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Answers that almost are exact made so: postures, what they miss by [m], whether exact."""
        miss, itself = compare(self._ideal, postures, T_base_tip, pose), self._ideal is self._chain
        done = miss.below(0.01 * CLOSURE_TOLERANCE) & itself
        almost = np.flatnonzero(miss.below(_ALMOST) & ~done)
        if len(almost):
            free, T = np.full(7, np.inf), T_base_tip[pose[almost]]
            postures[almost] = close_in(self._chain, postures[almost], T, -free, free, _POLISHING)
            # of the others only what an ideal arm misses is not what this one does
            again = almost if itself else np.arange(len(pose))
            found = compare(self._chain, postures[again], T_base_tip, pose[again])
            miss.distance[again], miss.angle[again] = found.distance, found.angle
        return postures, miss.distance, miss.below(CLOSURE_TOLERANCE)

    def some(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        count = len(T_base_tip)
        postures, pose = self._cuts(T_base_tip, bounds, near)
        key = np.column_stack([pose, postures[:, self.swept]])
        cut = np.cumsum((np.diff(key, axis=0, prepend=key[:1]) != 0).any(axis=1))
        postures, distance, exact = self._closed_in(postures, pose, T_base_tip)
        exact[exact] = ~repeated(postures[exact], cut[exact])  # EAIK gives some answers twice
        gap_m = np.full(count, np.inf)
        # of least-squares answers, which keep the orientation: what walks gives some of it up
        np.minimum.at(gap_m, pose, np.where(exact, 0.0, distance))

        inside = np.zeros(len(pose), dtype=bool)

        def apart(rows: IntArray) -> IntArray:
            """Of some rows the best to start from.

            Inside the limits the nearest to the reference, else the least outside, else the closest
            to the pose.
            """
            q, fits = nearest_turns(postures[rows], bounds.lower, bounds.upper, near)
            postures[rows], inside[rows] = q, fits & bounds.coupled_fit(q)
            away = np.linalg.norm(q - near, axis=1)
            beyond = np.maximum(bounds.excess(q).max(axis=1), 0.0)
            rank = np.where(inside[rows], away, 1e3 + beyond)
            rank = np.where(exact[rows], rank, 1e6 + distance[rows])
            return np.asarray(rows[_best(q, pose[rows], rank, count)])

        # least-squares answers, most of what some arms get, only where others are too few
        starts = apart(np.flatnonzero(exact))
        few = (np.bincount(pose[starts], minlength=count) < _STARTS)[pose]
        starts = np.concatenate([starts[~few[starts]], apart(np.flatnonzero(few))])
        # from the reference itself, and from the cuts
        of = np.concatenate([np.arange(count), pose[starts]])
        q = np.concatenate([np.tile(near, (count, 1)), postures[starts]])
        q = move_near(self._chain, q, T_base_tip[of], bounds.lower, bounds.upper, near)
        closed = compare(self._chain, q, T_base_tip, of).below(CLOSURE_TOLERANCE)
        gap_m[of[closed]] = 0.0
        closed &= bounds.coupled_fit(q)
        q, of = q[closed], of[closed]

        some = np.zeros(count, dtype=bool)
        some[pose[exact & inside]] = True
        some[of] = True
        # what breaks the limits is told only where nothing keeps them
        keep = exact & (inside | ~some[pose])
        gap_m[np.isinf(gap_m)] = np.nan
        return (*_together(postures[keep], pose[keep], q, of), gap_m)


def _leaves_closed_form(chain: SerialChain, joint: int) -> bool:
    """Whether the arm with one joint held has a closed form, at angles of no special meaning."""
    return all(EaikArm(chain, ZEROS[0], (joint, angle)).known for angle in (0.3, -1.1))


def _best(postures: FloatArray, pose: IntArray, rank: FloatArray, count: int) -> IntArray:
    """Up to :data:`_STARTS` rows of each pose with the lowest rank, well apart from each other."""
    rank, rows = rank.copy(), []
    for _ in range(_STARTS):
        best = first_per_group(pose, rank, count)
        best = best[best >= 0]
        best = best[np.isfinite(rank[best])]
        rows.append(best)
        chosen = np.full((count, postures.shape[1]), np.inf)
        chosen[pose[best]] = postures[best]
        rank[np.abs(postures - chosen[pose]).max(axis=1) < _APART_RAD] = np.inf
    return np.concatenate(rows)


def _together(
    cuts: FloatArray, pose: IntArray, walked: FloatArray, of: IntArray
) -> tuple[FloatArray, IntArray]:
    """Cuts and walked postures, each posture once, ordered by pose."""
    order = np.argsort(of, kind="stable")
    walked, of = walked[order], of[order]
    once = ~repeated(walked, of)
    walked, of = walked[once], of[once]
    fresh = np.ones(len(cuts), dtype=bool)
    rank = np.arange(len(of)) - np.searchsorted(of, of)
    for k in range(int(rank.max(initial=-1)) + 1):
        chosen = np.full((int(max(pose.max(initial=-1), of.max())) + 1, cuts.shape[1]), np.inf)
        chosen[of[rank == k]] = walked[rank == k]
        same = np.arange(len(cuts))
        for angle, taken in zip(cuts.T, chosen.T, strict=True):
            same = same[np.abs(angle[same] - taken[pose[same]]) <= SAME_POSTURE_RAD]
        fresh[same] = False
    pose = np.concatenate([of, pose[fresh]])
    order = np.argsort(pose, kind="stable")
    return np.concatenate([walked, cuts[fresh]])[order], pose[order]


_STEPS = 30
"""Most walks rest after a dozen; those that have not by then are cut off, on their pose or not."""
_LARGEST_PULL_RAD = 0.3
_LARGEST_STEP_RAD = 0.6
_AT_REST_RAD = 1e-10
_DAMPING = 1e-4
_LEAST_DAMPING = 1e-14
"""Of the closing step: relative to the squared pose error, so that it vanishes on the pose."""

_CLOSING = 10
"""Steps of closing in at the end; those that were on their pose take one or two."""

_PULL_GAIN = (0.05, 4.0)
"""Range of the gain of the pull along the self-motion, found from how the pull changed in the last
step: one on a straight self-motion, less on one that curves away from the reference."""


def move_near(
    chain: SerialChain,
    q: FloatArray,
    T_wanted: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    near: FloatArray,
) -> FloatArray:
    """Move along self-motions to where they come nearest to a posture, inside limits.

    Each step closes the pose (Newton) and follows the part of ``near - q`` that does not move the
    tip; joints that a step would take out of their limits are held on them. The gain of the pull
    is Barzilai and Borwein's, which on a curve is the secant method. Starts ``(S, n)`` need not
    take their poses ``(S, 4, 4)``. What comes out ``(S, n)`` [rad] is inside the limits, closed on
    the poses where that succeeded, and the nearest of its neighbourhood where it came to rest.
    """
    q = q.copy()
    moved, pull = np.zeros_like(q), np.zeros_like(q)
    active = np.arange(len(q))
    for _ in range(_STEPS):
        if not len(active):
            break
        here, T = q[active], T_wanted[active]
        state = chain.forward(here)
        J = state.jacobian(state.p_base_tip)
        turn = rotation_log(T[:, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
        error = np.concatenate([T[:, :3, 3] - state.p_base_tip, turn], axis=1)
        margins = lower - here, upper - here
        memory = moved[active], pull[active]
        step, moved[active], pull[active] = _step(J, error, near - here, margins, memory)
        q[active] = here + step
        rest = np.abs(step).max(axis=1) < _AT_REST_RAD
        active = active[~(rest & (np.abs(error).max(axis=1) < CLOSURE_TOLERANCE))]
    return close_in(chain, np.clip(q, lower, upper), T_wanted, lower, upper, _CLOSING)


def _step(
    J: FloatArray,
    error: FloatArray,
    wish: FloatArray,
    margins: tuple[FloatArray, FloatArray],
    memory: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One step (S, n): all of it, its part along the self-motion, and the pull that made that.

    ``margins`` are the distances to the limits, ``memory`` what the step before returned.
    """
    free = np.ones(wish.shape, dtype=bool)
    held = np.zeros_like(wish)
    damping = (_DAMPING * np.sum(error**2, axis=1) + _LEAST_DAMPING)[:, None, None] * np.eye(6)
    for _ in range(wish.shape[1]):
        Jf = J * free[:, None, :]
        Jt = np.swapaxes(Jf, -1, -2)
        pull = wish * free
        to_close = error - _times(J, held)
        rhs = np.stack([to_close, _times(Jf, pull)], axis=-1)
        closing, across = np.moveaxis(Jt @ np.linalg.solve(Jf @ Jt + damping, rhs), -1, 0)
        pull = pull - across
        moved = _gain(pull, *memory) * pull
        moved *= _cap(moved, _LARGEST_PULL_RAD)
        step = held + closing + moved
        step *= _cap(step, _LARGEST_STEP_RAD)
        out = free & ((step < margins[0]) | (step > margins[1]))
        if not out.any():
            break
        held = np.where(out, np.clip(step, *margins), held)
        free &= ~out
    return step, moved, pull


def _gain(pull: FloatArray, moved: FloatArray, before: FloatArray) -> FloatArray:
    """Gain (S, 1) of the pull, from how the last step along the self-motion changed it."""
    length, change = np.sum(moved**2, axis=1), np.sum(moved * (before - pull), axis=1)
    known = change > 0
    gain = np.where(known, length / np.where(known, change, 1.0), 1.0)
    return np.asarray(np.clip(gain, *_PULL_GAIN)[:, None])


def _cap(step: FloatArray, largest: float) -> FloatArray:
    """Factor (S, 1) that keeps every joint's step below one."""
    size = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(np.minimum(1.0, largest / np.maximum(size, 1e-300)))


def _times(J: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray((J @ v[..., None])[..., 0])
