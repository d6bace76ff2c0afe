"""Pictures of a board, and where the arm was when they were taken: what the estimate rests on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.hand_eye.start import FEWEST_POINTS
from calib.model.measurements.board_view import Carried
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Pictures:
    """What pictures of one board show, and where the arm was.

    Attributes
    ----------
    robot : Robot
        :func:`calib.robots.flange_robot` where nothing but poses of the flange is known.
    postures : array (N, n)
        [rad]; NaN for pictures without one, which serve the lens only.
    pixels : array (N, K, 2)
        From the upper left corner of the image; NaN for points that were not seen.
    board : array (K, 3)
        Points in the frame of the board [m].
    size_px : tuple of int
        Width and height of the pictures.
    carried : {"camera", "board"}
        What is on the flange.
    names : tuple of str
        Of the pictures. Those that several cameras took at one stop of the arm share a name.
    half_turn : bool
        Whether the board looks the same after half a turn, so that pictures show it either way
        round: its points then stand in the opposite order.
    camera, board_name : str
        Names of both, where there are several.
    """

    robot: Robot
    postures: FloatArray
    pixels: FloatArray
    board: FloatArray
    size_px: tuple[int, int]
    carried: Carried = "camera"
    names: tuple[str, ...] = ()
    half_turn: bool = False
    camera: str = "camera"
    board_name: str = "board"

    def __post_init__(self) -> None:
        postures, pixels = (
            np.asarray(given, dtype=float) for given in (self.postures, self.pixels)
        )
        board = np.asarray(self.board, dtype=float)
        object.__setattr__(self, "postures", postures)
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "board", board)
        N = len(pixels)
        if pixels.shape != (N, len(board), 2) or postures.shape != (N, self.robot.n):
            raise InputError(
                f"postures {postures.shape}, pixels {pixels.shape} and points {board.shape} do not "
                "belong together",
                hint="give (N, n), (N, K, 2) and (K, 3)",
                name="pictures",
            )
        for name in (self.camera, self.board_name):
            if not name or "." in name:
                raise InputError(
                    f"{name!r} is no name of a camera or a board",
                    hint="give one without points",
                    name="camera",
                )
        if not self.names:
            object.__setattr__(self, "names", tuple(f"P{i + 1:02d}" for i in range(N)))

    @property
    def labels(self) -> tuple[str, str]:
        """What is on the flange, and what stands around the arm."""
        both = (self.camera, self.board_name)
        return both if self.carried == "camera" else both[::-1]

    @property
    def with_board(self) -> BoolArray:
        """Pictures ``(N,)`` that show enough of the board."""
        return np.asarray(np.isfinite(self.pixels).all(axis=-1).sum(axis=1) >= FEWEST_POINTS)

    @property
    def usable(self) -> BoolArray:
        """Those of them ``(N,)`` whose posture is known, too."""
        return self.with_board & np.isfinite(self.postures).all(axis=1)
