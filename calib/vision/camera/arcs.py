"""An ellipse in a contour that follows it only in part: something hides the rest of the rim."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from calib.se3 import FloatArray
from calib.vision.camera.conic import ellipse_distance, half_axes, is_sound

_SHORTEST = 40
"""Points of the shortest piece of a contour that is tried: fewer fit any ellipse."""

_OVERLAP = 3
"""Pieces of a contour start at every third of their length, so one of them misses a corner."""

_LONGEST_CONTOUR = 1500
"""Points of a contour above which only every second, third ... is looked at."""

_NEAR_PX = 1.2
"""Distance at which a point of a contour, which goes from pixel to pixel, is on an ellipse."""

_SECTORS = 32
"""Parts of the rim that are counted."""


def ellipse_from_line(points: FloatArray) -> FloatArray | None:
    """Ellipse ``(5,)`` through points ``(K, 2)``, algebraic; None where they are on none."""
    if len(points) < 5:
        return None
    (x, y), (first, second), turn = cv2.fitEllipseDirect(points.astype(np.float32))
    angle = np.deg2rad(turn)
    cos, sin = np.cos(angle), np.sin(angle)
    a, b = first / 2, second / 2
    matrix = [a * cos**2 + b * sin**2, (a - b) * cos * sin, a * sin**2 + b * cos**2]
    ellipse = np.array([x, y, *matrix])
    return ellipse if is_sound(ellipse) else None


def ellipse_pieces(points: FloatArray) -> Iterator[FloatArray]:
    """Ellipses through pieces of a closed contour ``(K, 2)``, from long pieces to short ones."""
    points = points[:: len(points) // _LONGEST_CONTOUR + 1]
    count = len(points)
    ring = np.concatenate([points, points])
    length = count
    while length >= _SHORTEST:
        for start in range(0, count, max(length // _OVERLAP, 1)):
            ellipse = ellipse_from_line(ring[start : start + length])
            if ellipse is not None:
                yield ellipse
        length //= 2


def seen_share(ellipse: FloatArray, points: FloatArray) -> float:
    """Share of the rim of an ellipse that points ``(K, 2)`` lie on."""
    distance, _ = ellipse_distance(ellipse, points)
    near = points[np.abs(distance) < _NEAR_PX] - ellipse[:2]
    unit = near @ np.linalg.inv(half_axes(ellipse))
    sector = (np.arctan2(unit[:, 1], unit[:, 0]) / (2 * np.pi) * _SECTORS).astype(int) % _SECTORS
    return len(np.unique(sector)) / _SECTORS
