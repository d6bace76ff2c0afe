"""Poses from which a camera on the tip sees its target: drawn by what is in the image."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, inverse, rotation_exp, transform
from posedesign.cell import CameraSection, Cell, cone_rotations_at

COORDINATES = 6
"""Of a view: the place in the image (2), the distance, and what :func:`cone_rotations_at` takes."""


def viewing_poses(cell: Cell, camera: CameraSection, points: FloatArray) -> FloatArray:
    """Tip poses ``(N, 4, 4)`` that see the target, at points ``(N, 6)`` of the unit cube.

    All that a cell allows its camera: the middle of the target anywhere in the image less its
    border, at any distance, the face of the target tilted any way, and the camera rolled freely
    about the line of sight.
    """
    u, v, distance = points[:, :3].T
    room_px = np.array(camera.image_px) / 2.0 - camera.border_px
    across = (2.0 * np.stack([u, v], axis=-1) - 1.0) * room_px / camera.focal_px
    nearest_m, farthest_m = camera.nearest_mm / 1e3, camera.farthest_mm / 1e3
    away_m = nearest_m + (farthest_m - nearest_m) * distance
    # a frame whose z is the line of sight: tilted against the normal, and in the camera's own frame
    tilt = float(np.deg2rad(camera.largest_tilt_deg))
    R_base_sight = cone_rotations_at(_with_z(-cell.target_normal), tilt, points[:, 3:])
    R_camera_sight = _towards(across)
    R_base_camera = R_base_sight @ np.swapaxes(R_camera_sight, -1, -2)
    lens = cell.target_m - away_m[:, None] * R_base_sight[:, :, 2]
    return np.asarray(transform(R_base_camera, lens) @ inverse(cell.T_tip_camera))


def _towards(across: FloatArray) -> FloatArray:
    """Rotations ``(N, 3, 3)`` that turn z to the rays through points ``(N, 2)`` at depth one."""
    slope = np.linalg.norm(across, axis=1)
    angle = np.arctan(slope) / np.maximum(slope, np.finfo(float).tiny)
    axis = np.stack([-across[:, 1], across[:, 0], np.zeros(len(across))], axis=-1)
    return np.asarray(rotation_exp(axis * angle[:, None]))


def _with_z(z: FloatArray) -> FloatArray:
    """A rotation ``(3, 3)`` with this third column, a unit vector."""
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
