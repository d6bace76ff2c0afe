"""Boards found in a picture: which points of them, and roughly where.

Coordinates are OpenCV's here, counted from the middle of the first pixel.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray
from calib.vision.boards.board import (
    QUARTER_TURNS,
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


@dataclass(frozen=True, eq=False)
class Found:
    """What of a board was found."""

    board: Board  # as described, or with other colours
    which: NDArray[np.intp]  # (K,): points that may be seen
    board_map: BoardMap
    light: bool = False  # what is black on the board is light in the picture
    explained: int = 0  # markers that lie as on the board


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers of a dictionary in a picture."""

    ids: NDArray[np.intp]  # (M,)
    corners: FloatArray  # (M, 4, 2), clockwise from the left upper one of the marker
    squares: int = 0  # quadrilaterals that were seen, markers and others

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
    corners, ids, others = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(picture)
    if ids is None or not len(ids):
        return Markers(np.empty(0, dtype=np.intp), np.empty((0, 4, 2)), len(others))
    return Markers(
        np.asarray(ids).ravel().astype(np.intp),
        np.asarray(corners, dtype=float).reshape(-1, 4, 2),
        len(corners) + len(others),
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
    return Found(board, _points_of(board, seen), board_map, explained=int(np.count_nonzero(whole)))


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
                fitted = fit_grid(board, np.arange(len(at)), each.reshape(-1, 2), picture.shape)
                if fitted is not None:
                    return in_order(picture, board.variants, [_turned(board, fitted)])
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


def fit_grid(
    board: Board, which: NDArray[np.intp], at: FloatArray, shape: tuple[int, ...]
) -> BoardMap | None:
    """Return the map that points of a board lie on, seen from its face."""
    xy = board.points[which, :2]
    fitted = fit_map(xy, at, spacing(at), shape=shape)
    if fitted is None or not is_face_up(board, fitted[0], board.points[:, :2]):
        return None
    return fitted[0] if np.count_nonzero(fitted[1]) >= 0.8 * len(xy) else None


class Ways(NamedTuple):
    """Ways that a grid may lie on a map that was found."""

    board_map: BoardMap
    steps: FloatArray  # (T, 3, 3): from the board to the board that the map is of
    costs: FloatArray  # (T,): in correlations


def _turned(board: Chessboard, found: BoardMap) -> Ways:
    """Return ways that a chessboard may lie on the corners that OpenCV found, and what they cost.

    It may take corners of the outline for inner ones, in the white beside, and leave out as many on
    the other side, of rows or of columns.
    """
    middle = board.points[:, :2].mean(axis=0)
    across = board.columns != board.rows
    steps, costs = [], []
    for k, turn in enumerate(QUARTER_TURNS):
        halves = bool(k % 2) and (board.columns - board.rows) % 2 == 1
        for shift in product((-0.5, 0.5) if halves else (0.0, -1.0, 1.0), repeat=2):
            step = np.eye(3)
            step[:2, :2] = turn
            step[:2, 2] = middle - turn @ middle + board.square_m * np.array(shift)
            steps.append(step)
            costs.append(_MOVED * (any(shift) or (bool(k % 2) and across)))
    return Ways(found, np.array(steps), np.array(costs))


_MOVED = 0.02
"""By how much a correlation has to be better for a row of corners not to be of the board: of twelve
rows one in the white lowers it by twice that, and in a board that goes on it is the same."""


def in_order(
    picture: GreyImage, boards: Sequence[Board], ways: Iterable[Ways], *, light: bool = False
) -> Found | None:
    """Return the grid the way round that colours tell, upright where that leaves several.

    ``boards``: with points at the same places, and other colours. ``light``: the picture is the
    negative of what was taken.
    """
    xy = _between(boards[0])
    whites = [np.where(board.is_black(xy), 0.0, 1.0) for board in boards]
    best, best_score = None, 0.0
    for board_map, steps, costs in ways:
        slope = board_map.slope(boards[0].points[:, :2], boards[0].cell_m / 10).mean(axis=0)
        right = (slope @ steps[:, :2, :2])[:, :, 0]
        in_doubt = 1e-3 * right[:, 0] / np.linalg.norm(right, axis=1)
        at = board_map(xy @ np.swapaxes(steps[:, :2, :2], 1, 2) + steps[:, None, :2, 2])
        for board, white in zip(boards, whites, strict=True):
            scores = _colours(picture, at, white) + in_doubt - costs
            k = int(np.argmax(scores))
            if scores[k] > best_score:
                moved = replace(board_map, homography=board_map.homography @ steps[k])
                best, best_score = (board, moved), float(scores[k])
    return None if best is None else Found(best[0], np.arange(len(best[0].points)), best[1], light)


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


def _colours(picture: GreyImage, px: FloatArray, white: FloatArray) -> FloatArray:
    """Return correlations ``(T,)`` of the picture at pixels ``(T, M, 2)`` with white ``(M,)``."""
    height, width = picture.shape
    at = np.rint(px).astype(np.intp)
    inside = (at >= 0).all(axis=2) & (at < [width, height]).all(axis=2)
    at[~inside] = 0
    grey = picture[at[..., 1], at[..., 0]].astype(float)
    count = np.maximum(inside.sum(axis=1, keepdims=True), 1)
    grey, white = (
        inside * (each - (each * inside).sum(axis=1, keepdims=True) / count)
        for each in (grey, np.broadcast_to(white, grey.shape))
    )
    sizes = (grey**2).sum(axis=1) * (white**2).sum(axis=1)
    sizes[count[:, 0] < 4] = np.inf
    return np.asarray((grey * white).sum(axis=1) / np.sqrt(np.maximum(sizes, 1e-9)))
