"""A board found in a picture, or why it is not."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from calib.errors import InputError, check_type
from calib.vision.boards.board import (
    Board,
    Chessboard,
    CircleGrid,
    MarkerBoard,
    RoundTarget,
    dictionary_of,
)
from calib.vision.boards.finding import find_markers, halved, shows_squares
from calib.vision.boards.round_target import find_round_targets
from calib.vision.boards.sighting import BoardSighting, Status, sight
from calib.vision.camera.rendering import GreyImage

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
    x runs to the right of the picture.
    """
    check_type(board, Board, "board")
    check_picture(picture)
    sighting = sight(picture, board, thoroughly=True)
    if sighting is not None:
        return sighting
    status, message = why_not(picture, board)
    return BoardSighting.failed(board, status, message)


def check_picture(picture: object) -> None:
    """Refuse what is no grey picture of eight bits."""
    if not isinstance(picture, np.ndarray) or picture.dtype != np.uint8 or picture.ndim != 2:
        said = (
            f"an array {picture.shape} of {picture.dtype}"
            if isinstance(picture, np.ndarray)
            else f"of type {type(picture).__name__}"
        )
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


def why_not(picture: GreyImage, board: Board) -> tuple[Status, str]:
    """Status and message for a picture in which the board is not found."""
    wrong = _other_markers(picture, board) if isinstance(board, MarkerBoard) else ""
    wrong = wrong or _other_size(picture, board)
    if isinstance(board, RoundTarget) and find_round_targets(picture, board, squares=False):
        wrong = "the round target in the picture has no three squares: print that of this cell"
    if wrong:
        return "another board", wrong
    if _is_found_smaller(picture, board):
        return (
            "blurred",
            "the board is found in a smaller picture only: focus, let the camera come to rest",
        )
    clipped = float(np.mean(picture >= CLIPPED))
    if clipped > CLIPPED_SHARE:
        return "overexposed", f"{clipped:.0%} of the picture is clipped white: expose less"
    return "no board", f"the {board.words} is not in the picture, or not enough of it"


def _other_markers(picture: GreyImage, board: MarkerBoard) -> str:
    """Markers that are not of the board, or lie otherwise, in words."""
    own = find_markers(picture, board.markers, border_bits=board.border_bits, exactly=True)
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
    if np.count_nonzero(np.isin(seen.ids, board.ids)) >= LEAST_NAMED:
        return "the picture is mirrored: give it as the camera took it"
    return ""


def _other_size(picture: GreyImage, board: Board) -> str:
    """A board of a size near to it that the picture shows, in words."""
    if not isinstance(board, (Chessboard, CircleGrid)):
        return ""
    columns, rows = board.columns, board.rows
    if isinstance(board, Chessboard) and not shows_squares(picture, min(columns, rows) - 1):
        return ""
    near = [(columns - i, rows - j) for i in range(2) for j in range(2) if i or j]
    for size in [*near, (columns + 1, rows + 1), (rows, columns)]:
        try:
            other = replace(board, columns=size[0], rows=size[1])
        except InputError:
            continue
        found = None if size == (columns, rows) else sight(picture, other)
        if found is not None and found.is_ok:
            return f"the picture shows a {other.words}, not of {columns} x {rows}: correct them"
    return ""


def _is_found_smaller(picture: GreyImage, board: Board) -> bool:
    """Whether the board is there, with edges too wide to be found."""
    small = picture
    for _ in range(2):
        # finders overlook edges of many pixels, which are sharp in a picture of a quarter
        small = halved(np.asarray(cv2.GaussianBlur(small, (3, 3), 0), dtype=np.uint8))
        if min(small.shape) < 120:
            return False
        found = sight(small, board)
        if found is not None and found.is_ok:
            return True
    return False
