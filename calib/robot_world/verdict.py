"""Whether a solution is one to be trusted: by its covariance, its left-out residuals, its scale."""

from __future__ import annotations

import numpy as np

from calib.robot_world.accuracy import NOISE_DOUBT
from calib.robot_world.diagnosis import POOR, named
from calib.robot_world.identifiability import Motion
from calib.robot_world.results import RobotWorldResult, weakest
from calib.robot_world.scale import Scale, moved
from calib.se3 import BoolArray, FloatArray

LARGEST_SIGMA_RAD = float(np.radians(3.0))
"""Standard deviation of a rotation of X or Z from which on nobody would call it calibrated: by hand
a camera is mounted as well."""

LARGEST_SIGMA = POOR
"""The same for their translations, in parts of how far the poses move."""

LEFT_OUT = 3.0
"""Left-out residuals over residuals, from which on some pairs decide alone what is found: of more
than six good pairs they reach 2.2."""

_FEW = 6
"""Pairs up to which one that is left out is missed more than that, for want of others: there it is
a warning, of what is a good part of the motion."""

_FEWEST_LEFT = 3
"""Pairs of which none can be left out."""

_ROUNDING = 1e-8
"""Residual, in parts of the motion, that is none."""

HARDLY = "but the pairs hardly belong together, as the warnings say"

_SCALE_NAMED, _SCALE_WRONG = 1e-3, 1e-2
"""Distance of the scale from 1 from which on it is named, and from which on X and Z without it are
doubted: a printed target is as long as it should be to some thousandths."""


def judge(result: RobotWorldResult, status: str, message: str, motion: Motion) -> tuple[str, str]:
    """Status and message of a solution with all that its result says.

    Parameters
    ----------
    status, message : str
        What is known without it.
    motion : Motion
        Of the pairs used.
    """
    if status != "ok":
        return status, message
    size = float(motion.pairs.size[0])
    if result.drift:
        return "doubtful", f"{message}; {HARDLY}"
    reasons = _uncertain(result, size)
    if int(result.used.sum()) > _FEW:
        reasons += _not_predicted(result, motion)
    if result.scale is not None:
        if result.scale_estimated:
            message += f"; {_corrected(result.scale)}"
        elif is_named(result.scale) and abs(result.scale.value - 1.0) > _SCALE_WRONG:
            reasons += (_off(result.scale),)
    return ("doubtful", f"{message}; but {'; '.join(reasons)}") if reasons else (status, message)


def too_uncertain(covariance: FloatArray, size: FloatArray) -> BoolArray:
    """Whether covariances ``(T, 12, 12)`` leave X or Z unknown, with the poses' motion ``(T,)``."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)).reshape(-1, 2, 2, 3)
    # a comparison that a number which is none fails
    known = (sigma[:, :, 0] < LARGEST_SIGMA_RAD).all(axis=(1, 2))
    known &= (sigma[:, :, 1] < LARGEST_SIGMA * size[:, None, None]).all(axis=(1, 2))
    return np.asarray(~known)


def alone(result: RobotWorldResult, motion: Motion) -> tuple[str, ...]:
    """Pairs that X and Z hang on: no residual shows it if they are wrong."""
    one = np.isnan(result.left_out_residuals).any(axis=-1) & result.used
    N = int(result.used.sum())
    if N <= _FEWEST_LEFT or not one.any():
        return _not_predicted(result, motion) if N <= _FEW else ()
    return (f"without {named(one)} the others identify nothing: X and Z hang on it alone",)


def scale_doubts(result: RobotWorldResult) -> tuple[str, ...]:
    """What the scale of B's translations says of the pairs, in sentences."""
    scale = result.scale
    if scale is None:
        return ()
    if not scale.is_told:
        how = "not at all" if np.isinf(scale.sigma) else f"to {100.0 * scale.sigma:.2g} %"
        return (
            f"the pairs tell the scale of B's translations {how}: a wrong size of the target, unit "
            "or focal length would go unnoticed; measure from other distances and sides",
        )
    if result.scale_estimated or not is_named(scale):
        return ()
    turned_rad, moved_m = moved(scale, result.X, result.Z)
    return (
        f"{_off(scale)}: that turns X and Z by up to {np.degrees(turned_rad):.2g} deg and moves "
        f"them by up to {1e3 * moved_m:.3g} mm; check the size of the target (tag, squares of a "
        "board), the unit of length and the focal length, or the unit of A, since the pairs tell "
        "the ratio of both alone; estimate_scale corrects B",
    )


def is_named(scale: Scale) -> bool:
    """Whether a scale is told to be another than 1."""
    far = abs(scale.value - 1.0) > _SCALE_NAMED
    return far and scale.is_told and scale.probability < NOISE_DOUBT


def is_one(scale: Scale) -> bool:
    """Whether a scale is told to be 1, as closely as matters."""
    return max(abs(scale.value - 1.0), scale.sigma) < _SCALE_WRONG and not is_named(scale)


def _off(scale: Scale) -> str:
    return (
        f"translations of B fit those of A multiplied by {scale.value:.5g} ± {scale.sigma:.2g}, "
        f"{scale.sigmas:.0f} standard deviations from 1"
    )


def _corrected(scale: Scale) -> str:
    return (
        f"translations of B are multiplied by {scale.value:.6g} ± {scale.sigma:.2g}, estimated "
        "with X and Z"
    )


def _uncertain(result: RobotWorldResult, size: float) -> tuple[str, ...]:
    """Directions of X and Z that are not identified well enough."""
    covariance = result.covariance
    said: tuple[str, ...] = ()
    if covariance is not None and too_uncertain(covariance[None], np.array([size]))[0]:
        said += (
            "the pairs do not identify X and Z by this method: known least are "
            f"{' and '.join(weakest(covariance))}, where {np.degrees(LARGEST_SIGMA_RAD):.0f} deg "
            f"and a tenth of how far the poses move ({1e3 * LARGEST_SIGMA * size:.3g} mm) are the "
            "most for a calibration",
        )
    scale = result.scale
    if result.scale_estimated and scale is not None and not scale.is_told:
        said += (
            f"the pairs tell the scale of B to {100.0 * scale.sigma / scale.value:.2g} % only",
        )
    return said


def _not_predicted(result: RobotWorldResult, motion: Motion) -> tuple[str, ...]:
    """Pairs that X and Z from the others do not predict as well as they fit."""
    turned_rad, size = float(motion.turned_rad[0]), float(motion.pairs.size[0])
    N = int(result.used.sum())
    left = result.left_out_residuals[result.used]
    left = left[~np.isnan(left).any(axis=-1)]
    if not len(left):
        return ()
    predicted = np.sqrt((left**2).reshape(-1, 2, 3).sum(axis=-1).mean(axis=0))
    said = []
    for unit, scale, fits, predicts, whole in (
        ("deg", 180.0 / np.pi, result.rotation_rms_rad, predicted[0], turned_rad),
        ("mm", 1e3, result.translation_rms_m, predicted[1], size),
    ):
        bound = LEFT_OUT * fits if N > _FEW else max(LEFT_OUT * fits, POOR * whole)
        if predicts > max(bound, _ROUNDING * whole):
            said.append(f"{scale * predicts:.3g} {unit} in place of {scale * fits:.3g} {unit}")
    if not said:
        return ()
    return (f"pairs that are left out are off by {', '.join(said)}: X and Z hang on single pairs",)
