"""Inverse kinematics: poses in, for each pose every posture that takes it.

What solvers have in common: their interface, their answer, and the choice of full turns. Six-axis
arms are solved in closed form (:mod:`calib.robots.closed_form`) where there is one, all other arms
by damped iteration (:mod:`calib.robots.iterative`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from calib.robots.chain import SerialChain
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_log

CLOSURE_TOLERANCE = 1e-9
"""Largest distance [m] and angle [rad] between the pose asked for and the one a posture takes.
Closed forms reach 1e-12; what is farther off is a least-squares compromise, not a solution."""

LIMIT_TOLERANCE = 1e-9
"""Excess over a joint limit [rad] that is rounding: a posture on its limit is inside."""


@dataclass(frozen=True, eq=False)
class InverseSolutions:
    """Postures for a list of poses, as flat arrays.

    Attributes
    ----------
    postures : array (S, n)
        [rad]. Those of pose 0 first, then those of pose 1, and so on.
    pose : array (S,)
        Index of the pose that each posture takes.
    inside : array (S,) of bool
        Whether the posture lies inside the limits it was solved for. Where a joint has no full
        turn inside them, the turn that breaks them least is given.
    gap_m : array (N,)
        Distance from each pose to the nearest point the arm reaches: zero where there is a
        solution, NaN where it is not known.
    near : array (n,)
        Posture that full turns were chosen near to [rad].
    """

    postures: FloatArray
    pose: IntArray
    inside: BoolArray
    gap_m: FloatArray
    near: FloatArray

    def of(self, pose: int) -> FloatArray:
        """Postures ``(K, n)`` [rad] inside the limits that take one pose."""
        return np.asarray(self.postures[(self.pose == pose) & self.inside])

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


class InverseKinematics(ABC):
    """One way to solve for postures."""

    @abstractmethod
    def solve(
        self, T_base_tip: FloatArray, lower: FloatArray, upper: FloatArray, near: FloatArray
    ) -> InverseSolutions:
        """Postures for poses ``(N, 4, 4)``; full turns chosen inside limits ``(n,)`` near one."""


def nearest_turns(
    postures: FloatArray, lower: FloatArray, upper: FloatArray, near: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Shift each joint by full turns into its limits, as near to a reference as they allow.

    Parameters
    ----------
    postures : array (S, n)
        [rad]
    lower, upper, near : array (n,)
        Limits and reference posture [rad].

    Returns
    -------
    postures : array (S, n)
        The same arm positions. Where no turn of a joint fits, the one that breaks its limit least.
    inside : array (S,) of bool
    """
    turn = 2.0 * np.pi
    lowest = np.ceil((lower - LIMIT_TOLERANCE - postures) / turn)
    highest = np.floor((upper + LIMIT_TOLERANCE - postures) / turn)
    fits = lowest <= highest
    wanted = np.clip(np.round((near - postures) / turn), lowest, highest)
    # where none fits, lowest lands above the range and highest below it
    over, under = postures + turn * lowest - upper, lower - postures - turn * highest
    picked = postures + turn * np.where(fits, wanted, np.where(over < under, lowest, highest))
    return picked, np.asarray(fits.all(axis=-1))


def first_per_group(group: IntArray, cost: FloatArray, count: int) -> IntArray:
    """Index of the cheapest entry of each of ``count`` groups; -1 for an empty group."""
    order = np.lexsort((cost, group))
    first = np.full(count, -1, dtype=np.intp)
    groups, where = np.unique(group[order], return_index=True)
    first[groups] = order[where]
    return first


def pose_error(chain: SerialChain, postures: FloatArray, T_wanted: FloatArray) -> FloatArray:
    """Twist ``(..., 6)`` from where the tip is to where it should be: [m, rad], in base axes."""
    state = chain.forward(postures)
    turn = rotation_log(T_wanted[..., :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    return np.concatenate([T_wanted[..., :3, 3] - state.p_base_tip, turn], axis=-1)
