"""Ellipses in the image: that of a circle in space, and the one through measured points,
some of which may not be on it.

An ellipse is an array ``(..., 5)`` [px] of ``x, y, a, b, c``: its centre, and the symmetric matrix
``S = [[a, b], [b, c]]`` that maps the unit circle to it, ``center + S u``. Its eigenvalues are the
half axes. Unlike axes and angle, the five are smooth where an ellipse becomes a circle.

What the ellipse of a circle tells: where its middle is seen, and where the circle is.

The centre of the ellipse is not the image of the middle of the circle: the near half of a tilted
circle is seen larger. By symmetry it moves towards the near side, by about ``f r² sin(2 tilt) /
(2 d²)`` for a radius r at a distance d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.lens import Camera

_FIT_STEPS = 4
"""Gauss-Newton steps of a fit: from a start within a tenth of the axes the last is at rounding."""

_RIM = 16
"""Points of the rim that stand for it where the lens bends the ellipse: within 1e-5 px of many
more; within 0.01 px for a circle seen nearly edge on through a wide-angle lens."""

_BENT_STEPS = 1
"""Gauss-Newton steps of that fit: mean and scatter of the rim start it so near that a second one
moves it by 1e-5 px."""


def circle_image(camera: Camera, diameter_m: float, T_camera_target: FloatArray) -> FloatArray:
    """Ellipse ``(..., 5)`` [px] that the circle in the x-y plane of a target is seen as.

    NaN where the circle is not wholly in front of the lens, or shows its back. Target at poses
    ``(..., 4, 4)``.

    Exact for an ideal lens: the dual conic of the circle, ``diag(r², r², -1)``, maps by the
    homography ``H = K [r1 r2 p]`` to ``H diag(r², r², -1) Hᵀ`` [HartleyZisserman2004]_ (Eq. 2.16).
    With distortion the curve is no ellipse: then the one nearest to it, fitted to points of the
    rim as it is to an image.

    References
    ----------
    .. [HartleyZisserman2004] R. Hartley, A. Zisserman, Multiple View Geometry in Computer Vision,
       2nd edition, Cambridge University Press.
    """
    T = np.asarray(T_camera_target, dtype=float)
    flat = T[..., :3, [0, 1, 3]].copy()
    flat[..., :2] *= diameter_m / 2  # the unit circle, to the camera frame
    flat[..., :2, :] *= camera.focal_xy_px[:, None]
    dual = (flat * [1.0, 1.0, -1.0]) @ np.swapaxes(flat, -1, -2)
    facing = (T[..., :3, 2] * T[..., :3, 3]).sum(axis=-1) < 0.0
    seen = facing & (dual[..., 2, 2] < 0.0) & (T[..., 2, 3] > 0.0)
    dual = dual / np.where(seen, -dual[..., 2, 2], np.nan)[..., None, None]
    center = -dual[..., :2, 2]
    square = dual[..., :2, :2] + center[..., :, None] * center[..., None, :]
    ideal = _from_square(center, square)
    if camera.is_ideal:
        ideal[..., :2] += camera.center_px
        return ideal
    across = ellipse_points(ideal, _RIM) / camera.focal_xy_px
    rays = np.concatenate([across, np.ones((*across.shape[:-1], 1))], axis=-1)
    return fit_ellipse(camera.project(rays), steps=_BENT_STEPS)


def disc_image(camera: Camera, diameter_m: float, T_camera_target: FloatArray) -> FloatArray:
    """Ellipse ``(..., 5)`` [px] of a circle by the map of the image at its middle alone.

    That of an infinitely small circle, enlarged: its centre is the image of the middle at any tilt.
    Of a target at poses ``(..., 4, 4)``; NaN where it shows its back.
    """
    middle = T_camera_target[..., :3, 3]
    slope = camera.project_jacobian(middle) @ T_camera_target[..., :3, :2]
    facing = (T_camera_target[..., :3, 2] * middle).sum(axis=-1) < 0.0
    ellipse = ellipse_of_slope(camera.project(middle), slope, diameter_m)
    return np.where(facing[..., None], ellipse, np.nan)


def ellipse_of_slope(center_px: FloatArray, slope: FloatArray, diameter_m: float) -> FloatArray:
    """Ellipse ``(..., 5)`` of a circle in a plane that is mapped by ``(..., 2, 2)`` [px/m]."""
    square = slope @ np.swapaxes(slope, -1, -2)
    return _from_square(center_px, (diameter_m / 2.0) ** 2 * square)


def ellipse_axes(ellipse: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Long and short axis [px] (whole lengths) and direction of the long one, each ``(...)``.

    The direction [rad] counts from x towards y, in (-pi/2, pi/2].
    """
    a, b, c = ellipse[..., 2], ellipse[..., 3], ellipse[..., 4]
    return *axis_lengths(ellipse), np.asarray(np.arctan2(2 * b, a - c) / 2)


def axis_lengths(ellipse: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Long and short axis [px] (whole lengths) of ellipses ``(..., 5)``, each ``(...)``."""
    a, b, c = ellipse[..., 2], ellipse[..., 3], ellipse[..., 4]
    mean, apart = (a + c) / 2, np.hypot((a - c) / 2, b)
    return 2 * (mean + apart), 2 * (mean - apart)


def ellipse_vhs(ellipse: FloatArray) -> FloatArray:
    """V (down), H (to the right) and size s ``(..., 3)`` [px], sec. 2.1 of [Watanabe2006]_."""
    out = np.empty((*ellipse.shape[:-1], 3))
    out[..., 0], out[..., 1] = ellipse[..., 1], ellipse[..., 0]
    out[..., 2] = axis_lengths(ellipse)[0]
    return out


def ellipse_points(ellipse: FloatArray, count: int) -> FloatArray:
    """Points ``(..., count, 2)`` of ellipses ``(..., 5)``: ``S u`` of evenly spaced unit u."""
    angle = np.arange(count) * (2.0 * np.pi / count)
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(ellipse[..., None, :2] + unit @ half_axes(ellipse))


def ellipse_of_axes(
    center_px: ArrayLike, long_px: float, short_px: float, angle: float
) -> FloatArray:
    """Ellipse ``(5,)`` [px] of two axes (whole lengths), the first in a direction [rad]."""
    cos, sin, a, b = np.cos(angle), np.sin(angle), long_px / 2, short_px / 2
    matrix = [a * cos * cos + b * sin * sin, (a - b) * cos * sin, a * sin * sin + b * cos * cos]
    return np.array([*np.asarray(center_px), *matrix])


def half_axes(ellipse: FloatArray) -> FloatArray:
    """Symmetric matrices S ``(..., 2, 2)`` [px] that map the unit circle to the ellipses."""
    return np.asarray(ellipse[..., [2, 3, 3, 4]].reshape(*ellipse.shape[:-1], 2, 2))


def fit_ellipse(points: FloatArray, steps: int = _FIT_STEPS) -> FloatArray:
    """Ellipse ``(..., 5)`` of least squared distance from points ``(..., K, 2)`` [px].

    By Gauss-Newton, from their mean and scatter: they lie evenly about the whole of it.
    """
    center = points.mean(axis=-2)
    off = points - center[..., None, :]
    # the mean of u uᵀ over the unit circle is half the identity
    ellipse = _from_square(center, 2.0 * np.swapaxes(off, -1, -2) @ off / points.shape[-2])
    weight = np.ones(points.shape[:-1])
    for _ in range(steps):
        distance, jacobian = ellipse_distance(ellipse, points)
        ellipse = ellipse + ellipse_step(distance, jacobian, weight)
    return ellipse


def ellipse_distance(ellipse: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Signed distances ``(..., K)`` [px] of points ``(..., K, 2)`` from ellipses ``(..., 5)``.

    Positive outside; and their derivatives ``(..., K, 5)`` by the numbers of the ellipse.

    To first order in the distance [Sampson1982]_: ``(|w| - 1) / |grad|``, ``w = S⁻¹ (p - center)``.

    References
    ----------
    .. [Sampson1982] P. D. Sampson, Fitting conic sections to "very scattered" data, Computer
       Graphics and Image Processing 18.
    """
    a, b, c = (ellipse[..., None, k] for k in (2, 3, 4))
    determinant = a * c - b * b
    dx = points[..., 0] - ellipse[..., None, 0]
    dy = points[..., 1] - ellipse[..., None, 1]
    wx, wy = (c * dx - b * dy) / determinant, (a * dy - b * dx) / determinant
    length = np.hypot(wx, wy)
    gx, gy = (c * wx - b * wy) / determinant / length, (a * wy - b * wx) / determinant / length
    slope = np.hypot(gx, gy)
    nx, ny = gx / slope, gy / slope
    jacobian = -np.stack([nx, ny, nx * wx, nx * wy + ny * wx, ny * wy], axis=-1)
    return np.asarray((length - 1.0) / slope), jacobian


def ellipse_step(distance: FloatArray, jacobian: FloatArray, weight: FloatArray) -> FloatArray:
    """Gauss-Newton step ``(..., 5)`` of ellipses, from what :func:`ellipse_distance` returns."""
    weighted = np.swapaxes(jacobian * weight[..., None], -1, -2)
    normal = weighted @ jacobian
    # points too few or all in one place leave the ellipse where it is
    damping = 1e-12 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] + 1e-300
    step = np.linalg.solve(normal + damping * np.eye(5), weighted @ distance[..., None])
    return np.asarray(-step[..., 0])


def is_sound(ellipse: FloatArray) -> BoolArray:
    """Whether numbers ``(..., 5)`` are those of an ellipse: finite, both axes positive."""
    _, short = axis_lengths(ellipse)
    return np.asarray(np.isfinite(ellipse).all(axis=-1) & (short > 0.0))


def _from_square(center: FloatArray, square: FloatArray) -> FloatArray:
    """Ellipses ``(..., 5)`` from their centres and S²: the square root of a matrix of two rows."""
    xx, xy, yy = square[..., 0, 0], square[..., 0, 1], square[..., 1, 1]
    root = np.sqrt(np.maximum(xx * yy - xy * xy, 0.0))
    scale = np.sqrt(xx + yy + 2.0 * root)
    matrix = np.stack([(xx + root) / scale, xy / scale, (yy + root) / scale], axis=-1)
    return np.concatenate([center, matrix], axis=-1)


_REWEIGHTINGS = 8
"""Most steps with Cauchy weights: they settle in four or five where most points are good."""

_SETTLED = 0.2
"""Step, in scales of the distances, at which the weights have settled."""

_TRIMMINGS = 4
_OUTLIER = 3.0
"""Standard deviations at which a point is an outlier: one good one in 370."""

_MAD = 1.4826
"""Standard deviations of a normal distribution in a median absolute deviation."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Ellipse ``(5,)``, which points ``(K,)`` it was fitted to, and their rms distance [px]."""

    ellipse: FloatArray
    kept: BoolArray
    rms_px: float


def fit_robust(points: FloatArray, start: FloatArray, floor_px: float) -> RobustFit:
    """Fit an ellipse to points ``(K, 2)`` [px], outliers left out.

    Cauchy weights with the median distance as their scale lead from the start to most of the
    points; then least squares, and points beyond three standard deviations are left out. Those
    nearer than the floor never are.
    """
    ellipse = start
    distance, jacobian = ellipse_distance(ellipse, points)
    kept = np.ones(len(points), dtype=bool)
    with np.errstate(all="ignore"):  # a fit that runs away is told by its numbers
        for _ in range(_REWEIGHTINGS):
            scale = max(_MAD * float(np.median(np.abs(distance))), floor_px)
            step = ellipse_step(distance, jacobian, 1.0 / (1.0 + (distance / (2 * scale)) ** 2))
            ellipse = ellipse + step
            distance, jacobian = ellipse_distance(ellipse, points)
            if np.abs(step).max() < _SETTLED * scale:
                break
        for _ in range(_TRIMMINGS):
            scale = _MAD * float(np.median(np.abs(distance)))
            good = np.abs(distance) <= max(_OUTLIER * scale, floor_px)
            ellipse = ellipse + ellipse_step(distance, jacobian, good.astype(float))
            distance, jacobian = ellipse_distance(ellipse, points)
            same, kept = bool((good == kept).all()), good
            if same or not is_sound(ellipse):
                break
    rms = float(np.sqrt((distance[kept] ** 2).mean())) if kept.any() else float("nan")
    return RobustFit(ellipse, kept, rms)


_CONE_POINTS = 24
"""Points of a measured ellipse that are seen through the lens: as many as are projected."""


def circle_center_bias(
    camera: Camera, diameter_m: float, T_camera_target: FloatArray
) -> FloatArray:
    """Centre of the ellipse less the image of the middle of the circle ``(..., 2)`` [px].

    Of a target at poses ``(..., 4, 4)``. Exact, by projective geometry, for an ideal lens; with
    distortion for the ellipse that is fitted to the image. NaN where the circle is not seen.
    """
    ellipse = circle_image(camera, diameter_m, T_camera_target)
    return np.asarray(ellipse[..., :2] - camera.project(T_camera_target[..., :3, 3]))


def circle_poses(
    camera: Camera, diameter_m: float, ellipse: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Both places and normals of a circle of known diameter that look like ellipses ``(..., 5)``.

    The cone through the ellipse, turned to its axes, has two families of circular sections: from
    one ellipse alone nobody can tell which of the two the circle is [Forsyth1991]_.

    Returns
    -------
    middles : ndarray (..., 2, 3)
        Middle of the circle [m] in the camera frame.
    normals : ndarray (..., 2, 3)
        Unit normals out of the face, towards the lens.

    References
    ----------
    .. [Forsyth1991] D. Forsyth et al., Invariant descriptors for 3-D object recognition and pose,
       IEEE Trans. Pattern Analysis and Machine Intelligence 13(10).
    """
    # xᵀ C x = 0: one negative value, along the axis of the cone, and a smaller and a larger one
    values, axes = np.linalg.eigh(_cone(camera, np.asarray(ellipse, dtype=float)))
    low, small, large = (values[..., k, None] for k in range(3))
    forward, across = axes[..., :, 0], axes[..., :, 2]
    forward = forward * np.where(forward[..., 2:] < 0.0, -1.0, 1.0)
    # C less its middle value is a pair of planes: C is the same in all directions across n
    sin = np.sqrt((large - small) / (large - low))
    cos = np.sqrt((small - low) / (large - low))
    # the pole of the plane n x = h is the middle, and r² = -h² low large / small²
    h = diameter_m / 2 * small / np.sqrt(-low * large)
    sides = [(across, forward), (-across, forward)]
    middles = [h / small * (large * cos * e0 + low * sin * e2) for e2, e0 in sides]
    normals = [-(cos * e0 + sin * e2) for e2, e0 in sides]
    return np.stack(middles, axis=-2), np.stack(normals, axis=-2)


def circle_center(
    camera: Camera, diameter_m: float, ellipse: FloatArray, normal: ArrayLike
) -> FloatArray:
    """Where the middle of the circle is seen ``(..., 2)`` [px], from its ellipse alone.

    The ellipse tells the tilt by the ratio of its axes, which hardly changes for a face that is
    turned to the lens: below five degrees or so the noise of the correction (0.02 px for 20 mm at
    350 mm through 1600 px) is larger than a tenth of the bias, and it is better left alone.

    Parameters
    ----------
    ellipse : ndarray (..., 5)
        Measured [px].
    normal : array_like (..., 3)
        About how the face is turned, in the camera frame, as the posture of the robot tells: it
        decides between the two circles of :func:`circle_poses`, nothing else.
    """
    middles, normals = circle_poses(camera, diameter_m, ellipse)
    likeness = (normals * np.asarray(normal, dtype=float)[..., None, :]).sum(axis=-1)
    first = likeness[..., :1] >= likeness[..., 1:]
    return camera.project(np.where(first, middles[..., 0, :], middles[..., 1, :]))


def _cone(camera: Camera, ellipse: FloatArray) -> FloatArray:
    """Cone ``(..., 3, 3)`` of the rays through an ellipse, the lens taken out."""
    flat = fit_ellipse(camera.rays(ellipse_points(ellipse, _CONE_POINTS))[..., :2])
    S = np.linalg.inv(half_axes(flat))
    inner = S @ S
    edge = -(inner @ flat[..., :2, None])
    corner = (flat[..., None, :2] @ -edge) - 1.0
    return np.concatenate(
        [
            np.concatenate([inner, edge], axis=-1),
            np.concatenate([np.swapaxes(edge, -1, -2), corner], axis=-1),
        ],
        axis=-2,
    )
