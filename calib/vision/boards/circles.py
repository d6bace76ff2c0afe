"""Grids of circles found in a picture: ellipses, the lattices that they lie on, and the board."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray
from calib.vision.boards.board import AsymmetricCircleGrid, Board, CircleGrid
from calib.vision.boards.finding import HALVED_FROM_PX, Found, Ways, fit_grid, halved, in_order
from calib.vision.camera.rendering import GreyImage

_BLOB_PX = 16.0
"""Area of the smallest circle."""

_ROUNDNESS = 0.12
"""Difference of a blob's area from that of its ellipse, in parts of it."""

_LEAST_FULL = 0.03
"""Area of a blob in squares of the length of its contour, below which it is no ellipse."""


LIKE_SIZE = 1.6
"""The most that one circle is larger across than its neighbour, where they are printed alike."""


def lattices_for(picture: GreyImage, board: Board) -> CircleLattices:
    """Return the lattices of a picture that a board may be, if it is a grid of circles."""
    if isinstance(board, CircleGrid) and board.large_dot_m is not None:
        return CircleLattices(picture, LIKE_SIZE * board.large_dot_m / board.diameter_m)
    return CircleLattices(picture)


def find_circles(picture: GreyImage, board: CircleGrid, lattices: CircleLattices) -> Found | None:
    """Return the whole grid of circles, of black or of white ones."""
    for lattice in lattices:
        shown = np.asarray(255 - picture, dtype=np.uint8) if lattice.light else picture
        ways = []
        for which, blobs in _layouts(board, lattice.cells):
            fitted = fit_grid(board, which, lattice.blobs[blobs], picture.shape)
            if fitted is not None:
                ways.append(Ways(fitted, np.eye(3)[None], np.zeros(1)))
        found = in_order(shown, [board], ways, light=lattice.light)
        if found is not None:
            return found
    return None


class Lattice(NamedTuple):
    """Circles of a picture that lie on a lattice."""

    light: bool  # they are lighter than what is about them
    blobs: FloatArray  # (B, 2): places of all circles
    cells: Cells


class CircleLattices:
    """Lattices that the circles of a picture lie on, each grown when it is first asked for.

    ``like_size``: the most that one circle is larger across than its neighbour.
    """

    def __init__(self, picture: GreyImage, like_size: float = LIKE_SIZE) -> None:
        self._kept: list[Lattice] = []
        self._more = self._grown(picture, like_size)

    def __iter__(self) -> Iterator[Lattice]:
        yield from self._kept
        for each in self._more:
            self._kept.append(each)
            yield each

    @staticmethod
    def _grown(picture: GreyImage, like_size: float) -> Iterator[Lattice]:
        from scipy.spatial import cKDTree

        tries = [(picture, 1, part) for part in _PARTS]
        if picture.size > HALVED_FROM_PX:  # large circles are found there in a quarter of the time
            tries.insert(0, (halved(picture), 2, _PARTS[0]))
        for (shown, scale, part), light in product(tries, (False, True)):
            ellipses = find_ellipses(shown, part, light=light)
            if len(ellipses):  # both sides of a ring are one
                double = cKDTree(ellipses[:, :2]).query_pairs(2.0, output_type="ndarray")[:, 1]
                ellipses = np.delete(ellipses, double, axis=0)
            if _FEWEST_BLOBS <= len(ellipses) <= _MOST_BLOBS:
                blobs = scale * (ellipses[:, :2] + 0.5) - 0.5
                sizes = np.sqrt(ellipses[:, 2] * ellipses[:, 3])
                grown = _lattices(blobs, sizes, like_size)
                yield from (Lattice(light, blobs, cells) for cells in grown)


_FEWEST_BLOBS = 9
"""Circles of the smallest grid."""

_MOST_BLOBS = 3000
_SEEDS, _NEIGHBOURS, _BASES = 12, 10, 6
"""Blobs that a grid is grown from; neighbours of each that its first steps may go to, where the
next but one in a row of a tilted grid may be nearer than the next row; and pairs of such steps."""

_OPPOSITE = 0.35
"""Difference of the steps to two neighbours on both sides, in steps."""

_MISS, _FLAT, _LIKE = 0.3, 0.25, 2.5
"""Distance of a blob from where the grid goes on, in steps; sine of the least angle between two
steps; and the most that one may be longer than the other."""

_FAR = 2 * _MOST_BLOBS
"""Beyond any step between two cells: two coordinates are one number then."""

Cells = dict[tuple[int, int], int]
"""Blobs of a lattice by its two coordinates."""


def _lattices(blobs: FloatArray, sizes: FloatArray, like_size: float) -> Iterator[Cells]:
    """Yield lattices that blobs ``(B, 2)`` lie on, each grown from one in the midst of others."""
    places, known = _Places(blobs, sizes), set[int]()
    for seed, bases in _seeds(blobs, sizes):
        if seed in known:
            continue
        for basis in bases:
            cells = _grown(places, seed, basis, like_size)
            if len(cells) >= _FEWEST_BLOBS:
                known.update(cells.values())
                yield cells


def _seeds(blobs: FloatArray, sizes: FloatArray) -> Iterator[tuple[int, list[list[complex]]]]:
    """Yield blobs with neighbours of their size on both sides, twice, and the steps to these.

    Of clutter there are few, of a grid all but its border.
    """
    from scipy.spatial import cKDTree

    count = min(_NEIGHBOURS + 1, len(blobs))
    near = np.asarray(cKDTree(blobs).query(blobs, k=count)[1])[:, 1:]
    steps = (blobs[near] - blobs[:, None]) @ [1.0, 1.0j]  # (B, neighbours)
    larger = sizes[near] / sizes[:, None]
    like = (larger < LIKE_SIZE) & (larger > 1.0 / LIKE_SIZE)
    one, other = np.triu_indices(count - 1, 1)
    length = np.minimum(np.abs(steps[:, one]), np.abs(steps[:, other]))
    miss = np.abs(steps[:, one] + steps[:, other]) / np.maximum(length, 1e-9)
    miss[~(like[:, one] & like[:, other])] = np.inf
    opposite = miss < _OPPOSITE
    seeds = np.flatnonzero(opposite.sum(axis=1) >= 2)
    best = np.sort(miss[seeds], axis=1)[:, 1]  # of the second pair
    for seed in seeds[np.argsort(best, kind="stable")][:_SEEDS].tolist():
        pairs = np.flatnonzero(opposite[seed])
        step = ((steps[seed, one] - steps[seed, other]) / 2)[pairs]
        step = step[np.argsort(np.abs(step), kind="stable")].tolist()
        bases = [
            (abs(a) + abs(b), [a, b])
            for k, a in enumerate(step)
            for b in step[k + 1 :]
            if abs((a.conjugate() * b).imag) > _FLAT * abs(a) * abs(b) and abs(b) < _LIKE * abs(a)
        ]
        yield seed, [basis for _, basis in sorted(bases, key=lambda each: each[0])[:_BASES]]


class _Places:
    """Blobs as complex numbers, by squares: in each square those that a place in it may be near."""

    def __init__(self, blobs: FloatArray, sizes: FloatArray) -> None:
        self.all: list[complex] = (blobs @ [1.0, 1.0j]).tolist()
        self.sizes: list[float] = sizes.tolist()
        self._squares: dict[float, dict[tuple[float, float], list[int]]] = {}

    def near(self, radius: float) -> Callable[[complex, float], int | None]:
        """What finds the nearest blob of a place, closer to it than a limit up to the radius."""
        side = 2.0 ** math.ceil(math.log2(2.0 * radius))
        blobs, squares = self.all, self._squares.setdefault(side, {})
        if not squares:
            for blob, at in enumerate(blobs):
                x, y = (
                    {(of - side / 2) // side, (of + side / 2) // side} for of in (at.real, at.imag)
                )
                for square in product(x, y):
                    squares.setdefault(square, []).append(blob)

        def nearest(place: complex, limit: float) -> int | None:
            found = None
            for blob in squares.get((place.real // side, place.imag // side), ()):
                far = abs(blobs[blob] - place)
                if far < limit:
                    found, limit = blob, far
            return found

        return nearest


def _grown(places: _Places, seed: int, basis: Sequence[complex], like_size: float) -> Cells:
    """Return the lattice from a blob on, its steps following perspective and lens."""
    cells: Cells = {(0, 0): seed}
    used, queue = {seed}, deque([(0, 0)])
    short = min(map(abs, basis))
    blobs, sizes, nearest = places.all, places.sizes, places.near(_MISS * short)
    sides = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    while queue:
        u, v = queue.popleft()
        here = blobs[cells[u, v]]
        for k, (a, b) in enumerate(sides):
            there = (u + a, v + b)
            if there in cells:
                continue
            # the step before it, or beside it, or the first one
            step = basis[k % 2] * (1.0 if k < 2 else -1.0)
            if (u - a, v - b) in cells:
                step = here - blobs[cells[u - a, v - b]]
                if (u - 2 * a, v - 2 * b) in cells:  # steps grow and shrink along a row
                    before = blobs[cells[u - a, v - b]] - blobs[cells[u - 2 * a, v - 2 * b]]
                    step += step - before
            else:
                for c, d in ((b, a), (-b, -a)):
                    if (u + c, v + d) in cells and (u + a + c, v + b + d) in cells:
                        step = blobs[cells[u + a + c, v + b + d]] - blobs[cells[u + c, v + d]]
            found = nearest(here + step, _MISS * min(abs(step), short))
            if found is None or found in used:
                continue
            if 1.0 / like_size < sizes[found] / sizes[cells[u, v]] < like_size:
                cells[there] = found
                used.add(found)
                queue.append(there)
    return cells


def circles_shown(lattices: CircleLattices) -> tuple[type[CircleGrid], int, int] | None:
    """Return kind, columns and rows of a grid that the circles of a picture fill whole."""
    for _, _, cells in lattices:
        places = np.array(list(cells))
        for turn in _TURNS if len(places) >= _FEWEST_BLOBS else ():
            at = places @ turn
            columns, rows = (np.ptp(at, axis=0) + 1).tolist()
            if columns * rows == len(at) and columns >= rows >= 3:
                return CircleGrid, columns, rows
            wide, rows = (np.ptp(at @ [[1, 1], [1, -1]], axis=0) + 1).tolist()
            if min(wide // 2, rows) >= 3 and wide * rows == 2 * len(at) and wide < rows:
                return AsymmetricCircleGrid, wide // 2, rows
    return None


def _layouts(board: CircleGrid, cells: Cells) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Points of the board and the blobs that they may be, one way round and another.

    None where it does not fill the board, or fits at two places: with a row hidden, something
    beside the board would be taken for another.
    """
    wanted = np.rint(board.points[:, :2] / board.spacing_m).astype(int)
    if isinstance(board, AsymmetricCircleGrid):  # neighbours are diagonal: both sums are even
        wanted = np.stack([wanted.sum(axis=1), wanted[:, 0] - wanted[:, 1]], axis=1) // 2
    there, blobs = np.array(list(cells)), np.array(list(cells.values()))
    if len(there) < len(wanted):
        return []
    points = (wanted @ [_FAR, 1]).tolist()
    # far ones tell soonest that a board does not fit
    order = np.argsort(-np.abs(wanted - wanted[0]).sum(axis=1)).tolist()
    from_first = [points[k] - points[0] for k in order]
    found = []
    for turn in _TURNS:
        turned = (there @ (turn @ [_FAR, 1])).tolist()
        firsts = taken = set(turned)
        for step in from_first:
            firsts = {cell for cell in firsts if cell + step in taken}
        if len(firsts) > 1:
            return []
        if not firsts:
            continue
        (first,) = firsts
        index = {first + point - points[0]: k for k, point in enumerate(points)}
        which = np.array([index.get(cell, -1) for cell in turned], dtype=np.intp)
        found.append((which[which >= 0], blobs[which >= 0]))
    return found


_TURNS = [
    np.array([[a, b], [c, d]])
    for a, b, c, d in product((-1, 0, 1), repeat=4)
    if abs(a * d - b * c) == 1
]
"""Ways to lay two steps on the axes of the board: the nearest in a tilted one may be diagonal."""


_PARTS = (6, 20)
"""Parts of a picture that the means of surroundings are taken over."""


def dark_ellipses(picture: GreyImage) -> Iterator[FloatArray]:
    """Yield dark ellipses ``(B, 5)``, by means of wide surroundings first."""
    yield from (find_ellipses(picture, part) for part in _PARTS)


def find_ellipses(picture: GreyImage, part: int, *, light: bool = False) -> FloatArray:
    """Return ellipses ``(B, 5)`` darker or lighter than a part of the picture about them.

    Centre, both axes [px], and the direction of the first of these [deg].
    """
    block = max(11, min(picture.shape) // part) | 1
    binary = _binary(picture, block, light)
    for blur_px in _BLURS_PX:
        if np.count_nonzero(binary[:, 1:] != binary[:, :-1]) < _MOST_EDGES * picture.size:
            break
        calm = cv2.GaussianBlur(picture, (0, 0), blur_px)
        binary = _binary(np.asarray(calm, dtype=np.uint8), block, light)
    contours, _ = cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    ellipses = []
    for contour in contours:
        count = len(contour)
        if count < 8:
            continue
        # a contour runs through the middle of pixels: half a pixel is missing all around
        area = cv2.contourArea(contour) + count / 2
        if area < max(_BLOB_PX, _LEAST_FULL * count**2):
            continue
        (x, y), (first, second), turn = cv2.fitEllipseDirect(contour)
        whole = np.pi / 4 * (first + 1.0) * (second + 1.0)
        if not 0.0 < max(first, second) < 6.0 * min(first, second):
            continue
        if abs(area - whole) < _ROUNDNESS * whole + 0.05 * count:
            ellipses.append((x, y, first + 1.0, second + 1.0, turn))
    return np.array(ellipses).reshape(-1, 5)


_BLURS_PX, _MOST_EDGES = (1.5, 3.0), 0.15
"""Noise is blurred until no more pixels than that, of all, differ from the one beside them: OpenCV
takes seconds for the contours of more, and circles among them are not round. Circles that are as
small and as near to each other as any that are found have fewer."""


def _binary(picture: GreyImage, block: int, light: bool) -> NDArray[np.uint8]:
    """Return what is darker than its surroundings, or lighter."""
    kind, by = (cv2.THRESH_BINARY, -10) if light else (cv2.THRESH_BINARY_INV, 10)
    mean = cv2.ADAPTIVE_THRESH_MEAN_C
    return np.asarray(cv2.adaptiveThreshold(picture, 255, mean, kind, block, by), dtype=np.uint8)
