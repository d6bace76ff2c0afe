"""Where the camera says that a point is: how that moves with what is estimated."""

from __future__ import annotations

import numpy as np

from calib.lens import Lens, project
from calib.model import CalibrationModel
from calib.model.measurements.board_view import Carried
from calib.model.parameters import Frames, LensParameters, ParameterBlock
from calib.se3 import FloatArray, apply

_STEP = 1e-6
"""Of differences of poses [m, rad]: their curvature is far below rounding then."""


def pose_of(block: ParameterBlock, values: FloatArray) -> FloatArray:
    """The pose ``(4, 4)`` of a frame of a model."""
    if not isinstance(block, Frames):
        raise TypeError("X and Z are frames")
    return np.asarray(block.poses(values)[0])


def seen_point_motion(
    model: CalibrationModel, x: FloatArray, carried: Carried, lens: Lens, points: FloatArray
) -> FloatArray:
    """How points that the camera sees move with the parameters, ``(K, 3, p)`` [m per unit].

    Seen from the flange (eye-in-hand) or from the base: with X, or Z, and with the lens, the pixel
    and the depth as they are.

    Parameters
    ----------
    model : CalibrationModel
        X and Z are its first frames.
    x : array (p,)
    lens : Lens
        At these values.
    points : array (K, 3)
        In the frame of the camera [m].
    """
    frames = [k for k, block in enumerate(model.parameters) if isinstance(block, Frames)]
    which = frames[0] if carried == "camera" else frames[1]
    block, part = model.parameters[which], model.slices[which]
    motion = np.zeros((len(points), 3, model.p))
    for k in range(part.start, part.stop):
        step = _STEP * (np.arange(model.p)[part] == k)
        ahead, behind = (pose_of(block, x[part] + sign * step) for sign in (1.0, -1.0))
        motion[:, :, k] = (apply(ahead, points) - apply(behind, points)) / (2.0 * _STEP)
    R = pose_of(block, x[part])[:3, :3]
    for other, own in zip(model.parameters, model.slices, strict=True):
        if isinstance(other, LensParameters):
            seen = project(lens.name, np.array(lens.values)[:, None], points.T[:, :, None])
            by_point = seen.by_point[:, :2, :, 0].transpose(2, 0, 1)  # (K, 2, 2)
            by_lens = other.picked(seen.by_lens[..., 0]).transpose(2, 1, 0)  # (K, 2, l)
            across = np.linalg.solve(by_point, -by_lens)
            motion[:, :, own] = R[:, :2] @ across
    return motion
