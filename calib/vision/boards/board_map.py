"""The map from a flat board to its picture: a homography, and what a lens bends.

A lens bends the picture of a plane by a few pixels, and smoothly: a polynomial of third order over
the picture takes that up to some hundredths of a pixel, without knowing the lens. Points that do
not lie on such a map are not of the board. A fisheye lens bends by more than the distance of
neighbours. Its bend is taken first by two numbers, of the model of Kannala and Brandt, A generic
camera model and calibration method for conventional, wide-angle, and fish-eye lenses, IEEE TPAMI
28, 2006.
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

_FISHEYE = (0.9, 0.5, 1.3, 1.6)
"""Angles [rad] off the axis of a fisheye lens at which the corner of a picture is seen: a lens is
fitted from each on, if the first of them is better than none."""

_NEAR, _NEAR_ROUGH, _BETTER = 0.35, 0.4, 0.8
"""Mean distance of points from the map, in parts of a far one, below which no fisheye lens is
tried, of refined points and of rough ones; and what of it a lens leaves that is taken."""

_FLOOR_PX = 0.3
"""Points nearer than that to the map are never others: what the polynomial does not take of a lens
is less."""


@dataclass(frozen=True, eq=False)
class Fisheye:
    """A lens that draws pixels towards a middle.

    A ray at the angle ``a`` off the axis is seen ``focal_px * (a + cubic * a³)`` from the middle,
    and ``focal_px * tan(a)`` without the lens.
    """

    middle: FloatArray  # (2,): of the picture [px]
    focal_px: float
    cubic: float = 0.0

    def straight(self, px: FloatArray) -> FloatArray:
        """Return pixels ``(..., 2)`` without the lens."""
        off = (px - self.middle) / self.focal_px
        far = np.maximum(np.linalg.norm(off, axis=-1, keepdims=True), 1e-9)
        angle = far.copy()
        for _ in range(4):  # of Newton's method
            excess = angle * (1.0 + self.cubic * angle**2) - far
            angle = angle - excess / np.maximum(1.0 + 3.0 * self.cubic * angle**2, 0.2)
        part = np.tan(np.clip(angle, 1e-9, _WIDEST)) / far
        return np.asarray(self.middle + self.focal_px * part * off)

    def bent(self, px: FloatArray) -> FloatArray:
        """Return pixels ``(..., 2)`` with the lens."""
        off = (px - self.middle) / self.focal_px
        far = np.maximum(np.linalg.norm(off, axis=-1, keepdims=True), 1e-9)
        angle = np.arctan(far)
        part = angle * (1.0 + self.cubic * angle**2) / far
        return np.asarray(self.middle + self.focal_px * part * off)

    def fitted(self, xy: FloatArray, px: FloatArray) -> Fisheye:
        """Return the lens that points ``(K, 2)`` of a plane keep to best, from this one on."""
        lens, steps = self, np.array([[0.01, 0.0], [0.0, 0.01]])
        steps = steps[: 1 + (len(xy) >= _LENS_POINTS[1])]
        for _ in range(_LENS_ROUNDS):
            misses = [lens._moved(step)._miss(xy, px) for step in (np.zeros(2), *steps)]
            if any(miss is None for miss in misses):
                return lens
            here, *others = (np.asarray(miss) for miss in misses)
            slope = np.stack([(other - here) / 0.01 for other in others], axis=1)
            moved = np.asarray(np.linalg.lstsq(slope, -here, rcond=None)[0], dtype=float)
            lens = lens._moved(np.clip(moved, -0.2, 0.2) @ steps / 0.01)
        return lens

    def _moved(self, by: FloatArray) -> Fisheye:
        cubic = float(np.clip(self.cubic + by[1], -0.25, 0.25))
        return Fisheye(self.middle, self.focal_px * float(np.exp(by[0])), cubic)

    def _miss(self, xy: FloatArray, px: FloatArray) -> FloatArray | None:
        """Return distances ``(2 K,)`` [px] of points from those of the plane."""
        H, _ = cv2.findHomography(xy, self.straight(px), 0)
        if H is None or not np.isfinite(H).all():
            return None
        return np.asarray(self.bent(_projected(np.asarray(H, dtype=float), xy)) - px).ravel()


_LENS_ROUNDS, _LENS_POINTS = 3, (9, 20)
"""Rounds in which a lens is fitted; the fewest points that tell one number of it, and both."""

_WIDEST = 1.5
"""Largest angle [rad] off the axis of a lens at which anything is looked for."""


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
    start: BoardMap | None = None,
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
    start : BoardMap, optional
        A map before, whose lens is kept.

    Returns
    -------
    tuple or None
        None where fewer than four points keep to any map.
    """
    if len(xy) < 4:
        return None
    floor = _FLOOR_PX if refined else max(rough * near_px, 1.0)
    fisheye = None if start is None else start.fisheye
    best = _fit_robustly(xy, px, near_px, floor, refined, fisheye, start)
    if shape is None or fisheye is not None or len(xy) < _LENS_POINTS[0]:
        return best
    near = _NEAR if refined else _NEAR_ROUGH
    if _cost(best, xy, px, floor, most=1.0) < near:
        return best
    cost = _cost(best, xy, px, floor)
    middle = np.array([shape[1], shape[0]]) / 2.0 - 0.5
    for angle in _FISHEYE:
        lens = Fisheye(middle, float(np.linalg.norm(middle)) / angle)
        other = _fit_robustly(xy, px, near_px, floor, refined, lens, start)
        now = _cost(other, xy, px, floor)
        if now < _BETTER * cost:
            best, cost = other, now
        elif angle == _FISHEYE[0]:
            break
    return best


def _cost(
    fitted: tuple[BoardMap, BoolArray] | None,
    xy: FloatArray,
    px: FloatArray,
    far_px: float,
    most: float = 10.0,
) -> float:
    """Return the mean distance of points from a map in parts of a far one, each at ``most``."""
    if fitted is None:
        return most
    return float(np.minimum(np.linalg.norm(fitted[0](xy) - px, axis=1) / far_px, most).mean())


def _fit_robustly(
    xy: FloatArray,
    px: FloatArray,
    near_px: float,
    floor: float,
    refined: bool,
    fisheye: Fisheye | None,
    start: BoardMap | None = None,
) -> tuple[BoardMap, BoolArray] | None:
    limit = max(_FIRST_MISS * near_px, 2.0)
    if start is not None:
        inside = np.linalg.norm(start(xy) - px, axis=1) < limit
    else:
        straight = px if fisheye is None else fisheye.straight(px)
        first, kept = cv2.findHomography(xy, straight, cv2.RANSAC, limit, maxIters=500)
        if first is None or kept is None:
            return None
        inside = kept.ravel() > 0
    found: BoardMap | None = None
    for k in range(_ROUNDS):
        count = np.count_nonzero(inside)
        if count < 4:
            return None
        if fisheye is not None and k < _LENS_ROUNDS and count >= _LENS_POINTS[0]:
            fisheye = fisheye.fitted(xy[inside], px[inside])
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
    terms = np.empty((*at.shape[:-1], count))
    terms[..., 0] = 1.0
    first, order = 0, 0
    while first + order + 1 < count:  # of each order from those of the one before
        after = first + order + 1
        np.multiply(
            terms[..., first:after], y[..., None], out=terms[..., after : after + order + 1]
        )
        np.multiply(terms[..., after - 1], x, out=terms[..., after + order + 1])
        first, order = after, order + 1
    return terms
