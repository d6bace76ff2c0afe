"""The measurement that a cell describes, with its noise."""

from __future__ import annotations

import numpy as np

from calib.model.measurements import KINDS, CameraPose, Measurement, TouchUp, ViewLine
from calib.se3 import FloatArray
from posedesign.cell.schema import CellConfig
from posedesign.cell.schema_sections import NoiseSection


def make_measurement(config: CellConfig, R_tip_camera: FloatArray) -> Measurement:
    """The measurement that the file describes.

    The noise of a camera is that of ``[[noise]]`` where one is given for its kind: that may differ
    from axis to axis. ``R_tip_camera`` ``(3, 3)`` is how the camera is turned on the tip.
    """
    section = config.measurement
    if section.kind == "camera-pose":
        given = next((noise for noise in config.noise if noise.kind == section.kind), None)
        return CameraPose(
            noise_sigma(
                given
                or NoiseSection(
                    kind=section.kind,
                    three_sigma_mm=section.camera_three_sigma_mm,
                    three_sigma_deg=section.camera_three_sigma_deg,
                )
            )
        )
    if section.kind == "view-line":
        return ViewLine(np.array(section.three_sigma_mm[:2]) / 3e3)
    return make_touch_up(config, R_tip_camera)


def make_touch_up(config: CellConfig, R_tip_camera: FloatArray) -> TouchUp:
    """Touch-ups with the noise that the file gives them, along the axes that it gives."""
    section = config.measurement
    axes = R_tip_camera if section.noise_axes == "camera" else None
    return TouchUp(np.array(section.three_sigma_mm) / 3e3, axes)


def noise_sigma(noise: NoiseSection) -> FloatArray:
    """Standard deviations ``(m,)`` [m, rad] of a kind."""
    kind = KINDS[noise.kind]
    lengths = np.array(noise.three_sigma_mm) / 3e3
    count = kind.rows - kind.turns
    parts = [np.broadcast_to(lengths, (3,))[:count] if lengths.ndim else np.full(count, lengths)]
    if noise.three_sigma_deg is not None:
        parts.append(np.broadcast_to(np.deg2rad(noise.three_sigma_deg) / 3.0, (3,)))
    return np.concatenate(parts)
