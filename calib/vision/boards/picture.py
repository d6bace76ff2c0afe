"""The ideal picture of a board, what stands on the paper, and its print in simulated pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.se3 import FloatArray, transform
from calib.vision.boards.board import Board

_FRACTION_BITS = 10
"""Bits of a pixel's fraction that OpenCV draws with."""

LARGEST_PX = 20_000


def board_picture(board: Board, px_per_m: float, margin_m: float = 0.0) -> NDArray[np.uint8]:
    """The printed pattern as a picture ``(height, width)``, black 0 on white 255, white about it.

    The left upper corner of :attr:`Board.box`, less the margin, is the left upper corner of the
    picture; edges between pixels are drawn in between.
    """
    left, top, right, bottom = board.box + margin_m * np.array([-1.0, -1.0, 1.0, 1.0])
    width, height = (int(np.ceil(side * px_per_m - 1e-6)) for side in (right - left, bottom - top))
    if not (0 < width <= LARGEST_PX and 0 < height <= LARGEST_PX):
        raise InputError(
            f"a picture of the board at {px_per_m:g} px/m has {width} x {height} pixels",
            hint=f"choose px_per_m so that it has at most {LARGEST_PX} along a side",
            name="px_per_m",
        )
    # four times as fine, then averaged: edges between pixels come out grey by their share
    picture = np.full((4 * height, 4 * width), 255, dtype=np.uint8)
    rectangles, discs = board.printed
    _fill(picture, (rectangles - [left, top, left, top]) * (4 * px_per_m), 0)
    scale = 4 * px_per_m * 2**_FRACTION_BITS
    for x, y, radius in discs:
        # OpenCV counts from the middle of a pixel
        center = np.rint(scale * np.array([x - left, y - top]) - 2 ** (_FRACTION_BITS - 1))
        cv2.circle(
            picture,
            (int(center[0]), int(center[1])),
            int(np.rint(scale * radius)),
            0,
            -1,
            cv2.LINE_AA,
            _FRACTION_BITS,
        )
    _fill(picture, (board.cut_out - [left, top, left, top]) * (4 * px_per_m), 255)
    averaged = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(averaged, dtype=np.uint8)


def _fill(picture: NDArray[np.uint8], rectangles: FloatArray, grey: int) -> None:
    for x0, y0, x1, y1 in np.rint(rectangles).astype(int):
        picture[y0:y1, x0:x1] = grey


T_BOARD_PLATE = transform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""The plate's frame, whose z comes out of its face, in that of the board, whose z goes in."""

BLACK, WHITE = 0.08, 0.85
"""Reflectance of what is printed, and of the paper."""

PX_PER_M = 10_000.0
"""Of the print as it is sampled: finer than a camera that has all of it in view sees."""


@dataclass(frozen=True, eq=False)
class BoardPlate:
    """A printed board with white about it."""

    board: Board
    margin_m: float = 0.02  # of white

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
