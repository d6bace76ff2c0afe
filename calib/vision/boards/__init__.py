"""Calibration boards: what they are, what is printed, and where a picture shows their points.

:func:`make_board` describes one, :func:`detect_board` finds it in a picture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.vision.boards.board import BOARDS as BOARDS
    from calib.vision.boards.board import DICTIONARIES as DICTIONARIES
    from calib.vision.boards.board import AprilTagGrid as AprilTagGrid
    from calib.vision.boards.board import ArucoGrid as ArucoGrid
    from calib.vision.boards.board import AsymmetricCircleGrid as AsymmetricCircleGrid
    from calib.vision.boards.board import Board as Board
    from calib.vision.boards.board import CharucoBoard as CharucoBoard
    from calib.vision.boards.board import Chessboard as Chessboard
    from calib.vision.boards.board import CircleGrid as CircleGrid
    from calib.vision.boards.board import GridBoard as GridBoard
    from calib.vision.boards.board import KalibrAprilGrid as KalibrAprilGrid
    from calib.vision.boards.board import MarkerBoard as MarkerBoard
    from calib.vision.boards.board import MarkerGrid as MarkerGrid
    from calib.vision.boards.board import RoundTarget as RoundTarget
    from calib.vision.boards.board import make_board as make_board
    from calib.vision.boards.detection import BoardSighting as BoardSighting
    from calib.vision.boards.detection import detect_board as detect_board
    from calib.vision.boards.picture import board_picture as board_picture
else:
    __getattr__ = load_when_asked(__name__)
