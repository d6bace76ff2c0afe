"""What a solution of A X = Z B consists of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.robot_world.adjustment import Fit
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Estimate:
    """What one method returns for T problems.

    Attributes
    ----------
    X, Z : ndarray (T, 4, 4)
        The transforms.
    iterations : ndarray of int (T,) or None
        Where the method iterates, the cycles it took.
    converged : ndarray of bool (T,) or None
        Where the method iterates, whether it arrived within its limit.
    fit : Fit or None
        Where the method is an adjustment, its rows and information.
    sigma : ndarray (2, T) or None
        Where the method estimates the noise, the standard deviations of rotation and translation.
    weights : ndarray (T, N) or None
        Where the method leaves pairs out, 0 for these and 1 for the others.
    """

    X: FloatArray
    Z: FloatArray
    iterations: IntArray | None = None
    converged: BoolArray | None = None
    fit: Fit | None = None
    sigma: FloatArray | None = None
    weights: FloatArray | None = None


def residuals(A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray) -> FloatArray:
    """What A X differs from Z B by ``(..., N, 6)``: rotation vector [rad], then translation [m].

    Both in the axes of the frame that A maps to (eye in hand: the base): the rotation vector is
    ``log(R_A R_X (R_Z R_B)ᵀ)``, the translation that of A X less that of Z B.

    Parameters
    ----------
    A, B : ndarray (..., N, 4, 4)
        Measured transforms.
    X, Z : ndarray (..., 4, 4)
        The solution.
    """
    left, right = A @ X[..., None, :, :], Z[..., None, :, :] @ B
    difference = left[..., :3, :3] @ np.swapaxes(right[..., :3, :3], -1, -2)
    translation = left[..., :3, 3] - right[..., :3, 3]
    return np.concatenate([se3.rotation_log(difference), translation], axis=-1)


@dataclass(frozen=True, eq=False)
class RobotWorldBatch:
    """Solutions of T problems A X = Z B by one method.

    Attributes
    ----------
    X, Z : ndarray (T, 4, 4)
        The transforms; NaN in the trials whose motion identifies no X at all (``rank_deficient``).
    method : str
        Name of the method.
    iterations : ndarray of int (T,) or None
        Cycles of an iterative method, 0 where it was not run; None for the others.
    converged : ndarray of bool (T,)
        False where an iteration did not arrive; True for the methods that do not iterate.
    rank_deficient : ndarray of bool (T,)
        The rotations between the poses do not identify X: all about one axis, or none, or half
        turns.
    degenerate : ndarray of bool (T,)
        The same, or not to be told from it in the noise that the residuals show. X and Z are
        numbers there, since statistics over random problems need them, but ``ok`` is False.
    misfit : ndarray of bool (T,)
        The residuals are several times those of the closed form: the method has failed.
    """

    X: FloatArray
    Z: FloatArray
    method: str
    iterations: IntArray | None
    converged: BoolArray
    rank_deficient: BoolArray
    degenerate: BoolArray
    misfit: BoolArray

    @property
    def ok(self) -> BoolArray:
        """Trials ``(T,)`` that converged, on motions that identify X and Z, with a fair fit."""
        return self.converged & ~self.degenerate & ~self.misfit


@dataclass(frozen=True, eq=False)
class RobotWorldResult:
    """Solution of one problem A X = Z B.

    Attributes
    ----------
    X, Z : ndarray (4, 4)
        The transforms [m]; eye in hand, ``T_flange_camera`` and ``T_base_target``.
    method : str
        Name of the method.
    status : str
        ``"ok"``; ``"not converged"`` where an iteration did not arrive; ``"misfit"`` where the
        residuals are several times those of the closed form.
    message : str
        The status in a sentence.
    iterations : int or None
        Cycles of an iterative method.
    residuals : ndarray (N, 6)
        Rotation vector [rad] and translation [m] by which ``A X`` differs from ``Z B``, in the
        axes of the base.
    covariance : ndarray (12, 12) or None
        Of the errors of X (rotation, translation) and Z (rotation, translation) [rad, m], where a
        noise was given and the status is ``"ok"``; scaled up where the residuals are larger than
        the noise explains, which the message then says. An error (w, v) is meant as
        ``R_estimated = exp([w]) R_true`` and ``p_estimated = p_true + v``: rotation and translation
        in the axes of the frame that the transform maps to, the flange for X and the base for Z.
    """

    X: FloatArray
    Z: FloatArray
    method: str
    status: str
    message: str
    iterations: int | None
    residuals: FloatArray
    covariance: FloatArray | None = None

    @property
    def residual_rotation_rad(self) -> FloatArray:
        """Rotation angle ``(N,)`` [rad] between A X and Z B, pair by pair."""
        return np.asarray(np.linalg.norm(self.residuals[:, :3], axis=-1))

    @property
    def residual_translation_m(self) -> FloatArray:
        """Distance ``(N,)`` [m] between the origins of A X and Z B, pair by pair."""
        return np.asarray(np.linalg.norm(self.residuals[:, 3:], axis=-1))

    @property
    def rotation_rms_rad(self) -> float:
        """Root mean square of the residual rotation angles [rad]."""
        return float(np.sqrt((self.residuals[:, :3] ** 2).sum(axis=-1).mean()))

    @property
    def translation_rms_m(self) -> float:
        """Root mean square of the residual distances [m]."""
        return float(np.sqrt((self.residuals[:, 3:] ** 2).sum(axis=-1).mean()))

    @property
    def sigma_X(self) -> FloatArray | None:
        """Standard deviations ``(6,)`` of X: rotation [rad], translation [m]; as covariance."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[:6])

    @property
    def sigma_Z(self) -> FloatArray | None:
        """Standard deviations ``(6,)`` of Z: rotation [rad], translation [m]; as covariance."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[6:])

    def summary(self) -> str:
        """Text for people: X and Z in mm and W, P, R in degrees, residuals, deviations."""
        cycles = "" if self.iterations is None else f", {self.iterations} cycles"
        lines = [f"A X = Z B by {self.method}: {self.status}{cycles}", self.message]
        for name, T, sigma in (("X", self.X, self.sigma_X), ("Z", self.Z, self.sigma_Z)):
            lines.append(f"{name}  x y z {_three(T[:3, 3] * 1e3)} mm")
            lines.append(f"   W P R {_three(np.degrees(se3.wpr_from_rotation(T[:3, :3])))} deg")
            if sigma is not None:
                lines.append(f"   sigma {_three(sigma[3:] * 1e3)} mm")
                lines.append(f"   sigma {_three(np.degrees(sigma[:3]))} deg about x y z")
        lines.append(
            f"residuals of {len(self.residuals)} pairs, rms: "
            f"{np.degrees(self.rotation_rms_rad):.4f} deg, {self.translation_rms_m * 1e3:.4f} mm"
        )
        return "\n".join(lines)


def _three(values: FloatArray) -> str:
    return " ".join(f"{value:11.4f}" for value in values)
