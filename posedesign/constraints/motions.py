"""The straight joint-space ways between postures: what a joint move of the robot passes through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import BoolArray, FloatArray
from posedesign.constraints.constraint import ROUNDING
from posedesign.constraints.space import Collision


@dataclass(frozen=True, eq=False)
class WayVerdicts:
    """What is to be said of the ways from one posture to another.

    Attributes
    ----------
    clear : array (W,) of bool
    travel : array (W,)
        Largest joint travel [rad].
    part : array (W,)
        Where on the way something is in the way, from 0 at its start to 1; NaN where nothing is.
    reasons : tuple of str
        Empty where the way is clear.
    """

    clear: BoolArray
    travel: FloatArray
    part: FloatArray
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class WayChecker:
    """Bounds on ways: distances that are kept all along, and how far a joint may travel.

    Attributes
    ----------
    collisions : tuple of Collision
        Each with its bodies and the distance they keep; none: ways are not checked for them.
    largest_travel : float
        [rad]; infinite for no bound.
    """

    collisions: tuple[Collision, ...]
    largest_travel: float

    def steps(self, start: FloatArray, end: FloatArray) -> int:
        """Number of moves that the way between two postures ``(n,)`` [rad] takes."""
        return int(self.steps_of(np.abs(end - start).max()))

    def steps_of(self, travel: FloatArray) -> FloatArray:
        """Number of moves, a whole one, of ways by their largest joint travel ``(...)`` [rad]."""
        return np.asarray(np.maximum(1.0, np.ceil((travel - ROUNDING) / self.largest_travel)))

    def check(self, start: FloatArray, end: FloatArray, *, far: bool = False) -> WayVerdicts:
        """Verdicts on ways from postures ``(W, n)`` to postures ``(W, n)`` [rad].

        With ``far``, joints may travel as far as they like: there will be stops on the way.
        """
        moves = np.abs(end - start)
        travel = moves.max(axis=1, initial=0.0)
        clear = (travel <= self.largest_travel + ROUNDING) | far
        reasons, part = [""] * len(start), np.full(len(start), np.nan)
        for i in np.flatnonzero(~clear).tolist():
            degrees = np.rad2deg([travel[i], self.largest_travel])
            reasons[i] = (
                f"J{int(np.argmax(moves[i])) + 1} travels {degrees[0]:.0f} deg, "
                f"{degrees[1]:g} deg allowed"
            )
        for collision in self.collisions:
            rows = np.flatnonzero(clear)
            ways = collision.scene.ways(start[rows], end[rows], collision.keep_m)
            clear[rows] = ways.clear
            for i in np.flatnonzero(~ways.clear).tolist():
                said = collision.explain(float(ways.distance_m[i]), int(ways.pair[i]))
                reasons[rows[i]], part[rows[i]] = said, ways.part[i]
        return WayVerdicts(clear, travel, part, tuple(reasons))
