"""Contours in an image that may be circular targets, also where something hides part of the rim."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np

from calib.se3 import FloatArray
from calib.vision.camera.conic import (
    ellipse_axes,
    ellipse_distance,
    fit_robust,
    half_axes,
    is_sound,
)
from calib.vision.camera.edges import find_edges
from calib.vision.camera.rendering import GreyImage

_SHORTEST = 40
"""Points of the shortest piece of a contour that is tried: fewer fit any ellipse."""

_OVERLAP = 3
"""Pieces of a contour start at every third of their length, so one of them misses a corner."""

_LONGEST_CONTOUR = 1500
"""Points of a contour above which only every second, third ... is looked at."""

_ON_RIM_PX = 1.2
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
    near = points[np.abs(distance) < _ON_RIM_PX] - ellipse[:2]
    unit = near @ np.linalg.inv(half_axes(ellipse))
    sector = (np.arctan2(unit[:, 1], unit[:, 0]) / (2 * np.pi) * _SECTORS).astype(int) % _SECTORS
    return len(np.unique(sector)) / _SECTORS


_FLATTEST = 0.25
"""Least ratio of the axes: that of a circle seen at 75 degrees, where no edge is good any more."""

_LEAST_KEPT = 0.7
"""Share of a contour that must lie on its ellipse for it to be one."""

_LEAST_SEEN = 0.4
"""Share of the rim that must be seen for a piece of a contour to point to a target: less than what
a measurement needs, which then says how much is missing."""

_NEAR_PX = 0.8
"""Scale of the distances of a contour from its ellipse: it goes from pixel to pixel."""

_POINTS = 120
"""Points of a contour that are fitted: more say nothing new."""

_LARGEST = 1.5
"""Long axis of a target in widths of the image: a longer one is a side that is nearly straight."""

_LEVELS = (0.5, 0.3, 0.7)
"""Thresholds tried where Otsu's shows nothing, between dark and light of the image."""

_LEAST_RANGE = 12
"""Grey levels between the darkest and the lightest pixel below which nothing is in the image."""

_MOST = 2000
"""Contours above which a threshold cuts through noise."""

Finder = Callable[[FloatArray, float, int], "FloatArray | None"]


def find_candidates(
    image: GreyImage, *, dark: bool, smallest_px: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Ellipses that contours follow to a pixel: those whole in the image, those that its edge cuts.

    Otsu's threshold first; where it shows nothing whole, which uneven light or a glare can bring
    about, some fixed ones between dark and light. Where none shows a whole rim, something may hide
    a part of it: then pieces of the contours are looked at.

    Parameters
    ----------
    image : ndarray (height, width) of uint8
    dark : bool
    smallest_px : float

    Returns
    -------
    whole, cut : list of ndarray (5,)
        [px].
    """
    smooth = np.asarray(cv2.GaussianBlur(image, (3, 3), 0), dtype=np.uint8)
    low, high, _, _ = cv2.minMaxLoc(smooth)
    if high - low < _LEAST_RANGE:
        return [], []
    otsu, _ = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    levels = [otsu, *(low + share * (high - low) for share in _LEVELS)]
    cut: list[FloatArray] = []
    for finder in (_whole_contour, _best_piece):
        for level in levels:
            found = _at_level(smooth, level, dark, smallest_px, finder)
            if finder is _best_piece:
                # corners of plates have pieces on an ellipse, too, but no edge about it
                found = [e for e in found if find_edges(image, e, dark=dark).share >= _LEAST_SEEN]
            inside = [e for e in found if _is_inside(e, image.shape)]
            if inside:
                return inside, []
            cut = cut or found
        if cut:
            break
    return [], cut


def _at_level(
    image: GreyImage, level: float, dark: bool, smallest_px: float, finder: Finder
) -> list[FloatArray]:
    kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
    _, binary = cv2.threshold(image, level, 255, kind)
    contours, hierarchy = cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not contours or len(contours) > _MOST:
        return []
    height, width = image.shape
    found = []
    for contour, (_, _, _, parent) in zip(contours, hierarchy[0], strict=True):
        # the rim is the outer contour of its region; its cross is a hole in it
        if parent >= 0 or len(contour) < 2.0 * smallest_px:
            continue
        points = contour[:, 0].astype(float)
        on_border = ((points <= 0) | (points >= [width - 1, height - 1])).any(axis=1)
        ellipse = finder(points[~on_border] + 0.5, smallest_px, width)
        if ellipse is not None:
            found.append(ellipse)
    return found


def _whole_contour(points: FloatArray, smallest_px: float, width: int) -> FloatArray | None:
    """Ellipse ``(5,)`` that most of a contour ``(K, 2)`` lies on; None where there is none."""
    if len(points) < smallest_px:
        return None
    points = points[:: max(len(points) // _POINTS, 1)]
    hull = cv2.convexHull(points.astype(np.float32))[:, 0]
    start = ellipse_from_line(np.asarray(hull))
    if start is None or not _is_plausible(start, smallest_px, width):
        return None
    fit = fit_robust(points, start, _NEAR_PX)
    if not is_sound(fit.ellipse) or not _is_plausible(fit.ellipse, smallest_px, width):
        return None
    return fit.ellipse if fit.kept.mean() >= _LEAST_KEPT and fit.rms_px < _NEAR_PX else None


def _best_piece(points: FloatArray, smallest_px: float, width: int) -> FloatArray | None:
    """Ellipse ``(5,)`` through a piece of a contour, that of which most is seen, or None."""
    best, most = None, _LEAST_SEEN
    for ellipse in ellipse_pieces(points):
        if _is_plausible(ellipse, smallest_px, width):
            share = seen_share(ellipse, points)
            if share > most:
                best, most = ellipse, share
    return best


def _is_plausible(ellipse: FloatArray, smallest_px: float, width: int) -> bool:
    long, short, _ = ellipse_axes(ellipse)
    return bool(short >= smallest_px and short >= _FLATTEST * long and long <= _LARGEST * width)


def _is_inside(ellipse: FloatArray, shape: tuple[int, ...]) -> bool:
    """Whether an ellipse lies wholly inside an image of a shape (height, width)."""
    half = np.hypot(ellipse[[2, 3]], ellipse[[3, 4]])
    low, high = ellipse[:2] - half, ellipse[:2] + half
    return bool((low > 1.0).all() and (high < np.array(shape[::-1]) - 1.0).all())
