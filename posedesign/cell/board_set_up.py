"""Camera and board of a cell: where both are, and what the camera sees of the board.

Eye-in-hand, the camera is on the flange and the middle of the board is the target. Eye-to-hand, the
middle of the board is the tool point and the camera stands around the arm. Either way the tool
point is on the target where the board is in the middle of what is planned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import InputError
from calib.lens import DISTORTION, Lens
from calib.model.measurements.board_view import Carried
from calib.se3 import FloatArray, inverse, rotation_exp, transform
from posedesign.cell.data import CellData, board_axes, facing, fixed_camera
from posedesign.cell.schema import CameraSection

if TYPE_CHECKING:
    from calib.vision.boards import Board

FOUND_WHOLE = ("chessboard", "circles", "asymmetric-circles", "round-target")
"""Boards that are found with all of their points or not at all."""


@dataclass(frozen=True, eq=False)
class BoardSetUp:
    """Camera and board of a cell."""

    board: Board
    lens: Lens  # as described, or as calibrated before
    carried: Carried  # what is on the flange
    X: FloatArray
    Z: FloatArray
    """X, Z (4, 4): ``T_tip_camera`` and ``T_base_board``, or ``T_tip_board`` and ``T_base_camera``
    [m]."""
    share: float  # least share of the board's points in the image
    border_px: float  # width of the edge of the image where points do not count
    nearest_m: float
    farthest_m: float  # nearest_m, farthest_m: distances of the board from the lens [m]
    largest_tilt: float  # between the board's normal and the line of sight [rad]

    @property
    def T_board_middle(self) -> FloatArray:
        """The middle of the board, with its axes, in its frame."""
        return transform(np.eye(3), middle_of(self.board))

    def tip_poses(self, T_middle_camera: FloatArray) -> FloatArray:
        """Poses of the tip ``(..., 4, 4)`` from which the camera is so against the board's middle.

        Parameters
        ----------
        T_middle_camera : array (..., 4, 4)
        """
        T_board_camera = self.T_board_middle @ T_middle_camera
        if self.carried == "camera":
            return np.asarray(self.Z @ T_board_camera @ inverse(self.X))
        return np.asarray(self.Z @ inverse(T_board_camera) @ inverse(self.X))

    def cameras(self, T_base_tip: FloatArray) -> FloatArray:
        """Poses ``T_middle_camera (..., 4, 4)`` at poses of the tip."""
        if self.carried == "camera":
            T_board_camera = inverse(self.Z) @ T_base_tip @ self.X
        else:
            T_board_camera = inverse(T_base_tip @ self.X) @ self.Z
        return np.asarray(inverse(self.T_board_middle) @ T_board_camera)

    def room_px(self, distance_m: FloatArray) -> FloatArray:
        """How far the middle of the board may be off that of the image, ``(..., 2)`` [px].

        At distances ``(...)`` [m], squarely seen, with the share of its points still in view.
        """
        lens = self.lens
        half = np.array([lens.width_px, lens.height_px]) / 2.0 - self.border_px
        size = np.array(self.board.size_m) / 2.0 * lens.values[:2] / distance_m[..., None]
        # as much is out along x as along y: each keeps the root of the share
        return np.asarray(np.maximum(half - (2.0 * np.sqrt(self.share) - 1.0) * size, 0.0))

    def views(
        self, places: FloatArray, distance_m: FloatArray, R_middle_sight: FloatArray
    ) -> FloatArray:
        """Cameras ``T_middle_camera (N, 4, 4)`` that see the middle of the board at places.

        Parameters
        ----------
        places : array (N, 2)
            In the image: -1 to 1 over the room that there is.
        distance_m : array (N,)
            From the lens to the middle of the board [m].
        R_middle_sight : array (N, 3, 3)
            z along the line of sight, x as the camera's for a board in the middle.
        """
        pixels = np.array([self.lens.width_px, self.lens.height_px]) / 2.0
        across = self.lens.rays(pixels + places * self.room_px(distance_m))
        R = R_middle_sight @ np.swapaxes(rotations_to(across), -1, -2)
        return transform(R, -distance_m[:, None] * R_middle_sight[:, :, 2])


def rotations_to(across: FloatArray) -> FloatArray:
    """Rotations ``(N, 3, 3)`` that turn z to the rays through points ``(N, 2)`` at depth one."""
    slope = np.linalg.norm(across, axis=1)
    angle = np.arctan(slope) / np.maximum(slope, np.finfo(float).tiny)
    axis = np.stack([-across[:, 1], across[:, 0], np.zeros(len(across))], axis=-1)
    return np.asarray(rotation_exp(axis * angle[:, None]))


def board_set_up(cell: CellData) -> BoardSetUp:
    """Camera and board of a cell that calibrates by pictures of a board, as described or found.

    Raises
    ------
    InputError
        One of them is not described, or the lens cannot be.
    """
    camera, board = cell.config.camera, cell.board
    if board is None:
        raise InputError(
            "pictures of a board are measured, and no board is described",
            hint="describe it in [board]",
            name="board",
        )
    if camera is None:
        raise InputError(
            "pictures of a board are measured, and no camera is described",
            hint="give image_px and focal_px in [camera]",
            name="camera",
        )
    fixed = camera.mount == "fixed"
    middle = middle_of(board)
    if fixed:
        R = board_axes(cell)
        X, Z = transform(R, cell.tool_m - R @ middle), fixed_camera(cell, camera)
    else:
        along = (cell.robot.fk(cell.base_posture) @ cell.T_tip_camera)[:3, 0]
        R = facing(cell, cell.target_normal, along)
        X, Z = cell.T_tip_camera, transform(R, cell.target_m - R @ middle)
    carried: Carried = "board" if fixed else "camera"
    lens, found = _lens(camera), cell.camera_found
    if found is not None:
        if found.carried != carried:
            raise InputError(
                f"the {found.carried} was on the flange where the camera was calibrated, and in "
                f"this cell it is the {carried}",
                hint='correct camera.mount, "flange" or "fixed"',
                name="camera.mount",
            )
        lens, X, Z = found.lens, found.X, found.Z
    return BoardSetUp(
        board=board,
        lens=lens,
        carried=carried,
        X=X,
        Z=Z,
        share=1.0 if board.name in FOUND_WHOLE else camera.share_in_view,
        border_px=camera.border_px,
        nearest_m=camera.nearest_mm / 1e3,
        farthest_m=camera.farthest_mm / 1e3,
        largest_tilt=float(np.deg2rad(camera.largest_tilt_deg)),
    )


def middle_of(board: Board) -> FloatArray:
    """The middle of what is printed, ``(3,)`` [m] in the frame of the board."""
    return np.asarray(board.outline.mean(axis=0))


def _lens(camera: CameraSection) -> Lens:
    width, height = camera.image_px
    count = len(DISTORTION[camera.lens])
    if len(camera.distortion) > count:
        raise InputError(
            f"a {camera.lens} lens has {count} terms of distortion, {len(camera.distortion)} "
            "were given",
            hint=" ".join(DISTORTION[camera.lens]),
            name="camera.distortion",
        )
    terms = (*camera.distortion, *[0.0] * (count - len(camera.distortion)))
    focal = camera.focal_px
    return Lens(camera.lens, width, height, (focal, focal, width / 2.0, height / 2.0, *terms))
