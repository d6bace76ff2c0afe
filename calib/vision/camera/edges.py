"""Where the edge of a circle is, to a hundredth of a pixel, along the normals of an ellipse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import ellipse_axes, half_axes
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
    """Edges along the normals of an ellipse that is within two pixels of them.

    The edge is where a step between the two plateaus of a profile has the same area in the sector
    between its neighbours: ``∫ f (1 + t / rho) dt`` is kept, with f the profile from 1 inside to 0
    outside, t the way along the normal and rho the radius of curvature. A blur moves the half
    height of a curved edge inwards, by ``sigma² / (2 rho)``, but keeps that area.

    Parameters
    ----------
    image : ndarray (height, width) of uint8
    ellipse : ndarray (5,)
        [px].
    dark : bool
        Whether the inside is the darker side.
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
    grey = _bilinear(image, points[:, None] + t[:, None] * normals[:, None])  # (K, samples)

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


def _bilinear(image: GreyImage, pixels: FloatArray) -> FloatArray:
    """Grey levels ``(...)`` at pixels ``(..., 2)``; NaN outside the middles of the image's pixels.

    Not OpenCV's ``remap``, which rounds places to 1/32 of a pixel.
    """
    height, width = image.shape
    x, y = pixels[..., 0] - 0.5, pixels[..., 1] - 0.5
    outside = (x < 0.0) | (y < 0.0) | (x > width - 1) | (y > height - 1)
    column = np.clip(np.floor(x), 0, width - 2).astype(np.intp)
    row = np.clip(np.floor(y), 0, height - 2).astype(np.intp)
    fx, fy = x - column, y - row
    flat, at = image.ravel(), row * width + column
    top = flat[at] * (1.0 - fx) + flat[at + 1] * fx
    bottom = flat[at + width] * (1.0 - fx) + flat[at + width + 1] * fx
    return np.where(outside, np.nan, top * (1.0 - fy) + bottom * fy)
