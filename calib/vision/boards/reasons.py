"""Why a board is not found in a picture."""

from __future__ import annotations

from calib.vision.boards.board import Board
from calib.vision.boards.detection import Status
from calib.vision.camera.rendering import GreyImage


def why_not(picture: GreyImage, board: Board) -> tuple[Status, str]:
    """Status and message for a picture in which the board is not found."""
    return "no board", f"there is no {board.words} in the picture"
