"""Along the self-motion of a redundant arm to the posture nearest to a reference."""

from __future__ import annotations

import numpy as np

from calib.robots.chain import SerialChain
from calib.robots.inverse.iterative import close_in
from calib.robots.inverse.solutions import CLOSURE_TOLERANCE
from calib.se3 import FloatArray, rotation_log

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
    is Barzilai and Borwein's, which on a curve is the secant method.

    Parameters
    ----------
    chain : SerialChain
    q : array (S, n)
        Starts [rad]; they need not take their poses.
    T_wanted : array (S, 4, 4)
    lower, upper, near : array (n,)
        [rad]

    Returns
    -------
    array (S, n)
        [rad], inside the limits. Closed on the poses where that succeeded; the nearest of their
        neighbourhood where the walk came to rest.
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
