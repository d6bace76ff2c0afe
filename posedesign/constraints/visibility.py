"""Constraints on what the camera on the tool sees of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.geometry import Scene
from calib.se3 import FloatArray, IntArray
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


@dataclass(frozen=True, eq=False)
class TargetView:
    """A camera on the tip and the target that it is to see.

    ``T_tip_camera`` (4, 4). ``target_m`` (3,): in the base frame. ``normal`` (3,): unit vector out
    of the face of the target, in base axes. ``radius_m``: of the target.
    """

    camera: PinholeCamera
    T_tip_camera: FloatArray
    target_m: FloatArray
    normal: FloatArray
    radius_m: float

    def lens(self, arm: Situation) -> FloatArray:
        """Where the lens is, ``(S, 3)`` [m] in the base frame."""
        return arm.state.point(self.T_tip_camera[:3, 3])

    def in_camera(self, arm: Situation, points: FloatArray) -> FloatArray:
        """Points ``(K, 3)`` of the base frame in the camera frame, ``(S, K, 3)`` [m]."""
        R_base_camera = arm.state.R_base_tip @ self.T_tip_camera[:3, :3]
        return (points - self.lens(arm)[:, None]) @ R_base_camera

    def circle(self, count: int, part: float = 1.0) -> FloatArray:
        """Centre of the target and points at a part of its radius, ``(K, 3)`` [m] in base axes."""
        if self.radius_m == 0.0:
            return self.target_m[None]
        across = np.linalg.svd(self.normal[None])[2][1:]  # two directions across the normal
        angle = np.arange(count) * 2.0 * np.pi / count
        around = part * self.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.vstack([self.target_m, self.target_m + around @ across])


class Distance(Constraint):
    """The target neither too near to the lens nor too far from it."""

    name = "camera distance"
    hint_words = "change camera.nearest_mm or camera.farthest_mm"
    unit = "mm"
    display = 1e3
    comfort = 0.05

    def __init__(self, view: TargetView, nearest_m: float, farthest_m: float) -> None:
        self._view = view
        self._nearest_m, self._farthest_m = nearest_m, farthest_m

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Which: 0 too near, 1 too far."""
        distance = np.linalg.norm(self._view.target_m - self._view.lens(arm), axis=1)
        both = np.stack([distance - self._nearest_m, self._farthest_m - distance], axis=1)
        which = np.argmin(both, axis=1)
        return both[np.arange(len(both)), which], which

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        bound = (self._nearest_m, self._farthest_m)[which]
        distance = bound + margin if which == 0 else bound - margin
        end = ("nearest", "farthest")[which]
        return f"target {distance * 1e3:.0f} mm from the camera, {end} allowed {bound * 1e3:.0f} mm"


class Tilt(Constraint):
    """The face of the target turned to the camera."""

    name = "tilt of the target"
    hint_words = "correct target.normal, or raise camera.largest_tilt_deg"
    unit = "deg"
    display = float(np.rad2deg(1.0))
    comfort = np.deg2rad(10.0)

    def __init__(self, view: TargetView, largest: float) -> None:
        self._view = view
        self._largest = largest

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """The angle between the normal and the way to the lens."""
        sight = self._view.lens(arm) - self._view.target_m
        cosine = sight @ self._view.normal
        across = np.linalg.norm(np.cross(sight, self._view.normal), axis=1)
        return self._largest - np.arctan2(across, cosine), np.zeros(len(sight), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        tilt, largest = np.rad2deg([self._largest - margin, self._largest])
        return f"target seen at a tilt of {tilt:.1f} deg, largest allowed {largest:g} deg"


class InImage(Constraint):
    """The whole target inside the image, less a border."""

    name = "image border"
    hint_words = "correct camera.position_mm, wpr_deg, focal_px or image_px, or lower border_px"
    unit = "px"
    display = 1.0
    comfort = 100.0

    def __init__(self, view: TargetView, border_px: float) -> None:
        self._view = view
        self._border_px = border_px

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Of what is behind the lens, by the angle off the axis."""
        points = self._view.in_camera(arm, self._view.circle(_RIM, 1.0 / np.cos(np.pi / _RIM)))
        margin = self._view.camera.margin_px(points).min(axis=1)
        behind = self._view.camera.focal_px * self._off_axis(arm)
        margin = np.where(np.isinf(margin), -behind, margin) - self._border_px
        return margin, np.zeros(len(margin), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        off_deg = float(np.rad2deg(self._off_axis(arm.take(np.array([i])))[0]))
        if off_deg >= 90.0:
            return f"the camera looks away from the target, by {off_deg:.0f} deg"
        edge = margin + self._border_px
        if edge < 0.0:
            return f"target {-edge:.0f} px outside the image"
        return f"target {edge:.0f} px from the edge of the image, border {self._border_px:g} px"

    def _off_axis(self, arm: Situation) -> FloatArray:
        """Angle between the optical axis and the way to the target ``(S,)`` [rad]."""
        target = self._view.in_camera(arm, self._view.target_m[None])[:, 0]
        return np.asarray(np.arctan2(np.hypot(target[:, 0], target[:, 1]), target[:, 2]))


class LineOfSight(Constraint):
    """Nothing between the lens and the target: its middle, and its rim, where it is measured."""

    name = "line of sight"
    hint_words = "move what stands there, or the camera"
    measured = False

    def __init__(self, view: TargetView, scene: Scene) -> None:
        self._view = view
        self._scene = scene

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """Infinite or -1; which: what is in the way."""
        lens = self._view.lens(arm)
        way = self._view.target_m - lens
        along = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), ROUNDING)
        start = lens + CLEAR_OF_LENS_M * along
        end = self._view.target_m - CLEAR_OF_TARGET_M * along
        around = self._view.circle(_SIGHT_RIM)[1:] - self._view.target_m
        seen = self._scene.sight(arm.q, start, end, around=around, state=arm.state)
        return np.where(seen.clear, np.inf, -1.0), np.maximum(seen.blocker, 0)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        if margin > 0:
            return "nothing in the line of sight"
        return f"{self._scene.bodies[which].name} stands between camera and target"
