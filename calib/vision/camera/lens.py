"""Cameras: an ideal one, and a calibrated one with any principal point and a distorted lens.

Conventions of all cameras here: in its own frame the lens is the origin, z looks along the optical
axis, x runs to the right of the image and y down. Pixel coordinates (x, y) count from the left
upper corner of the image, so the middle of the first pixel is (0.5, 0.5); OpenCV counts from that
middle, and its coordinates are smaller by one half.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.lens import distorted, distorted_with_slope, slope_by_point
from calib.se3 import FloatArray


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera without distortion: all that the planning of poses needs."""

    width_px: int
    height_px: int
    focal_px: float  # focal length in pixels; the optical axis meets the image in its middle

    @property
    def center_px(self) -> FloatArray:
        """Where the optical axis meets the image ``(2,)`` [px]."""
        return np.array([self.width_px, self.height_px]) / 2.0

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of points ``(..., 3)`` [m] in the camera frame.

        From the left upper corner; NaN for points that are not in front of the lens.
        """
        depth = points[..., 2:]
        in_front = np.where(depth > 0.0, depth, np.nan)
        return np.asarray(self.center_px + self.focal_px * points[..., :2] / in_front)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Directions ``(..., 3)`` with z = 1 in the camera frame of pixels ``(..., 2)``."""
        across = (np.asarray(pixels, dtype=float) - self.center_px) / self.focal_px
        return np.concatenate([across, np.ones((*across.shape[:-1], 1))], axis=-1)

    def margin_px(self, points: FloatArray) -> FloatArray:
        """Distance [px] of points ``(..., 3)`` [m] from the edge of the image; negative outside.

        Minus infinity for points that are not in front of the lens.
        """
        pixels = self.project(points)
        size = np.array([self.width_px, self.height_px], dtype=float)
        margin = np.minimum(pixels, size - pixels).min(axis=-1)
        return np.asarray(np.where(np.isnan(margin), -np.inf, margin))


_UNDISTORTED = 1e-12
"""Step of the undistortion, in focal lengths, at which it ends: a thousandth of what is promised
(1e-10), and above the rounding of the polynomial."""

_STEPS = 30
"""Steps of the undistortion: Newton takes four or five where the lens has an inverse."""


@dataclass(frozen=True)
class Camera(PinholeCamera):
    """A pinhole camera with the lens distortion of OpenCV's five-parameter model.

    The image is at ``center + focal * (x', y')``, with ``(x', y')`` of the point over its depth
    (:func:`calib.lens.distorted`).

    Attributes
    ----------
    focal_px : float
        Focal length in pixels across the image.
    focal_y_px : float, optional
        Focal length in pixels down the image, where pixels are not square.
    principal_px : tuple of two floats, optional
        Where the optical axis meets the image, from the left upper corner of the image (OpenCV's
        ``cx, cy`` plus one half); the middle of the image unless given.
    distortion : tuple of five floats
        k1, k2, p1, p2, k3: OpenCV's order.
    """

    focal_y_px: float | None = None
    principal_px: tuple[float, float] | None = None
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("width_px", "height_px", "focal_px", "focal_y_px"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise InputError(
                    f"{name} of the camera is {value}", hint="give a positive number", name=name
                )
        if len(self.distortion) != 5 or not np.isfinite(self.distortion).all():
            raise InputError(
                f"distortion of the camera is {self.distortion}",
                hint="give the five numbers k1, k2, p1, p2, k3",
                name="distortion",
            )

    @classmethod
    def from_sensor(
        cls,
        size_px: tuple[int, int],
        sensor_mm: tuple[float, float],
        focal_mm: float,
        distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> Camera:
        """Camera from its data sheet: pixels and millimetres across and down, focal length."""
        (width, height), (across, down) = size_px, sensor_mm
        return cls(
            width,
            height,
            focal_mm * width / across,
            focal_y_px=focal_mm * height / down,
            distortion=distortion,
        )

    @classmethod
    def paper(cls) -> Camera:
        """Camera of section 3.1 of [Watanabe2006]_: 640 x 480 pixels on 1/3 inch, f = 12 mm.

        A 1/3 inch sensor is 4.8 x 3.6 mm, so the focal length is 1600 px.
        """
        return cls.from_sensor((640, 480), (4.8, 3.6), 12.0)

    @property
    def center_px(self) -> FloatArray:
        """Where the optical axis meets the image ``(2,)`` [px]."""
        return super().center_px if self.principal_px is None else np.array(self.principal_px)

    @property
    def focal_xy_px(self) -> FloatArray:
        """Focal lengths across and down the image ``(2,)`` [px]."""
        down = self.focal_px if self.focal_y_px is None else self.focal_y_px
        return np.array([self.focal_px, down])

    @property
    def is_ideal(self) -> bool:
        """Whether the lens has no distortion."""
        return not any(self.distortion)

    @cached_property
    def largest_radius(self) -> float:
        """Off-axis radius ``r`` (tangent of the angle) up to which the lens is one to one.

        The radial polynomial of a calibrated lens turns back somewhere outside the image: points
        beyond would be drawn inside it. Infinity where it never turns.
        """
        k1, k2, _, _, k3 = self.distortion
        slope = np.polynomial.Polynomial([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
        roots = slope.trim().roots() if any((k1, k2, k3)) else np.empty(0)
        square = roots[np.isreal(roots) & (roots.real > 0.0)].real
        return float(np.sqrt(square.min(initial=np.inf)))

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of points ``(..., 3)`` [m] in the camera frame.

        From the left upper corner of the image; NaN for points that are not in front of the lens,
        and for those beyond :attr:`largest_radius`.
        """
        x, y, depth = np.asarray(points, dtype=float).T
        depth = np.where(depth > 0.0, depth, np.nan)
        x, y = x / depth, y / depth
        if not self.is_ideal:
            x = np.where(x * x + y * y < self.largest_radius**2, x, np.nan)
            x, y = distorted(self.distortion, x, y)
        (fx, fy), (cx, cy) = self.focal_xy_px, self.center_px
        return np.ascontiguousarray(np.stack([cx + fx * x, cy + fy * y]).T)

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Directions ``(..., 3)`` with z = 1 in the camera frame of pixels ``(..., 2)``.

        Undistorted by Newton's iteration to 1e-10; NaN where no point is seen at that pixel.
        """
        image = (np.asarray(pixels, dtype=float) - self.center_px) / self.focal_xy_px
        across = image if self.is_ideal else self._undistorted(image)
        return np.concatenate([across, np.ones((*across.shape[:-1], 1))], axis=-1)

    def project_jacobian(self, points: FloatArray) -> FloatArray:
        """Derivatives ``(..., 2, 3)`` [px/m] of :meth:`project` by the points ``(..., 3)``."""
        x, y, depth = np.asarray(points, dtype=float).T
        x, y = x / depth, y / depth
        _, slope = distorted_with_slope(self.distortion, x, y)
        by_point = slope_by_point(self.focal_xy_px, slope, x, y, depth)
        return np.ascontiguousarray(np.swapaxes(by_point.T, -1, -2))

    def _undistorted(self, image: FloatArray) -> FloatArray:
        wanted = image.T
        across, step = wanted.copy(), np.full_like(wanted, np.inf)
        with np.errstate(all="ignore"):  # pixels that no point is seen at run away and become NaN
            for _ in range(_STEPS):
                seen, (xx, xy, yy) = distorted_with_slope(self.distortion, *across)
                x, y = wanted[0] - seen[0], wanted[1] - seen[1]
                step = np.stack([yy * x - xy * y, xx * y - xy * x])
                step /= xx * yy - xy * xy
                across = across + step
                if not (np.abs(step) > _UNDISTORTED).any():
                    break
            found = (np.abs(step) <= _UNDISTORTED).all(axis=0)
            found &= (across**2).sum(axis=0) < self.largest_radius**2
        return np.ascontiguousarray(np.where(found, across, np.nan).T)
