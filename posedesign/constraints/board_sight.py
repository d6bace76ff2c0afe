"""Constraints on what a camera sees of a calibration board: enough of it, near and square enough.

One of the two is on the tip, the other stands around the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.geometry import Scene
from calib.lens import Lens
from calib.model.measurements.board_view import Carried
from calib.se3 import FloatArray, IntArray, apply, inverse
from posedesign.constraints.checker import Constraint, Situation
from posedesign.constraints.visibility import (
    CLEAR_OF_LENS_M,
    CLEAR_OF_TARGET_M,
    Distance,
    InImage,
    LineOfSight,
    Tilt,
)

_AT_ONCE = 200_000
"""Points that are projected at once: some 50 MB."""


@dataclass(frozen=True, eq=False)
class BoardSight:
    """A camera and a board, one of them on the tip."""

    lens: Lens
    points: FloatArray  # (K, 3): what of the board has to be seen, in its frame [m]
    outline: FloatArray  # (4, 3): corners of what is printed, in order
    T_tip_own: FloatArray
    T_base_other: FloatArray
    """T_tip_own, T_base_other (4, 4): camera and board, or board and camera."""
    carried: Carried  # what is on the tip

    @cached_property
    def rim(self) -> FloatArray:
        """Middle, corners and middles of the sides of the print ``(9, 3)`` [m], board's frame."""
        corners = self.outline
        sides = (corners + np.roll(corners, -1, axis=0)) / 2.0
        return np.vstack([corners.mean(axis=0), corners, sides])

    def poses(self, arm: Situation) -> FloatArray:
        """Poses of the board in the camera's frame ``(S, 4, 4)``."""
        T_base_own = arm.state.T_base_tip @ self.T_tip_own
        if self.carried == "camera":
            return np.asarray(inverse(T_base_own) @ self.T_base_other)
        return np.asarray(inverse(self.T_base_other) @ T_base_own)

    def in_camera(self, arm: Situation, points: FloatArray) -> FloatArray:
        """Points ``(K, 3)`` of the board in the camera's frame, ``(S, K, 3)`` [m]."""
        T = self.poses(arm)
        return np.asarray(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])

    def cameras(self, arm: Situation) -> FloatArray:
        """Poses of the camera in the base frame ``(S, 4, 4)``."""
        if self.carried == "camera":
            return np.asarray(arm.state.T_base_tip @ self.T_tip_own)
        return np.broadcast_to(self.T_base_other, (len(arm.q), 4, 4))

    def margins_px(self, in_camera: FloatArray) -> FloatArray:
        """Distances ``(S, K)`` [px] of points in the camera's frame from the edge of the image.

        Negative outside; of what the lens does not show, by the angle off the axis.
        """
        lens = self.lens
        size = np.array([lens.width_px, lens.height_px], dtype=float)
        pixels = lens.project(in_camera)
        margin = np.minimum(pixels, size - pixels).min(axis=-1)
        across = np.hypot(in_camera[..., 0], in_camera[..., 1])
        depth = in_camera[..., 2]
        unseen = ~(across <= lens.steepest * depth) | np.isnan(margin)
        return np.asarray(np.where(unseen, -lens.values[0] * np.arctan2(across, depth), margin))

    def off_axis(self, arm: Situation) -> FloatArray:
        """Angle between the optical axis and the way to the middle of the board ``(S,)`` [rad]."""
        x, y, z = self.in_camera(arm, self.rim[:1])[:, 0].T
        return np.asarray(np.arctan2(np.hypot(x, y), z))


class BoardDistance(Distance):
    """All of the board neither too near to the lens nor too far from it."""

    def __init__(self, sight: BoardSight, nearest_m: float, farthest_m: float) -> None:
        self._sight = sight
        self._nearest_m, self._farthest_m = nearest_m, farthest_m

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: 0 too near, 1 too far."""
        distance = np.linalg.norm(self._sight.in_camera(arm, self._sight.rim), axis=2)
        near, far = distance.min(axis=1), distance.max(axis=1)
        both = np.stack([near - self._nearest_m, self._farthest_m - far], axis=1)
        which = np.argmin(both, axis=1)
        return both[np.arange(len(both)), which], which

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        return super().reason(arm, i, margin, which).replace("target", "board", 1)


class BoardTilt(Tilt):
    """The face of the board turned to the camera."""

    name = "tilt of the board"

    def __init__(self, sight: BoardSight, largest: float) -> None:
        self._sight = sight
        self._largest = largest

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """The angle between the normal and the way from the middle to the lens."""
        T = self._sight.poses(arm)
        middle = self._sight.in_camera(arm, self._sight.rim[:1])[:, 0]
        into = T[:, :3, 2]  # z of a board points away from who looks at it
        across = np.linalg.norm(np.cross(middle, into), axis=1)
        tilt = np.arctan2(across, np.einsum("sk,sk->s", middle, into))
        return self._largest - tilt, np.zeros(len(T), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        return super().reason(arm, i, margin, which).replace("target", "board", 1)


class BoardInImage(InImage):
    """Enough points of the board inside the image, less a border."""

    hint_words = (
        "correct camera.position_mm, wpr_deg, focal_px or image_px, move the board away from the "
        "lens, or take a smaller one"
    )

    def __init__(self, sight: BoardSight, border_px: float, share: float) -> None:
        self._sight = sight
        self._border_px = border_px
        self._count = int(np.ceil(share * len(sight.points) - 1e-9))

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Of the last point that is needed."""
        sight = self._sight
        found = np.empty(len(arm.q))
        step = max(1, _AT_ONCE // len(sight.points))
        for first in range(0, len(found), step):
            rows = np.arange(first, min(first + step, len(found)))
            margins = sight.margins_px(sight.in_camera(arm.take(rows), sight.points))
            last = len(sight.points) - self._count
            found[rows] = np.partition(margins, last, axis=1)[:, last]
        return found - self._border_px, np.zeros(len(found), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        sight, one = self._sight, arm.take(np.array([i]))
        off_deg = float(np.rad2deg(sight.off_axis(one)[0]))
        if off_deg >= 90.0:
            return f"the camera looks away from the board, by {off_deg:.0f} deg"
        inside = sight.margins_px(sight.in_camera(one, sight.points))[0] >= self._border_px
        return (
            f"{int(inside.sum())} of {inside.size} points of the board in the image less a border "
            f"of {self._border_px:g} px, {self._count} needed"
        )


class BoardLineOfSight(LineOfSight):
    """Nothing between the lens and the board: its middle, and its outline."""

    def __init__(self, sight: BoardSight, scene: Scene) -> None:
        self._sight = sight
        self._scene = scene

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Infinite or -1; which: what is in the way."""
        cameras = self._sight.cameras(arm)
        lens = cameras[:, :3, 3]
        blocker = np.full(len(lens), -1, dtype=np.intp)
        for point in self._sight.rim:
            rows = np.flatnonzero(blocker < 0)
            if not len(rows):
                break
            some = arm.take(rows)
            end = apply(cameras[rows], self._sight.in_camera(some, point[None])[:, 0])
            way = end - lens[rows]
            along = way / np.linalg.norm(way, axis=1, keepdims=True)
            seen = self._scene.sight(
                some.q,
                lens[rows] + CLEAR_OF_LENS_M * along,
                end - CLEAR_OF_TARGET_M * along,
                state=some.state,
            )
            blocker[rows] = seen.blocker
        return np.where(blocker < 0, np.inf, -1.0), np.maximum(blocker, 0)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        return super().reason(arm, i, margin, which).replace("target", "board", 1)


def sight_constraints(
    sight: BoardSight,
    scene: Scene,
    *,
    nearest_m: float,
    farthest_m: float,
    largest_tilt: float,
    border_px: float,
    share: float,
) -> list[Constraint]:
    """All of them, the costly ones last; the line of sight where there are bodies."""
    found: list[Constraint] = [
        BoardDistance(sight, nearest_m, farthest_m),
        BoardTilt(sight, largest_tilt),
        BoardInImage(sight, border_px, share),
    ]
    return [*found, BoardLineOfSight(sight, scene)] if scene.bodies else found
