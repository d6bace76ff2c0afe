"""Boards found in a picture: which points of them, and roughly where.

Coordinates are OpenCV's here, counted from the middle of the first pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calib.se3 import FloatArray
from calib.vision.boards.board import (
    AsymmetricCircleGrid,
    Board,
    CharucoBoard,
    Chessboard,
    CircleGrid,
    MarkerBoard,
)
from calib.vision.boards.board_map import BoardMap, fit_map
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
    """What of a board was found.

    Attributes
    ----------
    which : ndarray (K,)
        Points of the board that may be seen.
    board_map : BoardMap
    """

    which: NDArray[np.intp]
    board_map: BoardMap


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers of a dictionary in a picture.

    Attributes
    ----------
    ids : ndarray (M,)
    corners : ndarray (M, 4, 2)
        Clockwise from the left upper one of the marker.
    """

    ids: NDArray[np.intp]
    corners: FloatArray

    def __len__(self) -> int:
        return len(self.ids)

    def those(self, which: NDArray[np.bool_]) -> Markers:
        """Some of them."""
        return Markers(self.ids[which], self.corners[which])

    @property
    def side_px(self) -> float:
        """Usual length of their sides."""
        sides = self.corners - np.roll(self.corners, 1, axis=1)
        return float(np.median(np.linalg.norm(sides, axis=2)))


def find_markers(
    picture: GreyImage, dictionary: cv2.aruco.Dictionary, *, exactly: bool = False
) -> Markers:
    """Markers of a dictionary; with all bits right if asked for ``exactly``."""
    parameters = cv2.aruco.DetectorParameters()
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


def match_markers(board: MarkerBoard, markers: Markers) -> Found | None:
    """The board that markers lie on, where at least two lie as on it."""
    known = markers.those(np.isin(markers.ids, board.ids))
    if len(known) < LEAST_MARKERS:
        return None
    index = known.ids - board.first_id
    xy, px = board.marker_corners[index].reshape(-1, 2), known.corners.reshape(-1, 2)
    fitted = fit_map(xy, px, known.side_px)
    if fitted is None or not is_face_up(board, fitted[0], xy):
        return None
    board_map, inside = fitted
    seen = np.unique(index[inside.reshape(-1, 4).all(axis=1)])
    if len(seen) < LEAST_MARKERS:
        return None
    return Found(_points_of(board, seen), board_map)


def _points_of(board: MarkerBoard, seen: NDArray[np.intp]) -> NDArray[np.intp]:
    """Points of the board that are at corners of markers ``seen``."""
    if not isinstance(board, CharucoBoard):
        return np.asarray((4 * seen[:, None] + np.arange(4)).ravel())
    middle = board.marker_corners[seen].mean(axis=1)
    apart = np.abs(board.points[:, None, :2] - middle).max(axis=2)
    return np.nonzero((apart < 0.6 * board.square_m).any(axis=1))[0]


def find_chessboard(picture: GreyImage, board: Chessboard) -> Found | None:
    """The whole chessboard, and which of its corners is the first."""
    size = (board.columns - 1, board.rows - 1)
    scales = (2, 1) if picture.size > HALVED_FROM_PX else (1,)
    for scale in scales:
        shown = picture if scale == 1 else halved(picture)
        found, corners = cv2.findChessboardCornersSB(
            shown, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if found:
            at = np.asarray(corners, dtype=float).reshape(-1, 2)
            px = scale * (at + 0.5) - 0.5
            return _in_order(picture, board, px, size)
    return None


def find_circles(picture: GreyImage, board: CircleGrid) -> Found | None:
    """The whole grid of circles."""
    kind = (
        cv2.CALIB_CB_ASYMMETRIC_GRID
        if isinstance(board, AsymmetricCircleGrid)
        else cv2.CALIB_CB_SYMMETRIC_GRID
    )
    size = (board.columns, board.rows)
    for blobs in _blobs(picture):
        if not board.columns * board.rows <= len(blobs) <= _MOST_BLOBS:
            continue
        dots, scale, detector = _dotted(picture.shape, blobs)
        for flags in (kind, kind | cv2.CALIB_CB_CLUSTERING):
            found, centers = cv2.findCirclesGrid(dots, size, flags=flags, blobDetector=detector)
            if found:
                at = np.asarray(centers, dtype=float).reshape(-1, 2)
                _, nearest = cKDTree(blobs).query((at + 0.5) / scale - 0.5)
                ordered = _in_order(picture, board, blobs[nearest], size)
                if ordered is not None:
                    return ordered
    return None


def _dotted(
    shape: tuple[int, ...], blobs: FloatArray
) -> tuple[GreyImage, float, cv2.SimpleBlobDetector]:
    """A picture of nothing but dots, its scale, and what finds them: OpenCV takes no points."""
    distances, _ = cKDTree(blobs).query(blobs, k=2)
    apart = float(np.percentile(np.atleast_2d(distances)[:, 1], 10))
    scale = max(1.0, _DOTS_APART_PX / max(apart, 1.0))
    scale = min(scale, _LARGEST_DOTTED_PX / max(shape))
    dots = np.full([int(np.ceil(scale * side)) + 1 for side in shape], 255, dtype=np.uint8)
    for x, y in np.rint((blobs + 0.5) * scale - 0.5).astype(int):
        cv2.circle(dots, (int(x), int(y)), 3, 0, -1)
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.minThreshold, parameters.maxThreshold = 100.0, 200.0
    parameters.thresholdStep, parameters.minRepeatability = 60.0, 1
    parameters.minDistBetweenBlobs = 4.0
    parameters.minArea, parameters.maxArea = 9.0, 200.0
    parameters.filterByCircularity = parameters.filterByInertia = False
    parameters.filterByConvexity = False
    return dots, scale, cv2.SimpleBlobDetector.create(parameters)


_DOTS_APART_PX, _LARGEST_DOTTED_PX = 12.0, 4000.0
_MOST_BLOBS = 3000


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


def _in_order(
    picture: GreyImage, board: Board, px: FloatArray, size: tuple[int, int]
) -> Found | None:
    """Which way round the grid was found: by colours, and upright where that leaves two ways."""
    columns, rows = size
    grid = px.reshape(rows, columns, 2)
    turns = [grid, grid[::-1, ::-1], grid[::-1], grid[:, ::-1]]
    if rows == columns:
        turns += [turn.transpose(1, 0, 2) for turn in turns]
    xy = board.points[:, :2]
    best, best_score = None, 0.0
    for turn in turns:
        at = turn.reshape(-1, 2)
        near = float(np.median(np.linalg.norm(np.diff(turn, axis=1), axis=2)))
        fitted = fit_map(xy, at, near)
        if fitted is None or not is_face_up(board, fitted[0], xy):
            continue
        if np.count_nonzero(fitted[1]) < 0.8 * len(xy):
            continue
        score = _colours(picture, board, fitted[0])
        upright = fitted[0].slope(xy, board.cell_m / 10).mean(axis=0)
        score += 1e-3 * float(upright[0, 0] / np.linalg.norm(upright[:, 0]))
        if score > best_score:
            best, best_score = fitted[0], score
    return None if best is None else Found(np.arange(len(xy)), best)


def _colours(picture: GreyImage, board: Board, board_map: BoardMap) -> float:
    """Correlation of the picture with black and white of the board about its points."""
    step = board.cell_m / 4 * np.array([-1.0, 0.0, 1.0])
    offsets = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    xy = (board.points[:, None, :2] + offsets).reshape(-1, 2)
    at = np.rint(board_map(xy)).astype(np.intp)
    height, width = picture.shape
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    # on the lines of a chessboard there is neither black nor white
    told = np.tile(np.abs(offsets).min(axis=1) > 0.0, len(board.points))
    if len(board.printed[1]):
        told[:] = True
    inside &= told
    if np.count_nonzero(inside) < 4:
        return 0.0
    grey = picture[at[inside, 1], at[inside, 0]].astype(float)
    white = 1.0 - board.is_black(xy[inside])
    if grey.std() == 0.0 or white.std() == 0.0:
        return 0.0
    return float(np.corrcoef(grey, white)[0, 1])


def _blobs(picture: GreyImage) -> Iterator[FloatArray]:
    """Centres ``(B, 2)`` of dark ellipses, by a mean of the surroundings, first of wide ones."""
    for part in (6, 20):
        block = max(11, min(picture.shape) // part) | 1
        binary = cv2.adaptiveThreshold(
            picture, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, block, 10
        )
        contours, _ = cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        centers = []
        for contour in contours:
            if len(contour) < 8:
                continue
            # a contour runs through the middle of pixels: half a pixel is missing all around
            area = cv2.contourArea(contour) + len(contour) / 2
            if area < _BLOB_PX:
                continue
            (x, y), (first, second), _ = cv2.fitEllipseDirect(contour)
            whole = np.pi / 4 * (first + 1.0) * (second + 1.0)
            if not 0.0 < max(first, second) < 6.0 * min(first, second):
                continue
            if abs(area - whole) < _ROUNDNESS * whole + 0.05 * len(contour):
                centers.append((x, y))
        yield np.array(centers).reshape(-1, 2)
