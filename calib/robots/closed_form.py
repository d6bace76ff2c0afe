"""Inverse kinematics in closed form, for six-axis arms with a known decomposition.

The solver is EAIK (Ostermeier et al.): spherical wrists, three parallel axes and their kin, every
branch in a few microseconds.
"""

from __future__ import annotations

import eaik.pybindings.EAIK as eaik
import numpy as np

from calib.robots.chain import SerialChain
from calib.robots.inverse import (
    CLOSURE_TOLERANCE,
    InverseKinematics,
    InverseSolutions,
    nearest_turns,
)
from calib.se3 import BoolArray, FloatArray, rotation_log

STRAIGHT_WRIST = 1e-5
"""Sine of the angle between axes 4 and 6 below which the wrist is solved again. EAIK's own answers
are wrong below 3e-7 and good to 1e-10 from 3e-6 on."""


class ClosedForm(InverseKinematics):
    """Every branch of a six-axis arm in closed form."""

    def __init__(self, chain: SerialChain, solver: eaik.Robot) -> None:
        self._chain = chain
        self._solver = solver

    @classmethod
    def of(cls, chain: SerialChain) -> ClosedForm | None:
        """The solver for a chain, or None where its geometry has no closed form."""
        if chain.n != 6:
            return None
        state = chain.forward(np.zeros(chain.n))
        steps = np.diff(np.vstack([np.zeros(3), state.origins, state.p_base_tip]), axis=0)
        solver = eaik.Robot(state.axes.T, steps.T, state.R_base_tip, [], True)
        return cls(chain, solver) if solver.has_known_decomposition() else None

    def solve(
        self, T_base_tip: FloatArray, lower: FloatArray, upper: FloatArray, near: FloatArray
    ) -> InverseSolutions:
        """See :meth:`InverseKinematics.solve`."""
        count = len(T_base_tip)
        answers = [self._solver.calculate_IK(T) for T in T_base_tip]
        found = [np.asarray(a.Q, dtype=float).reshape(-1, self._chain.n) for a in answers]
        pose = np.repeat(np.arange(count), [len(f) for f in found])
        postures = np.concatenate([*found, np.empty((0, self._chain.n))])
        lost = _wrist_is_straight(self._chain, postures)
        if lost.any():
            postures[lost] = solve_straight_wrist(
                self._chain, postures[lost], T_base_tip[pose[lost]], near
            )
        distance, angle = _misses(self._chain, postures, T_base_tip[pose])
        exact = (distance < CLOSURE_TOLERANCE) & (angle < CLOSURE_TOLERANCE)
        gap_m = np.full(count, np.inf)
        np.minimum.at(gap_m, pose, np.where(exact, 0.0, distance))
        postures, inside = nearest_turns(postures[exact], lower, upper, near)
        return InverseSolutions(
            postures, pose[exact], inside, np.where(np.isinf(gap_m), np.nan, gap_m)
        )


def _wrist_is_straight(chain: SerialChain, postures: FloatArray) -> BoolArray:
    axes = chain.forward(postures).axes
    sine = np.linalg.norm(np.cross(axes[:, 3], axes[:, 5]), axis=-1)
    return np.asarray(sine < STRAIGHT_WRIST)


def solve_straight_wrist(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray, near: FloatArray
) -> FloatArray:
    """Joints 4 to 6 anew where axes 4 and 6 are one line, or nearly so.

    EAIK sets q4 = q6 = 0 there, whatever the roll of the pose. The direction of axis 6 gives q4 and
    q5; q6 is the turn then left over, which makes up for the rounding of q4. On the line itself
    only the sum (or difference) of q4 and q6 is given, and they share the way from ``near``.

    Parameters
    ----------
    postures : array (S, 6)
        Joints 1 to 3, and the side to which joint 5 bends, are kept [rad].
    T_wanted : array (S, 4, 4)
    near : array (6,)
        [rad]

    Returns
    -------
    array (S, 6)
        Exact for a wrist whose axis 5 is perpendicular to its neighbours.
    """
    q = postures.copy()
    q[:, 3], q[:, 5] = near[3], near[5]
    state = chain.forward(q)
    a4, a5, a6 = (state.axes[:, j] for j in (3, 4, 5))
    way = np.sign(_dot(a4, a6))[:, None]  # of axis 6, along or against axis 4
    x = np.cross(a5, way * a4)  # where axis 6 goes as joint 5 turns
    y = np.cross(a4, x)
    bend = np.arctan2(_dot(a6, x), _dot(a6, way * a4))
    side = np.where(bend < 0, -1.0, 1.0)
    R_error = T_wanted[:, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2)
    a6_wanted = (R_error @ a6[..., None])[..., 0]
    off_x, off_y = side * _dot(a6_wanted, x), side * _dot(a6_wanted, y)
    off = np.hypot(off_x, off_y)
    on_line = off < 0.1 * CLOSURE_TOLERANCE
    q[:, 3] += np.where(on_line, 0.0, np.arctan2(off_y, off_x))
    q[:, 4] += np.where(on_line, 0.0, side * np.arctan2(off, np.abs(_dot(a6_wanted, a4)))) - bend
    state = chain.forward(q)
    left_over = rotation_log(T_wanted[:, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    turn = _dot(left_over, state.axes[:, 5])
    shared = np.where(on_line, turn / 2.0, 0.0)
    q[:, 3] += way[:, 0] * shared
    q[:, 5] += turn - shared
    return q


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))


def _misses(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance [m] and angle [rad] between where postures bring the tip and where it should be."""
    state = chain.forward(postures)
    distance = np.linalg.norm(state.p_base_tip - T_wanted[:, :3, 3], axis=-1)
    # |R - R'| is sqrt(2) times the angle where it is small, without the cost of a logarithm
    angle = np.linalg.norm(state.R_base_tip - T_wanted[:, :3, :3], axis=(-2, -1)) / np.sqrt(2.0)
    return distance, angle
