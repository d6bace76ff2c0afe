"""Pose of a target from the places of its points in the image, with its covariance.

Pose of a target from its image: all edges of its pattern at once, no corners.

A corner that is found by itself is moved by the blur, by 0.15 px with a blur of one pixel: enough
for half a millimetre of depth. The edges between the corners are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from calib import se3
from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import circle_poses
from calib.vision.camera.edges import steps_along
from calib.vision.camera.ellipse import measure_ellipse
from calib.vision.camera.lens import Camera
from calib.vision.camera.rendering import GreyImage
from calib.vision.camera.target import CircleTarget

PoseStatus = Literal["ok", "ambiguous", "no pose"]

_FEWEST = 4
"""Points in a plane that fix a pose up to the two ways of seeing it."""

_UNTIL_SETTLED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-15)
"""Until steps are rounding: from OpenCV's start, within a degree, three or four are needed."""

_FLAT_M = 1e-9
"""Largest z of points that count as a plane for IPPE."""

_AS_GOOD = 9.21
"""Chi-square of two degrees of freedom that noise exceeds once in a hundred: a second pose that
costs less than that more cannot be told from the first."""


@dataclass(frozen=True, eq=False)
class TargetPose:
    """Pose of a target, as B of A X = Z B wants it.

    Attributes
    ----------
    T_camera_target : ndarray (4, 4)
        [m]; NaN with ``"no pose"``.
    covariance : ndarray (6, 6)
        Of (w, v) in ``R = exp([w]) R_true, p = p_true + v`` in camera axes, rotation [rad] first:
        the errors of :class:`calib.robot_world.PairNoise`. For the stated noise of the points.
    rms_px : float
        Rms of the coordinates' residuals.
    status : {"ok", "ambiguous", "no pose"}
        ``"ambiguous"``: a second pose, the face turned the other way, fits as well.
    """

    T_camera_target: FloatArray
    covariance: FloatArray
    rms_px: float
    status: PoseStatus
    message: str

    @property
    def is_ok(self) -> bool:
        """Whether the pose can be used."""
        return self.status == "ok"

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations ``(6,)``: rotation [rad], translation [m]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def pose_from_points(
    camera: Camera, points_m: FloatArray, pixels: FloatArray, sigma_px: float = 0.05
) -> TargetPose:
    """Pose of greatest likelihood from points of a plane target and their pixels.

    IPPE (OpenCV) gives the two poses that a plane can be seen in; both are refined by least
    squares on the pixels, and the better is returned.

    Parameters
    ----------
    points_m : ndarray (K, 3)
        In the target frame, with z = 0: :meth:`CircleTarget.corners`.
    pixels : ndarray (K, 2)
        From the left upper corner of the image.
    sigma_px : float
        Standard deviation of each coordinate, independent.

    Returns
    -------
    TargetPose
        Look at its ``status``.

    Raises
    ------
    InputError
        Fewer than four points, unequal numbers of them, points off the plane, or noise of zero.
    """
    points, seen = _checked(points_m, pixels, sigma_px)
    starts = _starts(camera, points, seen)
    found = sorted((_refined(camera, points, seen, T) for T in starts), key=lambda f: f[1])
    if not found or not np.isfinite(found[0][1]):
        nan = float("nan")
        return TargetPose(
            np.full((4, 4), nan),
            np.full((6, 6), nan),
            nan,
            "no pose",
            "no pose shows the points so",
        )
    T, cost = found[0]
    rms = float(np.sqrt(cost / seen.size))
    _, jacobian = _residuals(camera, points, seen, T)
    covariance: FloatArray = np.asarray(sigma_px**2 * np.linalg.inv(jacobian.T @ jacobian), float)
    if len(found) > 1 and found[1][1] - cost < _AS_GOOD * sigma_px**2:
        turned = se3.rotation_angle(found[1][0][:3, :3] @ T[:3, :3].T)
        # two starts may end in one pose, which is no second one
        if turned > 4.0 * np.sqrt(np.trace(covariance[:3, :3])):
            message = f"turned by {np.rad2deg(turned):.1f} deg the target fits as well"
            return TargetPose(T, covariance, rms, "ambiguous", message)
    return TargetPose(T, covariance, rms, "ok", f"{len(points)} points, {rms:.3f} px rms")


def _checked(
    points_m: FloatArray, pixels: FloatArray, sigma_px: float
) -> tuple[FloatArray, FloatArray]:
    points, seen = np.asarray(points_m, dtype=float), np.asarray(pixels, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or seen.shape != (len(points), 2):
        raise InputError(
            f"points {points.shape} and pixels {seen.shape} do not belong together",
            hint="give K points (K, 3) and their pixels (K, 2)",
            name="pixels",
        )
    if len(points) < _FEWEST:
        raise InputError(
            f"{len(points)} points fix no pose", hint="give four or more", name="points_m"
        )
    if np.abs(points[:, 2]).max() > _FLAT_M:
        raise InputError("points off the plane z = 0", hint="give a plane target", name="points_m")
    if not sigma_px > 0.0:
        raise InputError(f"noise of {sigma_px} px", hint="give a positive number", name="sigma_px")
    return points, seen


def _starts(camera: Camera, points: FloatArray, seen: FloatArray) -> list[FloatArray]:
    """Poses ``(4, 4)`` that the plane is seen in, by IPPE on undistorted pixels."""
    across = np.ascontiguousarray(camera.rays(seen)[:, :2])
    if not np.isfinite(across).all():
        return []
    count, turns, places, _ = cv2.solvePnPGeneric(
        points, across, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
    )
    starts = [
        se3.transform(se3.rotation_exp(turns[k][:, 0]), places[k][:, 0]) for k in range(count)
    ]
    return [T for T in starts if np.isfinite(T).all()]


def _refined(
    camera: Camera, points: FloatArray, seen: FloatArray, T: FloatArray
) -> tuple[FloatArray, float]:
    """Least squares on the pixels; the pose and its sum of squares [px²], infinite if it fails."""
    turn, place = cv2.solvePnPRefineLM(
        points,
        seen,
        np.block([[np.diag(camera.focal_xy_px), camera.center_px[:, None]], [0.0, 0.0, 1.0]]),
        np.array(camera.distortion),
        se3.rotation_log(T[:3, :3])[:, None],
        T[:3, 3:].copy(),
        _UNTIL_SETTLED,
    )
    T = se3.transform(se3.rotation_exp(turn[:, 0]), place[:, 0])
    residual, _ = _residuals(camera, points, seen, T)
    cost = float(residual @ residual)
    return T, cost if np.isfinite(cost) else float("inf")


def _residuals(
    camera: Camera, points: FloatArray, seen: FloatArray, T: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels seen less those of the pose ``(2K,)``, and the latter's derivatives ``(2K, 6)``."""
    turned = points @ T[:3, :3].T
    at = turned + T[:3, 3]
    by_point = camera.project_jacobian(at)
    jacobian = np.concatenate([-by_point @ se3.skew(turned), by_point], axis=-1)
    return (seen - camera.project(at)).ravel(), jacobian.reshape(-1, 6)


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

    Raises
    ------
    InputError
        A target without a cross.
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
        return _failed(f"{found.status}: {found.message}")
    T = _start(camera, target, found.ellipse, T_camera_target)
    for floor_px in _FLOORS_PX:
        residual, jacobian, good, bars = _edges(camera, target, image, T)
        good[good] = _inliers(residual[good], floor_px)
        share = min(float(good[~bars].mean()), float(good[bars].mean()) if bars.any() else 0.0)
        if share < _LEAST_SHARE:
            return _failed(f"{share:.0%} of circle or cross found, {_LEAST_SHARE:.0%} are needed")
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
    points, outward = _rim(target, scale)
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


def _rim(target: CircleTarget, scale: float) -> tuple[FloatArray, FloatArray]:
    """Points of the circle ``(K, 3)`` [m] and unit vectors out of it."""
    count = int(np.clip(np.pi * target.diameter_m * scale / _SPACING_PX, 32, 256))
    points = target.rim(count)
    return points, points / (target.diameter_m / 2)


def _bars(target: CircleTarget, scale: float) -> tuple[FloatArray, FloatArray]:
    """Points of the long sides of the cross ``(K, 3)`` [m], and unit vectors out of its bars."""
    clear = _REACH_PX / scale  # of the corners
    low, high = target.cross_width_m / 2 + clear, target.cross_length_m / 2 - clear
    count = int((high - low) * scale / _SPACING_PX) + 1 if high > low else 0
    along = np.linspace(low, high, count)
    half = np.full(count, target.cross_width_m / 2)
    points, outward = [], []
    for k in range(4):
        turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), k)
        for side in (1.0, -1.0):
            points.append(np.stack([along, side * half], axis=1) @ turn.T)
            outward.append(np.tile([0.0, side], (count, 1)) @ turn.T)
    zero = np.zeros((8 * count, 1))
    return np.hstack([np.vstack(points), zero]), np.hstack([np.vstack(outward), zero])


def _curvature_radius(pixels: FloatArray) -> FloatArray:
    """Radius ``(K,)`` [px] of the circle through each point of a closed line and its neighbours."""
    before, after = np.roll(pixels, 1, axis=0) - pixels, np.roll(pixels, -1, axis=0) - pixels
    twice = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    sides = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return np.asarray(sides * np.linalg.norm(before - after, axis=1) / (2.0 * twice))


def _inliers(residual: FloatArray, floor_px: float) -> BoolArray:
    off = np.abs(residual - np.median(residual))
    return np.asarray(off <= max(_OUTLIER * _MAD * float(np.median(off)), floor_px))


def _failed(message: str) -> TargetPose:
    nothing = np.full((6, 6), np.nan)
    return TargetPose(nothing[:4, :4], nothing, float("nan"), "no pose", message)
