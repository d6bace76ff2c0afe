"""Pictures of boards by OpenCV's own warping: perspective, distortion, blur, light and noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from calib.lens import Lens
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, rotation_exp, transform
from calib.vision.boards import Board, board_picture, make_board

BOARDS = {
    "charuco": make_board(
        "charuco", columns=8, rows=6, square_m=0.03, marker_m=0.021, dictionary="5x5_100"
    ),
    "aruco-grid": make_board(
        "aruco-grid", columns=5, rows=4, spacing_m=0.035, marker_m=0.026, dictionary="4x4_50"
    ),
    "apriltag-grid": make_board("apriltag-grid", columns=5, rows=4, spacing_m=0.03, marker_m=0.024),
    "kalibr-aprilgrid": make_board(
        "kalibr-aprilgrid", columns=6, rows=4, spacing_m=0.026, marker_m=0.02
    ),
    "chessboard": make_board("chessboard", columns=10, rows=7, square_m=0.025),
    "circles": make_board("circles", columns=7, rows=6, spacing_m=0.03),
    "asymmetric-circles": make_board("asymmetric-circles", columns=4, rows=11, spacing_m=0.02),
    "round-target": make_board("round-target", diameter_m=0.15),
}
"""One of each kind."""

FINER = 2
"""Pixels are averaged from so many along each side."""

BESIDE = 0.15
"""Of a picture, what lies beside it before the lens bends it into view."""


def canvas_of(lens: Lens) -> tuple[FloatArray, tuple[int, int]]:
    """From pixels of a lens without distortion to indices of a canvas about it, and its size.

    Pixels count from the corner of the picture, indices from the middle of the first.
    """
    size = np.array([lens.width_px, lens.height_px])
    first = -BESIDE * size
    to_index = np.array(
        [
            [FINER, 0, -FINER * first[0] - 0.5],
            [0, FINER, -FINER * first[1] - 0.5],
            [0, 0, 1.0],
        ]
    )
    width, height = (FINER * size * (1 + 2 * BESIDE)).astype(int)
    return to_index, (int(width), int(height))


NODES = 65
"""Along each side, where a lens is worked out; cubic splines between are right to 1e-4 px."""


@cache
def bend_of(lens: Lens) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where on the canvas each fine pixel of the picture is taken from."""
    size = lens.width_px, lens.height_px
    x, y = ((np.arange(FINER * side) + 0.5) / FINER for side in size)
    nodes = [np.linspace(0.0, side, NODES) for side in size]
    K, terms = lens.to_opencv()
    pixels = np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 1, 2) - 0.5
    straight = cv2.undistortPoints(pixels, K, terms, P=K).reshape(NODES, NODES, 2) + 0.5
    to_index, _ = canvas_of(lens)
    index = straight * np.diag(to_index)[:2] + to_index[:2, 2]
    right, down = (RectBivariateSpline(*nodes[::-1], index[..., k])(y, x) for k in range(2))
    return right.astype(np.float32), down.astype(np.float32)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with a lens, in front of one board."""

    lens: Lens
    board: Board
    blur_px: float = 1.0
    noise: float = 4.0  # blur_px, noise: standard deviations of the blur [px] and of grey levels
    light: float = 0.3
    """By how much of its brightness the right side of a picture is darker than the left."""
    px_per_m: float = 4000.0
    margin_m: float = 0.03

    @cached_property
    def print(self) -> NDArray[np.uint8]:
        """The board with white about it."""
        return board_picture(self.board, self.px_per_m, self.margin_m)

    def take(self, T_camera_board: FloatArray, rng: np.random.Generator) -> NDArray[np.uint8]:
        """A picture of the board there."""
        fx, fy, cx, cy = self.lens.values[:4]
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        left, top = self.board.box[:2] - self.margin_m
        from_print = np.array(
            [
                [1 / self.px_per_m, 0, left + 0.5 / self.px_per_m],
                [0, 1 / self.px_per_m, top + 0.5 / self.px_per_m],
                [0, 0, 1.0],
            ]
        )
        to_index, size = canvas_of(self.lens)
        M = to_index @ K @ T_camera_board[:3, [0, 1, 3]] @ from_print
        flat = cv2.warpPerspective(self.print, M, size, flags=cv2.INTER_LINEAR, borderValue=(90,))
        bent = cv2.remap(flat, *bend_of(self.lens), cv2.INTER_LINEAR, borderValue=(90,))
        small = cv2.resize(
            bent, (self.lens.width_px, self.lens.height_px), None, 0, 0, cv2.INTER_AREA
        )
        grey = cv2.GaussianBlur(small.astype(np.float32), (0, 0), self.blur_px)
        grey *= np.linspace(1.0, 1.0 - self.light, grey.shape[1], dtype=np.float32)
        grey = 0.85 * grey + 15.0 + self.noise * rng.standard_normal(grey.shape, dtype=np.float32)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def take_pictures(
    folder: Path,
    robot: Robot,
    camera: Camera,
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
    board, lens = camera.board, camera.lens
    size = np.array([lens.width_px, lens.height_px])
    middle, taken = board.points.mean(axis=0), list[FloatArray]()
    while len(taken) < count:
        R = rotation_exp(rng.uniform(-0.5, 0.5, 3) * [1.0, 1.0, 2.0])
        place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.4, 0.55)]) - R @ middle
        corners = lens.project(board.outline @ R.T + place)
        if not ((corners > 8) & (corners < size - 8)).all():
            continue
        found = robot.inverse((Z @ inverse(X @ transform(R, place)))[None], near=near)
        if not found.inside.any():
            continue
        inside = found.postures[found.inside]
        q = inside[np.argmin(np.abs(inside - near).max(axis=1))]
        T = robot.fk(q)
        stops = transform(
            rotation_exp(arm[1] * rng.standard_normal(3)) @ T[:3, :3],
            T[:3, 3] + arm[0] * rng.standard_normal(3),
        )
        picture = camera.take(inverse(stops @ X) @ Z, rng)
        cv2.imwrite(str(folder / f"img{len(taken) + 1}.png"), picture)
        taken.append(q)
    return np.array(taken)
