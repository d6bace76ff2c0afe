"""What an identification found, and how far it can be believed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from calib.parameters.base import Unit
from calib.se3 import BoolArray, FloatArray

DISPLAY: dict[Unit, tuple[str, float]] = {
    "rad": ("deg", 180.0 / np.pi),
    "m": ("mm", 1e3),
    "rad/Nm": ("urad/Nm", 1e6),
}
"""Unit in which people read a parameter, and the factor from SI to it."""

MODEL_DOUBT = 1e-4
"""Probability of a chi² as large as the one found below which noise does not explain the data."""

Status = Literal["converged", "not converged"]


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """Identified parameters with their uncertainty.

    Attributes
    ----------
    model : str
        Name of the set of parameters, e.g. ``offsets``.
    names, units : tuple of str
        Of the p parameters; SI units.
    nuisance : array (p,) of bool
        Which of them place the set-up rather than the robot.
    values : array (p,)
        [SI]
    nominal : array (p,)
        Where the robot as described stands [SI].
    covariance : array (p, p)
        [SI]. From the noise given; scaled up to the residuals where chance would leave ones as
        large as they are with a probability below ``MODEL_DOUBT`` only.
    residuals : array (N, m)
        Rows left over at each posture [m].
    leave_one_out : array (N, m)
        Rows at each posture when predicted from all the others [m]; NaN for a posture without
        which the parameters cannot be identified.
    chi2 : float
        Sum of squared residuals divided by the noise given, see :func:`best_chi2`.
    degrees_of_freedom : int
    noise_scale : float
        Residuals over noise: ``sqrt(chi2 / degrees_of_freedom)``, 1 where the noise fits; NaN
        where no equation is left over.
    iterations : int
    status : {"converged", "not converged"}
    message : str
    """

    model: str
    names: tuple[str, ...]
    units: tuple[Unit, ...]
    nuisance: BoolArray
    values: FloatArray
    nominal: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    leave_one_out: FloatArray
    chi2: float
    degrees_of_freedom: int
    noise_scale: float
    iterations: int
    status: Status
    message: str

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of each parameter, ``(p,)`` [SI]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms_m(self) -> float:
        """Root mean square of the distance left over at a posture [m]."""
        return _rms(self.residuals)

    @property
    def leave_one_out_rms_m(self) -> float:
        """The same for postures that took no part in the fit [m]; NaN where there are none.

        Over the postures that can be left out: see :attr:`indispensable`.
        """
        return _rms(self.leave_one_out[np.isfinite(self.leave_one_out).all(axis=1)])

    @property
    def indispensable(self) -> int:
        """Postures without which the parameters could not be identified."""
        return int((~np.isfinite(self.leave_one_out).all(axis=1)).sum())

    @property
    def distances_m(self) -> list[float]:
        """Distance left over at each posture [m]."""
        return [float(far) for far in np.linalg.norm(self.residuals, axis=1)]

    @property
    def max_m(self) -> float:
        """Largest distance left over [m]."""
        return max(self.distances_m)

    @property
    def explains_data(self) -> bool:
        """Whether the noise given is enough to explain the residuals."""
        return not chi2_is_too_large(self.chi2, self.degrees_of_freedom)

    def value(self, name: str) -> float:
        """Value of one parameter [SI]."""
        return float(self.values[self.names.index(name)])

    def displayed(self) -> list[tuple[str, str, float, float, float]]:
        """Name, unit, value, change from nominal and standard deviation as people read them."""
        rows = []
        for name, unit, value, start, sigma in zip(
            self.names, self.units, self.values, self.nominal, self.sigma, strict=True
        ):
            label, factor = DISPLAY[unit]
            rows.append((name, label, value * factor, (value - start) * factor, sigma * factor))
        return rows

    def summary(self) -> str:
        """The result as a few lines of text, in degrees and millimetres."""
        lines = [
            f"{self.model}: {self.rms_m * 1e3:.4f} mm rms, {self.max_m * 1e3:.4f} mm max, "
            f"leave-one-out {self.leave_one_out_rms_m * 1e3:.4f} mm rms",
            *(
                f"  {name:<24s} {value:12.5f} +- {sigma:.5f} {unit}  (change {change:+.5f})"
                for name, unit, value, change, sigma in self.displayed()
            ),
            f"  {self.message}",
        ]
        return "\n".join(lines)


def chi2_is_too_large(chi2: float, degrees_of_freedom: int) -> bool:
    """Whether chance alone would hardly give a chi² as large as this one."""
    if degrees_of_freedom == 0:
        return False
    return bool(chi2_distribution.sf(chi2, degrees_of_freedom) < MODEL_DOUBT)


def _rms(rows: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1)))) if len(rows) else float("nan")
