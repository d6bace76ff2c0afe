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
from calib.se3 import FloatArray


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
        distance, angle = _misses(self._chain, postures, T_base_tip[pose])
        exact = (distance < CLOSURE_TOLERANCE) & (angle < CLOSURE_TOLERANCE)
        gap_m = np.full(count, np.inf)
        np.minimum.at(gap_m, pose, np.where(exact, 0.0, distance))
        postures, inside = nearest_turns(postures[exact], lower, upper, near)
        return InverseSolutions(
            postures, pose[exact], inside, np.where(np.isinf(gap_m), np.nan, gap_m)
        )


def _misses(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance [m] and angle [rad] between where postures bring the tip and where it should be."""
    state = chain.forward(postures)
    distance = np.linalg.norm(state.p_base_tip - T_wanted[:, :3, 3], axis=-1)
    # |R - R'| is sqrt(2) times the angle where it is small, without the cost of a logarithm
    angle = np.linalg.norm(state.R_base_tip - T_wanted[:, :3, :3], axis=(-2, -1)) / np.sqrt(2.0)
    return distance, angle
