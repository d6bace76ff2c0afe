"""An ellipse through points some of which are not on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import ellipse_distance, ellipse_step, is_sound

_REWEIGHTINGS = 8
"""Most steps with Cauchy weights: they settle in four or five where most points are good."""

_SETTLED = 0.2
"""Step, in scales of the distances, at which the weights have settled."""

_TRIMMINGS = 4
_OUTLIER = 3.0
"""Standard deviations at which a point is an outlier: one good one in 370."""

_MAD = 1.4826
"""Standard deviations of a normal distribution in a median absolute deviation."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Ellipse ``(5,)``, which points ``(K,)`` it was fitted to, and their rms distance [px]."""

    ellipse: FloatArray
    kept: BoolArray
    rms_px: float


def fit_robust(points: FloatArray, start: FloatArray, floor_px: float) -> RobustFit:
    """Fit an ellipse to points ``(K, 2)`` [px], outliers left out.

    Cauchy weights with the median distance as their scale lead from the start to most of the
    points; then least squares, and points beyond three standard deviations are left out.

    Parameters
    ----------
    points : ndarray (K, 2)
    start : ndarray (5,)
    floor_px : float
        Least scale: points nearer than that are never outliers.

    Returns
    -------
    RobustFit
    """
    ellipse = start
    distance, jacobian = ellipse_distance(ellipse, points)
    kept = np.ones(len(points), dtype=bool)
    with np.errstate(all="ignore"):  # a fit that runs away is told by its numbers
        for _ in range(_REWEIGHTINGS):
            scale = max(_MAD * float(np.median(np.abs(distance))), floor_px)
            step = ellipse_step(distance, jacobian, 1.0 / (1.0 + (distance / (2 * scale)) ** 2))
            ellipse = ellipse + step
            distance, jacobian = ellipse_distance(ellipse, points)
            if np.abs(step).max() < _SETTLED * scale:
                break
        for _ in range(_TRIMMINGS):
            scale = _MAD * float(np.median(np.abs(distance)))
            good = np.abs(distance) <= max(_OUTLIER * scale, floor_px)
            ellipse = ellipse + ellipse_step(distance, jacobian, good.astype(float))
            distance, jacobian = ellipse_distance(ellipse, points)
            same, kept = bool((good == kept).all()), good
            if same or not is_sound(ellipse):
                break
    rms = float(np.sqrt((distance[kept] ** 2).mean())) if kept.any() else float("nan")
    return RobustFit(ellipse, kept, rms)
