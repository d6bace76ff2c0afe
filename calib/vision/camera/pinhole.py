"""An ideal camera: where a point in front of the lens appears in the image.

Conventions of all cameras here: in its own frame the lens is the origin, z looks along the optical
axis, x runs to the right of the image and y down. Pixel coordinates (x, y) count from the left
upper corner of the image, so the middle of the first pixel is (0.5, 0.5); OpenCV counts from that
middle, and its coordinates are smaller by one half.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera without distortion: all that the planning of poses needs.

    Attributes
    ----------
    width_px, height_px : int
    focal_px : float
        Focal length in pixels; the optical axis meets the image in its middle.
    """

    width_px: int
    height_px: int
    focal_px: float

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

    def room_px(self, points: FloatArray) -> FloatArray:
        """Distance [px] of points ``(..., 3)`` [m] from the edge of the image; negative outside.

        Minus infinity for points that are not in front of the lens.
        """
        pixels = self.project(points)
        size = np.array([self.width_px, self.height_px], dtype=float)
        room = np.minimum(pixels, size - pixels).min(axis=-1)
        return np.asarray(np.where(np.isnan(room), -np.inf, room))
