"""Contours in an image that may be circular targets."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calib.camera.conic import ellipse_axes, is_sound
from calib.camera.rendering import GreyImage
from calib.camera.robust import fit_robust
from calib.se3 import FloatArray

_FLATTEST = 0.25
"""Least ratio of the axes: that of a circle seen at 75 degrees, where no edge is good any more."""

_LEAST_KEPT = 0.7
"""Share of a contour that must lie on its ellipse: less than that of a rim that can be measured,
for what hides a part of the rim makes a contour of its own."""

_NEAR_PX = 0.8
"""Scale of the distances of a contour from its ellipse: it goes from pixel to pixel."""

_POINTS = 120
"""Points of a contour that are fitted: more say nothing new."""

_LARGEST = 1.5
"""Long axis of a target in widths of the image: a longer one is a side that is nearly straight."""

_LEVELS = (0.5, 0.3, 0.7)
"""Thresholds tried where Otsu's shows nothing, between dark and light of the image."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Ellipse ``(5,)`` [px] that a contour follows to a pixel."""

    ellipse: FloatArray


def find_candidates(
    image: GreyImage, *, dark: bool, smallest_px: float
) -> tuple[list[Candidate], list[Candidate]]:
    """Elliptical contours: those whole in the image, and those that its edge cuts.

    Otsu's threshold first; where it shows nothing whole, which uneven light or a glare can bring
    about, some fixed ones between dark and light.
    """
    smooth = cv2.GaussianBlur(image, (3, 3), 0)
    otsu, _ = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    whole, cut = _at_level(smooth, float(otsu), dark, smallest_px)
    if not whole:
        low, high = np.percentile(smooth[::4, ::4], [1.0, 99.0])
        for level in _LEVELS:
            whole, more = _at_level(smooth, low + level * (high - low), dark, smallest_px)
            cut = cut or more
            if whole:
                break
    return whole, cut


def _at_level(
    image: cv2.typing.MatLike, level: float, dark: bool, smallest_px: float
) -> tuple[list[Candidate], list[Candidate]]:
    kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
    _, binary = cv2.threshold(image, level, 255, kind)
    contours, hierarchy = cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    whole: list[Candidate] = []
    cut: list[Candidate] = []
    height, width = image.shape[:2]
    for contour, (_, _, _, parent) in zip(
        contours, [] if hierarchy is None else hierarchy[0], strict=True
    ):
        # the rim is the outer contour of its region; its cross is a hole in it
        if parent >= 0 or len(contour) < 2.0 * smallest_px:
            continue
        points = contour[:, 0].astype(float)
        on_border = ((points <= 0) | (points >= [width - 1, height - 1])).any(axis=1)
        ellipse = _ellipse_of(points[~on_border] + 0.5, smallest_px, width)
        if ellipse is not None:
            (cut if on_border.any() else whole).append(Candidate(ellipse))
    return whole, cut


def _ellipse_of(points: FloatArray, smallest_px: float, width: int) -> FloatArray | None:
    """Ellipse ``(5,)`` that most of a contour ``(K, 2)`` lies on; None where there is none."""
    if len(points) < smallest_px:
        return None
    points = points[:: max(len(points) // _POINTS, 1)]
    hull = cv2.convexHull(points.astype(np.float32))
    if len(hull) < 5:
        return None
    (x, y), (first, second), turn = cv2.fitEllipseDirect(hull)
    angle = np.deg2rad(turn)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    S = (axes.T * (np.array([first, second]) / 2)) @ axes
    start = np.array([x, y, S[0, 0], S[0, 1], S[1, 1]])
    if not is_sound(start) or not _plausible(start, smallest_px, width):
        return None
    fit = fit_robust(points, start, _NEAR_PX)
    if not is_sound(fit.ellipse) or not _plausible(fit.ellipse, smallest_px, width):
        return None
    return fit.ellipse if fit.kept.mean() >= _LEAST_KEPT and fit.rms_px < _NEAR_PX else None


def _plausible(ellipse: FloatArray, smallest_px: float, width: int) -> bool:
    long, short, _ = ellipse_axes(ellipse)
    return bool(short >= smallest_px and short >= _FLATTEST * long and long <= _LARGEST * width)
