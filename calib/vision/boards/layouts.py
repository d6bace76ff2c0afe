"""Layouts of markers: the one that a picture shows, against the one that is described.

Numbers of markers count on row by row. Where the rows end, and whether every second place is left
out, follows from which marker is seen where. So a picture tells the columns of a board, whatever
is described.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import BoolArray, FloatArray
from calib.vision.boards.board import (
    AprilTagGrid,
    ArucoGrid,
    CharucoBoard,
    KalibrAprilGrid,
    MarkerBoard,
    MarkerGrid,
)
from calib.vision.boards.finding import Markers, turns_of

MOST_COLUMNS = 40
"""Columns of the widest layout that is tried."""

_MISS = 0.4
"""Distance of corners of a marker from their place, in sides of a marker: its size may be
described wrongly, and be that of another kind of board."""

_SOME, _POSSIBLE = 12, 6
"""Markers that every layout is tried with, and layouts that are tried with all markers."""

_LEAST_SIDES = 6
"""Markers that tell the size of markers."""

_MOST_OF_ALL = 0.7
"""Share of all markers that a layout has to explain, before it is named."""

_LEAST, _MORE = 4, 2
"""Markers that a layout explains, and by how many these are more than the described one explains,
before the layout is named."""


@dataclass(frozen=True)
class Layout:
    """Places of markers by their numbers: each place of a grid, or every second one."""

    kind: type[MarkerBoard]
    columns: int
    white_first: bool = False
    """True if a ChArUco board has a marker in its left upper square."""
    first_id: int = 0

    @classmethod
    def of(cls, board: MarkerBoard) -> Layout:
        """Return the layout of a board."""
        white_first = isinstance(board, CharucoBoard) and board.legacy and board.rows % 2 == 0
        return cls(type(board), board.columns, white_first, board.first_id)

    def places(self, ids: NDArray[np.intp]) -> FloatArray:
        """Return columns and rows ``(M, 2)`` of markers; the first row of Kalibr's is the last."""
        number = ids - self.first_id
        if not issubclass(self.kind, CharucoBoard):
            row, column = np.divmod(number, self.columns)
            sign = -1 if issubclass(self.kind, KalibrAprilGrid) else 1
            return np.stack([column, sign * row], axis=1).astype(float)
        pair, rest = np.divmod(number, self.columns)  # two rows have as many markers as columns
        in_first = (self.columns + self.white_first) // 2
        odd = rest >= in_first
        column = 2 * np.where(odd, rest - in_first, rest) + (odd == self.white_first)
        return np.stack([column, 2 * pair + odd], axis=1).astype(float)

    def explains(self, markers: Markers, share: float) -> tuple[BoolArray, FloatArray]:
        """Return which markers ``(M,)`` lie as in this layout, and its homography to the picture.

        ``share``: of a step, that the side of a marker takes.
        """
        inside = np.zeros(len(markers), dtype=bool)
        possible = markers.ids >= self.first_id
        if not possible.any():
            return inside, np.eye(3)
        at = self.places(markers.ids[possible])[:, None] + share * _SQUARE
        px = markers.corners[possible]
        flat = at.reshape(-1, 2)
        found, kept = cv2.findHomography(
            flat, px.reshape(-1, 2), cv2.RANSAC, _MISS * markers.side_px, maxIters=300
        )
        if found is None:
            return inside, np.eye(3)
        H = np.asarray(found, dtype=float)
        ahead, down = (_moved(H, at + step) - _moved(H, at - step) for step in np.eye(2) / 4)
        face_up = ahead[..., 0] * down[..., 1] > ahead[..., 1] * down[..., 0]  # in no mirror
        inside[possible] = (face_up & (kept.reshape(-1, 4) > 0)).all(axis=1)
        return inside, H

    def says(self, markers: Markers, inside: BoolArray) -> str:
        """Return in words which board it is, as far as the markers tell."""
        at = self.places(markers.ids[inside])
        rows = int(np.ptp(at[:, 1])) + 1 if self._is_kalibr else int(at[:, 1].max()) + 1
        legacy = ", its left upper square white (legacy)" if self.white_first else ""
        first = f", the first marker {self.first_id}" if self.first_id else ""
        return (
            f"the {self.kind.name} of {self.columns} columns and {rows} rows or more{legacy}{first}"
        )

    @property
    def _is_kalibr(self) -> bool:
        return issubclass(self.kind, KalibrAprilGrid)


def another_layout(board: MarkerBoard, markers: Markers) -> str:
    """Return in words the layout that explains more markers than the described one; or nothing."""
    own, share = Layout.of(board), board.marker_m / board.step_m[0]
    known = np.isin(markers.ids, board.ids)
    ways = [markers.turned(turn) for turn in turns_of(board)]
    explained = max(int((own.explains(way, share)[0] & known).sum()) for way in ways)
    least = max(explained + _MORE, _LEAST, int(_MOST_OF_ALL * len(markers)))
    best, most = "", least - 1
    if most >= len(markers):
        return ""
    # some of the markers tell which layouts are possible
    some = np.arange(len(markers)) % max(1, len(markers) // _SOME) == 0
    tried = [
        (int(layout.explains(way.those(some), share)[0].sum()), -k, layout, way)
        for k, (layout, way) in enumerate(product(_layouts(board), ways))
    ]
    for _, _, layout, way in sorted(tried, key=lambda each: each[:2])[: -1 - _POSSIBLE : -1]:
        inside, _ = layout.explains(way, share)
        if inside.sum() > most:
            best, most = layout.says(way, inside), int(inside.sum())
    return best


def side_of_markers(board: MarkerBoard, markers: Markers, explained: int) -> float:
    """Return the side of the markers that are seen, in parts of the described one; NaN if few.

    ``explained``: number of those that lie as on the board.
    """
    known, layout = markers.those(np.isin(markers.ids, board.ids)), Layout.of(board)
    step, sides = board.step_m[0], [(0, np.nan)]
    for turn in turns_of(board):
        way = known.turned(turn)
        inside, H = np.ones(len(way), dtype=bool), np.eye(3)
        if explained < len(way):
            inside, H = layout.explains(way, board.marker_m / step)
        count = int(inside.sum())
        if count >= _LEAST_SIDES:
            side = _side_in_steps(way.those(inside), layout.places(known.ids[inside]), H)
            sides.append((count, side * step / board.marker_m))
    return float(max(sides)[1])


def _layouts(board: MarkerBoard) -> Iterator[Layout]:
    """Layouts that the markers of a board are printed in, of its own kind first."""
    own = type(board)
    kinds = [own, *(kind for kind in (CharucoBoard, ArucoGrid) if kind is not own)]
    if issubclass(own, AprilTagGrid):
        kinds = [own, KalibrAprilGrid if own is AprilTagGrid else AprilTagGrid, CharucoBoard]
    for kind in kinds:
        for first in dict.fromkeys((board.first_id, 0)):
            for columns in range(1 if issubclass(kind, MarkerGrid) else 2, MOST_COLUMNS + 1):
                yield Layout(kind, columns, False, first)
                if issubclass(kind, CharucoBoard):
                    yield Layout(kind, columns, True, first)


def _side_in_steps(markers: Markers, at: FloatArray, H: FloatArray) -> float:
    """Return the median side of markers at places ``(M, 2)``, in steps of the layout."""
    middles, _ = cv2.findHomography(at, markers.corners.mean(axis=1), 0)
    back = np.asarray(np.linalg.inv(H if middles is None else middles), dtype=float)
    corners = _moved(back, markers.corners)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.median(sides))


def _moved(H: FloatArray, at: FloatArray) -> FloatArray:
    out = at @ H[:, :2].T + H[:, 2]
    return np.asarray(out[..., :2] / out[..., 2:])


_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
