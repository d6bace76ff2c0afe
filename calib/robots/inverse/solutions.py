"""Inverse kinematics: poses in, for each pose every posture that takes it.

What solvers have in common: their interface and their answer. Six-axis arms are solved in closed
form (:mod:`calib.robots.inverse.closed_form`), seven-axis arms by closed forms along their
redundant joint (:mod:`calib.robots.inverse.redundant`), and what has no closed form by damped
iteration (:mod:`calib.robots.inverse.iterative`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.robots.bounds import (
    LIMIT_TOLERANCE,
    Bounds,
    first_per_group,
    nearest_turns,
    turned_inside,
)
from calib.robots.chain import ChainState, SerialChain
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_log

__all__ = [
    "CLOSURE_TOLERANCE",
    "LIMIT_TOLERANCE",
    "NEAR_SINGULAR",
    "Bounds",
    "InverseKinematics",
    "InverseSolutions",
    "NoPosture",
    "first_per_group",
    "nearest_turns",
    "pose_error",
    "singular_postures",
    "twist_to",
]

CLOSURE_TOLERANCE = 1e-9
"""Largest distance [m] and angle [rad] between the pose asked for and the one a posture takes.
Closed forms reach 1e-12; what is farther off is a least-squares compromise, not a solution."""

NEAR_SINGULAR = 0.01
"""Smallest singular value of the tip's Jacobian, its linear rows divided by the arm's reach, below
which a posture counts as near a singularity. There some joint turns a hundred times as far as the
tip does: at the 100 to 200 deg/s of an industrial joint the tip creeps at 1 to 2 deg/s, and an
error of the pose of 0.01 deg is one of 1 deg in the joint. With the spherical wrist of an
R-2000iC that is every posture with abs(q5) < 0.8 deg, and four of five at 2 deg."""

_AT_ONCE = 20_000
"""Jacobians decomposed at once: 10 MB."""


@dataclass(frozen=True)
class NoPosture:
    """Why no posture inside the limits takes a pose.

    Attributes
    ----------
    gap_m : float
        Distance to the nearest point the arm reaches [m]: zero where it is the limits that are in
        the way, NaN where it is not known.
    joint : int or None
        Joint (from zero) that the least offending posture brings farthest beyond its limits.
    coupled : str or None
        Name of the coupled limit, where it is one of these that is broken farthest.
    excess_rad : float
        How far beyond; NaN where no posture takes the pose at all.
    """

    gap_m: float
    joint: int | None
    coupled: str | None
    excess_rad: float


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
        Whether the posture lies inside the limits it was solved for, those that joints have
        together included. Where a joint has no full turn inside them, the turn that breaks them
        least is given.
    gap_m : array (N,)
        Distance from each pose to the nearest point the arm reaches: zero where there is a
        solution, NaN where it is not known.
    near : array (n,)
        Posture that full turns were chosen near to [rad].
    bounds : Bounds
        The limits it was solved for.
    chain : SerialChain
        The arm it was solved for.
    """

    postures: FloatArray
    pose: IntArray
    inside: BoolArray
    gap_m: FloatArray
    near: FloatArray
    bounds: Bounds
    chain: SerialChain

    @cached_property
    def singular(self) -> BoolArray:
        """Whether each posture is near a singularity, ``(S,)``: see :data:`NEAR_SINGULAR`."""
        return singular_postures(self.chain, self.postures)

    def of(self, pose: int) -> FloatArray:
        """Postures ``(K, n)`` [rad] inside the limits that take one pose."""
        first, last = np.searchsorted(self.pose, [pose, pose + 1])
        return np.asarray(self.postures[first:last][self.inside[first:last]])

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

    def reason(self, pose: int) -> NoPosture | None:
        """Why a pose has no posture inside the limits; None where it has one."""
        first, last = np.searchsorted(self.pose, [pose, pose + 1])
        if self.inside[first:last].any():
            return None
        if first == last:
            return NoPosture(float(self.gap_m[pose]), None, None, np.nan)
        excess = self.bounds.excess(self.postures[first:last])
        best = excess[int(np.argmin(excess.max(axis=1)))]
        worst, n = int(np.argmax(best)), self.postures.shape[1]
        together = worst - n
        return NoPosture(
            gap_m=float(self.gap_m[pose]),
            joint=worst if together < 0 else None,
            coupled=None if together < 0 else self.bounds.coupled[together].name,
            excess_rad=float(best[worst]),
        )


class InverseKinematics(ABC):
    """One way to solve for postures."""

    def __init__(self, chain: SerialChain) -> None:
        self._chain = chain

    @abstractmethod
    def solve(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray, every_turn: bool = False
    ) -> InverseSolutions:
        """Postures inside bounds for poses ``(N, 4, 4)``.

        Full turns are chosen nearest to a posture ``near`` ``(n,)`` [rad], or all are given.
        """

    def _answer(
        self,
        postures: FloatArray,
        pose: IntArray,
        gap_m: FloatArray,
        bounds: Bounds,
        near: FloatArray,
        every_turn: bool,
    ) -> InverseSolutions:
        """What :meth:`solve` returns, of postures in any turn."""
        postures, pose, inside = turned_inside(postures, pose, bounds, near, every_turn)
        return InverseSolutions(postures, pose, inside, gap_m, near, bounds, self._chain)


def singular_postures(chain: SerialChain, postures: FloatArray) -> BoolArray:
    """Whether postures ``(S, n)`` [rad] are near a singularity: see :data:`NEAR_SINGULAR`.

    An arm of fewer than six joints is judged by what its joints can do.
    """
    smallest = np.empty(len(postures))
    for start in range(0, len(postures), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        smallest[part] = chain.smallest_singular_values(chain.forward(postures[part]))
    return np.asarray(smallest < NEAR_SINGULAR)


def pose_error(chain: SerialChain, postures: FloatArray, T_wanted: FloatArray) -> FloatArray:
    """Twist ``(..., 6)`` from where the tip is to where it should be: [m, rad], in base axes."""
    return twist_to(chain.forward(postures), T_wanted)


def twist_to(state: ChainState, T_wanted: FloatArray) -> FloatArray:
    """Twist ``(..., 6)`` from the tip of a state to wanted poses: see :func:`pose_error`."""
    turn = rotation_log(T_wanted[..., :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    return np.concatenate([T_wanted[..., :3, 3] - state.p_base_tip, turn], axis=-1)
