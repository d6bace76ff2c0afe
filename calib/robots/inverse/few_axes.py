"""Poses that an arm of fewer than six axes can take, next to poses that it cannot.

Such an arm holds a point of its tip anywhere within its reach, and has as many orientations there
as it has axes beyond three: a SCARA one, a five-axis arm two. Of a pose that is asked for, the
point is kept, and the orientation comes as near as the axes allow.
"""

from __future__ import annotations

import numpy as np

from calib.batch_last import columns_of, cross, product, rotation_log, transposed, turn
from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import CLOSURE_TOLERANCE
from calib.se3 import FloatArray

AXES_OF_A_POSE = 6
"""Joints that an arm needs for every pose within its reach."""

_STARTS = 8
"""Postures that each pose is sought from, the nearest one among them."""

_ITERATIONS, _LAST = 40, 8
"""Steps towards point and orientation, and steps after them that close in on the point alone."""

_LEAST_MOTION = 1e-9
"""Square of the motion of the tool point, in its size, that counts as none."""

_WEIGHT = 30.0
"""Of the point against the orientation: a miss of a thirtieth of the reach counts as a radian."""

_DAMPING, _LARGEST_STEP = 1e-3, 0.5
"""Of the least squares, and the largest step of a joint [rad, parts of the reach]."""


def nearest_postures(
    chain: SerialChain,
    T_wanted: FloatArray,
    p_tip: FloatArray,
    near: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    starts: int = _STARTS,
) -> tuple[FloatArray, FloatArray]:
    """Return postures ``(N, n)`` with a point of the tip where poses have it, turned next to them.

    And how far the point is off ``(N,)`` [m]: above 1e-9 where no posture inside the limits brings
    it there.

    Parameters
    ----------
    T_wanted : array (N, 4, 4)
    p_tip : array (N, 3)
        The point in the tip frame [m].
    near : array (N, n)
        Posture that each pose is first sought from [rad, m].
    lower, upper : array (n,)
        Limits that the postures keep.
    starts : int
        Postures that each pose is sought from; 1: ``near`` alone, which gives the same branch.
    """
    count, n = near.shape
    rng = np.random.default_rng(0)  # the same poses must give the same postures at every call
    others = rng.uniform(lower, upper, (starts - 1, n))
    tried = np.concatenate([near[:, None], np.tile(others, (count, 1, 1))], axis=1)
    q = np.clip(tried.reshape(-1, n), lower, upper)
    T, p = np.repeat(T_wanted, starts, axis=0), np.repeat(p_tip, starts, axis=0)
    q, off, turned = _closed_in(chain, q, T, p, lower, upper)
    miss = np.where(off > CLOSURE_TOLERANCE, 1e3 + off, turned).reshape(count, starts)
    best = miss.argmin(axis=1)
    rows = np.arange(count) * starts + best
    return q[rows], off[rows]


def _closed_in(
    chain: SerialChain,
    q: FloatArray,
    T_wanted: FloatArray,
    p_tip: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return postures ``(S, n)`` after the steps, misses ``(S,)`` [m] and turns left over [rad]."""
    size = max(chain.reach_m, 1e-3)
    unit = np.where(chain.external.slides_of(chain.n), size, 1.0)[:, None]  # of a step
    R, p = columns_of(T_wanted[:, :3, :3]), np.ascontiguousarray(p_tip.T)
    place = np.ascontiguousarray(T_wanted[:, :3, 3].T) + turn(R, p)
    q, low, high = np.array(q.T, order="C"), lower[:, None], upper[:, None]
    for k in range(_ITERATIONS + _LAST + 1):
        walk = chain.walk(q)
        lever = turn(walk.tip, p)
        off = (place - walk.p_base_tip - lever) / size
        left = rotation_log(product(R, transposed(walk.tip)))
        if k == _ITERATIONS + _LAST:
            break
        J = chain.tip_jacobian(walk) * unit
        swept = cross(J[3:].transpose(1, 0, 2), lever).transpose(1, 0, 2)
        moved = (J[:3] + swept) / size
        step = _step(moved, J[3:], off, left, point_alone=k >= _ITERATIONS)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=0), 1e-300))
        q = np.clip(q + step * unit, low, high)
    return q.T.copy(), size * np.linalg.norm(off, axis=0), np.linalg.norm(left, axis=0)


def _step(
    moved: FloatArray, turned: FloatArray, off: FloatArray, left: FloatArray, *, point_alone: bool
) -> FloatArray:
    """Return steps ``(n, S)`` of damped least squares, of the point before the orientation."""
    if point_alone:
        JJt = np.einsum("ins,kns->sik", moved, moved)
        # of a plane or a line the point cannot go everywhere
        JJt[:, range(3), range(3)] += _LEAST_MOTION
        return np.asarray(
            np.einsum("kns,sk->ns", moved, np.linalg.solve(JJt, off.T[..., None])[..., 0])
        )
    A = _WEIGHT**2 * np.einsum("kis,kjs->sij", moved, moved) + np.einsum(
        "kis,kjs->sij", turned, turned
    )
    right = _WEIGHT**2 * np.einsum("kis,ks->si", moved, off) + np.einsum("kis,ks->si", turned, left)
    n = range(len(A[0]))
    A[:, n, n] += _DAMPING
    return np.asarray(np.linalg.solve(A, right[..., None])[..., 0].T)
