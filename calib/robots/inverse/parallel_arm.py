"""Arms with axes 2 to 4 parallel, where axis 6 is parallel to them, on which closed forms stumble.

Such an arm (that of Universal Robots) has two angles for the turn about one direction there: the
arm's own, about axes 2 to 4, and joint 6. Exactly there it moves with its tip at rest.
"""

from __future__ import annotations

import numpy as np

from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import CLOSURE_TOLERANCE
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_exp, rotation_log

_PARALLEL = 1e-9
"""Sine [rad] below which axes of a description are parallel, or perpendicular."""

_TINY = 1e-30
"""Takes the place of a product of lengths that is zero [m²]."""


def has_parallel_arm(chain: SerialChain) -> bool:
    """Whether axes 2 to 4 are parallel and each later axis is perpendicular to the one before."""
    a = chain.forward(np.zeros(chain.n)).axes
    parallel = np.abs(np.cross(a[1], a[2:4])).max() < _PARALLEL
    return bool(parallel and abs(a[3] @ a[4]) < _PARALLEL and abs(a[4] @ a[5]) < _PARALLEL)


def solve_parallel_arm(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Joints 2 to 6 anew where axis 6 is parallel to axes 2 to 4, or nearly so.

    Off that line the direction of axis 6 tells how far the arm has turned (either way) and joint
    5, and joint 6 makes up for its rounding; what is left is a triangle for joints 2 to 4. On the
    line joint 6 is free: it is kept, or turned until the triangle closes.

    Parameters
    ----------
    chain : SerialChain
        One for which :func:`has_parallel_arm`.
    postures : array (S, 6)
        Joint 1 is kept, and on the line joint 6 as far as the reach allows [rad].
    T_wanted : array (S, 4, 4)

    Returns
    -------
    postures : array (K, 6)
        [rad]; stretched towards the pose where that is out of reach.
    source : array (K,)
        Row of the posture that each comes from.
    """
    turns, bend, roll, source, line = _wrist(chain, postures, T_wanted)
    q = np.zeros((len(source), 6))
    q[:, 0], q[:, 4], q[:, 5] = postures[source, 0], bend, roll
    at_zero = chain.forward(q)
    n = at_zero.axes[:, 1]
    way = np.sign(np.sum(at_zero.axes[:, 1:4] * n[:, None], axis=-1))  # of axes 2 to 4
    q[:, 1] = turns
    state = chain.forward(q)
    o2, o3, o4 = (at_zero.origins[:, j] for j in (1, 2, 3))
    upper, fore = _flat(o3 - o2, n), _flat(o4 - o3, n)
    a6, o6 = state.axes[:, 5], state.origins[:, 5]
    centre = _flat(o6 + T_wanted[source, :3, 3] - state.p_base_tip - o2, n)
    offset = _flat(state.origins[:, 3] - o6, n)
    l2, l3 = np.linalg.norm(upper, axis=1), np.linalg.norm(fore, axis=1)
    more = np.where(line, _into_reach(centre, offset, n, np.abs(l2 - l3), l2 + l3), 0.0)
    turns, q[:, 5] = turns + more, roll - more * np.sign(_dot(a6, n))
    goal = centre + _rotated(offset, n, more)
    cosine = (_dot(goal, goal) - l2**2 - l3**2) / (2.0 * l2 * l3)
    elbow = np.arccos(np.clip(cosine, -1.0, 1.0))
    found = []
    for side in (1.0, -1.0):
        q3 = side * elbow - _angle(upper, fore, n)
        q2 = _angle(upper + _rotated(fore, n, q3), goal, n)
        posture = q.copy()
        posture[:, 1:4] = np.column_stack([q2, q3, turns - q2 - q3]) * way
        found.append(posture)
    return np.concatenate(found), np.tile(source, 2)


def _wrist(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, BoolArray]:
    """Turn of the arm about axis 2, joints 5 and 6 [rad], their rows, and which are on the line."""
    q = np.zeros_like(postures)
    q[:, 0] = postures[:, 0]
    state = chain.forward(q)
    n, a5, a6 = (state.axes[:, j] for j in (1, 4, 5))
    wanted = T_wanted[:, :3, :3] @ (np.swapaxes(state.R_base_tip, -1, -2) @ a6[..., None])
    wanted = wanted[..., 0]  # axis 6
    off = _flat(wanted, n)
    size = np.linalg.norm(off, axis=1)
    line: BoolArray = size < 0.1 * CLOSURE_TOLERANCE
    a5_wanted = np.cross(n, off / np.where(line, 1.0, size)[:, None])
    ahead = _angle(a5, a5_wanted, n)
    on, beside = np.flatnonzero(line), np.flatnonzero(~line)
    source = np.concatenate([on, beside, beside])
    turns = np.concatenate([np.zeros(len(on)), ahead[beside], ahead[beside] + np.pi])
    n, a5, a6, wanted = n[source], a5[source], a6[source], wanted[source]
    bend = _angle(_rotated(a6, n, turns), wanted, _rotated(a5, n, turns))
    q = q[source]
    q[:, 1], q[:, 4] = turns, bend
    q[: len(on), 5] = postures[on, 5]
    state = chain.forward(q)
    left_over = rotation_log(T_wanted[source, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    share = np.arange(len(source)) < len(on)
    turns = turns + np.where(share, _dot(left_over, n), 0.0)
    roll = q[:, 5] + np.where(share, 0.0, _dot(left_over, state.axes[:, 5]))
    return turns, bend, roll, source, share


def _into_reach(
    centre: FloatArray, offset: FloatArray, n: FloatArray, least: FloatArray, most: FloatArray
) -> FloatArray:
    """Smallest turn (S,) [rad] of an offset about n that brings its end into reach.

    Parameters
    ----------
    centre, offset : array (S, 3)
        Across n [m]: what the offset starts from, and the offset.
    n : array (S, 3)
    least, most : array (S,)
        Distances that the end may have [m]; where no turn does, it comes as near as it can.
    """
    sides = _dot(centre, centre) + _dot(offset, offset)
    twice = 2.0 * np.linalg.norm(centre, axis=1) * np.linalg.norm(offset, axis=1)
    nearest, farthest = (
        np.arccos(np.clip((d**2 - sides) / np.maximum(twice, _TINY), -1.0, 1.0))
        for d in (least, most)
    )
    angle = _angle(centre, offset, n)
    size = np.abs(angle)
    wanted = np.clip(size, farthest, nearest)
    return np.asarray(np.where(wanted == size, 0.0, np.copysign(wanted, angle) - angle))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))


def _flat(v: FloatArray, n: FloatArray) -> FloatArray:
    """The part of vectors (S, 3) across unit vectors."""
    return np.asarray(v - _dot(v, n)[:, None] * n)


def _angle(a: FloatArray, b: FloatArray, n: FloatArray) -> FloatArray:
    """Angle (S,) [rad] about n from a to b."""
    return np.asarray(np.arctan2(_dot(n, np.cross(a, b)), _dot(a, b)))


def _rotated(v: FloatArray, n: FloatArray, angle: FloatArray) -> FloatArray:
    return np.asarray((rotation_exp(n * angle[:, None]) @ v[..., None])[..., 0])
