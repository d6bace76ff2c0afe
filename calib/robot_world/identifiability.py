"""Whether the motion of a set of poses identifies X and Z.

``A_i X = Z B_i`` fixes X and Z exactly when the rotations between the poses have at least two
different axes. The quaternions of orientations that differ by rotations about one common axis lie
in a plane of the space of quaternions, so the third eigenvalue of ``mean a aᵀ`` measures what
there is besides: it is the mean square sine of half the angle turned about a second axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.errors import NotIdentifiableError
from calib.robot_world.algebra import (
    apply_matrix,
    closed_form_rotations,
    conjugate,
    left_matrix,
)
from calib.se3 import BoolArray, FloatArray, IntArray

SPREAD_TOLERANCE_RAD = 1e-5
"""Rotation about a second axis that counts as none: rounding of a file with six decimals."""

NOISE_FACTOR = 2.0
"""Rotation about a second axis, in units of the residual rotation per axis, below which it may be
noise alone: then the rotation of X about the common axis is not known to half a radian / √N."""

MISFIT_FACTOR = 3.0
"""Residual rotation, in units of that of the closed form, beyond which a method has failed: a
method may trade rotation for translation, but the rotations alone bound what is reasonable."""

MISFIT_FLOOR_RAD = 1e-6
"""Residual rotation that is never a misfit: above the rounding of any method."""

_SAME_PLACE_M = 1e-6
"""Movement that counts as none when the message says what is free."""


@dataclass(frozen=True)
class Motion:
    """What the rotations of T sets of pose pairs tell.

    Attributes
    ----------
    spread_rad : ndarray (T, 2)
        Root mean square rotation about the main axis and about a second one, the smaller of what
        A and B show (what noise in one of them adds does not count).
    residual_rad : ndarray (T,)
        Root mean square residual rotation angle of the closed form of the rotations.
    rank_deficient, degenerate : ndarray of bool (T,)
        No rotation about a second axis; none that stands out of the noise.
    """

    spread_rad: FloatArray
    residual_rad: FloatArray
    rank_deficient: BoolArray
    degenerate: BoolArray

    def is_misfit(self, residuals: FloatArray, trials: IntArray) -> BoolArray:
        """Whether residuals ``(len(trials), N, 6)`` of these trials say that a method failed."""
        angle_rms = np.sqrt((residuals[..., :3] ** 2).sum(axis=-1).mean(axis=-1))
        return np.asarray(angle_rms > MISFIT_FACTOR * self.residual_rad[trials] + MISFIT_FLOOR_RAD)


def examine(A: FloatArray, B: FloatArray) -> Motion:
    """Measure the motion of T sets of pose pairs ``(T, N, 4, 4)``."""
    spread = np.minimum(_spread(A), _spread(B))
    R_X, R_Z = closed_form_rotations(A, B)
    left = A[..., :3, :3] @ R_X[:, None]
    right = R_Z[:, None] @ B[..., :3, :3]
    angle = se3.rotation_angle(left @ np.swapaxes(right, -1, -2))
    residual = np.sqrt((angle**2).mean(axis=-1))
    rank_deficient = spread[:, 1] < SPREAD_TOLERANCE_RAD
    noisy = spread[:, 1] < NOISE_FACTOR * residual / np.sqrt(3.0)
    return Motion(spread, residual, rank_deficient, rank_deficient | noisy)


def not_identifiable(motion: Motion, A: FloatArray, B: FloatArray) -> NotIdentifiableError:
    """Error that names what one set of pairs ``(N, 4, 4)`` leaves free.

    Parameters
    ----------
    motion : Motion
        Of this set, found degenerate.
    A, B : ndarray (N, 4, 4)
        The set.
    """
    main_rad, second_rad = motion.spread_rad[0]
    noise_rad = NOISE_FACTOR * motion.residual_rad[0] / np.sqrt(3.0)
    if main_rad < max(SPREAD_TOLERANCE_RAD, noise_rad):
        if (
            min(np.ptp(A[:, :3, 3], axis=0).max(), np.ptp(B[:, :3, 3], axis=0).max())
            < _SAME_PLACE_M
        ):
            return NotIdentifiableError(
                ["rotation of X", "translation of X"],
                ["all poses are the same, so Z takes up any change of X"],
            )
        return NotIdentifiableError(
            ["translation of X", "rotation of X"],
            [
                "the poses differ by translations only, so Z takes up any translation of X",
                "the rotations do not show in which direction X is turned",
            ],
        )
    axis = _common_axis(A)
    reason = f"all rotations between the poses are about the axis {axis} of the flange"
    if not motion.rank_deficient[0]:
        reason += (
            f", as far as the noise shows ({np.degrees(second_rad):.2g} deg about others, "
            f"residuals of {np.degrees(motion.residual_rad[0]):.2g} deg)"
        )
    return NotIdentifiableError(
        [f"translation of X along the common axis {axis}", "rotation of X about it"],
        [reason, "Z takes up the one, and the rotations do not show the other"],
    )


def _spread(T: FloatArray) -> FloatArray:
    """Root mean square rotation ``(T, 2)`` [rad] about the main axis and about a second one."""
    q = se3.quaternion_from_rotation(T[..., :3, :3])
    mean_square = np.linalg.eigvalsh(np.swapaxes(q, -1, -2) @ q / q.shape[1])
    half_sine = np.sqrt(np.clip(mean_square[:, [2, 1]], 0.0, 1.0))
    return np.asarray(2.0 * np.arcsin(half_sine))


def _common_axis(A: FloatArray) -> str:
    """The axis of the rotations of one set ``(N, 4, 4)``, in the frame that A maps from."""
    q = se3.quaternion_from_rotation(A[:, :3, :3])
    _, vectors = np.linalg.eigh(q.T @ q)
    axis = apply_matrix(left_matrix(conjugate(vectors[:, 3])), vectors[:, 2])[1:]
    axis *= np.sign(axis[np.abs(axis).argmax()]) / np.linalg.norm(axis)
    return "(" + ", ".join(f"{value:.3g}" for value in axis.round(3) + 0.0) + ")"
