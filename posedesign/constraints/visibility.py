"""Constraints on what a camera sees of its target, or of a board: near, square and free enough.

Of camera and target the camera is on the tip; of camera and board either is, and the other stands
around the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.geometry import Scene
from calib.lens import Lens
from calib.model.measurements.board_view import Carried
from calib.se3 import FloatArray, IntArray, apply, inverse
from calib.vision.camera import PinholeCamera
from posedesign.constraints.checker import ROUNDING, Constraint, Situation

_RIM = 8
"""Points of the target's rim that must be in the image: the corners of an octagon about it."""

_SIGHT_RIM = 24
"""Points of the rim that lines of sight lead to: what covers a part of the target and is wider than
an eighth of it meets one."""

CLEAR_OF_LENS_M = 1e-3
CLEAR_OF_TARGET_M = 2e-3
"""Parts of the line of sight, next to the lens and to the target, where nothing is looked for: the
lens sits in the front of its camera, and the target on the face of its fixture."""

_AT_ONCE = 200_000
"""Points that are projected at once: some 50 MB."""


@dataclass(frozen=True, eq=False)
class TargetView:
    """A camera on the tip and the round target that it is to see, in the base frame."""

    camera: PinholeCamera
    T_tip_camera: FloatArray
    target_m: FloatArray  # (3,)
    normal: FloatArray  # (3,): unit vector out of its face
    radius_m: float

    what: ClassVar = "target"
    image_hint: ClassVar = (
        "correct camera.position_mm, wpr_deg, focal_px or image_px, or lower border_px"
    )

    @property
    def in_range(self) -> FloatArray:
        """Points ``(K, 3)`` [m] whose distances from the lens are bounded, the middle first."""
        return self.target_m[None]

    def _lens(self, arm: Situation) -> FloatArray:
        return arm.state.point(self.T_tip_camera[:3, 3])

    def _axes(self, arm: Situation) -> FloatArray:
        return np.asarray(arm.state.R_base_tip @ self.T_tip_camera[:3, :3])

    def in_camera(self, arm: Situation, points: FloatArray) -> FloatArray:
        """Points ``(K, 3)`` in the frame of the camera, ``(S, K, 3)`` [m]."""
        return np.asarray((points - self._lens(arm)[:, None]) @ self._axes(arm))

    def into(self, arm: Situation) -> FloatArray:
        """Unit vectors ``(S, 3)`` into the face, in camera axes."""
        return np.asarray(-self.normal @ self._axes(arm))

    def circle(self, count: int, part: float = 1.0) -> FloatArray:
        """Centre of the target and points at a part of its radius, ``(K, 3)`` [m] in base axes."""
        if self.radius_m == 0.0:
            return self.target_m[None]
        across = np.linalg.svd(self.normal[None])[2][1:]  # two directions across the normal
        angle = np.arange(count) * 2.0 * np.pi / count
        around = part * self.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.vstack([self.target_m, self.target_m + around @ across])

    def image_margin(self, arm: Situation) -> FloatArray:
        """Distance ``(S,)`` [px] of the last point that is needed from the edge of the image.

        Of what is behind the lens by the angle off the axis.
        """
        points = self.in_camera(arm, self.circle(_RIM, 1.0 / np.cos(np.pi / _RIM)))
        margin = self.camera.margin_px(points).min(axis=1)
        behind = self.camera.focal_px * _off_axis(self, arm)
        return np.where(np.isinf(margin), -behind, margin)

    def image_reason(self, arm: Situation, edge_px: float, border_px: float) -> str:
        """In words, how one posture has it in the image."""
        if edge_px < 0.0:
            return f"target {-edge_px:.0f} px outside the image"
        return f"target {edge_px:.0f} px from the edge of the image, border {border_px:g} px"

    def blockers(self, arm: Situation, scene: Scene) -> IntArray:
        """The first body, its row or -1, in the way from the lens to the middle and rim (S,)."""
        start, end = _shortened(self._lens(arm), self.target_m)
        around = self.circle(_SIGHT_RIM)[1:] - self.target_m
        return scene.sight(arm.q, start, end, around=around, state=arm.state).blocker


@dataclass(frozen=True, eq=False)
class BoardSight:
    """A camera and a board, one of them on the tip; points are in the frame of the board."""

    lens: Lens
    points: FloatArray  # (K, 3): what of the board has to be seen [m]
    outline: FloatArray  # (4, 3): corners of what is printed, in order
    T_tip_own: FloatArray
    T_base_other: FloatArray
    """T_tip_own, T_base_other (4, 4): camera and board, or board and camera."""
    carried: Carried  # what is on the tip
    share: float = 1.0  # of the points that has to be in the image

    what: ClassVar = "board"
    image_hint: ClassVar = (
        "correct camera.position_mm, wpr_deg, focal_px or image_px, move the board away from the "
        "lens, or take a smaller one"
    )

    @cached_property
    def in_range(self) -> FloatArray:
        """Middle, corners and middles of the sides of the print ``(9, 3)`` [m]."""
        corners = self.outline
        sides = (corners + np.roll(corners, -1, axis=0)) / 2.0
        return np.vstack([corners.mean(axis=0), corners, sides])

    @cached_property
    def _needed(self) -> int:
        return int(np.ceil(self.share * len(self.points) - 1e-9))

    def _poses(self, arm: Situation) -> FloatArray:
        """Poses of the board in the camera's frame ``(S, 4, 4)``."""
        T_base_own = arm.state.T_base_tip @ self.T_tip_own
        if self.carried == "camera":
            return np.asarray(inverse(T_base_own) @ self.T_base_other)
        return np.asarray(inverse(self.T_base_other) @ T_base_own)

    def in_camera(self, arm: Situation, points: FloatArray) -> FloatArray:
        T = self._poses(arm)
        return np.asarray(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])

    def into(self, arm: Situation) -> FloatArray:
        return np.asarray(self._poses(arm)[:, :3, 2])  # z points away from who looks at a board

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

    def image_margin(self, arm: Situation) -> FloatArray:
        found = np.empty(len(arm.q))
        step = max(1, _AT_ONCE // len(self.points))
        last = len(self.points) - self._needed
        for first in range(0, len(found), step):
            rows = np.arange(first, min(first + step, len(found)))
            margins = self.margins_px(self.in_camera(arm.take(rows), self.points))
            found[rows] = np.partition(margins, last, axis=1)[:, last]
        return found

    def image_reason(self, arm: Situation, edge_px: float, border_px: float) -> str:
        inside = self.margins_px(self.in_camera(arm, self.points))[0] >= border_px
        return (
            f"{int(inside.sum())} of {inside.size} points of the board in the image less a border "
            f"of {border_px:g} px, {self._needed} needed"
        )

    def blockers(self, arm: Situation, scene: Scene) -> IntArray:
        cameras = np.broadcast_to(self.T_base_other, (len(arm.q), 4, 4))
        if self.carried == "camera":
            cameras = arm.state.T_base_tip @ self.T_tip_own
        blocker = np.full(len(cameras), -1, dtype=np.intp)
        for point in self.in_range:
            rows = np.flatnonzero(blocker < 0)
            if not len(rows):
                break
            some = arm.take(rows)
            there = apply(cameras[rows], self.in_camera(some, point[None])[:, 0])
            start, end = _shortened(cameras[rows, :3, 3], there)
            blocker[rows] = scene.sight(some.q, start, end, state=some.state).blocker
        return blocker


Sight = TargetView | BoardSight
"""A camera and what it is to see, whose points are in a frame of its own."""


def _off_axis(sight: Sight, arm: Situation) -> FloatArray:
    """Angle between the optical axis and the way to the middle ``(S,)`` [rad]."""
    x, y, z = sight.in_camera(arm, sight.in_range[:1])[:, 0].T
    return np.asarray(np.arctan2(np.hypot(x, y), z))


def _shortened(lens: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lines of sight ``(S, 3)`` to ``(S, 3)`` or ``(3,)`` [m] without their ends on the solids."""
    way = end - lens
    along = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), ROUNDING)
    return lens + CLEAR_OF_LENS_M * along, end - CLEAR_OF_TARGET_M * along


class Distance(Constraint):
    """What is to be seen neither too near to the lens nor too far from it."""

    name = "camera distance"
    hint_words = "change camera.nearest_mm or camera.farthest_mm"
    unit = "mm"
    display = 1e3
    comfort = 0.05

    def __init__(self, sight: Sight, nearest_m: float, farthest_m: float) -> None:
        self._sight = sight
        self._nearest_m, self._farthest_m = nearest_m, farthest_m

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: 0 too near, 1 too far."""
        away = np.linalg.norm(self._sight.in_camera(arm, self._sight.in_range), axis=2)
        near, far = away.min(axis=1) - self._nearest_m, self._farthest_m - away.max(axis=1)
        return np.minimum(near, far), (far < near).astype(np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        bound = (self._nearest_m, self._farthest_m)[which]
        distance = bound + margin if which == 0 else bound - margin
        return (
            f"{self._sight.what} {distance * 1e3:.0f} mm from the camera, "
            f"{('nearest', 'farthest')[which]} allowed {bound * 1e3:.0f} mm"
        )


class Tilt(Constraint):
    """The face of what is to be seen turned to the camera."""

    hint_words = "correct target.normal, or raise camera.largest_tilt_deg"
    unit = "deg"
    display = float(np.rad2deg(1.0))
    comfort = np.deg2rad(10.0)

    def __init__(self, sight: Sight, largest: float) -> None:
        self.name = f"tilt of the {sight.what}"
        self._sight, self._largest = sight, largest

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """The angle between the normal and the way from the middle to the lens."""
        middle = self._sight.in_camera(arm, self._sight.in_range[:1])[:, 0]
        into = self._sight.into(arm)
        across = np.linalg.norm(np.cross(middle, into), axis=1)
        tilt = np.arctan2(across, np.einsum("sk,sk->s", middle, into))
        return self._largest - tilt, np.zeros(len(tilt), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        tilt, largest = np.rad2deg([self._largest - margin, self._largest])
        seen = f"{self._sight.what} seen at a tilt of {tilt:.1f} deg"
        return f"{seen}, largest allowed {largest:g} deg"


class InImage(Constraint):
    """What is to be seen inside the image, less a border."""

    name = "image border"
    unit = "px"
    display = 1.0
    comfort = 100.0

    def __init__(self, sight: Sight, border_px: float) -> None:
        self.hint_words = sight.image_hint
        self._sight, self._border_px = sight, border_px

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        margin = self._sight.image_margin(arm) - self._border_px
        return margin, np.zeros(len(margin), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        one = arm.take(np.array([i]))
        off_deg = float(np.rad2deg(_off_axis(self._sight, one)[0]))
        if off_deg >= 90.0:
            return f"the camera looks away from the {self._sight.what}, by {off_deg:.0f} deg"
        return self._sight.image_reason(one, margin + self._border_px, self._border_px)


class LineOfSight(Constraint):
    """Nothing between the lens and what is to be seen: its middle, and its rim."""

    name = "line of sight"
    hint_words = "move what stands there, or the camera"
    measured = False

    def __init__(self, sight: Sight, scene: Scene) -> None:
        self._sight, self._scene = sight, scene

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Infinite or -1; which: what is in the way."""
        blocker = self._sight.blockers(arm, self._scene)
        return np.where(blocker < 0, np.inf, -1.0), np.maximum(blocker, 0)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        if margin > 0:
            return "nothing in the line of sight"
        body = self._scene.bodies[which].name
        return f"{body} stands between camera and {self._sight.what}"


def sight_constraints(
    sight: Sight,
    scene: Scene,
    *,
    nearest_m: float,
    farthest_m: float,
    largest_tilt: float,
    border_px: float,
) -> list[Constraint]:
    """All of them, the costly ones last; the line of sight where there are bodies."""
    found: list[Constraint] = [
        Distance(sight, nearest_m, farthest_m),
        Tilt(sight, largest_tilt),
        InImage(sight, border_px),
    ]
    return [*found, LineOfSight(sight, scene)] if scene.bodies else found
