"""Inverse kinematics by damped iteration, for arms without a closed form."""

from __future__ import annotations

import numpy as np

from calib.robots.chain import SerialChain
from calib.robots.inverse import (
    CLOSURE_TOLERANCE,
    InverseKinematics,
    InverseSolutions,
    pose_error,
)
from calib.se3 import FloatArray

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

    def __init__(self, chain: SerialChain) -> None:
        self._chain = chain

    def solve(
        self, T_base_tip: FloatArray, lower: FloatArray, upper: FloatArray, near: FloatArray
    ) -> InverseSolutions:
        """See :meth:`InverseKinematics.solve`."""
        count, n = len(T_base_tip), self._chain.n
        # a fixed seed: the same pose must give the same postures at every call
        spread = np.random.default_rng(0).uniform(lower, upper, (_STARTS - 1, n))
        starts = np.vstack([near, spread])
        q = np.repeat(starts[None], count, axis=0)  # (N, starts, n)
        wanted = np.broadcast_to(T_base_tip[:, None], (count, _STARTS, 4, 4))
        q = self._iterate(q.reshape(-1, n), wanted.reshape(-1, 4, 4), lower, upper).reshape(
            count, _STARTS, n
        )
        error = pose_error(self._chain, q, wanted)  # (N, starts, 6)
        converged = np.abs(error).max(axis=-1) < CLOSURE_TOLERANCE
        distinct = converged & ~_repeats(q, converged)
        distance = np.linalg.norm(error[..., :3], axis=-1)
        return InverseSolutions(
            postures=q[distinct],
            pose=np.nonzero(distinct)[0],
            inside=np.ones(int(distinct.sum()), dtype=bool),
            gap_m=np.where(converged.any(axis=1), 0.0, distance.min(axis=1)),
        )

    def _iterate(
        self, q: FloatArray, wanted: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> FloatArray:
        """Step each of the starts ``(S, n)`` inside the limits until it closes on its pose."""
        q = q.copy()
        active = np.arange(len(q))
        for _ in range(_ITERATIONS):
            error = pose_error(self._chain, q[active], wanted[active])
            open_ = np.abs(error).max(axis=-1) > 0.01 * CLOSURE_TOLERANCE
            active, error = active[open_], error[open_]
            if not len(active):
                break
            q[active] = self._step(q[active], error, lower, upper)
        return q

    def _step(
        self, q: FloatArray, error: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> FloatArray:
        state = self._chain.forward(q)
        J = state.jacobian(state.p_base_tip)
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


def _repeats(q: FloatArray, converged: np.ndarray) -> np.ndarray:
    """Starts ``(N, starts)`` whose answer an earlier converged start has already given."""
    same = np.abs(q[:, :, None] - q[:, None, :]).max(axis=-1) < _SAME_POSTURE_RAD
    earlier = np.tril(np.ones((q.shape[1], q.shape[1]), dtype=bool), k=-1)
    return np.asarray((same & earlier & converged[:, None, :]).any(axis=-1))
