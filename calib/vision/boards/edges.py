"""Points of a board to a fraction of a pixel, by the edges that meet there or go around them.

The board's map (:mod:`calib.vision.boards.board_map`) says where edges should be. Grey levels are
read along lines across them, and a blurred step is fitted by least squares: how far it is from
where it should be moves the point. As the lines follow the map, neither perspective nor a lens
moves the middle of a circle, and edges are as straight as they are on the board.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.chance import normal_below
from calib.se3 import BoolArray, FloatArray
from calib.vision.boards.board import Board, CircleGrid
from calib.vision.boards.board_map import BoardMap
from calib.vision.camera.rendering import GreyImage

LONGEST_PX = 18.0
"""Of an edge beside a corner, what is looked at: further on a lens bends it."""

WIDEST_PX = 7.0
"""To each side of an edge; three times the blur where that is known."""

FIRST_SIGMA_PX = 1.5
"""Blur that edges are looked for with."""

LEAST_LIKENESS = 0.8
"""Correlation of grey levels with a step below which there is no edge of the board."""

LEAST_CONTRAST = 10.0
"""Grey levels between black and white."""

LEAST_OF_USUAL = 0.25
"""Contrast of an edge, in parts of that of most: light may fall off over the board."""

LEAST_OF_ARM = 0.4
"""Contrast of an edge to each side of a corner, in parts of that of both: what hides one side
moves the corner by a pixel, and the other side alone still looks like a step."""


@dataclass(frozen=True)
class _Reading:
    """Numbers of the lines that are read, and of the rounds that move points by them."""

    samples: int  # grey levels across an edge
    along: int  # lines across a straight edge to each side of a corner
    angles: int  # lines across the rim of a circle
    reads: int  # readings, each where the one before has moved the points
    fits: int  # steps of least squares of one reading


_ROUGH = _Reading(samples=15, along=4, angles=16, reads=2, fits=3)
"""Of points that are known to some pixels, with a blur that is not known."""

_FINE = _Reading(samples=15, along=10, angles=32, reads=2, fits=2)
"""Of points that are known to a part of a pixel."""

_INV_SQRT_2PI = 0.3989422804014327


@dataclass(frozen=True, eq=False)
class Refined:
    """Points as the picture shows them."""

    px: FloatArray  # (K, 2): in OpenCV's pixels
    good: BoolArray  # (K,): all edges of the point are there
    sigma_px: float  # standard deviation of the blur
    dark: FloatArray  # (K,): grey levels of both sides
    light: FloatArray  # (K,): grey levels of both sides


def refine(
    picture: GreyImage,
    board: Board,
    which: NDArray[np.intp],
    board_map: BoardMap,
    start_px: FloatArray,
    sigma_px: float | None = None,
) -> Refined:
    """Measure points of a board to a fraction of a pixel.

    Parameters
    ----------
    picture : ndarray (height, width) of uint8
    which : ndarray (K,)
        Points of the board that are looked for.
    start_px : ndarray (K, 2)
        Where they are, to a pixel or two.
    sigma_px : float, optional
        Blur, where it is known. Without it points are measured to a tenth of a pixel only, with
        fewer lines.
    """
    wide = WIDEST_PX if sigma_px is None else np.clip(3.0 * sigma_px + 1.0, 3.0, WIDEST_PX)
    reading = _ROUGH if sigma_px is None else _FINE
    make = _lines_of_circles if isinstance(board, CircleGrid) else _lines_of_corners
    lines = make(board, which, board_map, float(wide), sigma_px or FIRST_SIGMA_PX, reading)
    px = start_px.copy()
    sigma = np.full(lines.group.max(initial=0) + 1, sigma_px or FIRST_SIGMA_PX)
    inside = np.ones(len(which), dtype=bool)
    for _ in range(reading.reads):
        grey, here = lines.read(picture, px)
        inside &= here
        profiles, offset = lines.profiles(grey), np.zeros(lines.group.shape)
        for k in range(reading.fits):
            # the blur is fitted once the edges are where they are looked for
            free = sigma_px is not None or k > 0
            step = _fit_steps(profiles, lines.distance, offset, sigma[lines.group], free=free)
            offset = np.clip(offset + step.offset, -WIDEST_PX / 2, WIDEST_PX / 2)
            for group in range(len(sigma) if free else 0):
                known = step.sound & (lines.group == group) & inside[:, None]
                if known.any():
                    sigma[group] = np.clip(_middle(step.sigma[known]), 0.4, 6.0)
        px += (lines.mover @ offset[..., None])[..., 0]
    wanted = lines.wanted
    contrast = step.contrast
    usual = _middle(contrast[wanted & step.sound]) if (wanted & step.sound).any() else 0.0
    clear = contrast >= max(LEAST_CONTRAST, LEAST_OF_USUAL * usual)
    like = _likeness(profiles, step.ideal) >= LEAST_LIKENESS
    clear &= lines.arms(grey) >= LEAST_OF_ARM * contrast
    share = (clear & like & wanted).sum(axis=1) / wanted.sum(axis=1)
    good = inside & (share >= lines.share) & np.isfinite(px).all(axis=1)
    good &= np.linalg.norm(px - start_px, axis=1) < WIDEST_PX
    count = wanted.sum(axis=1)
    return Refined(
        px,
        good,
        float(np.sqrt(np.mean(sigma**2))),
        (step.base * wanted).sum(axis=1) / count,
        ((step.base + contrast) * wanted).sum(axis=1) / count,
    )


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines across the edges of points, E for each."""

    shift: NDArray[np.float32]
    """(2, K, E, A, V): from the point to where grey levels are read [px]; A lines across an edge
    are averaged."""
    sign: NDArray[np.float32]
    """(K, E, A): light is towards larger distances (1), or smaller ones (-1); 0 for no edge."""
    distance: FloatArray  # (K, E, V): across the edge [px]
    mover: FloatArray  # (K, 2, E): what an edge's offset moves the point by
    group: NDArray[np.intp]  # (K, E): edges with a blur of their own: those along x, along y
    share: float  # of the edges, how many must be seen

    @cached_property
    def wanted(self) -> BoolArray:
        """Edges that there are ``(K, E)``."""
        return np.asarray((self.sign != 0.0).any(axis=2))

    @cached_property
    def _box(self) -> tuple[FloatArray, FloatArray]:
        """Least and largest shift ``(K, 2)`` of each point."""
        flat = self.shift.reshape(2, len(self.sign), -1)
        low, high = (np.asarray(end(axis=2).T, dtype=float) for end in (flat.min, flat.max))
        return low, high

    def read(self, picture: GreyImage, px: FloatArray) -> tuple[NDArray[np.float32], BoolArray]:
        """Return grey levels ``(K, E, A, V)``, and which points lie wholly in the picture.

        Between the four pixels about each place; not by OpenCV's ``remap``, which rounds places to
        1/32 of a pixel.
        """
        height, width = picture.shape
        low, high = self._box
        with np.errstate(invalid="ignore"):
            within = (px + low >= 0.0) & (px + high <= [width - 1.001, height - 1.001])
        inside: BoolArray = np.asarray(within.all(axis=1))
        middle = np.where(inside[:, None], px, 0.0).astype(np.float32).T
        at = self.shift + middle[..., None, None, None]
        if not inside.all():
            at[:, ~inside] = 0.0
        whole = at.astype(np.int32)
        right, down = at - whole
        first = whole[1] * width + whole[0]
        flat = picture.ravel()
        above = _between(flat.take(first), flat.take(first + 1), right)
        first += width
        below = _between(flat.take(first), flat.take(first + 1), right)
        below -= above
        below *= down
        below += above
        return below, inside

    def profiles(self, grey: NDArray[np.float32]) -> FloatArray:
        """Return mean grey levels ``(K, E, V)`` across each edge, dark to light."""
        # edges that are light on the other side are turned in grey about their own middle, so
        # that what is the same on both sides of a corner cancels out
        used = self.sign != 0.0
        turned = (self.sign[..., None, :] @ grey)[..., 0, :]
        turned += ((used - self.sign) * grey.mean(axis=-1)).sum(axis=2)[..., None]
        return np.asarray(turned / np.maximum(used.sum(axis=2), 1)[..., None], dtype=float)

    def arms(self, grey: NDArray[np.float32]) -> FloatArray:
        """Contrast ``(K, E)`` of the weaker half of the lines across each edge."""
        third = grey.shape[-1] // 3
        step = grey[..., -third:].mean(axis=-1) - grey[..., :third].mean(axis=-1)
        step *= self.sign
        many = (2, step.shape[2] // 2) if step.shape[2] > 1 else (1, 1)
        shape = (*step.shape[:2], *many)
        used = (self.sign != 0.0).reshape(shape).sum(axis=3)
        means = step.reshape(shape).sum(axis=3) / np.maximum(used, 1)
        return np.asarray(np.where(used > 0, means, np.inf).min(axis=2))


def _between(left: GreyImage, other: GreyImage, share: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return grey levels between two pixels."""
    out = np.subtract(other, left, dtype=np.float32)
    out *= share
    out += left
    return out


def _through(at: FloatArray) -> NDArray[np.float32]:
    """Return weights ``(..., 3)`` of a parabola through values at -1, 0 and 1, for places."""
    square = at * at
    weights = [(square - at) / 2, 1.0 - square, (square + at) / 2]
    return np.stack(weights, axis=-1).astype(np.float32)


_NODES = np.array([-1.0, 0.0, 1.0])


def _lines_of_corners(
    board: Board,
    which: NDArray[np.intp],
    board_map: BoardMap,
    wide_px: float,
    sigma_px: float,
    reading: _Reading,
) -> _Lines:
    xy, (long_m, clear_m) = board.points[which, :2], board.clear_m
    slope = board_map.slope(xy, board.cell_m / 10)
    dark = board.quadrants[which]
    area = np.abs(np.linalg.det(slope))
    along_px = np.linalg.norm(slope, axis=1)  # (K, 2): of a metre along x, along y
    across_px = area[:, None] / along_px  # across the edge, of a metre along the other axis
    reach = np.minimum(long_m, LONGEST_PX / along_px)
    # beside the corner itself the other edge is seen
    near = np.minimum(1.5 * sigma_px / along_px, reach / 3)
    half = np.minimum(clear_m, wide_px / across_px)
    # the map is close to a parabola over as little of the board as this
    nodes = np.empty((len(xy), 2, 3, 3, 2))
    for axis in range(2):  # edges along x, then along y
        nodes[:, axis, ..., axis] = (xy[:, axis, None] + reach[:, axis, None] * _NODES)[..., None]
        nodes[:, axis, ..., 1 - axis] = (xy[:, 1 - axis, None] + half[:, axis, None] * _NODES)[
            :, None
        ]
    there = np.moveaxis(board_map(nodes), -1, 0)
    there = there - there[..., 1:2, 1:2]  # (2, K, E, 3, 3)
    part = (np.arange(reading.along) + 0.5) / reading.along
    places = (near[..., None] + (reach - near)[..., None] * part) / reach[..., None]
    places = np.concatenate([-places, places], axis=2)  # (K, E, A)
    across = np.linspace(-1.0, 1.0, reading.samples)
    shift = _through(places) @ (there.astype(np.float32) @ _through(across).T)
    light = np.stack([dark[:, :, 0] - dark[:, :, 1], dark[:, 0] - dark[:, 1]], axis=1)
    # an edge that is d px off along its normal moves the point by d over px a metre, in metres
    mover = slope[:, :, ::-1] / across_px[:, None]
    group = np.broadcast_to(np.arange(2), (len(xy), 2))
    sign = np.repeat(light, reading.along, axis=2).astype(np.float32)
    return _Lines(shift, sign, (half * across_px)[..., None] * across, mover, group, 1.0)


def _lines_of_circles(
    board: Board,
    which: NDArray[np.intp],
    board_map: BoardMap,
    wide_px: float,
    sigma_px: float,
    reading: _Reading,
) -> _Lines:
    del sigma_px  # nothing else is seen beside a rim
    xy, radius = board.points[which, :2], board.printed[1][which, 2]
    slope = board_map.slope(xy, board.cell_m / 10)
    _, clear_m = board.clear_m
    angle = 2 * np.pi * np.arange(reading.angles) / reading.angles
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (E, 2)
    tangent = np.stack([-out[:, 1], out[:, 0]], axis=1)
    area = np.abs(np.linalg.det(slope))
    along_px = np.linalg.norm(np.einsum("kij,ej->kei", slope, tangent), axis=2)
    across_px = area[:, None] / along_px  # (K, E), of a metre outwards
    half = np.minimum(clear_m, wide_px / across_px)
    # the map is close to a parabola over as little of the board as this
    nodes = radius[:, None, None] + half[..., None] * _NODES  # (K, E, 3)
    there = board_map(xy[:, None, None] + nodes[..., None] * out[:, None])
    there = np.moveaxis(there - board_map(xy)[:, None, None], -1, 0)
    across = np.linspace(-1.0, 1.0, reading.samples)
    shift = there.astype(np.float32) @ _through(across).T
    # the mean of cos² over a circle is one half
    moved_m = 2.0 / reading.angles * out.T / across_px[:, None]  # (K, 2, E)
    shape = (len(xy), reading.angles)
    return _Lines(
        shift[..., None, :],
        np.ones((*shape, 1), dtype=np.float32),
        (half * across_px)[..., None] * across,
        slope @ moved_m,
        np.zeros(shape, dtype=np.intp),
        0.85,
    )


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps fitted to grey levels, arrays ``(K, E)``; ``sound`` where the fit can be used."""

    offset: FloatArray  # to be added to where the step was taken to be
    contrast: FloatArray
    base: FloatArray
    sigma: FloatArray
    ideal: FloatArray  # (K, E, V): the step alone, from 0 to 1, before it was moved
    sound: BoolArray


def _fit_steps(
    profiles: FloatArray,
    distance: FloatArray,
    offset: FloatArray,
    sigma: FloatArray,
    *,
    free: bool,
) -> _Steps:
    """Take one step of least squares for base, contrast, offset (and blur) of blurred steps.

    ``base + contrast * Phi((distance - offset) / sigma)``, linear in the first two, linearised in
    the others.
    """
    scaled = (distance - offset[..., None]) / sigma[..., None]
    rows = np.empty((*scaled.shape, 4 if free else 3))
    rows[..., 0] = 1.0
    rows[..., 1] = step = normal_below(scaled)
    bell = np.exp(-0.5 * scaled * scaled) * (-_INV_SQRT_2PI / sigma[..., None])
    rows[..., 2] = bell
    if free:
        rows[..., 3] = bell * scaled
    turned = np.swapaxes(rows, -1, -2)
    normal = turned @ rows
    size = normal.shape[-1]
    normal += 1e-9 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(size)
    found: FloatArray = np.asarray(np.linalg.solve(normal, turned @ profiles[..., None]))[..., 0]
    contrast = found[..., 1]
    sound = contrast > LEAST_CONTRAST / 2
    safe = np.where(sound, contrast, np.inf)
    largest = sigma * 1.5
    moved = np.clip(found[..., 2] / safe, -largest, largest)
    blur = sigma + np.clip(found[..., 3] / safe, -sigma / 2, sigma) if free else sigma
    return _Steps(np.where(sound, moved, 0.0), contrast, found[..., 0], blur, step, sound)


def _likeness(profiles: FloatArray, ideal: FloatArray) -> FloatArray:
    """Return the correlation ``(K, E)`` of grey levels with steps ``(K, E, V)``."""
    profiles = profiles - profiles.mean(axis=-1, keepdims=True)
    ideal = ideal - ideal.mean(axis=-1, keepdims=True)
    sizes = (profiles**2).sum(axis=-1) * (ideal**2).sum(axis=-1)
    return np.asarray((profiles * ideal).sum(axis=-1) / np.sqrt(np.maximum(sizes, 1e-9)))


def _middle(values: FloatArray) -> float:
    """Return the median of values, the upper one of two."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])
