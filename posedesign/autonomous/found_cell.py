"""The cell with camera and target where the first step has found them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.se3 import FloatArray, wpr_from_rotation
from calib.vision.touch_up.set_up import SetUp
from posedesign.cell import CameraSection, Cell

_NEAREST, _FARTHEST = 0.5, 2.0
"""Distances of the target, in parts of the designated one, that a cell without a camera section is
given: the loop brings the target to the designated one, whatever happens on the way."""

_DECIMALS_MM, _DECIMALS_DEG = 4, 6
"""Far below what is known, and short enough to be read."""


def found_cell(
    cell: Cell, set_up: SetUp, image_px: tuple[int, int], sigma_m: FloatArray | None
) -> Cell:
    """A cell with what was found in place of what its file says of tool point, camera and target.

    Parameters
    ----------
    cell : Cell
    set_up : SetUp
    image_px : tuple of int
        Width and height of the pictures.
    sigma_m : array (3,), optional
        Noise of a touch-up along x, y, z of the camera [m], where it was measured.

    """
    config = cell.config
    T = set_up.T_tip_camera
    place = {
        "position_mm": _mm(T[:3, 3]),
        "wpr_deg": _deg(wpr_from_rotation(T[:3, :3])),
        "image_px": image_px,
        "focal_px": round(set_up.jacobian.focal_px, 3),
    }
    distance_mm = 1e3 * set_up.jacobian.distance_m
    given = config.camera or CameraSection(
        nearest_mm=_NEAREST * distance_mm, farthest_mm=_FARTHEST * distance_mm
    )
    measurement = config.measurement
    if sigma_m is not None:
        three = tuple(round(3e3 * s, 6) for s in sigma_m.tolist())
        measurement = measurement.model_copy(
            update={"three_sigma_mm": three, "noise_axes": "camera"}
        )
    changed = config.model_copy(
        update={
            "tool": config.tool.model_copy(
                update={
                    "point_mm": _mm(set_up.tool_m),
                    "camera_stand_off_mm": round(distance_mm, _DECIMALS_MM),
                }
            ),
            "base_pose": config.base_pose.model_copy(
                update={"posture_deg": _deg(set_up.postures[0])}
            ),
            "target": config.target.model_copy(
                update={
                    "position_mm": _mm(set_up.target_m),
                    "normal": tuple(round(v, 6) for v in set_up.facing.normal.tolist()),
                }
            ),
            "camera": given.model_copy(update=place),
            "measurement": measurement,
        }
    )
    return replace(
        cell,
        config=changed,
        base_posture=np.deg2rad(changed.base_pose.posture_deg),
        tool_m=np.array(changed.tool.point_mm) / 1e3,
        target_m=np.array(changed.target.position_mm) / 1e3,
    )


def _mm(vector: FloatArray) -> tuple[float, ...]:
    return tuple(round(1e3 * v, _DECIMALS_MM) + 0.0 for v in vector.tolist())


def _deg(angles: FloatArray) -> tuple[float, ...]:
    return tuple(round(v, _DECIMALS_DEG) + 0.0 for v in np.rad2deg(angles).tolist())
