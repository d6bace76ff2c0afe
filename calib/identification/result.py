"""What an identification found, and how far it can be believed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calib.chance import normal_quantile, student_quantile
from calib.model.parameters import Unit
from calib.se3 import BoolArray, FloatArray
from calib.shown import Shown


class Sizes(NamedTuple):
    """What is large and small for parameters of one unit [SI].

    Attributes
    ----------
    shown, factor : str, float
        Unit in which people read it, and the factor to that from SI.
    difference : float
        The Δp of Eq. 5 of [Watanabe2006]_: balances truncation against rounding for arms of a few
        metres, and of torques of some thousand Nm.
    largest_sigma : float
        Standard deviation beyond which a number says nothing: a fifth of a radian or of a metre is
        farther than the linear model, and any arm that is switched on, reaches.
    worth_having : float
        Standard deviation, all parameters taken in before being free as well, beyond which a
        parameter is left out: what an arm is built to is well inside, so nothing would be learnt.
        It is also what makes axes parallel that are so but for the rounding of a description: a
        column that differs by 1e-5 only shows a parameter with an uncertainty of metres.
    natural : float
        Changes that count as equally far: each moves the tool of a large arm by about a millimetre.
    """

    shown: str
    factor: float
    difference: float
    largest_sigma: float
    worth_having: float
    natural: float


SIZES: dict[Unit, Sizes] = {
    "rad": Sizes("deg", 180.0 / np.pi, 1e-6, 0.2, 1e-2, 1e-3),
    "m": Sizes("mm", 1e3, 1e-6, 0.2, 5e-3, 1e-3),
    "rad/Nm": Sizes("urad/Nm", 1e6, 1e-9, 1e-3, 1e-4, 1e-6),
    "rad/rad": Sizes("mrad/rad", 1e3, 1e-6, 0.2, 1e-2, 1e-3),
    "m/m": Sizes("mm/m", 1e3, 1e-6, 0.2, 1e-2, 1e-3),
    "px": Sizes("px", 1.0, 1e-3, 500.0, 100.0, 1.0),
    "1": Sizes("", 1.0, 1e-6, 10.0, 1.0, 1e-2),
    "s": Sizes("ms", 1e3, 1e-6, 1.0, 0.1, 1e-3),
}

DISPLAY = {unit: (sizes.shown, sizes.factor) for unit, sizes in SIZES.items()}
"""Unit in which people read a parameter, and the factor from SI to it."""

CONFIDENCE = 0.95

STRONG_CORRELATION = 0.9

HELD_SHARE = 0.8
"""Of the variance known beforehand that a parameter must have left to be held by that alone."""

Status = Literal["converged", "not converged"]

Loss = Literal["least-squares", "huber", "cauchy", "student-t", "graduated"]
"""What a measurement far from the others may do to a fit: :mod:`calib.identification.robust`."""


@dataclass(frozen=True)
class KindNoise:
    """Noise of one kind of measurement."""

    kind: str
    sigma: FloatArray
    """(m,): standard deviation of each row that the estimate is weighed by [m, rad]."""
    estimated: bool  # from the residuals, of this model or of a larger one, and not as given
    scale: float  # residuals over the noise given, redundancy taken into account; 1 where it fits
    doubted: bool
    """Whether the noise does not explain them: the covariance then takes it ``scale`` times as
    large."""
    unit: Literal["m", "px"] = "m"  # of the rows that are no angles
    arm_sigma: tuple[float, float] | None = None
    """Standard deviations of where the arm stops, along and about each axis [m, rad], beside
    ``sigma``: shared by all that is measured at a pose. None: not told apart from ``sigma``."""


class Displayed(NamedTuple):
    """A parameter in degrees and millimetres: its 95 % interval is from ``low`` to ``high``."""

    name: str
    unit: str
    value: float
    change: float
    sigma: float
    low: float
    high: float
    prior: float


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResult(Shown):
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
    prior : array (p,)
        Standard deviations known before measuring [SI]; infinite where nothing was.
    covariance : array (p, p)
        [SI]. From the noise given or estimated; from the residuals for kinds whose noise does
        not explain them, the estimate being weighed by the noise given all the same.
    prior_share : array (p,)
        Part of the variance known beforehand that the measurements leave, by the noise given:
        1 where they say nothing, 0 where nothing was known.
    singular_values : array (p,)
        Of the Jacobian over its noise, columns of unit length; what is known besides included.
    residuals : array (N, m)
        Rows left over at each measurement [m, rad].
    leave_one_out : array (N, m)
        Rows at each measurement when predicted from all other poses [m, rad]; NaN for a pose
        without which the parameters cannot be identified.
    angles : array (N, m) of bool
        Which rows are angles.
    poses : tuple of str
        Name of the pose of each measurement.
    outliers : array (N,) of bool
        Measurements that took no part because they contradict the others.
    weights : array (N,)
        Share that each measurement had in the fit; 1 without a robust loss.
    chi2 : float
        Sum of squared residuals of the measurements divided by the noise given.
    degrees_of_freedom : int
        Equations of the measurements that the parameters do not use up.
    noise_scale : float
        Residuals over noise: ``sqrt(chi2 / degrees_of_freedom)``, 1 where the noise fits; NaN
        where no equation is left over.
    chance : float
        Probability of residuals as large by the noise given alone.
    status : {"converged", "not converged"}
    notes : tuple of str
        What else has to be known: parameters merged with others, what rests on priors.
    """

    model: str
    names: tuple[str, ...]
    units: tuple[Unit, ...]
    nuisance: BoolArray
    values: FloatArray
    nominal: FloatArray
    prior: FloatArray
    covariance: FloatArray
    prior_share: FloatArray
    singular_values: FloatArray
    residuals: FloatArray
    leave_one_out: FloatArray
    angles: BoolArray
    poses: tuple[str, ...]
    outliers: BoolArray
    weights: FloatArray
    noise: tuple[KindNoise, ...]
    chi2: float
    degrees_of_freedom: int
    noise_scale: float
    chance: float
    iterations: int
    status: Status
    message: str
    notes: tuple[str, ...] = ()

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of each parameter, ``(p,)`` [SI]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval(self) -> FloatArray:
        """Bounds ``(2, p)`` [SI] of the 95 % interval of each parameter.

        By Student's distribution where the noise was taken from the residuals.
        """
        tail = 0.5 + CONFIDENCE / 2.0
        taken = any(kind.estimated or kind.doubted for kind in self.noise)
        free = self.degrees_of_freedom
        by_student = taken and free > 0
        reach = student_quantile(tail, free) if by_student else normal_quantile(tail)
        return np.asarray(self.values + reach * self.sigma * np.array([[-1.0], [1.0]]))

    @property
    def correlations(self) -> FloatArray:
        """Correlations ``(p, p)`` of the parameters."""
        sigma = self.sigma
        return np.asarray(self.covariance / np.outer(sigma, sigma))

    @property
    def strong_correlations(self) -> list[tuple[str, str, float]]:
        """Pairs correlated beyond ``STRONG_CORRELATION``, the strongest first."""
        upper = np.triu(self.correlations, 1)
        pairs = np.argwhere(np.abs(upper) > STRONG_CORRELATION)
        found = [(self.names[i], self.names[j], float(upper[i, j])) for i, j in pairs]
        return sorted(found, key=lambda pair: -abs(pair[2]))

    @property
    def held_by_prior(self) -> list[str]:
        """Parameters of which the measurements say next to nothing: the prior alone holds them."""
        held = self.prior_share > HELD_SHARE
        return [name for name, is_held in zip(self.names, held, strict=True) if is_held]

    @property
    def effective_parameters(self) -> float:
        """How many parameters the measurements had to tell.

        The trace of the information of the measurements times the covariance: p less what priors
        tell, which for each is the square of the standard deviation over that of its prior.
        """
        told = np.clip((self.sigma / self.prior) ** 2, 0.0, 1.0)
        return len(self.names) - float(told.sum())

    @property
    def used(self) -> BoolArray:
        """Measurements that took part in the fit, ``(N,)``."""
        return ~self.outliers

    @property
    def distances_m(self) -> list[float]:
        """Distance left over at each measurement [m]."""
        return [float(far) for far in self.lengths_m(self.residuals)]

    @property
    def rms_m(self) -> float:
        """Root mean square of the distance left over at a measurement [m]; outliers apart."""
        return self.rms_of(self.lengths_m(self.residuals))

    @property
    def weighed_rms_m(self) -> float:
        """Root mean square of the same [m], each weighed as the loss weighs it.

        Gross errors count little in it.
        """
        return self.rms_of(self.lengths_m(self.residuals), weighed=True)

    @property
    def max_m(self) -> float:
        """Largest distance left over [m]; outliers apart."""
        return float(self.lengths_m(self.residuals)[self.used].max(initial=0.0))

    @property
    def rms_rad(self) -> float:
        """Root mean square of the turn left over [rad]; NaN where no angle was measured."""
        return self.rms_of(self._turns(self.residuals))

    @property
    def leave_one_out_m(self) -> FloatArray:
        """Distance at each measurement predicted from the other poses, ``(N,)`` [m], or NaN."""
        return self.lengths_m(self.leave_one_out)

    @property
    def leave_one_out_rms_m(self) -> float:
        """The same as :attr:`rms_m` for poses that took no part in the fit [m].

        Over the poses that can be left out: see :attr:`indispensable`. NaN where there are none.
        """
        return self.rms_of(self.leave_one_out_m)

    @property
    def weighed_leave_one_out_rms_m(self) -> float:
        """The same as :attr:`weighed_rms_m` for poses that took no part in the fit [m]."""
        return self.rms_of(self.leave_one_out_m, weighed=True)

    @property
    def is_weighed(self) -> bool:
        """Return True if a robust loss weighed some of the measurements used down."""
        return bool((self.weights[self.used] != 1.0).any())

    @property
    def tails(self) -> float:
        """Residuals of all measurements used over those weighed by the loss; one without a loss."""
        weighed = self.weighed_rms_m
        return self.rms_m / weighed if self.is_weighed and weighed > 0.0 else 1.0

    @property
    def leave_one_out_rad(self) -> FloatArray:
        """Turn at each measurement predicted from the other poses, ``(N,)`` [rad], or NaN."""
        return self._turns(self.leave_one_out)

    @property
    def leave_one_out_rms_rad(self) -> float:
        """The same of the turns [rad]; NaN where no angle was measured."""
        return self.rms_of(self.leave_one_out_rad)

    @property
    def indispensable(self) -> int:
        """Poses without which the parameters could not be identified."""
        lost = ~np.isfinite(self.leave_one_out).all(axis=1) & self.used
        return len({pose for pose, is_lost in zip(self.poses, lost, strict=True) if is_lost})

    @property
    def explains_data(self) -> bool:
        """Whether the noise is enough to explain the residuals."""
        return not any(kind.doubted for kind in self.noise)

    def value(self, name: str) -> float:
        """Value of one parameter [SI]."""
        return float(self.values[self.names.index(name)])

    @property
    def headline(self) -> str:
        if any(kind.unit == "px" for kind in self.noise):
            return f"{self.model}: {self.noise_scale:.3f} times the noise"
        return (
            f"{self.model}: {self.rms_m * 1e3:.4f} mm rms, {self.max_m * 1e3:.4f} mm max, "
            f"leave-one-out {self.leave_one_out_rms_m * 1e3:.4f} mm rms"
        )

    def rows(self) -> list[dict[str, object]]:
        """One row a parameter, in degrees and millimetres."""
        keys = ("value", "change", "sigma", "low", "high", "unit")
        return [
            {"parameter": row.name, **{key: getattr(row, key) for key in keys}}
            for row in self.displayed()
        ]

    def displayed(self) -> list[Displayed]:
        """Parameters as people read them."""
        low, high = self.interval
        columns = (self.values, self.values - self.nominal, self.sigma, low, high, self.prior)
        return [
            Displayed(name, DISPLAY[unit][0], *(float(v) * DISPLAY[unit][1] for v in numbers))
            for name, unit, *numbers in zip(self.names, self.units, *columns, strict=True)
        ]

    def summary(self) -> str:
        """The result as a few lines of text, in degrees and millimetres."""
        width = max([24, *(len(name) for name in self.names)])
        lines = [
            self.headline,
            *(
                f"  {row.name:<{width}s} {row.value:12.5f} +- {row.sigma:.5f} {row.unit}  (change "
                f"{row.change:+.5f}, 95 % {row.low:.5f} to {row.high:.5f})"
                for row in self.displayed()
            ),
            f"  {self.message}",
            *(f"  {note}" for note in self.notes),
        ]
        return "\n".join(lines)

    def lengths_m(self, rows: FloatArray) -> FloatArray:
        """Distance ``(N,)`` [m] of rows ``(N, m)``: angles apart."""
        return np.asarray(np.linalg.norm(np.where(self.angles, 0.0, rows), axis=1))

    def rms_of(self, errors: FloatArray, *, weighed: bool = False) -> float:
        """Root mean square of errors ``(N,)`` that are known; outliers apart, NaN without any.

        ``weighed``: each counts by its weight in the fit, by one at most.
        """
        known = np.isfinite(errors) & self.used
        weights = np.ones(int(known.sum()))
        if weighed:
            weights = np.minimum(self.weights[known], 1.0)
        total = float(weights.sum())
        return float(np.sqrt(weights @ errors[known] ** 2 / total)) if total > 0 else float("nan")

    def _turns(self, rows: FloatArray) -> FloatArray:
        """Turn left over at each measurement [rad]; NaN for those without angles."""
        turns = np.linalg.norm(np.where(self.angles, rows, 0.0), axis=1)
        return np.where(self.angles.any(axis=1), turns, np.nan)
