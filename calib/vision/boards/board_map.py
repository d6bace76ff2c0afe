"""The map from a flat board to its picture: a homography, and what a lens bends.

A lens bends the picture of a plane by a few pixels, and smoothly: a polynomial of third order over
the picture takes that up to some hundredths of a pixel, without knowing the lens. Points that do
not lie on such a map are not of the board. A fisheye lens bends by more than the distance of
neighbours. Its bend is taken first by one number, of the division model of Fitzgibbon,
Simultaneous linear estimation of multiple view geometry and lens distortion, CVPR 2001.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calib.se3 import BoolArray, FloatArray

_ORDERS = ((30, 3), (16, 2))
"""Points from which on the polynomial has an order; with fewer there is the homography alone."""

_ROUNDS = 12
_FIRST_MISS = 0.35
"""Distance from the homography of points that may be the board's, in parts of the distance of
neighbours: a lens bends by less, and a point that is further off is nearer to another."""

_SIGMAS = 5.0
"""Standard deviations beyond which a point is another."""

ROUGH, ROUGH_MARKERS = 0.06, 0.15
"""Distance from the map of rough points that are the board's, in parts of the distance of
neighbours: paper is not flat, and corners of small markers are off by a pixel."""

_FISHEYE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Parts by which the corner of a picture is nearer to its middle than without a fisheye lens."""

_MOST = 0.85
"""Share of points on the map from which on no fisheye lens is tried."""

_FLOOR_PX = 0.3
"""Points nearer than that to the map are never others: what the polynomial does not take of a lens
is less."""


@dataclass(frozen=True, eq=False)
class Fisheye:
    """A lens that draws pixels towards a middle by the division model."""

    middle: FloatArray  # (2,): of the picture [px]
    strength: float  # one over the square of pixels

    def straight(self, px: FloatArray) -> FloatArray:
        """Return pixels ``(..., 2)`` without the lens."""
        off = px - self.middle
        part = 1.0 - self.strength * (off * off).sum(axis=-1, keepdims=True)
        return np.asarray(self.middle + off / np.maximum(part, 0.05))

    def bent(self, px: FloatArray) -> FloatArray:
        """Return pixels ``(..., 2)`` with the lens."""
        off = px - self.middle
        square = (off * off).sum(axis=-1, keepdims=True)
        return np.asarray(
            self.middle + 2.0 * off / (1.0 + np.sqrt(1.0 + 4 * self.strength * square))
        )


@dataclass(frozen=True, eq=False)
class BoardMap:
    """Where points of a board are seen, in OpenCV's pixels."""

    homography: FloatArray  # (3, 3): from the board [m]
    bend: FloatArray
    """(terms, 2): coefficients [px] of the polynomial, for terms of order two and three."""
    center: FloatArray  # (2,)
    scale: float  # of the pixels that the polynomial is written in
    fisheye: Fisheye | None = None

    def __call__(self, xy: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of points ``(..., 2)`` [m]."""
        flat = _projected(self.homography, np.asarray(xy))
        if self.fisheye is not None:
            flat = self.fisheye.bent(flat)
        if not len(self.bend):
            return flat
        terms = _terms((flat - self.center) / self.scale, len(self.bend))
        return np.asarray(flat + terms @ self.bend)

    def slope(self, xy: FloatArray, step_m: float) -> FloatArray:
        """Derivatives ``(..., 2, 2)`` [px/m], columns by x and y."""
        right, down = np.array([step_m, 0.0]), np.array([0.0, step_m])
        by_x = self(xy + right) - self(xy - right)
        by_y = self(xy + down) - self(xy - down)
        return np.stack([by_x, by_y], axis=-1) / (2 * step_m)


def fit_map(
    xy: FloatArray,
    px: FloatArray,
    near_px: float,
    *,
    refined: bool = False,
    rough: float = ROUGH,
    shape: tuple[int, ...] | None = None,
    fisheye: Fisheye | None = None,
) -> tuple[BoardMap, BoolArray] | None:
    """Fit the map that most of the points keep to, and tell which points do.

    Parameters
    ----------
    xy, px : ndarray (K, 2)
        Points on the board [m] and in the picture.
    near_px : float
        Distance of neighbours in the picture.
    refined : bool
        The points are known to a fraction of a pixel.
    rough : float
        Distance from the map of points that are not refined, in parts of ``near_px``.
    shape : tuple of int, optional
        Height and width of the picture. Fisheye lenses are tried where they are given and many
        points keep to no map without.
    fisheye : Fisheye, optional
        The lens, where it is known from a map before.

    Returns
    -------
    tuple or None
        None where fewer than four points keep to any map.
    """
    if len(xy) < 4:
        return None
    floor = _FLOOR_PX if refined else max(rough * near_px, 1.0)
    best = _fit_robustly(xy, px, near_px, floor, refined, fisheye)
    if shape is None or fisheye is not None or len(xy) < 16:
        return best
    if best is not None and best[1].mean() > _MOST:
        return best
    middle = np.array([shape[1], shape[0]]) / 2.0 - 0.5
    for part in _FISHEYE:
        lens = Fisheye(middle, part / float(middle @ middle))
        other = _fit_robustly(xy, px, near_px, floor, refined, lens)
        if other is not None and (best is None or other[1].sum() > best[1].sum()):
            best = other
    return best


def _fit_robustly(
    xy: FloatArray,
    px: FloatArray,
    near_px: float,
    floor: float,
    refined: bool,
    fisheye: Fisheye | None,
) -> tuple[BoardMap, BoolArray] | None:
    straight = px if fisheye is None else fisheye.straight(px)
    first, kept = cv2.findHomography(
        xy, straight, cv2.RANSAC, max(_FIRST_MISS * near_px, 2.0), maxIters=500
    )
    if first is None or kept is None:
        return None
    inside = kept.ravel() > 0
    found: BoardMap | None = None
    for k in range(_ROUNDS):
        if np.count_nonzero(inside) < 4:
            return None
        found = _fit(xy[inside], px[inside], fisheye)
        if found is None:
            return None
        miss = np.linalg.norm(found(xy) - px, axis=1)
        usual = _SIGMAS * 1.2 * float(np.median(miss[inside]))
        last = max(usual if refined else floor, floor)
        now = miss <= max(last, 0.5**k * _FIRST_MISS * near_px)
        # a closer limit leaves none of them out, either
        if np.array_equal(now, inside) and (miss[inside] <= last).all():
            break
        inside = now
    if found is None or np.count_nonzero(inside) < 4:
        return None
    return found, inside


def spacing(points: FloatArray) -> float:
    """Median distance of points ``(K, 2)`` from the nearest other one, in their unit."""
    from scipy.spatial import cKDTree

    return float(np.median(np.asarray(cKDTree(points).query(points, k=[2])[0])))


def _fit(xy: FloatArray, px: FloatArray, fisheye: Fisheye | None) -> BoardMap | None:
    solved, _ = cv2.findHomography(xy, px if fisheye is None else fisheye.straight(px), 0)
    if solved is None or not np.isfinite(solved).all():
        return None
    homography = np.asarray(solved, dtype=float)
    flat = _projected(homography, xy)
    if fisheye is not None:
        flat = fisheye.bent(flat)
    center = flat.mean(axis=0)
    scale = float(np.abs(flat - center).max()) or 1.0
    order = next((order for least, order in _ORDERS if len(xy) >= least), 0)
    if not order:
        return BoardMap(homography, np.empty((0, 2)), center, scale, fisheye)
    count = (order + 1) * (order + 2) // 2
    terms = _terms((flat - center) / scale, count)
    bend = np.asarray(np.linalg.lstsq(terms, px - flat, rcond=1e-4)[0], dtype=float)
    return BoardMap(homography, bend, center, scale, fisheye)


def _projected(homography: FloatArray, xy: FloatArray) -> FloatArray:
    out = xy @ homography[:, :2].T + homography[:, 2]
    return np.asarray(out[..., :2] / out[..., 2:])


def _terms(at: FloatArray, count: int) -> FloatArray:
    """Powers of the pixels ``(..., count)``, all orders from zero on."""
    x, y = at[..., 0], at[..., 1]
    rows = [[np.ones_like(x)]]
    while sum(map(len, rows)) < count:  # of each order from those of the one before
        rows.append([power * y for power in rows[-1]] + [rows[-1][-1] * x])
    return np.stack([power for row in rows for power in row], axis=-1)
