"""Inverse kinematics: poses in, for each pose every posture that takes it.

What solvers have in common: their interface and their answer. Six-axis arms are solved in closed
form (:mod:`calib.robots.inverse.closed_form`), those whose wrist has an offset by the zeros of a
polynomial (:mod:`calib.robots.inverse.offset_wrist`), seven-axis arms by closed forms along their
redundant joint (:mod:`calib.robots.inverse.redundant`), and others by damped iteration
(:mod:`calib.robots.inverse.solutions`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.batch_last import columns_of, product, rotation_log, transposed
from calib.robots.bounds import Bounds, first_per_group, turned_inside
from calib.robots.chain import ChainState, SerialChain
from calib.se3 import BoolArray, FloatArray, IntArray

CLOSURE_TOLERANCE = 1e-9
"""Largest distance [m] and angle [rad] between the pose asked for and the one a posture takes.
Closed forms reach 1e-12; what is farther off is a least-squares compromise, not a solution."""

NEAR_SINGULAR = 0.01
"""Smallest singular value of the tip's Jacobian, its linear rows divided by the arm's reach, below
which a posture counts as near a singularity. There some joint turns a hundred times as far as the
tip does: at the 100 to 200 deg/s of an industrial joint the tip creeps at 1 to 2 deg/s, and an
error of the pose of 0.01 deg is one of 1 deg in the joint. With the spherical wrist of an
R-2000iC that is every posture with abs(q5) < 0.8 deg, and four of five at 2 deg."""

_AT_ONCE = 20_000
"""Jacobians decomposed at once: 10 MB."""


@dataclass(frozen=True)
class NoPosture:
    """Why no posture inside the limits takes a pose."""

    gap_m: float
    """Distance to the nearest point the arm reaches [m]: zero where it is the limits that are in
    the way, NaN where it is not known."""
    joint: int | None
    """Joint (from zero) that the least offending posture brings farthest beyond its limits."""
    coupled: str | None
    """Name of the coupled limit, where it is one of these that is broken farthest."""
    excess: float  # how far beyond [rad, m]; NaN where no posture takes the pose at all


@dataclass(frozen=True, eq=False)
class InverseSolutions:
    """Postures for a list of poses, as flat arrays."""

    postures: FloatArray  # (S, n) [rad]. Those of pose 0 first, then those of pose 1, and so on.
    pose: IntArray  # (S,): index of the pose that each posture takes
    inside: BoolArray
    """(S,): whether the posture lies inside the limits it was solved for, those that joints have
    together included. Where a joint has no full turn inside them, the turn that breaks them least
    is given."""
    gap_m: FloatArray
    """(N,): distance from each pose to the nearest point the arm reaches: zero where there is a
    solution, NaN where it is not known."""
    near: FloatArray  # (n,): posture that full turns were chosen near to [rad]
    bounds: Bounds  # the limits it was solved for
    chain: SerialChain  # the arm it was solved for

    @cached_property
    def singular(self) -> BoolArray:
        """Whether each posture is near a singularity, ``(S,)``: see :data:`NEAR_SINGULAR`."""
        return singular_postures(self.chain, self.postures)

    def of(self, pose: int) -> FloatArray:
        """Postures ``(K, n)`` [rad] inside the limits that take one pose."""
        first, last = np.searchsorted(self.pose, [pose, pose + 1])
        return np.asarray(self.postures[first:last][self.inside[first:last]])

    def nearest(self) -> tuple[FloatArray, BoolArray]:
        """Of each pose the posture nearest to ``near``, inside the limits.

        Returns
        -------
        postures : array (N, n)
            [rad]; NaN where no solution lies inside the limits. Nearest in the Euclidean norm of
            the joint difference.
        found : array (N,) of bool
        """
        distance = np.linalg.norm(self.postures - self.near, axis=1)
        best = first_per_group(self.pose, np.where(self.inside, distance, np.inf), len(self.gap_m))
        postures = np.full((len(self.gap_m), self.postures.shape[1]), np.nan)
        chosen = best >= 0
        chosen[chosen] = self.inside[best[chosen]]
        postures[chosen] = self.postures[best[chosen]]
        return postures, chosen

    def reason(self, pose: int) -> NoPosture | None:
        """Why a pose has no posture inside the limits; None where it has one."""
        first, last = np.searchsorted(self.pose, [pose, pose + 1])
        if self.inside[first:last].any():
            return None
        if first == last:
            return NoPosture(float(self.gap_m[pose]), None, None, np.nan)
        excess = self.bounds.excess(self.postures[first:last])
        best = excess[int(np.argmin(excess.max(axis=1)))]
        worst, n = int(np.argmax(best)), self.postures.shape[1]
        together = worst - n
        return NoPosture(
            gap_m=float(self.gap_m[pose]),
            joint=worst if together < 0 else None,
            coupled=None if together < 0 else self.bounds.coupled[together].name,
            excess=float(best[worst]),
        )


class InverseKinematics(ABC):
    """One way to solve for postures."""

    poses_at_once: ClassVar[int]
    """What they take then stays within some megabytes."""

    def __init__(self, chain: SerialChain) -> None:
        self._chain = chain

    def solve(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray, every_turn: bool = False
    ) -> InverseSolutions:
        """Postures inside bounds for poses ``(N, 4, 4)``.

        Full turns are chosen nearest to a posture ``near`` ``(n,)`` [rad], or all are given.
        """
        postures, poses = [np.empty((0, self._chain.n))], [np.empty(0, dtype=np.intp)]
        gap_m = np.empty(len(T_base_tip))
        for start in range(0, len(T_base_tip), self.poses_at_once):
            part = slice(start, start + self.poses_at_once)
            q, of, gap_m[part] = self.some(T_base_tip[part], bounds, near)
            postures.append(q)
            poses.append(of + start)
        q, pose, inside = turned_inside(
            np.concatenate(postures), np.concatenate(poses), bounds, near, every_turn
        )
        return InverseSolutions(q, pose, inside, gap_m, near, bounds, self._chain)

    @abstractmethod
    def some(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Postures ``(S, n)`` in any turn, their poses in ascending order, and gaps ``(N,)`` [m].

        A gap is zero where there is a posture, NaN where it is not known.
        """


def singular_postures(chain: SerialChain, postures: FloatArray) -> BoolArray:
    """Whether postures ``(S, n)`` [rad] are near a singularity: see :data:`NEAR_SINGULAR`.

    An arm of fewer than six joints is judged by what its joints can do.
    """
    smallest = np.empty(len(postures))
    for start in range(0, len(postures), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        smallest[part] = chain.smallest_singular_values(chain.forward(postures[part]))
    return np.asarray(smallest < NEAR_SINGULAR)


def pose_error(chain: SerialChain, postures: FloatArray, T_wanted: FloatArray) -> FloatArray:
    """Twist ``(..., 6)`` from where the tip is to where it should be: [m, rad], in base axes."""
    return twist_to(chain.forward(postures), T_wanted)


def twist_to(state: ChainState, T_wanted: FloatArray) -> FloatArray:
    """Twist ``(..., 6)`` from the tip of a state to wanted poses: see :func:`pose_error`."""
    R = T_wanted[..., :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2)
    turn = rotation_log(columns_of(R.reshape(-1, 3, 3))).T.reshape(*R.shape[:-1])
    return np.concatenate([T_wanted[..., :3, 3] - state.p_base_tip, turn], axis=-1)


def damped_step(
    J: FloatArray, right: FloatArray, damping: FloatArray | float, largest_rad: float
) -> FloatArray:
    """Damped least-squares steps ``(..., n)`` [rad] of ``J dq = right``, cut to a largest turn.

    Jacobians ``(..., m, n)``, right sides ``(..., m)``, and what is added to ``J Jᵀ`` ``(...)``.
    """
    Jt = np.swapaxes(J, -1, -2)
    JJt = J @ Jt + np.asarray(damping)[..., None, None] * np.eye(J.shape[-2])
    step = (Jt @ np.linalg.solve(JJt, right[..., None]))[..., 0]
    largest = np.abs(step).max(axis=-1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, largest_rad / np.maximum(largest, 1e-300)))


_STARTS = 12
_ITERATIONS = 60
_DAMPING = 1e-4
"""Of the damped least-squares step, relative to the squared pose error; vanishes at the solution,
so that the last steps are Newton's."""

_SAME_POSTURE_RAD = 1e-3
"""Answers of two starts that differ by less are one posture."""


class DampedIteration(InverseKinematics):
    """Damped least squares from the reference posture and from starts spread over the limits.

    A redundant arm has infinitely many postures for a pose; each start gives the one it falls to,
    and the reference posture gives one near itself.
    """

    poses_at_once = 1000  # a dozen starts of each take 30 MB

    def some(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        rng = np.random.default_rng(0)  # the same pose must give the same postures at every call
        # where a margin leaves a joint no room they are crossed: what it would take is told
        lower = np.minimum(bounds.lower, bounds.upper)
        upper = np.maximum(bounds.lower, bounds.upper)
        q = self._from_starts(T_base_tip, near, lower, upper, _STARTS, rng)
        missed = ~self._closed(q, T_base_tip).any(axis=1)
        if missed.any():  # unreachable, or unlucky: once more from elsewhere
            again = self._from_starts(T_base_tip[missed], near, lower, upper, _STARTS, rng)
            q[missed] = again
        closed = self._closed(q, T_base_tip)
        distinct = closed & ~_repeats(q, closed)
        distance = np.linalg.norm(pose_error(self._chain, q, T_base_tip[:, None])[..., :3], axis=-1)
        gap_m = np.where(closed.any(axis=1), 0.0, distance.min(axis=1))
        return q[distinct], np.nonzero(distinct)[0], gap_m

    def _from_starts(
        self,
        T_base_tip: FloatArray,
        near: FloatArray,
        lower: FloatArray,
        upper: FloatArray,
        count: int,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Where ``near`` and random starts close in on each pose, ``(N, count, n)``."""
        starts = np.vstack([near, rng.uniform(lower, upper, (count - 1, self._chain.n))])
        q = np.tile(starts, (len(T_base_tip), 1))
        wanted = np.repeat(T_base_tip, count, axis=0)
        q = close_in(self._chain, q, wanted, lower, upper, _ITERATIONS)
        return q.reshape(len(T_base_tip), count, self._chain.n)

    def _closed(self, q: FloatArray, T_base_tip: FloatArray) -> BoolArray:
        error = pose_error(self._chain, q, T_base_tip[:, None])
        return np.asarray(np.abs(error).max(axis=-1) < CLOSURE_TOLERANCE)


def close_in(
    chain: SerialChain,
    q: FloatArray,
    T_wanted: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    iterations: int,
) -> FloatArray:
    """Step each posture ``(S, n)`` inside limits until it closes on its pose ``(S, 4, 4)``.

    Damped least squares; what has not closed after the iterations is returned as it is then.
    """
    return stepped(chain, q, T_wanted, lower, upper, iterations)[0]


def stepped(
    chain: SerialChain,
    q: FloatArray,
    T_wanted: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    iterations: int,
) -> tuple[FloatArray, IntArray]:
    """As :func:`close_in`, and the rows that were not seen to close, in ascending order.

    All others were seen to be a hundred times nearer than :data:`CLOSURE_TOLERANCE`.
    """
    q = np.array(q.T, order="C")  # a copy, even of one posture
    R, p = columns_of(T_wanted[:, :3, :3]), np.ascontiguousarray(T_wanted[:, :3, 3].T)
    active = np.arange(q.shape[1])
    for _ in range(iterations):
        left = []
        for start in range(0, len(active), _STEPPED_AT_ONCE):
            rows = active[start : start + _STEPPED_AT_ONCE]
            here = np.take(q, rows, axis=1)
            walk = chain.walk(here)
            turn = rotation_log(product(np.take(R, rows, axis=2), transposed(walk.tip)))
            error = np.concatenate([np.take(p, rows, axis=1) - walk.p_base_tip, turn])
            open_ = np.flatnonzero(np.abs(error).max(axis=0) > 0.01 * CLOSURE_TOLERANCE)
            if not open_.size:
                continue
            left.append(rows[open_])
            here, error = np.take(here, open_, axis=1), np.take(error, open_, axis=1)
            J = np.take(chain.tip_jacobian(walk), open_, axis=2)
            q[:, rows[open_]] = _step(here, J, error, lower[:, None], upper[:, None])
        active = np.concatenate(left) if left else active[:0]
        if not len(active):
            break
    return np.ascontiguousarray(q.T), active


_STEPPED_AT_ONCE = 2048
"""Postures stepped at once: their Jacobians stay in the cache of a core."""


def _step(
    q: FloatArray, J: FloatArray, error: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The next postures ``(n, S)`` by the Jacobians ``(6, n, S)`` of twists ``(6, S)``."""
    # joints at a limit that the step would push further out are held
    gradient = np.einsum("kns,ks->ns", J, error)
    held = ((q <= lower) & (gradient < 0)) | ((q >= upper) & (gradient > 0))
    if held.any():
        J = J * ~held
    JJt = np.einsum("ins,kns->sik", J, J)
    damping = _DAMPING * np.einsum("ks,ks->s", error, error) + 1e-14
    JJt[:, range(6), range(6)] += damping[:, None]
    step = np.einsum("kns,sk->ns", J, np.linalg.solve(JJt, error.T[..., None])[..., 0])
    step *= np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=0), 1e-300))
    return np.asarray(np.clip(q + step, lower, upper))


def _repeats(q: FloatArray, converged: BoolArray) -> BoolArray:
    """Starts ``(N, starts)`` whose answer an earlier converged start has already given."""
    same = np.abs(q[:, :, None] - q[:, None, :]).max(axis=-1) < _SAME_POSTURE_RAD
    earlier = np.tril(np.ones((q.shape[1], q.shape[1]), dtype=bool), k=-1)
    return np.asarray((same & earlier & converged[:, None, :]).any(axis=-1))
