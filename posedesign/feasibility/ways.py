"""The straight joint-space ways between postures: what a joint move of the robot passes through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.geometry.scene import Scene
from calib.se3 import BoolArray, FloatArray
from posedesign.feasibility.constraint import ROUNDING
from posedesign.feasibility.space import distance_reason


@dataclass(frozen=True, eq=False)
class WayVerdicts:
    """What is to be said of the ways from one posture to another.

    Attributes
    ----------
    clear : array (W,) of bool
    travel : array (W,)
        Largest joint travel [rad].
    reasons : tuple of str
        Empty where the way is clear.
    """

    clear: BoolArray
    travel: FloatArray
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class WayChecker:
    """Bounds on ways: a safety distance all along, and how far a joint may travel.

    Attributes
    ----------
    scene : Scene or None
        None: ways are not checked for collisions.
    keep_m : float
        Safety distance [m].
    largest_travel : float
        [rad]; infinite for no bound.
    """

    scene: Scene | None
    keep_m: float
    largest_travel: float

    def check(self, start: FloatArray, end: FloatArray) -> WayVerdicts:
        """Verdicts on ways from postures ``(W, n)`` to postures ``(W, n)`` [rad]."""
        moves = np.abs(end - start)
        travel = moves.max(axis=1, initial=0.0)
        far = travel > self.largest_travel + ROUNDING
        clear = ~far
        reasons = [""] * len(start)
        for i in np.flatnonzero(far):
            degrees = np.rad2deg([travel[i], self.largest_travel])
            reasons[i] = (
                f"J{int(np.argmax(moves[i])) + 1} travels {degrees[0]:.0f} deg, "
                f"{degrees[1]:g} deg allowed"
            )
        rows = np.flatnonzero(clear)
        if self.scene is not None and len(rows):
            found = self.scene.ways(start[rows], end[rows], self.keep_m)
            clear[rows] = found.clear
            for i, row in enumerate(rows):
                if not found.clear[i]:
                    said = distance_reason(
                        self.scene, float(found.distance_m[i]), int(found.pair[i]), self.keep_m
                    )
                    reasons[row] = f"{said}, at {found.part[i]:.0%} of the way"
        return WayVerdicts(clear, travel, tuple(reasons))
