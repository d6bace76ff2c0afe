"""A calibration board as the target of a visual touch-up.

Its middle is brought to the middle of the picture, and its size there to the one designated, by the
map from the board to the picture that all of its points tell. The slope of that map at the middle
is that of the distance alone, whatever the tilt: the ellipse that it makes of a circle is free of
what a tilt does to the ellipse of a real one, and a lens that bends the picture needs not be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.se3 import FloatArray, rotation_angle
from calib.vision.boards import Board, detect_board
from calib.vision.boards.board_map import fit_map, spacing
from calib.vision.boards.picture import BoardPlate
from calib.vision.camera import Camera, pose_from_points
from calib.vision.camera.conic import disc_image, ellipse_of_slope
from calib.vision.camera.rendering import GreyImage

_STEP_OF_CELL = 0.1
"""Step of the slope at the middle, of the distance of neighbouring points."""


@dataclass(frozen=True, eq=False)
class BoardTarget:
    """A board, its frame in the middle of what is printed, z out of its face."""

    board: Board

    is_known: ClassVar[bool] = True
    is_biased: ClassVar[bool] = False

    @property
    def diameter_m(self) -> float:
        """Longer side of what is printed [m]."""
        return max(self.board.size_m)

    @cached_property
    def middle_m(self) -> FloatArray:
        """Middle of what is printed ``(2,)`` [m] in the frame of the board."""
        return np.asarray(self.board.outline[:, :2].mean(axis=0))

    def measure(
        self, image: GreyImage, near_px: FloatArray | None = None
    ) -> tuple[FloatArray, str]:
        """See :meth:`~calib.vision.camera.observers.Target.measure`; there is one such board."""
        nothing = np.full(5, np.nan)
        found = detect_board(image, self.board)
        if not found.is_ok:
            return nothing, f"{found.status}: {found.message}"
        xy, px = self.board.points[found.seen, :2], found.pixels[found.seen]
        fitted = fit_map(xy, px, spacing(px), refined=True)
        if fitted is None:
            return nothing, "too few points: those that are seen lie on no plane"
        slope = fitted[0].slope(self.middle_m, _STEP_OF_CELL * self.board.cell_m)
        return ellipse_of_slope(fitted[0](self.middle_m), slope, self.diameter_m), ""

    def image(
        self, camera: Camera, T_camera_target: FloatArray, diameter_m: float | None = None
    ) -> FloatArray:
        return disc_image(
            camera, self.diameter_m if diameter_m is None else diameter_m, T_camera_target
        )

    def pose(self, camera: Camera, image: GreyImage, about: FloatArray) -> FloatArray | None:
        """``T_camera_board``: see :meth:`~calib.vision.camera.observers.Target.pose`.

        Of a board that looks the same after half a turn that way round which is nearer to the first
        of the poses ``(K, 4, 4)`` that it may be about.
        """
        found = detect_board(image, self.board)
        if not found.is_ok:
            return None
        ways = [found.pixels, found.pixels[::-1]][: 1 + self.board.ambiguous_half_turn]
        poses = []
        for pixels in ways:
            seen = np.isfinite(pixels).all(axis=1)
            pose = pose_from_points(camera, self.board.points[seen], pixels[seen])
            if pose.is_ok:
                poses.append(pose.T_camera_target)
        R = about[0, :3, :3]
        return min(poses, key=lambda T: float(rotation_angle(R.T @ T[:3, :3])), default=None)

    @cached_property
    def _plate(self) -> BoardPlate:
        return BoardPlate(self.board)

    def pattern(self, xy: FloatArray) -> FloatArray:
        return self._plate.pattern(xy + (self.middle_m * [1.0, -1.0]).astype(xy.dtype))

    def plate_corners(self) -> FloatArray:
        return np.asarray(self._plate.plate_corners() - [self.middle_m[0], -self.middle_m[1], 0.0])
