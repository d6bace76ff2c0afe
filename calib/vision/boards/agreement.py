"""Agreement of a picture with the description of a board, where the board was found.

The lattice of a board says what would be printed beyond it, if it were larger, and in each of its
rows and columns. A picture of a larger board shows the first, one of a smaller board lacks some of
the second.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.se3 import BoolArray, FloatArray
from calib.vision.boards.board import (
    AprilTagGrid,
    GridBoard,
    KalibrAprilGrid,
    MarkerBoard,
    MarkerGrid,
)
from calib.vision.boards.board_map import BoardMap
from calib.vision.boards.finding import turns_of
from calib.vision.camera.edges import read_grey
from calib.vision.camera.rendering import GreyImage

_ACROSS = np.array([0.06, 0.17, 0.33, 0.5, 0.67, 0.83, 0.94])
"""Places across a cell of the lattice, and down, at which grey levels are read. The second one is
in the border of the markers of grids."""

_NEAR = 2.2
"""Distance of cells from points that were seen, in cells: further on the map is not known."""

_GOES_ON = 0.4
"""Correlation with the pattern above which it is there."""

_MOST_OF_ROW = 0.6
"""Share of a row that has to be seen, for the board to end before it."""

_AT_EDGE = 2
"""Of the grey levels down a cell, those that are read first: beyond them the paper may end."""

_CONTRAST = 0.25
"""Standard deviation of grey levels beyond the board, in parts of the contrast of its edges, of a
pattern."""

_PAPER = 0.3
"""Difference from white, in parts of the contrast, of paper without a pattern."""

_LEAST_OF_CELL = 0.4
"""Share of a cell beyond the board that has to be in the picture, for it to be judged."""

_LEAST_CELLS = 3
"""Cells of a side that have to be seen, for it to be judged."""

SIDE_OFF, SIDE_OFF_PX = 0.03, 0.3
"""Difference of the side of a marker in a grid, in parts of it, and of an edge of it [px], that
neither ink nor light makes."""


def disagreement(
    grey: GreyImage,
    board: GridBoard,
    board_map: BoardMap,
    seen: FloatArray,
    levels: tuple[float, float],
) -> str:
    """Return in words what of the picture is not as described, or nothing.

    Parameters
    ----------
    seen : ndarray (K, 2)
        Points of the board that were seen [m].
    levels : tuple of float
        Grey levels of black and white.
    """
    if isinstance(board, MarkerBoard) and _shows_others(grey, board, board_map, seen, levels):
        return OTHER_MARKERS
    size = _size_of_misfit(grey, board, board_map, seen, levels)
    if size:
        return f"a {size} board"
    if not isinstance(board, MarkerGrid):
        return ""
    if (_squares_between(grey, board, board_map, seen) > 0.5) != board.is_kalibr:
        kinds = "no black squares", AprilTagGrid.name, "black squares", KalibrAprilGrid.name
        return "{} between the markers (kind {})".format(*kinds[2 * (not board.is_kalibr) :][:2])
    return ""


def _size_of_misfit(
    grey: GreyImage,
    board: GridBoard,
    board_map: BoardMap,
    seen: FloatArray,
    levels: tuple[float, float],
) -> str:
    """Return "larger" or "smaller" if the board in the picture is that, and else nothing."""
    cells, places, black = _lattice_of(board)
    near = _near(cells.reshape(-1, 2), seen, board.step_m).reshape(cells.shape[:2])
    at, inside = read_grey(grey, board_map(places))  # (rows, columns, samples)
    readable = inside & near[..., None]
    partly = readable.mean(axis=2) > _LEAST_OF_CELL
    dark, light = levels
    for side in ((0, _INSIDE), (-1, _INSIDE), (_INSIDE, 0), (_INSIDE, -1)):
        if np.count_nonzero(partly[side]) >= min(_LEAST_CELLS, len(partly[side])):
            there = readable[side]
            levels_there = at[side][there]
            like = _likeness(*_along(at[side], black[side], there, across=side[1] == _INSIDE))
            if like > _GOES_ON and levels_there.std() > _CONTRAST * (light - dark):
                return "larger"
    if not isinstance(board, MarkerBoard):  # found with all points or not at all
        return ""
    own = np.s_[1:-1, 1:-1]
    fine = (board.rows, board.columns, len(_ACROSS), len(_ACROSS))
    # the gap of a grid is white, and in Kalibr's the squares of the row before are in it
    edge = np.s_[1:_AT_EDGE] if isinstance(board, MarkerGrid) else np.s_[:_AT_EDGE]
    upright = _Rows(readable[own].reshape(fine), at[own].reshape(fine), black[own].reshape(fine))
    for turn, row in _may_end(upright, edge):
        rows = upright.turned(turn)
        if _ends(rows.of(row), rows.of(row + 1), edge):
            return "smaller"
    return ""


class _Rows(NamedTuple):
    """Places in cells ``(rows, columns, samples, samples)``."""

    readable: BoolArray  # they can be judged
    at: FloatArray  # their grey levels
    black: FloatArray  # 1 for what would be black, NaN for what is not known

    def of(self, row: int) -> _Rows:
        """Return those of one row ``(columns, samples, samples)``."""
        return _Rows(self.readable[row], self.at[row], self.black[row])

    def turned(self, turn: int) -> _Rows:
        """Return them by quarter turns, of cells and in each cell."""
        readable = np.rot90(np.rot90(self.readable, turn), turn, axes=(2, 3))
        at, black = (
            np.rot90(np.rot90(each, turn), turn, axes=(2, 3)) for each in (self.at, self.black)
        )
        return _Rows(readable, at, black)


def _may_end(rows: _Rows, edge: slice) -> Iterator[tuple[int, int]]:
    """Yield quarter turns, and rows after which black is light: most boards have none."""
    readable, at, black = rows
    usable = readable.all(axis=(2, 3))
    sums = []
    for ink in (black == 1.0, black == 0.0):
        sums.append((usable * (at * ink).sum(axis=(2, 3)), usable * ink.sum(axis=(2, 3))))
    begins = readable & (black == 1.0)
    for turn in range(4):  # rows from above, columns from the right, rows from below ...
        along, order = 1 - turn % 2, slice(None, None, -1 if turn in (1, 2) else 1)
        dark, light = (
            (total.sum(axis=along) / np.maximum(count.sum(axis=along), 1))[order]
            for total, count in sums
        )
        there, where = (
            np.moveaxis(each, 3 - along, 2)[:, :, order][:, :, edge] for each in (at, begins)
        )
        count = where.sum(axis=(along, 2, 3))[order]
        first = (there * where).sum(axis=(along, 2, 3))[order] / np.maximum(count, 1)
        for row in np.flatnonzero(first[1:] > dark[:-1] + _PAPER * (light - dark)[:-1]).tolist():
            yield turn, row


def _ends(before: _Rows, row: _Rows, edge: slice) -> bool:
    """Return True if a row shows its pattern, and the next one white where that begins."""
    usable = before.readable.all(axis=(1, 2)) & row.readable[:, edge].all(axis=(1, 2))
    at, black = row.at[usable, edge], row.black[usable, edge]
    if usable.mean() < _MOST_OF_ROW or (black == 1.0).any(axis=(1, 2)).sum() < 2:
        return False
    beside, pattern = before.at[usable], before.black[usable]
    if not ((pattern == 1.0).any() and (pattern == 0.0).any()):
        return False
    dark, light = (float(np.median(beside[pattern == ink])) for ink in (1.0, 0.0))
    should_be_black = at[black == 1.0]
    middle = float(np.median(should_be_black))
    if abs(middle - light) > _PAPER * (light - dark):
        return False  # it may be hidden
    missing = np.mean(should_be_black < (dark + light) / 2) < 0.1
    return bool(missing and _likeness(beside, pattern) > _GOES_ON)


def _shows_others(
    grey: GreyImage,
    board: MarkerBoard,
    board_map: BoardMap,
    seen: FloatArray,
    levels: tuple[float, float],
) -> bool:
    """Return True if markers in the picture have other bits than those described there."""
    border, count = board.border_bits, board.bits.shape[1]
    across = (np.arange(border, count - border) + 0.5) / count
    aside = board.marker_m * np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    near = _near(board.marker_corners.mean(axis=1), seen, board.step_m, _BESIDE)
    places = board.marker_corners[near, :1] + aside
    at, inside = read_grey(grey, board_map(places))
    clear = inside.all(axis=1) & (at.std(axis=1) > _CONTRAST * (levels[1] - levels[0]))
    if np.count_nonzero(clear) < _LEAST_OTHERS:
        return False
    own = np.s_[border:-border]
    white = ~board.bits[near][clear][:, own, own]
    at = at[clear] - at[clear].mean(axis=1, keepdims=True)
    likeness = []
    for turn in turns_of(board):
        bits = np.rot90(white, turn, axes=(1, 2)).reshape(at.shape).astype(float)
        bits -= bits.mean(axis=1, keepdims=True)
        sizes = np.linalg.norm(at, axis=1) * np.linalg.norm(bits, axis=1)
        likeness.append((at * bits).sum(axis=1) / np.maximum(sizes, 1e-9))
    best = max(likeness, key=lambda each: float(np.median(each)))
    others = int(np.count_nonzero(best < _LIKE_BITS))
    return others >= max(_LEAST_OTHERS, _MOST_OTHERS * len(best))


OTHER_MARKERS = "markers at other places"

_BESIDE = 0.8
"""Distance of markers from points that were seen, in cells, whose bits are compared."""

_LIKE_BITS, _LEAST_OTHERS, _MOST_OTHERS = 0.4, 2, 0.25
"""Correlation of grey levels with the bits of a marker below which it is another, and how many and
which share of others there may not be. The bits of two markers are correlated by 0.3 at most."""


def _squares_between(
    grey: GreyImage, board: MarkerGrid, board_map: BoardMap, seen: FloatArray
) -> float:
    """Return the share of places between four markers that are as dark as the markers' borders."""
    cells = _lattice_of(board)[0][1:-1, 1:-1]
    step, gap = np.array(board.step_m), board.spacing_m - board.marker_m
    at_marker = np.array([board.marker_m / 2 - 0.25 * gap, 0.0])
    places = np.stack([cells + step / 2, cells + at_marker, cells + step * [0.5, 0.0]], axis=2)
    near = _near(places[:, :, 0].reshape(-1, 2), seen, board.step_m).reshape(cells.shape[:2])
    levels, inside = read_grey(grey, board_map(places[:-1, :-1]))
    corner, black, white = levels[inside.all(axis=2) & near[:-1, :-1]].T
    return float(np.mean(corner < (black + white) / 2)) if len(corner) else float(board.is_kalibr)


def side_of_markers_off(board: MarkerGrid, which: NDArray[np.intp], px: FloatArray) -> float:
    """Return by how much markers are larger than described, in parts; zero where it is not sure.

    By sides of two neighbours over the distance between them, which perspective leaves alike.

    Parameters
    ----------
    which, px : ndarray (K,), (K, 2)
        Points of the board whose edges were seen, and where.
    """
    seen = np.full((len(board.points), 2), np.nan)
    seen[which] = px
    grid = seen.reshape(board.rows, board.columns, 4, 2)
    shares, sides = list[FloatArray](), list[FloatArray]()
    for axis, ends in ((1, ((0, 1), (3, 2))), (0, ((0, 3), (1, 2)))):
        lattice = np.moveaxis(grid, axis, 0)
        for one, other in ends:
            side = np.linalg.norm(lattice[..., other, :] - lattice[..., one, :], axis=-1)
            step = np.linalg.norm(lattice[1:] - lattice[:-1], axis=-1)
            shares.append(((side[1:] + side[:-1]) / (step[..., one] + step[..., other])).ravel())
            sides.append(side.ravel())
    share = np.concatenate(shares)
    share = share[np.isfinite(share)]
    if len(share) < _LEAST_PAIRS:
        return 0.0
    part = float(np.median(share)) * board.spacing_m / board.marker_m - 1.0
    side_px = float(np.nanmedian(np.concatenate(sides)))
    return part if abs(part) > SIDE_OFF and abs(part) * side_px / 2 > SIDE_OFF_PX else 0.0


_LEAST_PAIRS = 4
"""Pairs of sides that tell the size of the markers."""


@lru_cache(maxsize=32)
def _lattice_of(board: GridBoard) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return middles, places and blackness of the cells of a board and of those about it.

    Arrays ``(rows + 2, columns + 2, 2)``, ``(..., samples, 2)`` and ``(..., samples)``.
    """
    step, count = np.array(board.step_m), np.array([board.columns, board.rows])
    first = board.box.reshape(2, 2).mean(axis=0) - step * count / 2
    column, row = np.meshgrid(np.arange(-1, count[0] + 1), np.arange(-1, count[1] + 1))
    corners = first + step * np.stack([column, row], axis=-1)
    aside = step * np.stack(np.meshgrid(_ACROSS, _ACROSS), axis=-1).reshape(-1, 2)
    places = corners[..., None, :] + aside
    # what is beyond is as two cells before it: of two, one is black, or no large dot
    period = step * np.minimum(count, 2)
    last = first + step * count
    under = np.ceil(np.maximum(first - places, 0.0) / period - 1e-9)
    over = np.ceil(np.maximum(places - last, 0.0) / period - 1e-9)
    inside = places + period * (under - over)
    black = board.known_black(inside.reshape(-1, 2)).reshape(places.shape[:-1])
    # the outer squares of Kalibr's grids lie in cells beyond
    own = (places > board.box[:2]).all(axis=-1) & (places < board.box[2:]).all(axis=-1)
    own[1:-1, 1:-1] = False
    black[own] = np.nan
    return corners + step / 2, places, black


def _near(
    cells: FloatArray, seen: FloatArray, step_m: tuple[float, float], most: float = _NEAR
) -> BoolArray:
    from scipy.spatial import cKDTree

    far = np.asarray(cKDTree(seen / step_m).query(cells / step_m)[0])
    return far < most


_INSIDE = slice(1, -1)


def _along(
    at: FloatArray, black: FloatArray, there: BoolArray, *, across: bool
) -> tuple[FloatArray, FloatArray]:
    """Return grey levels and pattern beyond a side, less their means at each distance from it.

    White paper that ends on a dark table is like the gap of a grid with its next markers, but it
    is so all along the side.
    """
    known = there & np.isfinite(black)
    row, column = np.divmod(np.arange(at.shape[-1]), len(_ACROSS))
    index = np.broadcast_to(row if across else column, at.shape)[known]
    count = np.maximum(np.bincount(index, minlength=len(_ACROSS)), 1)
    levels, pattern = (
        values[known] - (np.bincount(index, values[known], len(_ACROSS)) / count)[index]
        for values in (at, black)
    )
    return levels, pattern


def _likeness(grey: FloatArray, black: FloatArray) -> float:
    """Return the correlation of grey levels with a pattern, NaN of it left out."""
    known = np.isfinite(black)
    at, white = grey[known], 1.0 - black[known]
    if len(at) < 8 or at.std() == 0.0 or white.std() == 0.0:
        return 0.0
    return float(np.corrcoef(at, white)[0, 1])
