"""Pose of a target from the places of its points in the image, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from calib import se3
from calib.errors import InputError
from calib.se3 import FloatArray
from calib.vision.camera.lens import Camera

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
    """Pose of a target, as B of A X = Z B wants it."""

    T_camera_target: FloatArray  # (4, 4) [m]; NaN with ``"no pose"``
    covariance: FloatArray
    """(6, 6): of (w, v) in ``R = exp([w]) R_true, p = p_true + v`` in camera axes, rotation [rad]
    first: the errors of :class:`calib.robot_world.PairNoise`. For the stated noise of the
    points."""
    rms_px: float  # rms of the coordinates' residuals
    status: PoseStatus
    """``"ambiguous"``: a second pose, the face turned the other way, fits as well."""
    message: str

    @property
    def is_ok(self) -> bool:
        """Whether the pose can be used."""
        return self.status == "ok"

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations ``(6,)``: rotation [rad], translation [m]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @classmethod
    def failed(cls, message: str) -> TargetPose:
        """Outcome without a pose."""
        nothing = np.full((6, 6), np.nan)
        return cls(nothing[:4, :4], nothing, float("nan"), "no pose", message)


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

    Raises
    ------
    InputError
        Fewer than four points, unequal numbers of them, points off the plane, or noise of zero.
    """
    points, seen = _checked(points_m, pixels, sigma_px)
    starts = _starts(camera, points, seen)
    found = sorted((_refined(camera, points, seen, T) for T in starts), key=lambda f: f[1])
    if not found or not np.isfinite(found[0][1]):
        return TargetPose.failed("no pose shows the points so")
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
