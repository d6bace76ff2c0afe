"""Points of a board to a fraction of a pixel, by the edges that meet there or go around them.

The board's map (:mod:`calib.vision.boards.board_map`) says where edges should be. Grey levels are
read along lines across them, and a blurred step is fitted by least squares: how far it is from
where it should be moves the point. As the lines follow the map, neither perspective nor a lens
moves the middle of a circle, and edges are as straight as they are on the board.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.chance import normal_below
from calib.se3 import BoolArray, FloatArray
from calib.vision.boards.board import Board, CircleGrid
from calib.vision.boards.board_map import BoardMap
from calib.vision.camera.edges import read_grey

SAMPLES = 15
"""Grey levels that are read across an edge."""

ALONG = 10
"""Lines across a straight edge."""

ANGLES = 32
"""Lines across the rim of a circle."""

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

_STEPS = 6
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
    picture: NDArray[np.float32],
    board: Board,
    which: NDArray[np.intp],
    board_map: BoardMap,
    start_px: FloatArray,
    sigma_px: float | None = None,
) -> Refined:
    """Points of the board to a fraction of a pixel.

    Parameters
    ----------
    picture : ndarray (height, width) of float32
    which : ndarray (K,)
        Points of the board that are looked for.
    start_px : ndarray (K, 2)
        Where they are, to a pixel or two.
    sigma_px : float, optional
        Blur, where it is known.
    """
    wide = WIDEST_PX if sigma_px is None else np.clip(3.0 * sigma_px + 1.0, 3.0, WIDEST_PX)
    make = _lines_of_circles if isinstance(board, CircleGrid) else _lines_of_corners
    lines = make(board, which, board_map, float(wide), sigma_px or FIRST_SIGMA_PX)
    px = start_px.copy()
    sigma = np.full(lines.group.max(initial=0) + 1, sigma_px or FIRST_SIGMA_PX)
    inside = np.ones(len(which), dtype=bool)
    for k in range(_STEPS):
        profiles, within = lines.read(picture, px)
        inside &= within
        # the blur is fitted once the edges are where they are looked for
        step = _fit_steps(profiles, lines.distance, sigma[lines.group], free=k > 1)
        if k > 1:
            for group in range(len(sigma)):
                known = step.sound & (lines.group == group) & inside[:, None]
                if known.any():
                    sigma[group] = np.clip(np.median(step.sigma[known]), 0.4, 6.0)
        offset = np.clip(step.offset, -WIDEST_PX / 2, WIDEST_PX / 2)
        moved = (lines.mover @ np.where(np.isfinite(offset), offset, 0.0)[..., None])[..., 0]
        px += moved
        if k > 2 and np.abs(moved).max(initial=0.0) < 2e-3:
            break
    wanted = lines.wanted
    contrast = step.contrast
    usual = float(np.median(contrast[wanted & step.sound])) if (wanted & step.sound).any() else 0.0
    clear = contrast >= max(LEAST_CONTRAST, LEAST_OF_USUAL * usual)
    like = step.likeness >= LEAST_LIKENESS
    clear &= lines.arms(picture, px) >= LEAST_OF_ARM * contrast
    share = (clear & like & wanted).sum(axis=1) / wanted.sum(axis=1)
    good = inside & (share >= lines.share) & np.isfinite(px).all(axis=1)
    good &= np.linalg.norm(px - start_px, axis=1) < WIDEST_PX
    return Refined(
        px,
        good,
        float(np.sqrt(np.mean(sigma**2))),
        np.nanmean(np.where(wanted, step.base, np.nan), axis=1),
        np.nanmean(np.where(wanted, step.base + contrast, np.nan), axis=1),
    )


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines across the edges of points, E for each."""

    shift: FloatArray
    """(K, E, A, V, 2): from the point to where grey levels are read [px]; A lines across an edge
    are averaged."""
    sign: FloatArray
    """(K, E, A): light is towards larger distances (1), or smaller ones (-1); 0 for no edge."""
    distance: FloatArray  # (K, E, V): across the edge [px]
    mover: FloatArray  # (K, 2, E): what an edge's offset moves the point by
    group: NDArray[np.intp]  # (K, E): edges with a blur of their own: those along x, along y
    share: float  # of the edges, how many must be seen

    @property
    def wanted(self) -> BoolArray:
        """Edges that there are ``(K, E)``."""
        return np.asarray((self.sign != 0.0).any(axis=2))

    def read(self, picture: NDArray[np.float32], px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Grey levels ``(K, E, V)``, dark to light, and which points lie wholly in the picture."""
        at = px[:, None, None, None] + self.shift
        grey, inside = read_grey(picture, at)
        used = self.sign != 0.0
        whole = (inside | ~used[..., None]).all(axis=(1, 2, 3))
        # edges that are light on the other side are turned in grey about their own middle, so
        # that what is the same on both sides of a corner cancels out
        middle = grey.mean(axis=-1, keepdims=True)
        turned = self.sign[..., None] * (grey - middle) + middle * used[..., None]
        count = np.maximum(used.sum(axis=2), 1)
        return np.asarray(turned.sum(axis=2) / count[..., None]), whole

    def arms(self, picture: NDArray[np.float32], px: FloatArray) -> FloatArray:
        """Contrast ``(K, E)`` of the weaker half of the lines across each edge."""
        grey, _ = read_grey(picture, px[:, None, None, None] + self.shift)
        third = SAMPLES // 3
        step = grey[..., -third:].mean(axis=-1) - grey[..., :third].mean(axis=-1)
        step *= np.sign(self.sign)
        halves = np.stack(np.array_split(step, min(2, step.shape[2]), axis=2), axis=2)
        used = np.stack(np.array_split(self.sign != 0.0, min(2, step.shape[2]), axis=2), axis=2)
        means = halves.sum(axis=3) / np.maximum(used.sum(axis=3), 1)
        return np.asarray(np.where(used.any(axis=3), means, np.inf).min(axis=2))


def _lines_of_corners(
    board: Board,
    which: NDArray[np.intp],
    board_map: BoardMap,
    wide_px: float,
    sigma_px: float,
) -> _Lines:
    xy, (long_m, clear_m) = board.points[which, :2], board.clear_m
    here, slope = board_map(xy), board_map.slope(xy, board.cell_m / 10)
    dark = board.quadrants[which]
    area = np.abs(np.linalg.det(slope))
    shifts, signs, distances, movers = [], [], [], []
    for axis in range(2):  # edges along x, then along y
        along_px = np.linalg.norm(slope[:, :, axis], axis=1)
        across_px = area / along_px  # across the edge, of a metre along the other axis
        reach = np.minimum(long_m, LONGEST_PX / along_px)
        # beside the corner itself the other edge is seen
        near = np.minimum(1.5 * sigma_px / along_px, reach / 3)
        places = near[:, None] + (reach - near)[:, None] * (np.arange(ALONG) + 0.5) / ALONG
        places = np.concatenate([-places, places], axis=1)  # (K, A)
        half = np.minimum(clear_m, wide_px / across_px)
        across = half[:, None] * np.linspace(-1.0, 1.0, SAMPLES)  # (K, V)
        offset = np.empty((*places.shape, SAMPLES, 2))
        offset[..., axis] = places[:, :, None]
        offset[..., 1 - axis] = across[:, None]
        shifts.append(board_map(xy[:, None, None] + offset) - here[:, None, None])
        light = dark[:, :, 0] - dark[:, :, 1] if axis == 0 else dark[:, 0] - dark[:, 1]
        signs.append(np.repeat(light, ALONG, axis=1))
        distances.append(across * across_px[:, None])
        # an edge that is d px off along its normal moves the point by d over px a metre, in metres
        movers.append(slope[:, :, 1 - axis] / across_px[:, None])
    shift, sign, distance = (np.stack(each, axis=1) for each in (shifts, signs, distances))
    group = np.broadcast_to(np.arange(2), (len(xy), 2))
    return _Lines(shift, sign, distance, np.stack(movers, axis=2), group, 1.0)


def _lines_of_circles(
    board: Board,
    which: NDArray[np.intp],
    board_map: BoardMap,
    wide_px: float,
    sigma_px: float,
) -> _Lines:
    xy, radius = board.points[which, :2], board.printed[1][which, 2]
    slope = board_map.slope(xy, board.cell_m / 10)
    _, clear_m = board.clear_m
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (E, 2)
    tangent = np.stack([-out[:, 1], out[:, 0]], axis=1)
    area = np.abs(np.linalg.det(slope))
    along_px = np.linalg.norm(np.einsum("kij,ej->kei", slope, tangent), axis=2)
    across_px = area[:, None] / along_px  # (K, E), of a metre outwards
    half = np.minimum(clear_m, wide_px / across_px)
    outwards = half[..., None] * np.linspace(-1.0, 1.0, SAMPLES)  # (K, E, V)
    places = (radius[:, None, None] + outwards)[..., None] * out[:, None]
    shift = board_map(xy[:, None, None] + places) - board_map(xy)[:, None, None]
    # the mean of cos² over a circle is one half
    moved_m = 2.0 / ANGLES * out.T / across_px[:, None]  # (K, 2, E)
    shape = (len(xy), ANGLES)
    return _Lines(
        shift[:, :, None],
        np.ones((*shape, 1)),
        outwards * across_px[..., None],
        slope @ moved_m,
        np.zeros(shape, dtype=np.intp),
        0.85,
    )


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps fitted to grey levels, arrays ``(K, E)``; ``sound`` where the fit can be used."""

    offset: FloatArray
    contrast: FloatArray
    base: FloatArray
    sigma: FloatArray
    likeness: FloatArray
    sound: BoolArray


def _fit_steps(
    profiles: FloatArray, distance: FloatArray, sigma: FloatArray, *, free: bool
) -> _Steps:
    """One step of least squares for base, contrast, offset (and blur) of steps at zero.

    ``base + contrast * Phi((distance - offset) / sigma)``, linear in the first two, linearised in
    the others.
    """
    scaled = distance / sigma[..., None]
    step = normal_below(scaled)
    bell = _INV_SQRT_2PI * np.exp(-0.5 * scaled * scaled) / sigma[..., None]
    columns = [np.ones_like(step), step, -bell]
    if free:
        columns.append(-bell * scaled)
    rows = np.stack(columns, axis=-1)  # (K, E, V, 3 or 4)
    turned = np.swapaxes(rows, -1, -2)
    normal = turned @ rows
    size = normal.shape[-1]
    normal += 1e-9 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(size)
    found: FloatArray = np.asarray(np.linalg.solve(normal, turned @ profiles[..., None]))[..., 0]
    contrast = found[..., 1]
    sound = contrast > LEAST_CONTRAST / 2
    safe = np.where(sound, contrast, np.inf)
    largest = sigma * 1.5
    offset = np.clip(found[..., 2] / safe, -largest, largest)
    blur = sigma + np.clip(found[..., 3] / safe, -sigma / 2, sigma) if free else sigma
    centred = profiles - profiles.mean(axis=-1, keepdims=True)
    ideal = step - step.mean(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        likeness = (centred * ideal).sum(axis=-1) / np.sqrt(
            (centred**2).sum(axis=-1) * (ideal**2).sum(axis=-1)
        )
    return _Steps(
        np.where(sound, offset, 0.0),
        contrast,
        found[..., 0],
        blur,
        np.nan_to_num(likeness),
        sound,
    )
