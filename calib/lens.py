"""Lenses as functions of their parameters: pixels of points, and the derivatives of both.

Conventions are those of :mod:`calib.vision.camera.lens`: z along the optical axis, x to the right,
y down, pixels from the left upper corner of the image, whose first pixel has its middle at
(0.5, 0.5). Distortions are OpenCV's, in its order [OpenCV]_:

- ``pinhole``: k1 k2 p1 p2 k3 [Brown1971]_;
- ``rational``: the same with k4 k5 k6 in the denominator of the radial factor;
- ``fisheye``: k1 k2 k3 k4 over the angle from the axis [Kannala2006]_.

Arrays have the posture last: K points at S postures are ``(3, K, S)``.

References
----------
.. [OpenCV] Camera calibration and 3D reconstruction, detailed description; fisheye camera model.
.. [Brown1971] D. C. Brown, Close-range camera calibration, Photogrammetric Engineering 37, 1971.
.. [Kannala2006] J. Kannala, S. Brandt, A generic camera model and calibration method for
   conventional, wide-angle, and fish-eye lenses, IEEE TPAMI 28, 2006.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from calib.errors import InputError, near_names
from calib.se3 import FloatArray

LensName = Literal["pinhole", "rational", "fisheye"]

LINEAR = ("fx", "fy", "cx", "cy")
"""Focal lengths and principal point [px], the first of all parameters."""

DISTORTION: dict[str, tuple[str, ...]] = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
"""Terms of each distortion, in OpenCV's order."""

NEAREST_M = 1e-3
"""Depth that points nearer to the lens, or behind it, are taken to have: a fit that starts badly
then sees a large residual and not none."""


Terms = Sequence[float] | FloatArray
"""Distortion in OpenCV's order."""


class Projection(NamedTuple):
    """Pixels of points and their derivatives."""

    pixels: FloatArray  # (2, K, S)
    by_point: FloatArray  # (2, 3, K, S) [px/m]
    by_lens: FloatArray  # (L, 2, K, S), by the parameters of the lens


@dataclass(frozen=True)
class Lens:
    """A lens with its values."""

    name: LensName
    width_px: int
    height_px: int  # width_px, height_px: size of the image
    values: tuple[float, ...]  # fx, fy, cx, cy [px], then the distortion in OpenCV's order

    def __post_init__(self) -> None:
        if self.name not in DISTORTION:
            raise InputError(
                f"there is no lens {self.name!r}",
                hint=near_names(self.name, tuple(DISTORTION)),
                name="lens",
            )
        names = self.names
        if len(self.values) != len(names):
            raise InputError(
                f"a {self.name} lens has {len(names)} values, {len(self.values)} were given",
                hint=" ".join(names),
                name="lens",
            )
        if not (np.isfinite(self.values).all() and min(self.values[:2]) > 0):
            raise InputError(
                f"a lens with the values {', '.join(f'{v:g}' for v in self.values)} cannot be",
                hint="focal lengths are above zero",
                name="lens",
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values."""
        return (*LINEAR, *DISTORTION[self.name])

    @property
    def distortion(self) -> tuple[float, ...]:
        """Distortion in OpenCV's order."""
        return self.values[len(LINEAR) :]

    @cached_property
    def steepest(self) -> float:
        """Slope of the steepest ray that the lens shows, a little beyond the edge of the image."""
        x, y = float(self.width_px), float(self.height_px)
        edge = np.array([[a * x, b * y] for a in (0.0, 0.5, 1.0) for b in (0.0, 0.5, 1.0)])
        return BEYOND * float(np.linalg.norm(self.rays(edge), axis=1).max())

    def with_values(self, values: FloatArray) -> Lens:
        """The same lens with other values."""
        return replace(self, values=tuple(float(value) for value in values))

    @classmethod
    def from_opencv(
        cls, name: LensName, size_px: tuple[int, int], K: FloatArray, distortion: FloatArray
    ) -> Lens:
        """A lens from OpenCV's camera matrix ``(3, 3)`` and distortion; missing terms are zero."""
        terms = np.zeros(len(DISTORTION[name]))
        given = np.ravel(distortion)
        if np.any(given[len(terms) :]):
            raise InputError(
                f"a {name} lens has {len(terms)} terms of distortion, {given.size} were given",
                name="lens",
            )
        terms[: given.size] = given[: len(terms)]
        linear = (K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5)
        return cls(name, *size_px, tuple(float(v) for v in (*linear, *terms)))

    def to_opencv(self) -> tuple[FloatArray, FloatArray]:
        """OpenCV's camera matrix ``(3, 3)`` and distortion."""
        fx, fy, cx, cy = self.values[:4]
        K = np.array([[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]])
        return K, np.array(self.distortion)

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of points ``(..., 3)`` [m]; NaN behind the lens."""
        x, y, z = np.asarray(points, dtype=float).T
        depth = np.maximum(z, NEAREST_M)
        x, y = x / depth, y / depth
        if self.name == "fisheye":
            r, _, far = _fisheye_angle(self.distortion, x, y)
            image = x * (far / r), y * (far / r)
        else:
            image = distorted(self.distortion, x, y)
        fx, fy, cx, cy = self.values[:4]
        pixels = np.where(z > 0, [fx * image[0] + cx, fy * image[1] + cy], np.nan)
        return np.ascontiguousarray(pixels.T)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Where pixels ``(..., 2)`` lie on the plane z = 1, ``(..., 2)``, by OpenCV; NaN stays."""
        import cv2

        K, distortion = self.to_opencv()
        flat = np.reshape(pixels, (-1, 1, 2)) - 0.5
        known = np.isfinite(flat).all(axis=(1, 2))
        out = np.full((len(flat), 2), np.nan)
        if known.any():
            ends = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12)
            if self.name == "fisheye":
                found = cv2.fisheye.undistortPoints(flat[known], K, distortion, criteria=ends)
            else:
                found = cv2.undistortPointsIter(
                    flat[known], K, distortion, np.eye(3), np.eye(3), ends
                )
            out[known] = found.reshape(-1, 2)
        return out.reshape(*np.shape(pixels)[:-1], 2)


def project(name: str, values: FloatArray, points: FloatArray) -> Projection:
    """Project points ``(3, K, S)`` [m] in the frame of a camera by lens values ``(L, S)``."""
    depth = np.maximum(points[2], NEAREST_M)
    x, y = points[0] / depth, points[1] / depth
    distort = _fisheye if name == "fisheye" else _radial
    image, slope, by_terms = distort(values[4:, None, :], x, y)
    f = values[:2, None, :]
    pixels = f * image + values[2:4, None, :]
    by_lens = np.zeros((len(values), 2, *x.shape))
    for k in range(2):
        by_lens[k, k] = image[k]
        by_lens[2 + k, k] = 1.0
    by_lens[4:] = by_terms * f
    by_point = slope_by_point(f, slope, x, y, depth)
    by_point[:, 2] *= points[2] > NEAREST_M
    return Projection(pixels, by_point, by_lens)


BEYOND = 1.02
"""Slope of a ray, over that of the steepest in the image, up to which a lens is described: the
polynomial of a distortion brings what is far outside back into the picture."""


Image = tuple[FloatArray, FloatArray]
"""x and y of points in the image ``(...)``, in focal lengths."""


class Slope(NamedTuple):
    """Derivatives of a distorted image by x and y, ``(...)`` each: a symmetric matrix."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray


_Distorted = tuple[FloatArray, Slope, FloatArray]
"""Image ``(2, K, S)`` in focal lengths, its derivative by x and y, and by the terms."""


def slope_by_point(
    focal_px: FloatArray, slope: Slope, x: FloatArray, y: FloatArray, depth: FloatArray
) -> FloatArray:
    """Derivatives ``(2, 3, ...)`` [px/m] of pixels by points at ``x, y`` of a depth [m]."""
    out = np.empty((2, 3, *x.shape))
    for row in range(2):
        for k in range(2):
            out[row, k] = focal_px[row] * slope[row + k] / depth
        out[row, 2] = -(out[row, 0] * x + out[row, 1] * y)
    return out


def distorted(terms: Terms, x: FloatArray, y: FloatArray) -> Image:
    """The image in focal lengths by Brown's distortion, with a denominator of eight terms.

    With ``r² = x² + y²`` and the factor ``f = 1 + k1 r² + k2 r⁴ + k3 r⁶``, over ``1 + k4 r² + k5 r⁴
    + k6 r⁶`` of eight terms: ``x' = x f + 2 p1 x y + p2 (r² + 2 x²)`` and ``y' = y f + p1 (r² + 2
    y²) + 2 p2 x y`` [Brown1971]_. Of points over their depth ``(...)``, by terms as
    :data:`DISTORTION` has them.
    """
    r2 = x * x + y * y
    return _bent(terms, x, y, r2, _radial_factor(terms, r2)[0])


def distorted_with_slope(terms: Terms, x: FloatArray, y: FloatArray) -> tuple[Image, Slope]:
    """What :func:`distorted` gives, and its derivatives by x and y."""
    k1, k2, p1, p2, k3 = terms[:5]
    xx, yy = x * x, y * y
    r2 = xx + yy
    radial, below = _radial_factor(terms, r2)
    by_r2 = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))
    if len(terms) > 5:
        k4, k5, k6 = terms[5:]
        by_r2 = (by_r2 - radial * (k4 + r2 * (2.0 * k5 + r2 * (3.0 * k6)))) / below
    by_r2 = 2.0 * by_r2
    along_x, along_y = p2 * x, p1 * y
    slope = Slope(
        radial + xx * by_r2 + 2.0 * along_y + 6.0 * along_x,
        x * y * by_r2 + 2.0 * (p1 * x + p2 * y),
        radial + yy * by_r2 + 6.0 * along_y + 2.0 * along_x,
    )
    return _bent(terms, x, y, r2, radial), slope


def _radial_factor(terms: Terms, r2: FloatArray) -> tuple[FloatArray, FloatArray | float]:
    """By how much points lie further out, and its denominator."""
    k1, k2, _, _, k3 = terms[:5]
    above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if len(terms) == 5:
        return above, 1.0
    k4, k5, k6 = terms[5:]
    below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return above / below, below


def _bent(terms: Terms, x: FloatArray, y: FloatArray, r2: FloatArray, radial: FloatArray) -> Image:
    p1, p2 = terms[2:4]
    factor = radial + 2.0 * (p1 * y + p2 * x)
    return x * factor + p2 * r2, y * factor + p1 * r2


def _radial(terms: FloatArray, x: FloatArray, y: FloatArray) -> _Distorted:
    image, slope = distorted_with_slope(terms, x, y)
    r2 = x * x + y * y
    by_terms = np.empty((len(terms), 2, *x.shape))
    radial, below = _radial_factor(terms, r2)
    powers = (r2 / below, r2 * r2 / below, r2**3 / below)
    for k, power in zip((0, 1, 4), powers, strict=True):
        by_terms[k] = x * power, y * power
    xy = 2.0 * x * y
    by_terms[2] = xy, r2 + 2.0 * y * y
    by_terms[3] = r2 + 2.0 * x * x, xy
    for k, power in zip(range(5, len(terms)), powers, strict=False):
        by_terms[k] = -radial * x * power, -radial * y * power
    return np.stack(image), slope, by_terms


def _fisheye(terms: FloatArray, x: FloatArray, y: FloatArray) -> _Distorted:
    """Kannala's distortion: the image is as far out as a polynomial of the angle says."""
    r, angle, far = _fisheye_angle(terms, x, y)
    k1, k2, k3, k4 = terms
    a2 = angle * angle
    far_slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)))
    factor, r2 = far / r, r * r
    by_r2 = (far_slope / (1.0 + r2) - factor) / r2  # of the factor, over x or y
    slope = Slope(factor + x * x * by_r2, x * y * by_r2, factor + y * y * by_r2)
    powers = np.stack([angle ** (2 * k + 3) / r for k in range(4)])
    by_terms = np.stack([powers * x, powers * y], axis=1)
    return np.stack([x * factor, y * factor]), slope, by_terms


def _fisheye_angle(
    terms: Terms, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance from the axis, its angle, and that of the image."""
    r = np.sqrt(np.maximum(x * x + y * y, 1e-24))
    angle = np.arctan(r)
    a2 = angle * angle
    k1, k2, k3, k4 = terms
    return r, angle, angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
