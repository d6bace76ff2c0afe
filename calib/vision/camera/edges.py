"""Where the edge of a circle is, to a hundredth of a pixel, along the normals of an ellipse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import (
    ellipse_axes,
    ellipse_distance,
    ellipse_of_axes,
    fit_robust,
    half_axes,
    is_sound,
)
from calib.vision.camera.rendering import GreyImage

_REACH_PX = 4.5
"""Half length of a profile: the edge within a pixel of its middle, and a plateau on each side
beyond three standard deviations of a blur of one pixel."""

_FREE_RADIUS = 0.4
"""Part of the radius, from the rim inwards, that a cross in the circle leaves free."""

_CROSS_BLUR_PX = 1.5
"""How far the edge of a cross spreads towards the rim: a standard deviation and a half of a usual
blur. Farther in, a cross would pull the edges of a circle of 20 px out by 0.2 px."""

_LEAST_REACH_PX = 1.5
"""Half length of the shortest profile: the edge within a pixel of its middle."""

_PLATEAU_PX = 1.5
"""Length at each end of a profile that counts as plateau."""

_STEP_PX = 0.5
"""Between samples of a profile: two in a pixel lose nothing of it."""

_SPACING_PX = 1.5
"""Between profiles along the rim: closer ones share their pixels."""

_FEWEST, _MOST = 32, 256
"""Profiles: enough for five unknowns and outliers; more than that the noise does not need."""

_NEIGHBOURS = 4
"""Profiles on each side whose plateaus are averaged: light varies slowly along the rim, and the
noise of a plateau shifts the edge by as much as the reach is long."""

_LEAST_CONTRAST = 0.5
"""Of the median contrast: with less, something stands before that part of the rim."""

_MOST_ADDED = 0.04
"""Of the median contrast, how much light may be added to both sides of the rim: what mirrors a lamp
adds to dark and light alike, and the slope of it moves the edge. Uneven light multiplies them."""

_SOFTEST = 6.0
"""Grey levels of contrast below which there is no edge."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Points of the edge ``(K, 2)`` [px] and whether each was found ``(K,)``."""

    points: FloatArray
    found: BoolArray

    @property
    def share(self) -> float:
        """Share of the rim where the edge was found."""
        return float(self.found.mean())


def find_edges(image: GreyImage, ellipse: FloatArray, *, dark: bool) -> Edges:
    """Edges along the normals of an ellipse ``(5,)`` within two pixels of them, dark inside or not.

    The edge is where a step between the two plateaus of a profile has the same area in the sector
    between its neighbours: ``∫ f (1 + t / rho) dt`` is kept, with f the profile from 1 inside to 0
    outside, t the way along the normal and rho the radius of curvature. A blur moves the half
    height of a curved edge inwards, by ``sigma² / (2 rho)``, but keeps that area.
    """
    long, short, _ = (float(v) for v in ellipse_axes(ellipse))
    count = int(np.clip(np.pi * (long + short) / 2 / _SPACING_PX, _FEWEST, _MOST))
    reach = min(_REACH_PX, max(_FREE_RADIUS * short / 2 - _CROSS_BLUR_PX, _LEAST_REACH_PX))
    on_rim, normal, radius = _rim(ellipse, count)
    return steps_along(image, on_rim, normal, reach, radius=radius, dark=dark)


def steps_along(
    image: GreyImage,
    points: FloatArray,
    normals: FloatArray,
    reach: float,
    *,
    dark: bool,
    radius: FloatArray | float = np.inf,
    ring: bool = True,
) -> Edges:
    """Edges along normals ``(K, 2)`` through points ``(K, 2)`` [px]; see :func:`find_edges`.

    Parameters
    ----------
    image : ndarray (height, width) of uint8
    points, normals : ndarray (K, 2)
    reach : float
        Half length of a profile [px].
    dark : bool
        Whether the side that the normals come from is the darker.
    radius : ndarray (K,) or float
        Radius of curvature [px], positive where the normals point away from its centre.
    ring : bool
        Whether neighbouring points follow each other about a closed edge, so that their plateaus
        may be averaged.
    """
    samples = 2 * max(round(reach / _STEP_PX), 3)
    step = 2 * reach / samples
    t = (np.arange(samples) + 0.5) * step - reach
    grey, seen = read_grey(image, points[:, None] + t[:, None] * normals[:, None] - 0.5)
    grey[~seen] = np.nan  # (K, samples)

    ends = max(round(min(_PLATEAU_PX, reach / 3) / step), 1)
    inside, outside = grey[:, :ends].mean(axis=1), grey[:, -ends:].mean(axis=1)
    if ring:
        inside, outside = _smooth(inside), _smooth(outside)
    contrast = outside - inside if dark else inside - outside
    measured = contrast[np.isfinite(contrast)]
    bound = max(_LEAST_CONTRAST * float(np.median(measured)), _SOFTEST) if measured.size else np.inf
    weight = 1.0 + t / np.asarray(radius)[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = contrast > bound
        if ring and found.any():
            darker, lighter = (inside, outside) if dark else (outside, inside)
            ratio = float(np.median(darker[found]) / np.median(lighter[found]))
            added = np.abs(darker - ratio * lighter) / (1.0 - ratio)
            found &= added <= _MOST_ADDED * float(np.median(measured))
        share = (outside[:, None] - grey) / (outside - inside)[:, None]
        area = (share * weight).sum(axis=1) * step
        g = area - reach + reach**2 / (2.0 * radius)
        shift = g - g**2 / (2.0 * radius)
        found &= np.abs(shift) < reach / 2
    return Edges(points + np.where(found, shift, 0.0)[:, None] * normals, found)


def _rim(ellipse: FloatArray, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points ``(K, 2)``, outward normals ``(K, 2)``, radii of curvature ``(K,)`` of an ellipse."""
    S = half_axes(ellipse)
    angle = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    along = np.stack([-unit[:, 1], unit[:, 0]], axis=-1) @ S
    speed = np.linalg.norm(along, axis=1)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=-1) / speed[:, None]
    return ellipse[:2] + unit @ S, normal, speed**3 / np.linalg.det(S)


def _smooth(values: FloatArray) -> FloatArray:
    """Mean of each of ``(K,)`` values about a ring with its neighbours; NaN where one is NaN."""
    ring = np.concatenate([values[-_NEIGHBOURS:], values, values[:_NEIGHBOURS]])
    width = 2 * _NEIGHBOURS + 1
    return np.convolve(ring, np.full(width, 1.0 / width), mode="valid")


def read_grey(
    image: GreyImage | NDArray[np.float32], at: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Grey levels ``(...)`` at OpenCV's pixels ``(..., 2)``, and which of them are in the image.

    Between those of the four about them; not by OpenCV's ``remap``, which rounds places to 1/32 of
    a pixel.
    """
    height, width = image.shape
    x, y = at[..., 0], at[..., 1]
    with np.errstate(invalid="ignore"):
        inside = (x >= 0.0) & (x <= width - 1.001) & (y >= 0.0) & (y <= height - 1.001)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    column, row = x.astype(np.intp), y.astype(np.intp)
    right, down = x - column, y - row
    flat, first = image.ravel(), row * width + column
    above = flat[first] * (1.0 - right) + flat[first + 1] * right
    below = flat[first + width] * (1.0 - right) + flat[first + width + 1] * right
    return np.asarray(above * (1.0 - down) + below * down, dtype=float), inside


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
    center, (first, second), turn = cv2.fitEllipseDirect(points.astype(np.float32))
    ellipse = ellipse_of_axes(center, first, second, np.deg2rad(turn))
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

_MOST_CANDIDATES = 2000
"""Contours above which a threshold cuts through noise."""

Finder = Callable[[FloatArray, float, int], "FloatArray | None"]


def find_candidates(
    image: GreyImage, *, dark: bool, smallest_px: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Ellipses that contours follow to a pixel: those whole in the image, those that its edge cuts.

    Otsu's threshold first; where it shows nothing whole, which uneven light or a glare can bring
    about, some fixed ones between dark and light. Where none shows a whole rim, something may hide
    a part of it: then pieces of the contours are looked at.
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
    if not contours or len(contours) > _MOST_CANDIDATES:
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
