"""A board as something that is drawn into simulated pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray, transform
from calib.vision.boards.board import Board
from calib.vision.boards.picture import board_picture

T_BOARD_PLATE = transform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""The plate's frame, whose z comes out of its face, in that of the board, whose z goes in."""

BLACK, WHITE = 0.08, 0.85
"""Reflectance of what is printed, and of the paper."""

PX_PER_M = 10_000.0
"""Of the print as it is sampled: finer than a camera that has all of it in view sees."""


@dataclass(frozen=True, eq=False)
class BoardPlate:
    """A printed board with white about it.

    Attributes
    ----------
    margin_m : float
        Width of the white [m].
    """

    board: Board
    margin_m: float = 0.02

    @cached_property
    def _print(self) -> NDArray[np.float32]:
        grey = board_picture(self.board, PX_PER_M, self.margin_m).astype(np.float32) / 255.0
        return np.asarray(BLACK + (WHITE - BLACK) * grey, dtype=np.float32)

    def pattern(self, xy: FloatArray) -> FloatArray:
        """Reflectance ``(...)`` at points ``(..., 2)`` [m] of the plate; NaN off it."""
        left, top = self.board.box[:2] - self.margin_m
        x = ((xy[..., 0] - left) * PX_PER_M - 0.5).astype(np.float32)
        y = ((-xy[..., 1] - top) * PX_PER_M - 0.5).astype(np.float32)
        flat = x.reshape(-1, x.shape[-1]), y.reshape(-1, x.shape[-1])
        out = np.empty(flat[0].shape, dtype=np.float32)
        for first in range(0, len(out), _ROWS):  # OpenCV takes no more rows at once
            part = slice(first, first + _ROWS)
            out[part] = cv2.remap(
                self._print,
                flat[0][part],
                flat[1][part],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(np.nan,),
            )
        return np.asarray(out.reshape(x.shape), dtype=float)

    def plate_corners(self) -> FloatArray:
        """Corners of the plate ``(4, 3)`` [m] in its frame, in order about z."""
        left, top, right, bottom = self.board.box + self.margin_m * np.array([-1, -1, 1, 1])
        corners = [[left, -bottom], [right, -bottom], [right, -top], [left, -top]]
        return np.column_stack([np.array(corners), np.zeros(4)])


_ROWS = 30_000
