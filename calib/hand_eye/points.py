"""Where the camera says that a point is: how that moves with what is estimated."""

from __future__ import annotations

import numpy as np

from calib.lens import Lens, project
from calib.model import CalibrationModel
from calib.model.parameters import Frames, LensParameters
from calib.se3 import FloatArray, apply

_STEP = 1e-6
"""Of differences of poses [m, rad]: their curvature is far below rounding then."""


def poses_of(model: CalibrationModel, x: FloatArray) -> dict[str, FloatArray]:
    """Poses ``(4, 4)`` [m] of what is on the flange and around the arm, by label."""
    return {
        label: T
        for block, part in zip(model.parameters, model.slices, strict=True)
        if isinstance(block, Frames)
        for label, T in zip(block.labels, block.poses(x[part]), strict=True)
    }


def seen_point_motion(
    model: CalibrationModel,
    x: FloatArray,
    frame: str,
    lens: Lens,
    points: FloatArray,
    camera: str = "camera",
) -> FloatArray:
    """How points ``(K, 3)`` that a camera sees move with the parameters, ``(K, 3, p)`` [m each].

    Seen from the flange (eye-in-hand) or from the base: with the frame of the camera, and with the
    lens, at these values, the pixel and the depth as they are. The frame of the camera and the
    camera that the lens is of are told by their labels.
    """
    motion = np.zeros((len(points), 3, model.p))
    for k in np.flatnonzero([f".{frame}." in f".{name}" for name in model.names]).tolist():
        step = _STEP * (np.arange(model.p) == k)
        ahead, behind = (poses_of(model, x + sign * step)[frame] for sign in (1.0, -1.0))
        motion[:, :, k] = (apply(ahead, points) - apply(behind, points)) / (2.0 * _STEP)
    R = poses_of(model, x)[frame][:3, :3]
    for block, own in zip(model.parameters, model.slices, strict=True):
        if isinstance(block, LensParameters) and block.label == camera:
            seen = project(lens.name, np.array(lens.values)[:, None], points.T[:, :, None])
            by_point = seen.by_point[:, :2, :, 0].transpose(2, 0, 1)  # (K, 2, 2)
            by_lens = block.picked(seen.by_lens[..., 0]).transpose(2, 1, 0)  # (K, 2, l)
            motion[:, :, own] = R[:, :2] @ np.linalg.solve(by_point, -by_lens)
    return motion
