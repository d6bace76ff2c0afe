"""Pose of a target from its image: all edges of its pattern at once, no corners.

A corner that is found by itself is moved by the blur, by 0.15 px with a blur of one pixel: enough
for half a millimetre of depth. The edges between the corners are not.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.camera.circle_pose import circle_poses
from calib.camera.edges import steps_along
from calib.camera.ellipse import measure_ellipse
from calib.camera.lens import Camera
from calib.camera.pnp import PoseStatus, TargetPose
from calib.camera.rendering import GreyImage
from calib.camera.target import CircleTarget
from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray

_REACH_PX = 4.5
"""Half length of a profile, as for the ellipse; less where the bars of the cross are narrow."""

_LEAST_REACH_PX = 2.5
"""Below that a bar of the cross is blurred from side to side."""

_SPACING_PX = 1.5
"""Between points of an edge: closer ones share their pixels."""

_STEPS = 4
"""Gauss-Newton steps, each with edges found anew: the start is within a pixel, and the last moves
by a hundredth."""

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
    camera : Camera
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
        return _failed("no pose", f"{found.status}: {found.message}")
    T = _start(camera, target, found.ellipse, T_camera_target)
    for _ in range(_STEPS):
        residual, jacobian, seen = _edges(camera, target, image, T)
        good = seen.copy()
        good[seen] = _inliers(residual[seen])
        if good.sum() < _LEAST_SHARE * len(good):
            return _failed("no pose", f"{good.mean():.0%} of the edges found")
        step, *_ = np.linalg.lstsq(jacobian[good], residual[good], rcond=None)
        T = se3.transform(se3.rotation_exp(step[:3]) @ T[:3, :3], T[:3, 3] + step[3:])
    left = residual[good] - jacobian[good] @ step
    rms = float(np.sqrt((left**2).mean()))
    variance = float(left @ left) / (len(left) - 6)
    inverse = np.linalg.inv(jacobian[good].T @ jacobian[good])
    covariance: FloatArray = np.asarray(variance * inverse, dtype=float)
    return TargetPose(
        T, covariance, rms, "ok", f"{good.mean():.0%} of the edges, {rms:.3f} px rms"
    )


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
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """How far edges lie outside those of a pose ``(K,)`` [px], derivatives ``(K, 6)``, found."""
    scale = float(camera.focal_xy_px.min()) / T[2, 3]  # px/m, about
    parts = [_rim(target, scale)]
    bars = _bars(target, scale)
    # a bar that leans is narrower by the ratio of the axes
    lean = abs(float(T[:3, 2] @ T[:3, 3])) / float(np.linalg.norm(T[:3, 3]))
    reach = min(_REACH_PX, 0.45 * target.cross_width_m * scale * lean)
    if reach >= _LEAST_REACH_PX and len(bars[0]):
        parts.append(bars)
    residuals, jacobians, founds = [], [], []
    for k, (points, outward) in enumerate(parts):
        turned = points @ T[:3, :3].T
        by_point = camera.project_jacobian(turned + T[:3, 3])
        pixels = camera.project(turned + T[:3, 3])
        along = np.cross(outward, [0.0, 0.0, 1.0]) @ T[:3, :3].T  # in the plane, along the edge
        tangent = (by_point @ along[..., None])[..., 0]
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        out = (by_point @ (outward @ T[:3, :3].T)[..., None])[..., 0]
        normal *= np.sign((normal * out).sum(axis=1, keepdims=True))
        edges = steps_along(
            image,
            pixels,
            normal,
            _REACH_PX if k == 0 else reach,
            dark=target.is_dark == (k == 0),
            radius=_curvature_radius(pixels) if k == 0 else np.inf,
            ring=k == 0,
        )
        by_pose = np.concatenate([-by_point @ se3.skew(turned), by_point], axis=-1)
        residuals.append(((edges.points - pixels) * normal).sum(axis=1))
        jacobians.append((normal[:, None] @ by_pose)[:, 0])
        founds.append(edges.found)
    return np.concatenate(residuals), np.vstack(jacobians), np.concatenate(founds)


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


def _inliers(residual: FloatArray) -> BoolArray:
    off = np.abs(residual - np.median(residual))
    return np.asarray(off <= max(_OUTLIER * _MAD * float(np.median(off)), 0.1))


def _failed(status: PoseStatus, message: str) -> TargetPose:
    nothing = np.full((6, 6), np.nan)
    return TargetPose(nothing[:4, :4], nothing, float("nan"), status, message)
