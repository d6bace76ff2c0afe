"""Images of targets as a camera takes them: anti-aliased, blurred, unevenly lit, noisy, 8 bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.se3 import FloatArray
from calib.vision.camera.lens import Camera

GreyImage = NDArray[np.uint8]

_SAMPLES = 64
"""Rays of a pixel that an edge runs through: their mean is within 0.01 of the covered area."""

_BLOCK = 1024
"""Such pixels at once: what their rays take stays in the cache."""

_SIDE = np.linspace(0.0, 1.0, 9)[:, None]
"""Places along each side of a plate at which it is projected: a bowed side stays in the box."""


class Plate(Protocol):
    """A flat target, with z out of its face."""

    def pattern(self, xy: FloatArray) -> FloatArray:
        """Reflectance ``(...)`` at points ``(..., 2)`` [m] of its plane; NaN off it."""

    def plate_corners(self) -> FloatArray:
        """Corners ``(4, 3)`` [m] in its frame, in order about z."""


@dataclass(frozen=True)
class Occluder:
    """Something near the lens that hides a part of the image; its outline is good to a pixel."""

    corners_px: tuple[tuple[float, float], ...]  # of a polygon
    reflectance: float = 0.2


@dataclass(frozen=True)
class Glare:
    """Mirrored light: a blob that is added to the image, and cut off where the image saturates."""

    center_px: tuple[float, float]
    sigma_px: float
    peak_grey: float = 400.0  # added in its middle


@dataclass(frozen=True)
class Imaging:
    """How a scene becomes grey levels."""

    blur_px: float = 1.0  # standard deviation of the Gaussian point spread function; 0 for none
    noise_grey: float = 2.0  # standard deviation of the Gaussian noise of a pixel, in grey levels
    white_grey: float = 230.0  # grey level of a white surface in the middle of the image
    surroundings: float = 0.35  # reflectance of what stands about the plates
    gradient: tuple[float, float] = (0.0, 0.0)
    """Relative change of the light from the left edge to the right one, and from top to bottom."""
    vignetting: float = 0.0
    """Relative loss of light in the corners; it grows with the square of the distance."""
    occluders: tuple[Occluder, ...] = ()
    glares: tuple[Glare, ...] = ()

    def __post_init__(self) -> None:
        for name in ("blur_px", "noise_grey"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value}", hint="give a number of 0 or more", name=name)


def render(
    camera: Camera,
    scene: Sequence[tuple[Plate, FloatArray]],
    imaging: Imaging,
    rng: np.random.Generator,
) -> GreyImage:
    """Image of targets, each at its pose.

    Parameters
    ----------
    scene : sequence of (Plate, array (4, 4))
        Targets with ``T_camera_target`` [m], the later in front of the earlier. A target that
        shows its back or lies behind the lens is not drawn.
    rng : numpy.random.Generator
        Of the noise.
    """
    shape = (camera.height_px, camera.width_px)
    reflectance = np.full(shape, imaging.surroundings, dtype=np.float32)
    for target, T_camera_target in scene:
        _draw(reflectance, camera, target, T_camera_target)
    for occluder in imaging.occluders:
        _hide(reflectance, occluder)
    if imaging.blur_px > 0.0:
        reflectance = np.asarray(
            cv2.GaussianBlur(reflectance, (0, 0), imaging.blur_px, borderType=cv2.BORDER_REPLICATE),
            dtype=np.float32,
        )
    grey = reflectance
    grey *= _light(shape, imaging.white_grey, imaging.gradient, imaging.vignetting)
    for glare in imaging.glares:
        grey += _blob(shape, glare)
    noise = np.zeros_like(grey)
    if imaging.noise_grey > 0.0:
        noise = rng.standard_normal(shape, dtype=np.float32)
        noise *= np.float32(imaging.noise_grey)
    # rounds and saturates as a camera does, in one pass
    return np.asarray(cv2.add(grey, noise, dtype=cv2.CV_8U), dtype=np.uint8)


def _draw(
    reflectance: NDArray[np.float32], camera: Camera, target: Plate, T_camera_target: FloatArray
) -> None:
    """Draw one target: its pattern at the corners of the pixels, sampled finely on its edges.

    A pixel whose four corners see the same is of that reflectance: an arc of radius r px that
    enters and leaves through one side covers less than 1 / (12 r) of it. The others are sampled
    with many rays, and what lies off the plate stays as it was.
    """
    normal, place = T_camera_target[:3, 2], T_camera_target[:3, 3]
    if normal @ place >= 0.0:
        return
    box = _box(camera, target, T_camera_target)
    if box is None:
        return
    left, top, right, bottom = box
    view = reflectance[top:bottom, left:right]
    # (x, y, 1) / depth in the plane of the target, linear in the ray
    plane = np.linalg.inv(T_camera_target[:3, [0, 1, 3]])
    rays = _corner_rays(camera)[:, top : bottom + 1, left : right + 1]
    corners = np.tensordot(plane, rays, axes=1).astype(np.float32)
    seen = _pattern(target, corners)
    first = seen[:-1, :-1]
    same = (seen[1:, :-1] == first) & (seen[:-1, 1:] == first) & (seen[1:, 1:] == first)
    plain = same & (first >= 0.0)
    view[plain] = first[plain]
    on_edges = np.nonzero(~same)
    for start in range(0, len(on_edges[0]), _BLOCK):
        rows, columns = (index[start : start + _BLOCK] for index in on_edges)
        around = np.stack(
            [corners[:, rows + i, columns + j] for i in (0, 1) for j in (0, 1)], axis=-1
        )
        fine = _pattern(target, around @ _bilinear())  # shape (edge pixels, samples)
        off = fine < 0.0
        fine[off] = 0.0
        view[rows, columns] = fine.mean(axis=1) + off.mean(axis=1) * view[rows, columns]


def _pattern(target: Plate, plane: NDArray[np.float32]) -> FloatArray:
    """Reflectance ``(...)`` at homogeneous points ``(3, ...)`` of the plane, -1 off the plate."""
    inverse_depth = np.where(plane[2] > 0.0, plane[2], np.float32(np.nan))
    seen = target.pattern(np.moveaxis(plane[:2] / inverse_depth, 0, -1))
    seen[np.isnan(seen)] = -1.0
    return seen


def _box(
    camera: Camera, target: Plate, T_camera_target: FloatArray
) -> tuple[int, int, int, int] | None:
    """Left, top, right, bottom of the pixels that a plate may cover; None where there are none."""
    corners = target.plate_corners()
    sides = [a + _SIDE * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    points = np.vstack(sides) @ T_camera_target[:3, :3].T + T_camera_target[:3, 3]
    pixels = camera.project(points)
    size = np.array([camera.width_px, camera.height_px])
    unseen = np.isnan(pixels).any(axis=1)
    if unseen.all():
        return None
    low, high = (np.zeros(2), size) if unseen.any() else (pixels.min(axis=0), pixels.max(axis=0))
    # one pixel more on each side for what a bowed side does between its sampled places
    left, top = (int(v) for v in np.clip(np.floor(low) - 1, 0, size))
    right, bottom = (int(v) for v in np.clip(np.ceil(high) + 1, 0, size))
    return (left, top, right, bottom) if left < right and top < bottom else None


def _hide(reflectance: NDArray[np.float32], occluder: Occluder) -> None:
    mask = np.zeros(reflectance.shape, dtype=np.uint8)
    shift = 8  # bits of the fraction of a pixel
    corners = np.rint((np.array(occluder.corners_px) - 0.5) * (1 << shift)).astype(np.int32)
    cv2.fillPoly(mask, [corners], 255, lineType=cv2.LINE_AA, shift=shift)
    share = mask.astype(np.float32) / 255.0
    reflectance += share * (occluder.reflectance - reflectance)


def _blob(shape: tuple[int, int], glare: Glare) -> NDArray[np.float32]:
    (x, y), sigma = glare.center_px, glare.sigma_px
    across = np.exp(-0.5 * ((np.arange(shape[1]) + 0.5 - x) / sigma) ** 2)
    down = np.exp(-0.5 * ((np.arange(shape[0]) + 0.5 - y) / sigma) ** 2)
    return (glare.peak_grey * np.outer(down, across)).astype(np.float32)


@lru_cache(maxsize=4)
def _corner_rays(camera: Camera) -> FloatArray:
    """Rays ``(3, height + 1, width + 1)`` through the corners of the pixels."""
    x, y = np.meshgrid(np.arange(camera.width_px + 1.0), np.arange(camera.height_px + 1.0))
    rays = np.ascontiguousarray(np.moveaxis(camera.rays(np.stack([x, y], axis=-1)), -1, 0))
    rays.setflags(write=False)
    return rays


@lru_cache(maxsize=4)
def _light(
    shape: tuple[int, int], white: float, gradient: tuple[float, float], vignetting: float
) -> NDArray[np.float32]:
    """Grey level of white at each pixel ``(height, width)``."""
    y = ((np.arange(shape[0]) + 0.5) / shape[0] - 0.5)[:, None]
    x = ((np.arange(shape[1]) + 0.5) / shape[1] - 0.5)[None, :]
    aspect = shape[0] / shape[1]
    corner = (1.0 + aspect**2) / 4.0
    light = 1.0 + gradient[0] * x + gradient[1] * y
    light = light * (1.0 - vignetting * (x * x + (aspect * y) ** 2) / corner)
    grey = (white * light).astype(np.float32)
    grey.setflags(write=False)
    return grey


@lru_cache(maxsize=1)
def _bilinear() -> NDArray[np.float32]:
    """Weights ``(4, samples)`` of the corners of a pixel at low-discrepancy places in it.

    The additive recurrence with the plastic number, evenly spread whatever the direction of an
    edge, which a square grid is not; and its mirror image, so that the places balance about the
    middle. The image of a ray is smooth enough for bilinear weights.
    """
    plastic = 1.32471795724474602596
    steps = np.array([1.0 / plastic, 1.0 / plastic**2])
    half = (0.5 + np.arange(_SAMPLES // 2)[:, None] * steps) % 1.0
    x, y = np.vstack([half, 1.0 - half]).T
    return np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x]).astype(np.float32)
