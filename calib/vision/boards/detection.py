"""Boards in pictures: their corners or centres to a fraction of a pixel, or why there are none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError, check_type
from calib.se3 import FloatArray
from calib.vision.boards.agreement import OTHER_MARKERS, disagreement, side_of_markers_off
from calib.vision.boards.board import (
    AprilTagGrid,
    Board,
    Chessboard,
    CircleGrid,
    GridBoard,
    KalibrAprilGrid,
    MarkerBoard,
    MarkerGrid,
    RoundTarget,
    dictionary_of,
)
from calib.vision.boards.board_map import BoardMap, fit_map
from calib.vision.boards.circles import (
    CircleLattices,
    circles_shown,
    find_circles,
    lattices_for,
)
from calib.vision.boards.edges import Refined, refine
from calib.vision.boards.finding import (
    Found,
    Markers,
    find_chessboard,
    find_markers,
    halved,
    is_face_up,
    match_markers,
    points_near,
    read_markers,
    squares_shown,
)
from calib.vision.boards.layouts import another_layout, side_of_markers
from calib.vision.boards.round_target import find_round_targets
from calib.vision.camera.rendering import GreyImage

Status = Literal[
    "ok", "no board", "another board", "too few points", "blurred", "overexposed", "ambiguous"
]

LEAST_POINTS = 6
"""Points of a sighting: with four the camera's pose fits always, right or wrong."""

LEAST_SHARE = 0.7
"""Of the points of boards without markers: they are only found as a whole."""

LARGEST_SIGMA_PX, LARGEST_MISS_PX = 3.5, 0.5
"""Blur, and median distance of the points from the map that they lie on, beyond which a picture is
blurred: a moving camera moves the points, too. A lens out of focus alone does not."""

OVEREXPOSED_BLACK = 110.0
"""Grey level of black beside clipped white: three times the light that would have been enough."""


@dataclass(frozen=True, eq=False)
class BoardSighting:
    """What one picture shows of a board.

    Attributes
    ----------
    pixels : ndarray (K, 2)
        Points of the board, x right and y down from the left upper corner of the image: OpenCV's
        plus one half. NaN for points that are not seen; all of them unless the status is ``"ok"``.
    status : {"ok", "no board", "another board", "too few points", "blurred", "overexposed", \
"ambiguous"}
        ``"ambiguous"`` where the picture shows the board twice.
    message : str
        What is wrong and what to do, in one line; empty for ``"ok"``.
    sharpness_px : float
        Width of the edges at the points, from a tenth to nine tenths of the step; NaN where none
        was measured.
    """

    pixels: FloatArray
    status: Status
    message: str
    sharpness_px: float

    @property
    def is_ok(self) -> bool:
        """Whether the points can be used."""
        return self.status == "ok"

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which points of the board are seen ``(K,)``."""
        return np.asarray(np.isfinite(self.pixels).all(axis=1))

    @classmethod
    def failed(
        cls, board: Board, status: Status, message: str, sharpness_px: float = np.nan
    ) -> BoardSighting:
        """A sighting without points."""
        return cls(np.full((len(board.points), 2), np.nan), status, message, sharpness_px)


def sight(
    picture: GreyImage,
    board: Board,
    *,
    thoroughly: bool = False,
    lattices: CircleLattices | None = None,
) -> BoardSighting | None:
    """The sighting of a board that is found; None where it is not.

    ``lattices``: of the circles in the picture, where they are known.
    """
    found: Found | None = None
    if isinstance(board, MarkerBoard):
        markers, found, read_px = read_markers(picture, board)
        twice, many = np.unique(markers.ids, return_counts=True)
        twice = twice[(many > 1) & np.isin(twice, board.ids)]
        if len(twice) > 1:
            twins = f"markers {twice[0]} and {twice[1]}"
            message = f"{twins} are seen twice: leave one board in the picture"
            return BoardSighting.failed(board, "ambiguous", message)
        markers = markers.those(~np.isin(markers.ids, twice))
        if found is not None and len(markers) - found.explained >= LEAST_UNEXPLAINED:
            said = another_layout(board, markers)
            if said:
                return BoardSighting.failed(board, "another board", _not_the(board, said))
        if found is not None:
            side = _side_of_markers(board, markers, found)
            if abs(side - 1.0) > max(SIDE_OFF, SIDE_OFF_PX * read_px / markers.side_px):
                said = f"markers of {side * board.marker_m / board.step_m[0]:.2f} of "
                said += "the spacing" if isinstance(board, MarkerGrid) else "a square"
                return BoardSighting.failed(board, "another board", _not_the(board, said))
    elif isinstance(board, Chessboard):
        found = find_chessboard(picture, board, thoroughly=thoroughly)
    elif isinstance(board, CircleGrid):
        found = find_circles(picture, board, lattices or lattices_for(picture, board))
    elif isinstance(board, RoundTarget):
        targets = find_round_targets(picture, board)
        if len(targets) > 1:
            message = f"{len(targets)} round targets are seen: leave one in the picture"
            return BoardSighting.failed(board, "ambiguous", message)
        found = targets[0] if targets else None
    sighting = None if found is None else _measure(picture, found)
    if (
        sighting is not None
        and sighting.message == OTHER_MARKERS
        and isinstance(board, MarkerBoard)
    ):
        said = another_layout(board, markers) or f"{OTHER_MARKERS} or another dictionary"
        return replace(sighting, message=_not_the(board, said))
    return sighting


def _not_the(board: Board, said: str) -> str:
    return f"the picture shows {said}, not the {board.words}: correct the description"


def _side_of_markers(board: MarkerBoard, markers: Markers, found: Found) -> float:
    """Return the side of markers in parts of the described one; NaN where they do not tell."""
    if not isinstance(board, MarkerGrid):
        return side_of_markers(board, markers, found.explained)
    if board.is_kalibr:  # its squares touch the corners of tags, and decoders miss them
        return float("nan")
    known = markers.those(np.isin(markers.ids, board.ids))
    which = 4 * (known.ids - board.first_id)[:, None] + np.arange(4)
    return 1.0 + side_of_markers_off(board, which.ravel(), known.corners.reshape(-1, 2))


LEAST_UNEXPLAINED = 2
"""Markers that lie otherwise than on the board, from which on another layout is looked for."""

SIDE_OFF, SIDE_OFF_PX = 0.1, 3.0
"""Difference of the side of markers from the described one, in parts of it and in pixels, from
which on a board is another. The points of a ChArUco board do not depend on it, and corners of
markers are known to a pixel only, of the picture in which they were read."""


def _measure(picture: GreyImage, found: Found) -> BoardSighting | None:
    board, which, board_map = found.board, found.which, found.board_map
    if found.light:
        picture = np.asarray(255 - picture, dtype=np.uint8)
    xy = board.points[which, :2]
    area = np.abs(np.linalg.det(board_map.slope(xy, board.cell_m / 10)))
    near_px = float(board.cell_m * np.sqrt(np.median(area)))
    measured = refine(picture, board, which, board_map, board_map(xy))
    if isinstance(board, MarkerGrid):  # before points that lie on no map are left out
        off = side_of_markers_off(board, which[measured.good], measured.px[measured.good])
        if off:
            share = (1.0 + off) * board.marker_m / board.spacing_m
            said = _not_the(board, f"markers of {share:.3f} of the spacing")
            return BoardSighting.failed(board, "another board", said)
    for _ in range(1 + GROWTH):  # points that are known to a part of a pixel say where others are
        fitted = _fit_map(board, which, measured, board_map, near_px, picture.shape)
        if fitted is None:
            return _too_few(board, measured)
        board_map, inside = fitted
        before = which
        if isinstance(board, MarkerBoard):
            which = points_near(board, which[inside])
        at = board_map(board.points[which, :2])
        if np.isin(which, before).all():
            break
        measured = refine(picture, board, which, board_map, at)
    measured = refine(picture, board, which, board_map, at, measured.sigma_px)
    fitted = _fit_map(board, which, measured, board_map, near_px, picture.shape, least=4)
    if fitted is None:
        return _too_few(board, measured)
    board_map, inside = fitted
    return _judged(picture, board, which, replace(measured, good=inside), board_map)


GROWTH = 2
"""Steps that points may be away from those of the markers that were read."""


def _fit_map(
    board: Board,
    which: NDArray[np.intp],
    measured: Refined,
    board_map: BoardMap,
    near_px: float,
    shape: tuple[int, ...],
    least: int = LEAST_POINTS,
) -> tuple[BoardMap, NDArray[np.bool_]] | None:
    """Return the map that good points lie on, and which of all ``(K,)`` do; None of too few."""
    good = np.array(measured.good)
    if np.count_nonzero(good) < least:
        return None
    fitted = fit_map(
        board.points[which[good], :2],
        measured.px[good],
        near_px,
        refined=True,
        shape=shape,
        start=board_map,
    )
    if fitted is None:
        return None
    good[good] = fitted[1]
    return fitted[0], good


def _judged(
    picture: GreyImage,
    board: Board,
    which: NDArray[np.intp],
    measured: Refined,
    board_map: BoardMap,
) -> BoardSighting | None:
    good, xy = measured.good, board.points[which, :2]
    least = LEAST_POINTS
    if not isinstance(board, MarkerBoard):
        least = max(least, int(np.ceil(LEAST_SHARE * len(xy))))
    if np.count_nonzero(good) < least:
        return _too_few(board, measured)
    _, across = np.linalg.svd(xy[good] - xy[good].mean(axis=0), compute_uv=False)
    if not across > 0.4 * board.cell_m:  # on a line
        return _too_few(board, measured)
    if not is_face_up(board, board_map, xy[good]):
        return None
    width = _WIDTH * measured.sigma_px
    failed = partial(BoardSighting.failed, board, sharpness_px=width)
    dark, light = (float(np.median(each[good])) for each in (measured.dark, measured.light))
    if isinstance(board, GridBoard):
        said = disagreement(picture, board, board_map, xy[good], (dark, light))
        if said:
            words = said if said == OTHER_MARKERS else _not_the(board, said)
            return failed("another board", words)
    miss = np.linalg.norm(board_map(xy[good]) - measured.px[good], axis=1)
    if measured.sigma_px > LARGEST_SIGMA_PX and np.median(miss) > LARGEST_MISS_PX:
        said = f"edges are {width:.0f} px wide: focus the camera, let it come to rest"
        return failed("blurred", said)
    if light > 252.0 and dark > OVEREXPOSED_BLACK:
        said = f"white is clipped and black has grey level {dark:.0f}: expose less"
        return failed("overexposed", said)
    pixels = np.full((len(board.points), 2), np.nan)
    pixels[which[good]] = measured.px[good] + 0.5
    return BoardSighting(pixels, "ok", "", width)


_WIDTH = 2.563
"""Width of a blurred edge, from a tenth to nine tenths of the step, in standard deviations."""


def _too_few(board: Board, measured: Refined) -> BoardSighting | None:
    """Where its markers or its cross say that the board is there; else clutter was found."""
    if not isinstance(board, (MarkerBoard, RoundTarget)):
        return None
    said = (
        f"{np.count_nonzero(measured.good)} points of {len(board.points)} are seen well enough: "
        "show more of the board, nearer, in even light"
    )
    return BoardSighting.failed(board, "too few points", said, _WIDTH * measured.sigma_px)


LEAST_NAMED = 4
"""Markers from which on a dictionary is named: fewer may be clutter."""

CLIPPED, CLIPPED_SHARE = 253, 0.5
"""Grey level of clipped white, and the share of such pixels in a picture that hides a board."""

_FAMILIES = (
    ("DICT_4X4_50", "DICT_4X4_100", "DICT_4X4_250", "DICT_4X4_1000"),
    ("DICT_5X5_50", "DICT_5X5_100", "DICT_5X5_250", "DICT_5X5_1000"),
    ("DICT_6X6_50", "DICT_6X6_100", "DICT_6X6_250", "DICT_6X6_1000"),
    ("DICT_7X7_50", "DICT_7X7_100", "DICT_7X7_250", "DICT_7X7_1000"),
    ("DICT_APRILTAG_36H11",),
    ("DICT_ARUCO_MIP_36H12",),
    ("DICT_ARUCO_ORIGINAL",),
    ("DICT_APRILTAG_25H9",),
)
"""Dictionaries that begin with the same markers. That of 16 bits finds its tags in anything."""


def detect_board(picture: GreyImage, board: Board) -> BoardSighting:
    """Find a board in a grey picture, and measure its points.

    Boards with markers may be seen in part. Chessboards, grids of circles and round targets must
    be seen as a whole; of those that look the same after half a turn, the way round is taken whose
    x runs to the right of the picture. Grids of circles may be white on black.
    """
    check_type(board, Board, "board")
    check_picture(picture)
    lattices = lattices_for(picture, board)
    sighting = sight(picture, board, thoroughly=True, lattices=lattices)
    if sighting is None:
        sighting = _found_smaller(picture, board)
    if sighting is not None:
        return sighting
    status, message = why_not(picture, board, lattices)
    return BoardSighting.failed(board, status, message)


def check_picture(picture: object) -> None:
    """Refuse what is no grey picture of eight bits."""
    if not isinstance(picture, np.ndarray) or picture.dtype != np.uint8 or picture.ndim != 2:
        said = f"of type {type(picture).__name__}"
        if isinstance(picture, np.ndarray):
            said = f"an array {picture.shape} of {picture.dtype}"
        raise InputError(
            f"the picture is {said}",
            hint="give grey levels of eight bits, (height, width) of uint8",
            name="picture",
        )
    if min(picture.shape) < 32:
        raise InputError(
            f"the picture has {picture.shape[1]} x {picture.shape[0]} pixels",
            hint="it takes 32 x 32 at least",
            name="picture",
        )


def why_not(picture: GreyImage, board: Board, lattices: CircleLattices) -> tuple[Status, str]:
    """Status and message for a picture in which the board is not found."""
    wrong = _other_markers(picture, board) if isinstance(board, MarkerBoard) else ""
    wrong = wrong or _other_size(picture, board, lattices)
    if isinstance(board, RoundTarget) and find_round_targets(picture, board, squares=False):
        wrong = "the round target in the picture has no three squares: print that of this cell"
    if wrong:
        return "another board", wrong
    clipped = float(np.mean(picture >= CLIPPED))
    if clipped > CLIPPED_SHARE:
        return "overexposed", f"{clipped:.0%} of the picture is clipped white: expose less"
    return "no board", f"the {board.words} is not in the picture, or not enough of it"


def _other_markers(picture: GreyImage, board: MarkerBoard) -> str:
    """Return markers that are not of the board, or lie otherwise, in words."""
    border_bits = board.border_bits
    if find_markers(picture, board.markers, border_bits=border_bits, quickly=True).squares == 0:
        return ""
    own = find_markers(picture, board.markers, border_bits=board.border_bits, exactly=True)
    said = another_layout(board, own)
    if said:
        return _not_the(board, said)
    if isinstance(board, AprilTagGrid):
        borders = 3 - board.border_bits
        other = find_markers(picture, board.markers, border_bits=borders, exactly=True)
        if len(other) >= LEAST_NAMED:
            kind = (AprilTagGrid, KalibrAprilGrid)[borders - 1].name
            said = f"tags with borders of {borders} cells, as those of the kind {kind}"
            return _not_the(board, said)
    of_board = np.isin(own.ids, board.ids)
    if np.count_nonzero(~of_board) >= LEAST_NAMED:
        return (
            f"the picture shows markers {own.ids.min()} to {own.ids.max()} of {board.dictionary}, "
            f"the board has {board.ids.start} to {board.ids.stop - 1}: correct first_id, columns "
            "or rows"
        )
    if np.count_nonzero(of_board) >= LEAST_NAMED:
        return (
            "markers of the board are seen, but not as they lie on it: correct kind, columns, "
            "marker size, legacy, or the picture is mirrored"
        )
    for family in _FAMILIES:
        if board.dictionary in family:
            continue
        found = find_markers(picture, dictionary_of(family[-1]), exactly=True)
        if len(np.unique(found.ids)) < LEAST_NAMED:
            continue
        name = next(name for name in family if found.ids.max() < len(dictionary_of(name).bytesList))
        return (
            f"the picture shows markers {found.ids.min()} to {found.ids.max()} of {name}, "
            f"not of {board.dictionary}: correct the dictionary"
        )
    mirrored = np.ascontiguousarray(picture[:, ::-1])
    seen = find_markers(mirrored, board.markers, border_bits=board.border_bits, exactly=True)
    if len(seen) >= LEAST_NAMED and match_markers(board, seen, picture.shape) is not None:
        return "the picture is mirrored: give it as the camera took it"
    return ""


def _other_size(picture: GreyImage, board: Board, lattices: CircleLattices) -> str:
    """A board of another size, or of circles in another order, that the picture shows, in words."""
    if isinstance(board, Chessboard):
        size = squares_shown(picture, max(min(board.columns, board.rows) - 3, 3))
        if size and sorted(size) != sorted((board.columns, board.rows)):
            size = size if (size[0] < size[1]) == (board.columns < board.rows) else size[::-1]
            return _not_the(board, f"a chessboard of {size[0]} x {size[1]} squares or more")
    shown = circles_shown(lattices) if isinstance(board, CircleGrid) else None
    if shown is None or not isinstance(board, CircleGrid):
        return ""
    kind, columns, rows = shown
    if kind is type(board) and sorted((columns, rows)) == sorted((board.columns, board.rows)):
        return ""
    if kind is CircleGrid and board.columns < board.rows:
        columns, rows = rows, columns
    return _not_the(board, f"the {kind.name} of {columns} x {rows}")


def _found_smaller(picture: GreyImage, board: Board) -> BoardSighting | None:
    """The sighting in a smaller picture: wide edges, which finders overlook, are sharp in it."""
    small = picture
    for times in (2, 4):
        small = halved(np.asarray(cv2.GaussianBlur(small, (3, 3), 0), dtype=np.uint8))
        if min(small.shape) < 120:
            return None
        found = sight(small, board)
        if found is not None and found.status in ("ok", "another board"):
            return replace(
                found, pixels=times * found.pixels, sharpness_px=times * found.sharpness_px
            )
    return None
