"""The target of visual touch-up: a circle with a cross in it, on a plate, and its pose in an image.

The pose is that of all edges of the pattern at once. A corner that is found by itself is moved by
the blur, by 0.15 px with a blur of one pixel: enough for half a millimetre of depth. The edges
between the corners are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib import se3
from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import circle_image, circle_poses
from calib.vision.camera.edges import steps_along
from calib.vision.camera.ellipse import measure_ellipse
from calib.vision.camera.lens import Camera
from calib.vision.camera.rendering import GreyImage
from calib.vision.camera.target_pose import TargetPose

SMALLEST_PX = 10.0
"""Short axis of the smallest target that is measured."""


@dataclass(frozen=True)
class CircleTarget:
    """A circle with a cross in its middle, on a rectangular plate.

    The target frame has its origin in the middle of circle and plate, x and y along the sides of
    the plate and along the bars of the cross, and z out of the face.
    """

    diameter_m: float = 0.020  # of the circle
    plate_m: tuple[float, float] = (0.040, 0.040)  # size of the plate along x and y
    cross_length_m: float = 0.012
    cross_width_m: float = 0.002
    """cross_length_m, cross_width_m: length and width of the two bars of the cross. It ends inside
    the circle, so the contour of the circle is whole; a length of 0 leaves the cross out."""
    circle: float = 0.08
    face: float = 0.85
    """circle, face: reflectance (0 black, 1 white) of the circle, and of plate and cross. A light
    circle with a dark cross on a dark plate has ``circle > face``."""

    is_known: ClassVar[bool] = False
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 0.0 < self.diameter_m < min(self.plate_m):
            self._refuse("diameter_m", "give a positive one that the plate has room for")
        if not 0.0 <= self.cross_length_m < self.diameter_m:
            self._refuse("cross_length_m", "the cross must end inside the circle")
        if self.cross_length_m > 0.0 and not 0.0 < self.cross_width_m < self.cross_length_m:
            self._refuse("cross_width_m", "the bars of a cross are longer than they are wide")
        for name in ("circle", "face"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                self._refuse(name, "reflectances lie between 0 and 1")
        if self.circle == self.face:
            self._refuse("circle", "circle and face must differ in reflectance")

    @property
    def is_dark(self) -> bool:
        """Whether the circle is darker than the plate about it."""
        return self.circle < self.face

    def measure(
        self, image: GreyImage, near_px: FloatArray | None = None
    ) -> tuple[FloatArray, str]:
        found = measure_ellipse(image, dark=self.is_dark, smallest_px=SMALLEST_PX, near_px=near_px)
        if found.is_ok:
            return found.ellipse, ""
        return np.full(5, np.nan), f"{found.status}: {found.message}"

    def image(
        self, camera: Camera, T_camera_target: FloatArray, diameter_m: float | None = None
    ) -> FloatArray:
        return circle_image(
            camera, self.diameter_m if diameter_m is None else diameter_m, T_camera_target
        )

    def pose(self, camera: Camera, image: GreyImage, about: FloatArray) -> FloatArray | None:
        """See :meth:`~calib.vision.camera.observers.Target.pose`: by all edges."""
        found = [pose_from_image(camera, self, image, T) for T in about]
        good = [pose for pose in found if pose.is_ok]
        return min(good, key=lambda pose: pose.rms_px).T_camera_target if good else None

    def on_plate(self, xy: FloatArray) -> BoolArray:
        """Whether points ``(..., 2)`` [m] of the target's plane lie on the plate ``(...)``."""
        width, height = self.plate_m
        return np.asarray((np.abs(xy[..., 0]) <= width / 2) & (np.abs(xy[..., 1]) <= height / 2))

    def pattern(self, xy: FloatArray) -> FloatArray:
        """Reflectance ``(...)`` at points ``(..., 2)`` [m] of the target's plane; NaN off it."""
        x, y = np.abs(xy[..., 0]), np.abs(xy[..., 1])
        inside = x * x + y * y <= (self.diameter_m / 2) ** 2
        if self.cross_length_m > 0.0:
            half_length, half_width = self.cross_length_m / 2, self.cross_width_m / 2
            longer, shorter = np.maximum(x, y), np.minimum(x, y)
            inside &= (longer > half_length) | (shorter > half_width)
        reflectance = np.where(inside, self.circle, self.face)
        reflectance[~self.on_plate(xy)] = np.nan
        return reflectance

    def plate_corners(self) -> FloatArray:
        """Corners of the plate ``(4, 3)`` [m] in the target frame, in order about z."""
        half = np.array(self.plate_m) / 2
        signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return np.column_stack([signs * half, np.zeros(4)])

    def cross_corners(self) -> FloatArray:
        """Corners of the cross ``(12, 3)`` [m] in the target frame, in order about z.

        ``(0, 3)`` where there is no cross.
        """
        if self.cross_length_m == 0.0:
            return np.empty((0, 3))
        long, short = self.cross_length_m / 2, self.cross_width_m / 2
        arm = np.array([[long, -short], [long, short], [short, short]])
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # row vectors, by 90 degrees about z
        quarters = [arm @ np.linalg.matrix_power(turn, k) for k in range(4)]
        return np.column_stack([np.vstack(quarters), np.zeros(12)])

    def corners(self) -> FloatArray:
        """Corners of cross and plate ``(K, 3)`` [m] in the target frame."""
        return np.vstack([self.cross_corners(), self.plate_corners()])

    def rim(self, count: int) -> FloatArray:
        """Points of the circle ``(count, 3)`` [m] in the target frame, evenly spaced about z."""
        angle = np.arange(count) * (2.0 * np.pi / count)
        circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
        return np.asarray(self.diameter_m / 2 * circle)

    def _refuse(self, name: str, hint: str) -> None:
        raise InputError(
            f"{name} of the target is {getattr(self, name)}",
            hint=hint,
            name=name,
            value=getattr(self, name),
        )


_REACH_PX = 4.5
"""Half length of a profile, as for the ellipse; less where the bars of the cross are narrow."""

_LEAST_REACH_PX = 2.5
"""Below that a bar of the cross is blurred from side to side."""

_HALF_BAR = 0.45
"""Reach in widths of a bar of the cross: the plateau ends before its middle."""

_SPACING_PX = 1.5
"""Between points of an edge: closer ones share their pixels."""

_FLOORS_PX = (2.0, 1.0, 0.3, 0.1)
"""Gauss-Newton steps, each with edges found anew, and how near to the pose an edge is never an
outlier: the circle is right from the start, the cross off by what the rough pose is turned."""

_SHARED = 1.2
"""Standard deviations grow by that because neighbouring profiles share pixels and plateaus: 1.05 to
1.3 in images with a noise of two grey levels and a blur of one pixel."""

_OUTLIER = 3.5
"""Standard deviations at which an edge is left out: one good one in 2000."""

_MAD = 1.4826
"""Standard deviations of a normal distribution in a median absolute deviation."""

_LEAST_SHARE = 0.6
"""Share of the edges that must be found, as for the ellipse."""


def pose_from_image(
    camera: Camera, target: CircleTarget, image: GreyImage, T_camera_target: FloatArray
) -> TargetPose:
    """Pose of a target in an image, by least squares on the edges of circle and cross.

    Parameters
    ----------
    target : CircleTarget
        With a cross: a circle alone does not tell how it is turned.
    image : ndarray (height, width) of uint8
    T_camera_target : ndarray (4, 4)
        About the pose, as the posture of the robot tells. It decides which way the face leans, and
        between the quarter turns in which the pattern looks the same; turned about its normal it
        must be right to a few degrees.

    Returns
    -------
    TargetPose
        Its covariance is that of the scatter of the edges about the pose.
    """
    if target.cross_length_m == 0.0:
        raise InputError(
            "a circle without a cross does not tell how it is turned",
            hint="take a target with a cross, or circle_poses",
            name="cross_length_m",
        )
    near = camera.project(T_camera_target[:3, 3])
    found = measure_ellipse(image, dark=target.is_dark, near_px=near)
    if not found.is_ok:
        return TargetPose.failed(f"{found.status}: {found.message}")
    T = _start(camera, target, found.ellipse, T_camera_target)
    for floor_px in _FLOORS_PX:
        residual, jacobian, good, bars = _edges(camera, target, image, T)
        off = np.abs(residual[good] - np.median(residual[good]))
        good[good] = off <= max(_OUTLIER * _MAD * float(np.median(off)), floor_px)
        share = min(float(good[~bars].mean()), float(good[bars].mean()) if bars.any() else 0.0)
        if share < _LEAST_SHARE:
            return TargetPose.failed(
                f"{share:.0%} of circle or cross found, {_LEAST_SHARE:.0%} are needed"
            )
        step, *_ = np.linalg.lstsq(jacobian[good], residual[good], rcond=None)
        T = se3.transform(se3.rotation_exp(step[:3]) @ T[:3, :3], T[:3, 3] + step[3:])
    left = residual[good] - jacobian[good] @ step
    sigma_px = _SHARED * np.sqrt(float(left @ left) / (len(left) - 6))
    inverse = np.linalg.inv(jacobian[good].T @ jacobian[good])
    covariance: FloatArray = np.asarray(sigma_px**2 * inverse, dtype=float)
    rms = float(np.sqrt((left**2).mean()))
    message = f"{good.mean():.0%} of the edges, {rms:.3f} px rms"
    return TargetPose(T, covariance, rms, "ok", message)


def _start(
    camera: Camera, target: CircleTarget, ellipse: FloatArray, about: FloatArray
) -> FloatArray:
    """Pose ``(4, 4)`` from the ellipse, turned about its normal as the rough one."""
    middles, normals = circle_poses(camera, target.diameter_m, ellipse)
    which = int(np.argmax(normals @ about[:3, 2]))
    normal = normals[which]
    x = about[:3, 0] - (about[:3, 0] @ normal) * normal
    x /= np.linalg.norm(x)
    return se3.transform(np.column_stack([x, np.cross(normal, x), normal]), middles[which])


def _edges(
    camera: Camera, target: CircleTarget, image: GreyImage, T: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
    """How far edges lie outside those of a pose ``(K,)`` [px], derivatives ``(K, 6)``.

    And whether each was found, and whether it is one of the cross, both ``(K,)``.
    """
    scale = float(camera.focal_xy_px.min()) / T[2, 3]  # px/m, about
    # a bar that leans is narrower by the ratio of the axes
    lean = abs(float(T[:3, 2] @ T[:3, 3])) / float(np.linalg.norm(T[:3, 3]))
    reach = min(_REACH_PX, _HALF_BAR * target.cross_width_m * scale * lean)
    count = int(np.clip(np.pi * target.diameter_m * scale / _SPACING_PX, 32, 256))
    points = target.rim(count)
    outward = points / (target.diameter_m / 2)
    pixels, normal, jacobian = _projected(camera, points, outward, T)
    radius = _curvature_radius(pixels)
    edges = steps_along(image, pixels, normal, _REACH_PX, dark=target.is_dark, radius=radius)
    residual, found = ((edges.points - pixels) * normal).sum(axis=1), edges.found
    bars = np.zeros(len(points), dtype=bool)
    points, outward = _bars(target, scale)
    if reach < _LEAST_REACH_PX or not len(points):
        return residual, jacobian, found, bars
    pixels, normal, of_bars = _projected(camera, points, outward, T)
    edges = steps_along(image, pixels, normal, reach, dark=not target.is_dark, ring=False)
    return (
        np.concatenate([residual, ((edges.points - pixels) * normal).sum(axis=1)]),
        np.vstack([jacobian, of_bars]),
        np.concatenate([found, edges.found]),
        np.concatenate([bars, np.ones(len(points), dtype=bool)]),
    )


def _projected(
    camera: Camera, points: FloatArray, outward: FloatArray, T: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels ``(K, 2)`` of points of edges, their normals in the image ``(K, 2)``, derivatives.

    The derivatives ``(K, 6)`` are those of the place along the normal by (w, v) of the pose.
    """
    turned = points @ T[:3, :3].T
    by_point = camera.project_jacobian(turned + T[:3, 3])
    along = np.cross(outward, [0.0, 0.0, 1.0]) @ T[:3, :3].T
    tangent = (by_point @ along[..., None])[..., 0]
    out = (by_point @ (outward @ T[:3, :3].T)[..., None])[..., 0]
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign((normal * out).sum(axis=1, keepdims=True))
    by_pose = np.concatenate([-by_point @ se3.skew(turned), by_point], axis=-1)
    return camera.project(turned + T[:3, 3]), normal, (normal[:, None] @ by_pose)[:, 0]


def _bars(target: CircleTarget, scale: float) -> tuple[FloatArray, FloatArray]:
    """Points of the long sides of the cross ``(K, 3)`` [m], and unit vectors out of its bars."""
    clear = _REACH_PX / scale  # of the corners
    low, high = target.cross_width_m / 2 + clear, target.cross_length_m / 2 - clear
    count = int((high - low) * scale / _SPACING_PX) + 1 if high > low else 0
    along = np.linspace(low, high, count)[:, None]
    turns = se3.rotation_exp(np.pi / 2 * np.arange(4)[:, None] * np.array([0.0, 0.0, 1.0]))
    sides = np.array([[[0.0, 1.0, 0.0]], [[0.0, -1.0, 0.0]]])
    points = along * np.array([1.0, 0.0, 0.0]) + target.cross_width_m / 2 * sides
    outward = np.broadcast_to(sides, points.shape)
    both = (each @ np.swapaxes(turns, -1, -2)[:, None] for each in (points, outward))
    first, second = (each.reshape(-1, 3) for each in both)
    return first, second


def _curvature_radius(pixels: FloatArray) -> FloatArray:
    """Radius ``(K,)`` [px] of the circle through each point of a closed line and its neighbours."""
    before, after = np.roll(pixels, 1, axis=0) - pixels, np.roll(pixels, -1, axis=0) - pixels
    twice = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    sides = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return np.asarray(sides * np.linalg.norm(before - after, axis=1) / (2.0 * twice))
