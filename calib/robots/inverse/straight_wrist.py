"""The wrist joints where axes 4 and 6 are one line, on which closed forms stumble."""

from __future__ import annotations

import numpy as np

from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import CLOSURE_TOLERANCE
from calib.se3 import FloatArray, IntArray, rotation_log

STRAIGHT_WRIST = 1e-5
"""Sine of the angle between axes 4 and 6 below which the wrist is solved again. EAIK's own answers
are wrong below 3e-7 and good to 1e-10 from 3e-6 on."""


def solve_straight_wrist(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray, near: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Joints 4 to 6 anew where axes 4 and 6 are one line, or nearly so.

    EAIK sets q4 = q6 = 0 there, whatever the roll of the pose. The direction of axis 6 gives q4 and
    q5; q6 is the turn then left over, which makes up for the rounding of q4. On the line itself
    only the sum (or difference) of q4 and q6 is given, and they share the way from ``near``.

    Parameters
    ----------
    postures : array (S, 6)
        Joints 1 to 3 are kept [rad].
    T_wanted : array (S, 4, 4)
    near : array (6,)
        [rad]

    Returns
    -------
    postures : array (K, 6)
        Joint 5 bent either way, or straight where axis 6 is on the line. Exact for a wrist whose
        axis 5 is perpendicular to its neighbours.
    source : array (K,)
        Row of the posture that each comes from.
    """
    q = postures.copy()
    q[:, 3], q[:, 5] = near[3], near[5]
    state = chain.forward(q)
    a4, a5, a6 = (state.axes[:, j] for j in (3, 4, 5))
    way = np.sign(_dot(a4, a6))[:, None]  # of axis 6, along or against axis 4
    x = np.cross(a5, way * a4)  # where axis 6 goes as joint 5 turns
    q[:, 4] -= np.arctan2(_dot(a6, x), _dot(a6, way * a4))  # straight
    R_error = T_wanted[:, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2)
    a6_wanted = (R_error @ a6[..., None])[..., 0]
    off_x, off_y = _dot(a6_wanted, x), _dot(a6_wanted, np.cross(a4, x))
    off = np.hypot(off_x, off_y)
    on_line = off < 0.1 * CLOSURE_TOLERANCE
    bend, turn = np.arctan2(off, np.abs(_dot(a6_wanted, a4))), np.arctan2(off_y, off_x)
    straight = np.zeros_like(q)
    bent = straight.copy()
    bent[:, 3], bent[:, 4] = turn, bend
    other = straight.copy()
    other[:, 3], other[:, 4] = turn + np.pi, -bend
    count = np.arange(len(q))
    source = np.concatenate([count[on_line], count[~on_line], count[~on_line]])
    q = q[source] + np.concatenate([straight[on_line], bent[~on_line], other[~on_line]])
    state = chain.forward(q)
    left_over = rotation_log(T_wanted[source, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    roll = _dot(left_over, state.axes[:, 5])
    shared = np.where(on_line[source], roll / 2.0, 0.0)
    q[:, 3] += way[source, 0] * shared
    q[:, 5] += roll - shared
    return q, source


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))
