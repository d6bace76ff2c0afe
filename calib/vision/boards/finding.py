"""Boards found in a picture: which points of them, and roughly where.

Coordinates are OpenCV's here, counted from the middle of the first pixel.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray
from calib.vision.boards.board import (
    QUARTER_TURNS,
    AsymmetricCircleGrid,
    Board,
    CharucoBoard,
    Chessboard,
    CircleGrid,
    KalibrAprilGrid,
    MarkerBoard,
)
from calib.vision.boards.board_map import ROUGH_MARKERS, BoardMap, fit_map, spacing
from calib.vision.camera.rendering import GreyImage

SMALLEST_MARKER_PX = 10.0
"""Side of the smallest marker whose bits can be read: more than a pixel for each."""

LEAST_MARKERS = 2
"""One marker may be found in clutter; two that lie as on the board are not."""

HALVED_FROM_PX = 1.0e6
"""Pixels from which on a chessboard is looked for in a picture of half the size: it is found
there in a quarter of the time, and refined in the whole one."""

_BLOB_PX = 16.0
"""Area of the smallest circle."""

_ROUNDNESS = 0.12
"""Difference of a blob's area from that of its ellipse, in parts of it."""


@dataclass(frozen=True, eq=False)
class Found:
    """What of a board was found."""

    board: Board  # as described, or with other colours
    which: NDArray[np.intp]  # (K,): points that may be seen
    board_map: BoardMap
    explained: int = 0  # markers that lie as on the board


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers of a dictionary in a picture."""

    ids: NDArray[np.intp]  # (M,)
    corners: FloatArray  # (M, 4, 2), clockwise from the left upper one of the marker

    def __len__(self) -> int:
        return len(self.ids)

    def those(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Markers:
        """Return some of them."""
        return Markers(self.ids[which], self.corners[which])

    def turned(self, turn: int) -> Markers:
        """Return them with another corner as the left upper one."""
        return Markers(self.ids, np.roll(self.corners, turn, axis=1))

    @property
    def side_px(self) -> float:
        """Usual length of their sides."""
        sides = self.corners - np.roll(self.corners, 1, axis=1)
        return float(np.median(np.linalg.norm(sides, axis=2)))


def find_markers(
    picture: GreyImage,
    dictionary: cv2.aruco.Dictionary,
    *,
    border_bits: int = 1,
    exactly: bool = False,
    quickly: bool = False,
) -> Markers:
    """Return markers of a dictionary; with all bits right if asked for ``exactly``.

    ``quickly``: black is told from white by one mean of the surroundings in place of three.
    """
    parameters = cv2.aruco.DetectorParameters()
    if quickly:
        parameters.adaptiveThreshWinSizeMin = _QUICK_WINDOW_PX
        parameters.adaptiveThreshWinSizeMax = _QUICK_WINDOW_PX
    parameters.markerBorderBits = border_bits
    parameters.minMarkerPerimeterRate = 4 * SMALLEST_MARKER_PX / max(picture.shape)
    if exactly:
        parameters.errorCorrectionRate = 0.0
        parameters.maxErroneousBitsInBorderRate = 0.1
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(picture)
    if ids is None or not len(ids):
        return Markers(np.empty(0, dtype=np.intp), np.empty((0, 4, 2)))
    return Markers(
        np.asarray(ids).ravel().astype(np.intp),
        np.asarray(corners, dtype=float).reshape(-1, 4, 2),
    )


def turns_of(board: MarkerBoard) -> range:
    """Return the quarter turns that markers may have against those of OpenCV's dictionary.

    AprilTags are upright, or upside down, by who printed them. The detectors of Kalibr's grids
    read tags that are turned in any way.
    """
    if isinstance(board, KalibrAprilGrid):
        return range(4)
    return range(0, 4, 2) if "APRILTAG" in board.dictionary else range(1)


_QUICK_WINDOW_PX = 13

_ENOUGH = 0.7
"""Share of the markers in the picture that are read quickly, from which on no others are looked
for: the map says where points are."""


def read_markers(picture: GreyImage, board: MarkerBoard) -> tuple[Markers, Found | None, float]:
    """Return the markers of a picture, the board that they lie on, and pixels of one that was read.

    Most markers are read in a fraction of the time that all of them take, in large pictures at half
    their size. All are looked for where few are, or one lies otherwise than on the board.
    """
    scale, shown = 1.0, picture
    if picture.size > HALVED_FROM_PX:
        scale, shown = 2.0, halved(picture)
    quick = find_markers(shown, board.markers, border_bits=board.border_bits, quickly=True)
    quick = Markers(quick.ids, scale * (quick.corners + 0.5) - 0.5)
    found = match_markers(board, quick, picture.shape)
    if found is not None and found.explained == len(quick):
        px = found.board_map(board.marker_corners)
        inside = (px > 0.0).all(axis=(1, 2)) & (px < picture.shape[::-1]).all(axis=(1, 2))
        if found.explained >= _ENOUGH * np.count_nonzero(inside):
            return quick, found, scale
    markers = find_markers(picture, board.markers, border_bits=board.border_bits)
    return markers, match_markers(board, markers, picture.shape), 1.0


def match_markers(
    board: MarkerBoard, markers: Markers, shape: tuple[int, ...] | None = None
) -> Found | None:
    """Return the board that markers lie on, where at least two lie as on it.

    Markers that are seen twice are left out.
    """
    ids, first, many = np.unique(markers.ids, return_index=True, return_counts=True)
    known = markers.those(np.sort(first[(many == 1) & np.isin(ids, board.ids)]))
    if len(known) < LEAST_MARKERS:
        return None
    index = known.ids - board.first_id
    known, xy = known.turned(_turn_of(board, known)), board.marker_corners[index].reshape(-1, 2)
    px = known.corners.reshape(-1, 2)
    fitted = fit_map(xy, px, known.side_px, rough=ROUGH_MARKERS, shape=shape)
    if fitted is None or not is_face_up(board, fitted[0], xy[fitted[1]]):
        return None
    board_map, inside = fitted
    whole = np.asarray(inside.reshape(-1, 4).all(axis=1))
    seen = np.unique(index[whole])
    if len(seen) < LEAST_MARKERS:
        return None
    return Found(board, _points_of(board, seen), board_map, int(np.count_nonzero(whole)))


def _turn_of(board: MarkerBoard, known: Markers) -> int:
    """Return the turn with which the sides of markers tell best where the nearest others are."""
    turns = turns_of(board)
    if len(turns) == 1:
        return turns[0]
    xy = board.marker_corners[known.ids - board.first_id].mean(axis=1)
    px = known.corners.mean(axis=1)
    apart = np.abs(xy[:, None] - xy).sum(axis=2)
    np.fill_diagonal(apart, np.inf)
    near = apart.argmin(axis=1)
    miss = []
    for turn in turns:
        corners = known.turned(turn).corners
        right, down = (corners[:, k] - corners[:, 0] for k in (1, 3))
        step = ((xy[near] - xy) / board.marker_m)[:, :, None]
        there = px + right * step[:, 0] + down * step[:, 1]
        miss.append(float(np.median(np.linalg.norm(there - px[near], axis=1))))
    return turns[int(np.argmin(miss))]


def _points_of(board: MarkerBoard, seen: NDArray[np.intp]) -> NDArray[np.intp]:
    """Points of the board that are at corners of markers ``seen``."""
    if isinstance(board, KalibrAprilGrid):  # its squares hide the outlines of some tags
        return np.arange(len(board.points))
    if not isinstance(board, CharucoBoard):
        return np.asarray((4 * seen[:, None] + np.arange(4)).ravel())
    middle = board.marker_corners[seen].mean(axis=1)
    apart = np.abs(board.points[:, None, :2] - middle).max(axis=2)
    return np.nonzero((apart < 0.6 * board.square_m).any(axis=1))[0]


def points_near(board: MarkerBoard, seen: NDArray[np.intp]) -> NDArray[np.intp]:
    """Points of the board that are seen, or one step beside points that are."""
    xy = board.points[:, :2] / board.step_m
    apart = np.abs(xy[:, None] - xy[seen]).max(axis=2)
    return np.nonzero((apart < 1.1).any(axis=1))[0]


def find_chessboard(picture: GreyImage, board: Chessboard, *, thoroughly: bool) -> Found | None:
    """The whole chessboard, and which of its corners is the first.

    Looked for ``thoroughly`` where it is not found quickly: that takes some tenths of a second.
    """
    size = (board.columns - 1, board.rows - 1)
    scales = _scales(picture)
    usual = cv2.CALIB_CB_NORMALIZE_IMAGE
    tries = [(scale, usual) for scale in scales]
    if thoroughly:
        tries.append((scales[0], usual + cv2.CALIB_CB_EXHAUSTIVE))
    for scale, flags in tries:
        shown = picture if scale == 1 else halved(picture)
        found, corners = cv2.findChessboardCornersSB(shown, size, flags=flags)
        if found:
            at = np.asarray(corners, dtype=float).reshape(-1, 2)
            grid: FloatArray = (scale * (at + 0.5) - 0.5).reshape(*size[::-1], 2)
            for each in (grid, grid[:, ::-1]):  # of which one is seen in a mirror
                fitted = _fitted(board, np.arange(len(at)), each.reshape(-1, 2), picture.shape)
                if fitted is not None:
                    return _in_order(picture, board.variants, _turned(board, fitted))
            return None
    return None


def squares_shown(picture: GreyImage, least: int) -> tuple[int, int] | None:
    """Return columns and rows of squares of a chessboard with so many inner corners or more."""
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE + cv2.CALIB_CB_LARGER
    for scale in _scales(picture):
        shown = picture if scale == 1 else halved(picture)
        found, _, meta = cv2.findChessboardCornersSBWithMeta(shown, (least, least), flags)
        if found:
            rows, columns = np.asarray(meta).shape[:2]
            return columns + 1, rows + 1
    return None


def _scales(picture: GreyImage) -> tuple[int, ...]:
    return (2, 1) if picture.size > HALVED_FROM_PX else (1,)


def find_circles(picture: GreyImage, board: CircleGrid, lattices: CircleLattices) -> Found | None:
    """The whole grid of circles."""
    for blobs, cells in lattices:
        fitted = (
            _fitted(board, which, blobs[b], picture.shape) for which, b in _layouts(board, cells)
        )
        maps = [(each, 0.0) for each in fitted if each]
        found = _in_order(picture, [board], maps) if maps else None
        if found is not None:
            return found
    return None


class CircleLattices:
    """Lattices that the dark circles of a picture lie on, each grown when it is first asked for.

    With the places ``(B, 2)`` of all circles.
    """

    def __init__(self, picture: GreyImage) -> None:
        self._kept: list[tuple[FloatArray, Cells]] = []
        self._more = self._grown(picture)

    def __iter__(self) -> Iterator[tuple[FloatArray, Cells]]:
        yield from self._kept
        for each in self._more:
            self._kept.append(each)
            yield each

    @staticmethod
    def _grown(picture: GreyImage) -> Iterator[tuple[FloatArray, Cells]]:
        from scipy.spatial import cKDTree

        for ellipses in dark_ellipses(picture):
            blobs = ellipses[:, :2]
            if len(blobs):  # both sides of a ring are one
                double = cKDTree(blobs).query_pairs(2.0, output_type="ndarray")[:, 1]
                blobs = np.delete(blobs, double, axis=0)
            if _FEWEST_BLOBS <= len(blobs) <= _MOST_BLOBS:
                yield from ((blobs, cells) for cells in _lattices(blobs))


_FEWEST_BLOBS = 9
"""Circles of the smallest grid."""

_MOST_BLOBS = 3000
_SEEDS, _NEIGHBOURS = 12, 8
"""Blobs that a grid is grown from, and neighbours of each that its first step may go to: in a
tilted grid the next but one in a row may be nearer than the next row."""

_MISS, _FLAT, _LIKE = 0.3, 0.25, 2.5
"""Distance of a blob from where the grid goes on, in steps; sine of the least angle between two
steps; and the most that one may be longer than the other."""

_FAR = 2 * _MOST_BLOBS
"""Beyond any step between two cells: two coordinates are one number then."""

Cells = dict[tuple[int, int], int]
"""Blobs of a lattice by its two coordinates."""


def _lattices(blobs: FloatArray) -> Iterator[Cells]:
    """Lattices that blobs ``(B, 2)`` lie on, each grown from a blob and two of its neighbours."""
    from scipy.spatial import cKDTree

    tree, places = cKDTree(blobs), _Places(blobs)
    far = np.linalg.norm(blobs - np.median(blobs, axis=0), axis=1)
    middle = [int(k) for k in np.argsort(far, kind="stable")]
    for seed in middle[:: max(1, len(middle) // _SEEDS)][:_SEEDS]:
        near = np.asarray(tree.query(blobs[seed], k=min(_NEIGHBOURS + 1, len(blobs)))[1])
        steps = blobs[near[1:]] - blobs[seed]
        length = np.linalg.norm(steps, axis=1)
        tried: list[tuple[float, int, int]] = []
        for i in range(len(steps)):
            for j in range(i + 1, len(steps)):
                sine = abs(np.linalg.det(steps[[i, j]])) / max(length[i] * length[j], 1e-9)
                if sine > _FLAT and length[j] < _LIKE * length[i]:
                    tried.append((float(length[i] + length[j]), i, j))
        for _, i, j in sorted(tried)[:_NEIGHBOURS]:
            yield _grown(places, seed, [complex(*steps[k]) for k in (i, j)])


class _Places:
    """Blobs as complex numbers, by squares: in each square those that a place in it may be near."""

    def __init__(self, blobs: FloatArray) -> None:
        self.all: list[complex] = (blobs @ [1.0, 1.0j]).tolist()
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


def _grown(places: _Places, seed: int, basis: Sequence[complex]) -> Cells:
    """The lattice from a blob on, its steps following perspective and lens."""
    cells: Cells = {(0, 0): seed}
    used, queue = {seed}, deque([(0, 0)])
    short = min(map(abs, basis))
    blobs, nearest = places.all, places.near(_MISS * short)
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
            else:
                for c, d in ((b, a), (-b, -a)):
                    if (u + c, v + d) in cells and (u + a + c, v + b + d) in cells:
                        step = blobs[cells[u + a + c, v + b + d]] - blobs[cells[u + c, v + d]]
            found = nearest(here + step, _MISS * min(abs(step), short))
            if found is not None and found not in used:
                cells[there] = found
                used.add(found)
                queue.append(there)
    return cells


def circles_shown(lattices: CircleLattices) -> tuple[type[CircleGrid], int, int] | None:
    """Return kind, columns and rows of a grid that the circles of a picture fill whole."""
    for _, cells in lattices:
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


def halved(picture: GreyImage) -> GreyImage:
    """The picture at half its size, pixels averaged."""
    height, width = picture.shape
    even = picture[: height - height % 2, : width - width % 2]
    small = cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def is_face_up(board: Board, board_map: BoardMap, xy: FloatArray) -> bool:
    """Whether the board is seen from its face, at all of the points, and not in a mirror."""
    turned = np.linalg.det(board_map.slope(xy, board.cell_m / 10))
    return bool((turned > 0.0).all())


def _fitted(
    board: Board, which: NDArray[np.intp], at: FloatArray, shape: tuple[int, ...]
) -> BoardMap | None:
    """The map that points of a board lie on, seen from its face."""
    xy = board.points[which, :2]
    fitted = fit_map(xy, at, spacing(at), shape=shape)
    if fitted is None or not is_face_up(board, fitted[0], board.points[:, :2]):
        return None
    return fitted[0] if np.count_nonzero(fitted[1]) >= 0.8 * len(xy) else None


def _turned(board: Chessboard, found: BoardMap) -> Iterator[tuple[BoardMap, float]]:
    """Ways that a chessboard may lie on the corners that OpenCV found, and what they cost.

    It may take corners of the outline for inner ones, in the white beside, and leave out as many on
    the other side, of rows or of columns.
    """
    middle = board.points[:, :2].mean(axis=0)
    across = board.columns != board.rows
    for k, turn in enumerate(QUARTER_TURNS):
        halves = bool(k % 2) and (board.columns - board.rows) % 2 == 1
        for shift in product((-0.5, 0.5) if halves else (0.0, -1.0, 1.0), repeat=2):
            step = np.eye(3)
            step[:2, :2] = turn
            step[:2, 2] = middle - turn @ middle + board.square_m * np.array(shift)
            moved = replace(found, homography=found.homography @ step)
            yield moved, _MOVED * (any(shift) or (bool(k % 2) and across))


_MOVED = 0.02
"""By how much a correlation has to be better for a row of corners not to be of the board: of twelve
rows one in the white lowers it by twice that, and in a board that goes on it is the same."""


def _in_order(
    picture: GreyImage, boards: Sequence[Board], maps: Iterable[tuple[BoardMap, float]]
) -> Found | None:
    """Return the grid the way round that colours tell, upright where that leaves two ways.

    ``boards``: with points at the same places, and other colours.
    """
    xy = _between(boards[0])
    whites = [np.where(board.is_black(xy), 0.0, 1.0) for board in boards]
    best, best_score = None, 0.0
    for board_map, cost in maps:
        slopes = board_map.slope(boards[0].points[:, :2], boards[0].cell_m / 10)
        upright = slopes.mean(axis=0)
        in_doubt = 1e-3 * float(upright[0, 0] / np.linalg.norm(upright[:, 0]))
        at = board_map(xy)
        for board, white in zip(boards, whites, strict=True):
            score = _colours(picture, at, white) + in_doubt - cost
            if score > best_score:
                best, best_score = (board, board_map), score
    return None if best is None else Found(best[0], np.arange(len(best[0].points)), best[1])


def _between(board: Board) -> FloatArray:
    """Return places ``(M, 2)`` whose colours tell which way round a board is seen."""
    if isinstance(board, CircleGrid) and board.large_dot_m is not None:
        # about each corner, what is black of the large dot only
        radius = (board.large_dot_m + board.diameter_m) / 4
        angle = 2.0 * np.pi * np.arange(16) / 16
        corners = board.points[[0, board.columns - 1, -board.columns, -1], None, :2]
        return (corners + radius * np.stack([np.cos(angle), np.sin(angle)], 1)).reshape(-1, 2)
    step = board.cell_m / 4 * np.array([-1.0, 0.0, 1.0])
    offsets = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    if not len(board.printed[1]):  # on the lines of a chessboard there is neither black nor white
        offsets = offsets[np.abs(offsets).min(axis=1) > 0.0]
    return np.asarray((board.points[:, None, :2] + offsets).reshape(-1, 2))


def _colours(picture: GreyImage, px: FloatArray, white: FloatArray) -> float:
    """Correlation of the picture at pixels ``(M, 2)`` with white ``(M,)``."""
    height, width = picture.shape
    at = np.rint(px).astype(np.intp)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    if np.count_nonzero(inside) < 4:
        return 0.0
    grey, white = picture[at[inside, 1], at[inside, 0]].astype(float), white[inside]
    if grey.std() == 0.0 or white.std() == 0.0:
        return 0.0
    return float(np.corrcoef(grey, white)[0, 1])


def dark_ellipses(picture: GreyImage) -> Iterator[FloatArray]:
    """Dark ellipses ``(B, 5)``, by a mean of the surroundings, first of wide ones.

    Centre, both axes [px], and the direction of the first of these [deg].
    """
    for part in (6, 20):
        block = max(11, min(picture.shape) // part) | 1
        binary = _binary(picture, block)
        for blur_px in _BLURS_PX:
            if np.count_nonzero(binary[:, 1:] != binary[:, :-1]) < _MOST_EDGES * picture.size:
                break
            calm = cv2.GaussianBlur(picture, (0, 0), blur_px)
            binary = _binary(np.asarray(calm, dtype=np.uint8), block)
        contours, _ = cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        ellipses = []
        for contour in contours:
            if len(contour) < 8:
                continue
            # a contour runs through the middle of pixels: half a pixel is missing all around
            area = cv2.contourArea(contour) + len(contour) / 2
            if area < _BLOB_PX:
                continue
            (x, y), (first, second), turn = cv2.fitEllipseDirect(contour)
            whole = np.pi / 4 * (first + 1.0) * (second + 1.0)
            if not 0.0 < max(first, second) < 6.0 * min(first, second):
                continue
            if abs(area - whole) < _ROUNDNESS * whole + 0.05 * len(contour):
                ellipses.append((x, y, first + 1.0, second + 1.0, turn))
        yield np.array(ellipses).reshape(-1, 5)


_BLURS_PX, _MOST_EDGES = (1.5, 3.0), 0.15
"""Noise is blurred until no more pixels than that, of all, differ from the one beside them: OpenCV
takes seconds for the contours of more, and circles among them are not round. Circles that are as
small and as near to each other as any that are found have fewer."""


def _binary(picture: GreyImage, block: int) -> NDArray[np.uint8]:
    """What is darker than its surroundings."""
    kind, mean = cv2.THRESH_BINARY_INV, cv2.ADAPTIVE_THRESH_MEAN_C
    return np.asarray(cv2.adaptiveThreshold(picture, 255, mean, kind, block, 10), dtype=np.uint8)
