"""Inverse kinematics in closed form, for six-axis arms with a known decomposition.

The solver is EAIK (Ostermeier et al.): spherical wrists, three parallel axes and their kin, every
branch in a few microseconds.
"""

from __future__ import annotations

import eaik.pybindings.EAIK as eaik
import numpy as np

from calib.robots.chain import ChainState, SerialChain
from calib.robots.inverse import (
    CLOSURE_TOLERANCE,
    InverseKinematics,
    InverseSolutions,
    nearest_turns,
)
from calib.robots.iterative import close_in
from calib.robots.straight_wrist import STRAIGHT_WRIST, solve_straight_wrist
from calib.se3 import BoolArray, FloatArray, IntArray

_POLISHING = 12
"""Steps: those that arrive take three to eight."""


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
        state = self._chain.forward(postures)
        sine = np.linalg.norm(np.cross(state.axes[:, 3], state.axes[:, 5]), axis=-1)
        straight = sine < STRAIGHT_WRIST
        if straight.any():
            postures, pose = self._mend(postures, pose, straight, T_base_tip, near)
            state = self._chain.forward(postures)
        distance, angle = _misses(state, T_base_tip[pose])
        exact = (distance < CLOSURE_TOLERANCE) & (angle < CLOSURE_TOLERANCE)
        gap_m = np.full(count, np.inf)
        np.minimum.at(gap_m, pose, np.where(exact, 0.0, distance))
        lost = (gap_m > 0)[pose]  # answers of poses that have no exact one
        if lost.any():
            postures, arrived = self._polish(postures, pose, lost, T_base_tip, near)
            exact |= arrived
            gap_m[pose[exact]] = 0.0
        postures, inside = nearest_turns(postures[exact], lower, upper, near)
        gap_m[np.isinf(gap_m)] = np.nan
        return InverseSolutions(postures, pose[exact], inside, gap_m, near)

    def _mend(
        self,
        postures: FloatArray,
        pose: IntArray,
        straight: BoolArray,
        T_base_tip: FloatArray,
        near: FloatArray,
    ) -> tuple[FloatArray, IntArray]:
        """Answers with a straight wrist solved again, those of each pose still together."""
        # EAIK gives one or both ways to bend joint 5: take each place of the arm once
        arms = np.column_stack([pose, np.round(postures[:, :3], 9)])[straight]
        once = np.flatnonzero(straight)[np.unique(arms, axis=0, return_index=True)[1]]
        mended, source = solve_straight_wrist(
            self._chain, postures[once], T_base_tip[pose[once]], near
        )
        pose = np.concatenate([pose[~straight], pose[once][source]])
        order = np.argsort(pose, kind="stable")
        return np.concatenate([postures[~straight], mended])[order], pose[order]

    def _polish(
        self,
        postures: FloatArray,
        pose: IntArray,
        lost: BoolArray,
        T_base_tip: FloatArray,
        near: FloatArray,
    ) -> tuple[FloatArray, BoolArray]:
        """Close in on poses from answers that miss them: postures, and which of them arrived.

        Most poses that EAIK has no exact answer for are out of reach and stay so. But on arms
        without a spherical wrist it loses poses with a straight one, and comes close.
        """
        off = np.flatnonzero(lost)
        free = np.full(self._chain.n, np.inf)
        wanted = T_base_tip[pose[off]]
        postures = postures.copy()
        postures[off] = close_in(self._chain, postures[off], wanted, -free, free, _POLISHING)
        distance, angle = _misses(self._chain.forward(postures[off]), wanted)
        closed = off[(distance < CLOSURE_TOLERANCE) & (angle < CLOSURE_TOLERANCE)]
        # several answers may close in on one posture
        turn = np.remainder(np.round(postures[closed] - near, 6), round(2.0 * np.pi, 6))
        known = np.column_stack([pose[closed], turn])
        arrived = np.zeros(len(postures), dtype=bool)
        arrived[closed[np.unique(known, axis=0, return_index=True)[1]]] = True
        return postures, arrived


def _misses(state: ChainState, T_wanted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance [m] and angle [rad] between where the tip is and where it should be."""
    distance = np.linalg.norm(state.p_base_tip - T_wanted[:, :3, 3], axis=-1)
    # |R - R'| is sqrt(2) times the angle where it is small, without the cost of a logarithm
    angle = np.linalg.norm(state.R_base_tip - T_wanted[:, :3, :3], axis=(-2, -1)) / np.sqrt(2.0)
    return distance, angle
