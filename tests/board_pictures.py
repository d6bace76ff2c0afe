"""Pictures of boards, drawn by OpenCV: each pixel looks at the board along its own ray."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from calib.lens import Lens
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, rotation_exp, transform
from calib.vision.boards import Board, board_picture

PAPER_PX_PER_M, MARGIN_M = 6000.0, 0.02
FINER = 2
"""Rays across a pixel."""

Picture = np.ndarray


def draw_board(
    board: Board,
    lens: Lens,
    T_camera_board: FloatArray,
    rng: np.random.Generator,
    *,
    blur_px: float = 0.8,
    noise_grey: float = 2.0,
) -> Picture:
    """A grey picture ``(height, width)`` of a board on a grey table."""
    paper = board_picture(board, PAPER_PX_PER_M, MARGIN_M)
    size = lens.width_px * FINER, lens.height_px * FINER
    u, v = np.meshgrid(*((np.arange(n) + 0.5) / FINER - 0.5 for n in size))
    K, distortion = lens.to_opencv()
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)[:, None]
    rays = np.column_stack([cv2.undistortPoints(pixels, K, distortion)[:, 0], np.ones(u.size)])
    R, p = T_camera_board[:3, :3], T_camera_board[:3, 3]
    on_board = (rays * ((R[:, 2] @ p) / (rays @ R[:, 2]))[:, None] - p) @ R[:, :2]
    at = (on_board - board.box[:2] + MARGIN_M) * PAPER_PX_PER_M - 0.5
    maps = (part.reshape(v.shape).astype(np.float32) for part in at.T)
    seen = cv2.remap(
        paper, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=150
    ).astype(np.float32)
    blurred = cv2.GaussianBlur(seen, (0, 0), blur_px * FINER)
    small = cv2.resize(blurred, lens_size(lens), interpolation=cv2.INTER_AREA)
    noisy = 30.0 + 0.75 * small + noise_grey * rng.standard_normal(small.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def lens_size(lens: Lens) -> tuple[int, int]:
    """Width and height."""
    return lens.width_px, lens.height_px


def take_pictures(
    folder: Path,
    robot: Robot,
    board: Board,
    lens: Lens,
    X: FloatArray,
    Z: FloatArray,
    count: int,
    rng: np.random.Generator,
    *,
    near: FloatArray,
    arm: tuple[float, float] = (1e-4, 2e-4),
) -> FloatArray:
    """Take pictures of a board from an arm with the camera on its flange; its joints [rad].

    All of the board is in each of them. The arm stops off by ``arm`` [m, rad].
    """
    folder.mkdir(parents=True, exist_ok=True)
    middle, taken = board.points.mean(axis=0), list[FloatArray]()
    while len(taken) < count:
        R = rotation_exp(rng.uniform(-0.5, 0.5, 3) * [1.0, 1.0, 2.0])
        place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.4, 0.55)]) - R @ middle
        corners = lens.project(board.outline @ R.T + place)
        if not ((corners > 8) & (corners < np.array(lens_size(lens)) - 8)).all():
            continue
        flange = Z @ inverse(X @ transform(R, place))
        found = robot.inverse(flange[None], near=near)
        if not found.inside.any():
            continue
        inside = found.postures[found.inside]
        q = inside[np.argmin(np.abs(inside - near).max(axis=1))]
        T = robot.fk(q)
        stops = transform(
            rotation_exp(arm[1] * rng.standard_normal(3)) @ T[:3, :3],
            T[:3, 3] + arm[0] * rng.standard_normal(3),
        )
        picture = draw_board(board, lens, inverse(stops @ X) @ Z, rng)
        cv2.imwrite(str(folder / f"img{len(taken) + 1}.png"), picture)
        taken.append(q)
    return np.array(taken)
