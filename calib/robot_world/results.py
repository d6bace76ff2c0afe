"""What a solution of A X = Z B consists of.

The same equation as OpenCV names it.

``cv2.calibrateRobotWorldHandEye`` calls A the transform from world to camera, B from base to
gripper, X from base to world and Z from gripper to camera: A X = Z B read from the other side. With
our names its world is the target and its gripper the flange.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.batch_last import columns_of, product, rotation_log, transposed, turn
from calib.errors import InputError, one_line
from calib.robot_world.errors_of_pairs import Fit
from calib.se3 import BoolArray, FloatArray, IntArray
from calib.shown import Shown

if TYPE_CHECKING:
    from calib.robot_world.noise import Noise
    from calib.robot_world.scale import Scale


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
    scale : ndarray (T,) or None
        Where it was estimated, the factor of B's translations.
    """

    X: FloatArray
    Z: FloatArray
    iterations: IntArray | None = None
    converged: BoolArray | None = None
    fit: Fit | None = None
    sigma: FloatArray | None = None
    weights: FloatArray | None = None
    scale: FloatArray | None = None

    def of(self, trial: int) -> Estimate:
        """The estimate of one of the problems."""
        own = np.array([trial])
        return Estimate(
            self.X[own],
            self.Z[own],
            None if self.iterations is None else self.iterations[own],
            None if self.converged is None else self.converged[own],
            None if self.fit is None else self.fit.of(own),
            None if self.sigma is None else self.sigma[:, own],
            None if self.weights is None else self.weights[own],
            None if self.scale is None else self.scale[own],
        )

    def with_others(self, others: Sequence[tuple[int, Estimate]]) -> Estimate:
        """These estimates with those of some problems, one at a time, in their place."""
        values: dict[str, Any] = {name: getattr(self, name) for name in _EACH}
        values = {name: None if v is None else v.copy() for name, v in values.items()}
        fit = self.fit
        for trial, one in others:
            for name, value in values.items():
                if value is not None:
                    value[trial] = getattr(one, name)[0]
            if fit is not None and one.fit is not None:
                fit = fit.with_others(np.array([trial]), one.fit)
        return replace(self, fit=fit, **values)


_EACH = ("X", "Z", "iterations", "converged", "weights")
"""Arrays of :class:`Estimate` with the problems along their first axis."""


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
    shape = np.broadcast_shapes(A.shape[:-2], B.shape[:-2], (*X.shape[:-2], 1))
    R_A, p_A, R_B, p_B, R_X, p_X, R_Z, p_Z = (
        part
        for T in (A, B, X[..., None, :, :], Z[..., None, :, :])
        for part in _columns(np.broadcast_to(T, (*shape, 4, 4)))
    )
    difference = product(product(R_A, R_X), transposed(product(R_Z, R_B)))
    translation = turn(R_A, p_X) + p_A - turn(R_Z, p_B) - p_Z
    error = np.concatenate([rotation_log(difference), translation])
    return np.ascontiguousarray(error.T).reshape(*shape, 6)


def _columns(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns ``(3, 3, S)`` and origins ``(3, S)`` of transforms ``(..., 4, 4)``."""
    flat = T.reshape(-1, 4, 4)
    return columns_of(flat[:, :3, :3]), np.ascontiguousarray(flat[:, :3, 3].T)


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
    doubtful : ndarray of bool (T,)
        What is left is of the size of the motion itself: A and B do not belong together.
    covariance : ndarray (T, 12, 12) or None
        Of X and Z, by the methods of maximum likelihood; see
        :attr:`RobotWorldResult.covariance`.
    chi2 : ndarray (T,) or None
        By these methods, where a noise was given; see :attr:`RobotWorldResult.chi2`.
    """

    X: FloatArray
    Z: FloatArray
    method: str
    iterations: IntArray | None
    converged: BoolArray
    rank_deficient: BoolArray
    degenerate: BoolArray
    misfit: BoolArray
    doubtful: BoolArray
    covariance: FloatArray | None = None
    chi2: FloatArray | None = None

    @classmethod
    def joined(cls, parts: Sequence[RobotWorldBatch]) -> RobotWorldBatch:
        """Batches of the same method as one."""
        values: dict[str, Any] = {}
        for part in fields(cls):
            each = [getattr(batch, part.name) for batch in parts]
            values[part.name] = np.concatenate(each) if isinstance(each[0], np.ndarray) else each[0]
        return cls(**values)

    @property
    def ok(self) -> BoolArray:
        """Trials ``(T,)`` that converged, on motions that identify X and Z, with a fair fit."""
        return self.converged & ~self.degenerate & ~self.misfit & ~self.doubtful


_AXES = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg")
_SIGMA_AXES = (
    *("sigma_x_mm", "sigma_y_mm", "sigma_z_mm"),
    *("sigma_about_x_deg", "sigma_about_y_deg", "sigma_about_z_deg"),
)


@dataclass(frozen=True, eq=False, repr=False)
class RobotWorldResult(Shown):
    """Solution of one problem A X = Z B.

    Attributes
    ----------
    X, Z : ndarray (4, 4)
        The transforms [m]; eye in hand, ``T_flange_camera`` and ``T_base_target``.
    method : str
        Name of the method.
    scale_estimated : bool
        Whether the scale of B's translations was estimated with X and Z; residuals are then those
        of B corrected.
    iterations : int or None
        Cycles of an iterative method.
    used : ndarray of bool (N,)
        False for the pairs that a robust method left out.
    noise_estimated : bool
        Whether the noise was not given.
    noise_made : str
        How the noise is made, in words, where it was estimated and the residuals show one that is
        not of B, alike in all directions; else empty.
    chi2, freedom, chi2_probability : float, int, float or None
        Sum of the squares of the residuals in units of the noise given, at the likeliest X and Z
        whatever the method, its degrees of freedom, and the probability of one as large. None
        where no noise was given, or 0 of rotation or of translation.
    ambiguities : tuple of str
        In words, the other X that fit as well.
    alternatives : tuple of (X, Z)
        These, ``(4, 4)`` each.

    Notes
    -----
    The covariance, and what each pair's residual is when it is left out, take many solutions by
    most methods. They are worked out when they are first asked for, as all that X and Z do not
    depend on: the status asks for both.
    """

    X: FloatArray
    Z: FloatArray
    method: str
    scale_estimated: bool
    iterations: int | None
    used: BoolArray
    noise_estimated: bool
    noise_made: str
    chi2: float | None
    freedom: int
    chi2_probability: float | None
    ambiguities: tuple[str, ...]
    alternatives: tuple[tuple[FloatArray, FloatArray], ...]
    _residuals: Callable[[], FloatArray] = field(repr=False)
    _noise: Callable[[FloatArray], Noise | None] = field(repr=False)
    _drift: Callable[[], tuple[str, ...]] = field(repr=False)
    _doubts: Callable[[RobotWorldResult], tuple[str, ...]] = field(repr=False)
    _rank: Callable[[], int] = field(repr=False)
    _spread: Callable[[Noise | None], FloatArray | None] = field(repr=False)
    _leave_out: Callable[[], FloatArray] = field(repr=False)
    _scale: Callable[[RobotWorldResult], Scale | None] = field(repr=False)
    _judged: Callable[[RobotWorldResult], tuple[str, str]] = field(repr=False)

    @property
    def status(self) -> str:
        """``"ok"`` where X and Z may be used as they are; else what is the matter.

        ``"not converged"`` where an iteration did not arrive; ``"misfit"`` where the residuals are
        several times those of the closed form; ``"ambiguous"`` where other X and Z fit as well;
        ``"doubtful"`` where the message says that the pairs do not belong together, that the
        standard deviations are too large for a calibration, that X and Z of the other pairs do not
        predict those left out, or that the translations of B have another scale than those of A.
        """
        return self._verdict[0]

    @property
    def message(self) -> str:
        """The status in a sentence."""
        return self._verdict[1]

    @cached_property
    def _verdict(self) -> tuple[str, str]:
        return self._judged(self)

    @cached_property
    def residuals(self) -> FloatArray:
        """Rotation vector [rad] and translation [m] ``(N, 6)`` by which A X differs from Z B.

        In the axes of the base.
        """
        return self._residuals()

    @cached_property
    def noise(self) -> Noise | None:
        """Noise of the pairs: that given, or else as the residuals show it.

        On B where they show no other, which :attr:`noise_made` tells.

        None where the status is ``"misfit"`` or ``"not converged"``.
        """
        return self._noise(self.residuals)

    @cached_property
    def drift(self) -> tuple[str, ...]:
        """What changes along the sequence of pairs, in sentences."""
        return self._drift()

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What seems to be wrong with the pairs, each in a sentence."""
        return self._doubts(self)

    @cached_property
    def scale(self) -> Scale | None:
        """By what the translations of B have to be multiplied to fit those of A, and how sure.

        Estimated with X and Z by maximum likelihood whatever the method, from the pairs used; by
        the method itself where :attr:`scale_estimated`. None where the method has failed.
        """
        return self._scale(self)

    @cached_property
    def rank(self) -> int:
        """Directions of X and Z, of 12, that the pairs see."""
        return self._rank()

    @cached_property
    def covariance(self) -> FloatArray | None:
        """Covariance ``(12, 12)`` of X and Z [rad, m]; None where :attr:`noise` is.

        Of the errors of X (rotation, translation) and Z (rotation, translation). An error (w, v)
        is meant as ``R_estimated = exp([w]) R_true`` and ``p_estimated = p_true + v``: rotation
        and translation in the axes of the frame that the transform maps to, the flange for X and
        the base for Z. Scaled up where the residuals are larger than the noise given explains. A
        bias of the method, to second order, is in it by its square, and where the scale of B was
        estimated, what that adds.
        """
        if self.scale_estimated and self.scale is not None:
            joint = self.scale.covariance
            return None if joint is None else joint[:12, :12]
        return self._spread(self.noise)

    @cached_property
    def left_out_residuals(self) -> FloatArray:
        """Residuals ``(N, 6)`` of each pair with X and Z from all others: how well they predict."""
        return self._leave_out()

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
        """Root mean square of the residual rotation angles [rad] of the pairs used."""
        return _rms(self.residuals[self.used, :3])

    @property
    def translation_rms_m(self) -> float:
        """Root mean square of the residual distances [m] of the pairs used."""
        return _rms(self.residuals[self.used, 3:])

    @property
    def left_out_rotation_rms_rad(self) -> float:
        """Root mean square of the rotation angles [rad] that are left with a pair left out."""
        return _rms(self.left_out_residuals[self.used, :3])

    @property
    def left_out_translation_rms_m(self) -> float:
        """Root mean square of the distances [m] that are left with a pair left out."""
        return _rms(self.left_out_residuals[self.used, 3:])

    @property
    def sigma_X(self) -> FloatArray | None:
        """Standard deviations ``(6,)`` of X: rotation [rad], translation [m]; as covariance."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[:6])

    @property
    def sigma_Z(self) -> FloatArray | None:
        """Standard deviations ``(6,)`` of Z: rotation [rad], translation [m]; as covariance."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[6:])

    @property
    def weak_directions(self) -> tuple[str, ...]:
        """What the poses tell least about: the shift and the turn with the largest deviation."""
        return () if self.covariance is None else weakest(self.covariance)

    @property
    def headline(self) -> str:
        cycles = "" if self.iterations is None else f", {self.iterations} cycles"
        return f"A X = Z B by {self.method}: {self.status}{cycles}"

    def rows(self) -> list[dict[str, object]]:
        """X and Z in mm and deg, with their standard deviations where those are known."""
        found: list[dict[str, object]] = []
        for name, T, sigma in (("X", self.X, self.sigma_X), ("Z", self.Z, self.sigma_Z)):
            turn = np.degrees(se3.wpr_from_rotation(T[:3, :3]))
            numbers = [*(1e3 * T[:3, 3]), *turn]
            row = dict(zip(_AXES, map(float, numbers), strict=True))
            if sigma is not None:
                spread = [*(1e3 * sigma[3:]), *np.degrees(sigma[:3])]
                row |= dict(zip(_SIGMA_AXES, map(float, spread), strict=True))
            found.append({"transform": name, **row})
        return found

    def summary(self) -> str:
        """Text for people: X and Z in mm and W, P, R in degrees, residuals, deviations."""
        lines = [self.headline, self.message]
        for name, T, sigma in (("X", self.X, self.sigma_X), ("Z", self.Z, self.sigma_Z)):
            lines.append(f"{name}  x y z {_three(T[:3, 3] * 1e3)} mm")
            lines.append(f"   W P R {_three(np.degrees(se3.wpr_from_rotation(T[:3, :3])))} deg")
            if sigma is not None:
                lines.append(f"   sigma {_three(sigma[3:] * 1e3)} mm")
                lines.append(f"   sigma {_three(np.degrees(sigma[:3]))} deg about x y z")
        lines.append(
            f"residuals of {int(self.used.sum())} pairs, rms: "
            f"{np.degrees(self.rotation_rms_rad):.4f} deg, {self.translation_rms_m * 1e3:.4f} mm"
        )
        lines.append(
            "each pair left out, rms: "
            f"{np.degrees(self.left_out_rotation_rms_rad):.4f} deg, "
            f"{self.left_out_translation_rms_m * 1e3:.4f} mm"
        )
        if self.chi2 is not None:
            lines.append(
                f"chi² {self.chi2:.1f} of {self.freedom} degrees of freedom: probability "
                f"{self.chi2_probability:.2g} with the noise given"
            )
        if self.scale is not None:
            lines.append(
                f"scale of B's translations {self.scale.value:.6g}, sigma {self.scale.sigma:.2g}"
            )
        lines += [f"known least: {text}" for text in self.weak_directions]
        lines += [f"ambiguous: {text}" for text in self.ambiguities]
        lines += [f"warning: {text}" for text in self.warnings]
        return "\n".join(lines)


def weakest(covariance: FloatArray) -> tuple[str, ...]:
    """In words, the turn and the shift of X or Z with the largest standard deviations."""
    said = []
    for what, first, unit, scale in (
        ("rotation", 0, "deg", 180.0 / np.pi),
        ("translation", 3, "mm", 1e3),
    ):
        most: tuple[float, str] = (0.0, "")
        for name, frame, at in (("X", "flange", 0), ("Z", "base", 6)):
            own = slice(at + first, at + first + 3)
            values, vectors = np.linalg.eigh(covariance[own, own])
            sigma = scale * float(np.sqrt(max(values[-1], 0.0)))
            way = "about" if unit == "deg" else "along"
            text = f"{what} of {name} {way} {direction(vectors[:, -1])} of the {frame}"
            most = max(most, (sigma, f"{text}: {sigma:.3g} {unit}"))
        said.append(most[1])
    return tuple(said)


def direction(axis: FloatArray) -> str:
    """A unit vector ``(3,)`` as text, with its largest component positive."""
    axis = axis * np.sign(axis[np.abs(axis).argmax()]) / np.linalg.norm(axis)
    return "(" + ", ".join(f"{value:.3g}" for value in axis.round(3) + 0.0) + ")"


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).mean())) if len(vectors) else float("nan")


def _three(values: FloatArray) -> str:
    return " ".join(f"{value:11.4f}" for value in values)


def pairs_from_opencv(
    world2cam: ArrayLike, base2gripper: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """A = T_base_flange and B = T_target_camera from what OpenCV's function takes.

    Parameters
    ----------
    world2cam : array_like (N, 4, 4)
        T_camera_target [m]: its arguments ``R_world2cam`` and ``t_world2cam``.
    base2gripper : array_like (N, 4, 4)
        T_flange_base [m]: its arguments ``R_base2gripper`` and ``t_base2gripper``.

    Returns
    -------
    A, B : ndarray (N, 4, 4)
        What :func:`calib.robot_world.solve` takes.

    Raises
    ------
    InputError
        A matrix is not a rigid transform.
    """
    T_camera_target = se3.check_transforms(world2cam, "world2cam")
    T_flange_base = se3.check_transforms(base2gripper, "base2gripper")
    return se3.inverse(T_flange_base), se3.inverse(T_camera_target)


def result_to_opencv(result: RobotWorldResult) -> tuple[FloatArray, FloatArray]:
    """``base2world`` = T_target_base and ``gripper2cam`` = T_camera_flange ``(4, 4)`` [m].

    Raises
    ------
    InputError
        Something else than a result.
    """
    if not isinstance(result, RobotWorldResult):
        raise InputError(f"{one_line(result)} is no result of solve", name="result")
    return se3.inverse(result.Z), se3.inverse(result.X)
