"""Moving arms by their controllers: nominal postures, and lost motion taken up on arrival."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray, IntArray
from calib.visual.arms import Arms
from calib.visual.following import follow

Refuses = Callable[[FloatArray], list[str]]
"""Of postures ``(K, n)`` [rad], why each must not be taken; empty where it may."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Arms, and how they are moved.

    Attributes
    ----------
    robot : Robot
        Nominal: what the controller knows.
    arms : Arms
    approach_rad : float
        Every stop is reached by a last movement of this angle in all joints, always in the
        positive sense, so that backlash and friction leave the joints on the same side; 0 for
        none. It has to be more than the lost motion of a joint.
    refuses : callable, optional
        Asked before every move.
    """

    robot: Robot
    arms: Arms
    approach_rad: float = np.deg2rad(0.2)
    refuses: Refuses | None = None

    def to_posture(self, which: IntArray, q: FloatArray) -> list[str]:
        """Move arms ``(K,)`` to postures ``(K, n)`` [rad]; of each, why it was not moved."""
        reasons = [""] * len(q) if self.refuses is None else self.refuses(q)
        free = np.array([not reason for reason in reasons], dtype=bool)
        if free.any():
            if self.approach_rad > 0.0:
                before = np.maximum(q[free] - self.approach_rad, self.robot.lower)
                self.arms.move(which[free], before)
            self.arms.move(which[free], q[free])
        return reasons

    def to_pose(self, which: IntArray, q: FloatArray, T_wanted: FloatArray) -> list[str]:
        """Move the nominal tip from postures ``(K, n)`` [rad] to poses ``(K, 4, 4)``."""
        postures, found = follow(self.robot, q, T_wanted)
        reasons = ["" if ok else "joint limits or a singularity are in the way" for ok in found]
        moved = np.flatnonzero(found)
        for k, reason in zip(moved, self.to_posture(which[moved], postures[moved]), strict=True):
            reasons[k] = reason
        return reasons
