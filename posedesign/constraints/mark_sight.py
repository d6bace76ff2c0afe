"""Constraints on what an instrument around the arm sees of the tool's marks.

A tracker sees a reflector that faces it, in its range, with nothing in between; a wire or a ball
bar runs straight from its foot to the tool point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.geometry import Scene
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints.checker import ROUNDING, Constraint, Situation

CLEAR_OF_MARK_M = 0.025
"""Part of the line of sight next to a mark where nothing is looked for: it sits on the tool. The
ball of a 1.5 inch reflector has a radius of 19 mm."""

CLEAR_OF_INSTRUMENT_M = 2e-3
"""The same next to the instrument, which may stand on its support."""


@dataclass(frozen=True, eq=False)
class Mark:
    """A point of the tool that is measured."""

    name: str
    point_m: FloatArray  # (3,): in the axes of the tip
    axis: FloatArray | None = None
    """(3,): unit vector that it faces along, in these; None where it is seen from all around."""
    largest: float = np.pi
    """Angle between this and the line of sight up to which it is measured [rad]."""


class MarkSight(Constraint):
    """Enough marks of the tool, ``least``, face the instrument in its range, nothing in between.

    ``place_m (3,)``: of the instrument, or the foot of a bar or wire, in the base frame.
    """

    name = "marks in sight"
    hint_words = (
        "move the instrument (target.position_mm), or correct axis and largest_angle_deg of "
        "tool.mark, or nearest_mm and farthest_mm of the target"
    )
    measured = False

    def __init__(
        self,
        marks: Sequence[Mark],
        place_m: FloatArray,
        nearest_m: float,
        farthest_m: float,
        scene: Scene,
        least: int = 1,
    ) -> None:
        self.marks, self._place_m, self._scene = tuple(marks), place_m, scene
        self._nearest_m, self._farthest_m, self._least = nearest_m, farthest_m, least

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Infinite or -1; which: the mark that is next to be seen, and why it is not."""
        why = self._why_not(arm)
        seen = (why == _SEEN).sum(axis=1)
        # of those that are not seen the one that passes most of what is asked, first
        mark = np.argmax(np.where(why == _SEEN, -1, why), axis=1)
        which = mark * len(_REASONS) + why[np.arange(len(why)), mark]
        return np.where(seen >= self._least, np.inf, -1.0), which

    def seen(self, arm: Situation) -> BoolArray:
        """Which marks are seen, ``(S, K)``."""
        return np.asarray(self._why_not(arm) == _SEEN)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        if margin > 0:
            return "marks in sight"
        mark, why = divmod(which, len(_REASONS))
        away_m, angle = self._sight(arm.take(np.array([i])))
        return _REASONS[why].format(
            mark=self.marks[mark].name,
            away_mm=1e3 * away_m[0, mark],
            near_mm=1e3 * self._nearest_m,
            far_mm=1e3 * self._farthest_m,
            angle_deg=np.rad2deg(angle[0, mark]),
            largest_deg=np.rad2deg(self.marks[mark].largest),
        )

    def _sight(self, arm: Situation) -> tuple[FloatArray, FloatArray]:
        """Distance [m] and angle [rad] at which the instrument sees each mark, ``(S, K)``."""
        away, angle = np.empty((2, len(arm.q), len(self.marks)))
        for k, mark in enumerate(self.marks):
            sight = self._place_m - arm.state.point(mark.point_m)
            away[:, k] = np.linalg.norm(sight, axis=1)
            if mark.axis is None:
                angle[:, k] = 0.0
                continue
            faced = arm.state.R_base_tip @ mark.axis
            across = np.linalg.norm(np.cross(sight, faced), axis=1)
            angle[:, k] = np.arctan2(across, np.einsum("sk,sk->s", sight, faced))
        return away, angle

    def _why_not(self, arm: Situation) -> IntArray:
        """Index into the reasons why each mark is not seen ``(S, K)``, or :data:`_SEEN`."""
        away, angle = self._sight(arm)
        why = np.full(away.shape, _SEEN, dtype=np.intp)
        largest = np.array([mark.largest for mark in self.marks])
        why[angle > largest + ROUNDING] = _TURNED
        why[away > self._farthest_m + ROUNDING] = _FAR
        why[away < self._nearest_m - ROUNDING] = _NEAR
        if not self._scene.bodies:
            return why
        for k, mark in enumerate(self.marks):
            rows = np.flatnonzero(why[:, k] == _SEEN)
            if not len(rows):
                continue
            some = arm.take(rows)
            there = some.state.point(mark.point_m)
            along = (there - self._place_m) / np.maximum(away[rows, k, None], ROUNDING)
            seen = self._scene.sight(
                some.q,
                self._place_m + CLEAR_OF_INSTRUMENT_M * along,
                there - CLEAR_OF_MARK_M * along,
                state=some.state,
            )
            why[rows[~seen.clear], k] = _HIDDEN
        return why


_NEAR, _FAR, _TURNED, _HIDDEN, _SEEN = range(5)
_REASONS = (
    "{mark} {away_mm:.0f} mm from the instrument, nearest allowed {near_mm:.0f} mm",
    "{mark} {away_mm:.0f} mm from the instrument, farthest allowed {far_mm:.0f} mm",
    "{mark} seen at {angle_deg:.0f} deg from its axis, largest allowed {largest_deg:.0f} deg",
    "something stands between the instrument and {mark}",
    "{mark} in sight",
)
