"""What pictures show of the board, as it is found and as a table: ``camera_points.csv``.

======================  =========================================================================
``picture``             name of the picture
``point``               number of the point of the board, from 0: as ``Board.points`` has them
``x_px``, ``y_px``      where it is, from the left upper corner of the image
``residual_x_px``       by how much the result shows it elsewhere; empty for what was not used
``residual_y_px``       the same down the image
======================  =========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.se3 import FloatArray
from calib.vision.boards import Board, BoardSighting, detect_board
from posedesign.files.pictures import read_grey

Advance = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Sightings:
    """What N pictures show of a board of K points.

    ``pixels`` (N, K, 2): from the left upper corner of the image; NaN where a point is not seen.
    ``reasons``: why a picture shows none of them; empty where it shows some.
    """

    pixels: FloatArray
    reasons: tuple[str, ...]

    @property
    def shown(self) -> int:
        """Pictures that show the board."""
        return sum(not reason for reason in self.reasons)


def find_boards(
    paths: Sequence[Path], board: Board, advance: Advance = lambda what, part: None
) -> Sightings:
    """Find a board in pictures, one at a time.

    Raises FileFormatError: a picture that cannot be read.
    """
    found: list[BoardSighting] = []
    for k, path in enumerate(paths):
        advance(path.name, k / max(len(paths), 1))
        found.append(detect_board(read_grey(path), board))
    pixels = np.array([one.pixels for one in found]).reshape(len(paths), len(board.points), 2)
    reasons = ["" if one.is_ok else f"{one.status}: {one.message}" for one in found]
    return Sightings(pixels, tuple(reasons))
