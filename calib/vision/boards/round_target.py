"""Round targets in a picture: dark ellipses whose inside looks like cross and squares.

The rim says where a target is, but for how it is turned and for perspective; what is in it says
both.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import FloatArray
from calib.vision.boards.board import RoundTarget
from calib.vision.boards.board_map import BoardMap
from calib.vision.boards.circles import dark_ellipses
from calib.vision.boards.finding import Found
from calib.vision.boards.picture import board_picture
from calib.vision.camera.edges import read_grey
from calib.vision.camera.rendering import GreyImage

SMALLEST_PX = 30.0
"""Short axis of the smallest target: its bars are four pixels wide across the tilt."""

_MOST = 40
"""Ellipses of a picture that are looked at, the largest first."""

_RADII, _ANGLES = np.linspace(0.2, 0.85, 8), 120
"""Places in an ellipse that are compared with the pattern, turned step by step."""

_MOVED = (0.0, -0.12, 0.12, -0.24, 0.24)
"""Where the middle of the circle may be seen, in half axes."""

_LIKE, _ALIGNED = 0.5, 0.85
"""Correlation with the pattern, by the ellipse and aligned."""

_ACROSS_PX = 160.0
"""Diameter of the pattern that is aligned: finer says nothing new."""

_ABOUT = 0.1
"""White about the pattern, in diameters."""

_UNTIL_ALIGNED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 60, 1e-5)

_SQUARE_SEEN = 0.5
"""Contrast of a square with the dark where there is none, in parts of that of the cross."""


def find_round_targets(
    picture: GreyImage, board: RoundTarget, *, squares: bool = True
) -> list[Found]:
    """Targets that are wholly in a picture, with their squares, or without."""
    found: list[Found] = []
    grey = picture.astype(np.float32)
    for ellipses in dark_ellipses(picture):
        large = ellipses[ellipses[:, 2:4].min(axis=1) >= SMALLEST_PX]
        for ellipse in large[np.argsort(-large[:, 2] * large[:, 3], kind="stable")][:_MOST]:
            if any(_holds(other.board_map, board, ellipse[:2]) for other in found):
                continue
            start = _turned(grey, board, ellipse)
            aligned = None if start is None else _aligned(picture, board, ellipse, start)
            if aligned is not None and _has_squares(grey, board, aligned) == squares:
                found.append(Found(board, np.arange(len(board.points)), aligned))
    return found


def _holds(board_map: BoardMap, board: RoundTarget, px: FloatArray) -> bool:
    """Whether a pixel is in a target that was found."""
    xyw = np.linalg.inv(board_map.homography) @ [*px, 1.0]
    return bool(np.linalg.norm(xyw[:2] / xyw[2]) < board.diameter_m / 2)


def _turned(
    grey: NDArray[np.float32], board: RoundTarget, ellipse: FloatArray
) -> FloatArray | None:
    """The homography ``(3, 3)`` to an ellipse that shows the pattern in it best, of some.

    The rim leaves open how the pattern is turned, and where its middle is seen: a tilt moves it
    along the short axis.
    """
    x, y, first, second, direction = ellipse
    angle = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    xy = (_RADII[:, None, None] * circle).reshape(-1, 2)
    white = _standard(np.where(board.is_black(board.diameter_m / 2 * xy), 0.0, 1.0))
    axes = np.asarray(cv2.getRotationMatrix2D((0.0, 0.0), -direction, 1.0)[:, :2], dtype=float)
    short = axes[:, int(second < first)]
    to_px = np.eye(3)
    to_px[:2, :2], to_px[:2, 2] = axes @ np.diag([first / 2, second / 2]) @ axes.T, [x, y]
    best, most = None, _LIKE
    for moved in _MOVED:
        H = to_px @ _moved_middle(moved * short)
        seen, inside = read_grey(grey, _map(H)(xy))
        if not inside.all() or seen.std() == 0.0:
            continue
        spectrum = np.fft.rfft(_standard(seen)) * np.conj(np.fft.rfft(white))
        likeness = np.fft.irfft(spectrum.sum(axis=0), _ANGLES) / seen.size
        k = int(np.argmax(likeness))
        if likeness[k] > most:
            (cos, sin), most = circle[k], likeness[k]
            turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, board.diameter_m / 2]])
            best = H @ turn
    return best


def _standard(values: FloatArray) -> FloatArray:
    """Values ``(radii, angles)`` of mean zero and deviation one."""
    return np.asarray((values - values.mean()) / values.std()).reshape(-1, _ANGLES)


def _moved_middle(to: FloatArray) -> FloatArray:
    """The homography that keeps the unit circle, and moves its middle to a point ``(2,)`` in it.

    In homogeneous coordinates it keeps x² + y² - w²: a boost of the Lorentz group.
    """
    gamma = 1.0 / np.sqrt(1.0 - to @ to)
    across = np.eye(2) + gamma**2 / (1.0 + gamma) * np.outer(to, to)
    return np.block([[across, gamma * to[:, None]], [gamma * to, gamma]])


def _aligned(
    picture: GreyImage, board: RoundTarget, ellipse: FloatArray, start: FloatArray
) -> BoardMap | None:
    """The homography of greatest correlation with the pattern, by OpenCV's ECC.

    Evangelidis and Psarakis, Parametric image alignment using enhanced correlation coefficient
    maximization, IEEE TPAMI 30, 2008.
    """
    half_px = float(ellipse[2:4].max()) / 2.0
    low = np.maximum(np.floor(ellipse[:2] - 1.2 * half_px), 0.0).astype(int)
    high = np.ceil(ellipse[:2] + 1.2 * half_px).astype(int) + 1
    part = picture[low[1] : high[1], low[0] : high[0]]
    scale = min(1.0, _ACROSS_PX / (2.0 * half_px))
    shown = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # what is printed, a border of white about it, in pixels
    px_per_m = _ACROSS_PX / board.diameter_m
    pattern = board_picture(board, px_per_m, _ABOUT * board.diameter_m)
    from_pattern = np.eye(3)
    from_pattern[:2, :2] /= px_per_m
    from_pattern[:2, 2] = 0.5 / px_per_m - (0.5 + _ABOUT) * board.diameter_m
    to_shown = np.diag([scale, scale, 1.0])
    to_shown[:2, 2] = scale * (0.5 - low) - 0.5
    warp = to_shown @ start @ from_pattern
    try:
        likeness, found = cv2.findTransformECC(
            pattern,
            shown,
            (warp / warp[2, 2]).astype(np.float32),
            cv2.MOTION_HOMOGRAPHY,
            _UNTIL_ALIGNED,
        )
    except cv2.error:  # it runs away where the pattern is not there
        return None
    if not likeness > _ALIGNED:
        return None
    H = np.linalg.inv(to_shown) @ np.asarray(found, dtype=float) @ np.linalg.inv(from_pattern)
    return _map(H / H[2, 2])


def _map(homography: FloatArray) -> BoardMap:
    return BoardMap(homography, np.empty((0, 2)), np.zeros(2), 1.0)


def _has_squares(grey: NDArray[np.float32], board: RoundTarget, board_map: BoardMap) -> bool:
    """Whether three of the corners beside the cross are light, and the fourth is dark."""
    near = board.cut_out[2:].reshape(-1, 2, 2).mean(axis=1)
    step = board.cell_m / 4 * np.array([-1.0, 0.0, 1.0])
    about = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    at, _ = read_grey(grey, board_map(np.vstack([near, -near[1], [0.0, 0.0]])[:, None] + about))
    *squares, dark, cross = at.mean(axis=1)
    return bool(min(squares) - dark > _SQUARE_SEEN * (cross - dark))
