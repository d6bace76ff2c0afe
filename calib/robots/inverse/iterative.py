"""Inverse kinematics by damped iteration, for arms without a closed form."""

from __future__ import annotations

import numpy as np

from calib.robots.bounds import Bounds
from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import (
    CLOSURE_TOLERANCE,
    InverseKinematics,
    InverseSolutions,
    pose_error,
    twist_to,
)
from calib.se3 import BoolArray, FloatArray, IntArray

_STARTS = 12
_ITERATIONS = 60
_DAMPING = 1e-4
"""Of the damped least-squares step, relative to the squared pose error; vanishes at the solution,
so that the last steps are Newton's."""

_POSES_AT_ONCE = 1000
"""Poses worked on at once; a dozen starts of each take 30 MB."""

_SAME_POSTURE_RAD = 1e-3
"""Answers of two starts that differ by less are one posture."""


class DampedIteration(InverseKinematics):
    """Damped least squares from the reference posture and from starts spread over the limits.

    A redundant arm has infinitely many postures for a pose; each start gives the one it falls to,
    and the reference posture gives one near itself.
    """

    def solve(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray, every_turn: bool = False
    ) -> InverseSolutions:
        """See :meth:`InverseKinematics.solve`."""
        postures, pose = [np.empty((0, self._chain.n))], [np.empty(0, dtype=np.intp)]
        gap_m = np.full(len(T_base_tip), np.nan)
        for start in range(0, len(T_base_tip), _POSES_AT_ONCE):
            part = slice(start, start + _POSES_AT_ONCE)
            q, of, gap_m[part] = self._some(T_base_tip[part], bounds, near)
            postures.append(q)
            pose.append(of + start)
        return self._answer(
            np.concatenate(postures), np.concatenate(pose), gap_m, bounds, near, every_turn
        )

    def _some(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Postures, their poses and the gaps [m] of some poses."""
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
    q = q.copy()
    active = np.arange(len(q))
    for _ in range(iterations):
        state = chain.forward(q[active])
        error = twist_to(state, T_wanted[active])
        open_ = np.abs(error).max(axis=-1) > 0.01 * CLOSURE_TOLERANCE
        if not open_.any():
            break
        active = active[open_]
        J = state.jacobian(state.p_base_tip)[open_]
        q[active] = _step(q[active], J, error[open_], lower, upper)
    return q


def _step(
    q: FloatArray, J: FloatArray, error: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    # joints at a limit that the step would push further out are held
    gradient = (np.swapaxes(J, -1, -2) @ error[..., None])[..., 0]
    held = ((q <= lower) & (gradient < 0)) | ((q >= upper) & (gradient > 0))
    J = J * ~held[..., None, :]
    damping = _DAMPING * np.sum(error**2, axis=-1)[..., None, None] + 1e-14
    JJt = J @ np.swapaxes(J, -1, -2) + damping * np.eye(6)
    step = (np.swapaxes(J, -1, -2) @ np.linalg.solve(JJt, error[..., None]))[..., 0]
    largest = np.abs(step).max(axis=-1, keepdims=True)
    step *= np.minimum(1.0, 0.5 / np.maximum(largest, 1e-300))
    return np.asarray(np.clip(q + step, lower, upper))


def _repeats(q: FloatArray, converged: BoolArray) -> BoolArray:
    """Starts ``(N, starts)`` whose answer an earlier converged start has already given."""
    same = np.abs(q[:, :, None] - q[:, None, :]).max(axis=-1) < _SAME_POSTURE_RAD
    earlier = np.tril(np.ones((q.shape[1], q.shape[1]), dtype=bool), k=-1)
    return np.asarray((same & earlier & converged[:, None, :]).any(axis=-1))
