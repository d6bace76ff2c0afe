"""Pictures of a board, and where the arm was when they were taken: what the estimate rests on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.hand_eye.start import FEWEST_POINTS
from calib.model.measurements.board_view import Carried
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray, IntArray

MOVING = np.array([[5e-3], [np.inf]])
"""Velocity [rad/s, m/s] of a joint from which on the arm moves: in a hundredth of a second by less
than it stops off."""

NEAR_S, FEWEST_NEAR, MOST_NEAR = 0.25, 4, 9
"""Rows of a record that its motion is found from at a time: no further away, so many at least, and
the nearest. Rounding and noise of single ones matter less."""


def rows_near(times_s: FloatArray, at_s: float) -> IntArray:
    """Rows of a record that tell how the arm moves at a time; none where it is too coarse."""
    far = np.abs(times_s - at_s)
    near = np.argsort(far, kind="stable")[:MOST_NEAR]
    near = np.sort(near[far[near] <= NEAR_S])
    enough = len(near) >= FEWEST_NEAR and times_s[near[0]] <= at_s <= times_s[near[-1]]
    return near if enough else near[:0]


def motion_at(
    times_s: FloatArray, postures: FloatArray, at_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joints ``(N, n)``, and how they move ``(N, 2, n)`` [rad/s, rad/s²], at times of a record.

    The record has postures ``(M, n)`` [rad] at rising times ``(M,)``. By the cubic of least squares
    through the nearest rows.

    Raises
    ------
    InputError
        Times that do not rise, or one that the record has no rows about.
    """
    times, rows = np.asarray(times_s, dtype=float), np.asarray(postures, dtype=float)
    if not (np.diff(times) > 0).all():
        raise InputError("the times of the record do not all rise", hint="sort it", name="time")
    at = np.asarray(at_s, dtype=float)
    q, motion = np.empty((len(at), rows.shape[1])), np.empty((len(at), 2, rows.shape[1]))
    for i, time in enumerate(at.tolist()):
        near = rows_near(times, time)
        if not len(near):
            raise InputError(
                f"the record of the joints has no {FEWEST_NEAR} rows about time {time:g} s",
                hint=f"within {NEAR_S:g} s, on both sides; are times in seconds, by one clock?",
                name="time",
            )
        scale = float(np.abs(times[near] - time).max())
        powers = np.vander((times[near] - time) / scale, 4, increasing=True)
        found = np.linalg.lstsq(powers, rows[near], rcond=None)[0]
        q[i], motion[i] = found[0], found[1:3] * [[1.0 / scale], [2.0 / scale**2]]
    return q, motion


@dataclass(frozen=True, eq=False)
class Pictures:
    """What pictures of one board show, and where the arm was."""

    robot: Robot  # :func:`calib.robots.flange_robot` where nothing but poses of the flange is known
    postures: FloatArray  # (N, n) [rad]; NaN for pictures without one, which serve the lens only
    pixels: FloatArray
    """(N, K, 2): from the upper left corner of the image; NaN for points that were not seen."""
    board: FloatArray  # (K, 3): points in the frame of the board [m]
    size_px: tuple[int, int]  # width and height of the pictures
    carried: Carried = "camera"  # what is on the flange
    names: tuple[str, ...] = ()
    """Of the pictures. Those that several cameras took at one stop of the arm share a name."""
    half_turn: bool = False
    """Whether the board looks the same after half a turn, so that pictures show it either way
    round: its points then stand in the opposite order."""
    camera: str = "camera"
    board_name: str = "board"  # camera, board_name: names of both, where there are several
    motion: FloatArray | None = None
    """(N, 2, n): velocity [rad/s] and acceleration [rad/s²] of the joints where the arm moved, as
    :func:`motion_at` gives them: how much later than the joints were read each picture was taken is
    estimated then."""

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
        if self.motion is not None:
            motion = np.asarray(self.motion, dtype=float)
            known = np.isfinite(motion).all(axis=(1, 2)) if motion.ndim == 3 else np.zeros(0)
            if motion.shape != (N, 2, self.robot.n) or not known[self.usable].all():
                raise InputError(
                    f"velocities and accelerations {motion.shape} do not belong to {N} pictures",
                    hint="give (N, 2, n), known wherever the posture is",
                    name="motion",
                )
            object.__setattr__(self, "motion", motion)
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
    def is_moving(self) -> bool:
        """Whether the arm moved in a picture that is used."""
        return self.motion is not None and bool((np.abs(self.motion[self.usable]) > MOVING).any())

    def each_once(self) -> IntArray:
        """Return the index of each usable picture, without exact copies of another one."""
        rows = np.flatnonzero(self.usable)
        both = np.column_stack([self.postures[rows], self.pixels[rows].reshape(len(rows), -1)])
        first = np.unique(both, axis=0, return_index=True, equal_nan=True)[1]
        return rows[np.sort(first)]

    @property
    def usable(self) -> BoolArray:
        """Those of them ``(N,)`` whose posture is known, too."""
        return self.with_board & np.isfinite(self.postures).all(axis=1)
