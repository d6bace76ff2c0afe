"""An ideal camera: where a point in front of the lens appears in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera without distortion.

    In its own frame the lens is the origin, z looks along the optical axis, x runs to the right of
    the image and y down.

    Attributes
    ----------
    width_px, height_px : int
    focal_px : float
        Focal length in pixels; the optical axis meets the image in its middle.
    """

    width_px: int
    height_px: int
    focal_px: float

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of points ``(..., 3)`` [m] in the camera frame.

        From the left upper corner; NaN for points that are not in front of the lens.
        """
        depth = points[..., 2:]
        in_front = np.where(depth > 0.0, depth, np.nan)
        middle = np.array([self.width_px, self.height_px]) / 2.0
        return np.asarray(middle + self.focal_px * points[..., :2] / in_front)

    def room_px(self, points: FloatArray) -> FloatArray:
        """Distance [px] of points ``(..., 3)`` [m] from the edge of the image; negative outside.

        Minus infinity for points that are not in front of the lens.
        """
        pixels = self.project(points)
        size = np.array([self.width_px, self.height_px], dtype=float)
        room = np.minimum(pixels, size - pixels).min(axis=-1)
        return np.asarray(np.where(np.isnan(room), -np.inf, room))
