"""Calibration boards: what they are, what is printed, and where a picture shows their points.

:func:`make_board` describes one, :func:`detect_board` finds it in a picture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.vision.boards.board import (
        BOARDS,
        DICTIONARIES,
        AprilTagGrid,
        ArucoGrid,
        AsymmetricCircleGrid,
        Board,
        CharucoBoard,
        Chessboard,
        CircleGrid,
        GridBoard,
        KalibrAprilGrid,
        MarkerBoard,
        MarkerGrid,
        RoundTarget,
        make_board,
    )
    from calib.vision.boards.detection import BoardSighting, detect_board
    from calib.vision.boards.picture import board_picture
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "BOARDS",
    "DICTIONARIES",
    "AprilTagGrid",
    "ArucoGrid",
    "AsymmetricCircleGrid",
    "Board",
    "BoardSighting",
    "CharucoBoard",
    "Chessboard",
    "CircleGrid",
    "GridBoard",
    "KalibrAprilGrid",
    "MarkerBoard",
    "MarkerGrid",
    "RoundTarget",
    "board_picture",
    "detect_board",
    "make_board",
]
