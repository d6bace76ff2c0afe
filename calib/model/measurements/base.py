"""How a kind of measurement sees the tool and its target, and how well.

Every kind is a function of the pose of the tool against its target: of where the tool point is in
the target's axes, and for some of how the tool is turned in them. Arrays have the posture last,
see :mod:`calib.model.context`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model.context import MeasurementContext
from calib.se3 import FloatArray

UNKNOWN_SIGMA = 1e-4
"""Standard deviation that a kind of unknown noise is given to start with [m, rad]."""


class Measurement(ABC):
    """One way of measuring, with its noise.

    Parameters
    ----------
    sigma : float, array_like or None
        Standard deviation of each row in the axes of the noise [m, rad]; one number means the
        same for all. None: it is estimated from the residuals.

    Attributes
    ----------
    name : str
        In the field's words, as in files.
    rows : int
        Equations m that one measurement gives.
    turns : int
        How many of them, at the end, are angles [rad].
    reads : bool
        Whether something is read off. Otherwise the arm is moved until the tool meets the
        target, and what is read is zero.
    sees_rotation : bool
        Whether it depends on the orientation of the tool.
    is_distance : bool
        Whether what is read is a length, with a zero of its own.
    sigma : array (m,)
    estimated : bool
        Whether the noise is to be estimated.
    found : bool
        Whether it was found from residuals, and not given.
    """

    name: str
    rows: int
    turns: int = 0
    reads: bool = True
    sees_rotation: bool = False
    is_distance: bool = False
    sigma: FloatArray
    estimated: bool
    found: bool = False

    def __init__(self, sigma: ArrayLike | None) -> None:
        self.estimated = sigma is None
        self.sigma = check_sigma(UNKNOWN_SIGMA if sigma is None else sigma, self.rows)

    @property
    def mean_sigma_m(self) -> float:
        """Root mean square of the noise over the rows that are lengths [m]."""
        lengths = self.sigma[: self.rows - self.turns]
        return float(np.sqrt(np.mean(lengths**2)))

    def with_noise(self, scale: ArrayLike) -> Measurement:
        """The same kind with its noise times a factor, one for all or one for each row."""
        other = copy(self)
        other.sigma = self.sigma * np.asarray(scale, dtype=float)
        return other

    def of_unknown_noise(self) -> Measurement:
        """The same kind with its noise to be estimated, from the one that it has."""
        other = copy(self)
        other.estimated = True
        return other

    def of_found_noise(self) -> Measurement:
        """The same kind, its noise being that of residuals: estimated once, then as if given."""
        other = copy(self)
        other.estimated, other.found = False, True
        return other

    @abstractmethod
    def predict(self, view: MeasurementContext) -> FloatArray:
        """What is read ``(m, S)``."""

    def difference(self, predicted: FloatArray, observed: FloatArray) -> FloatArray:
        """Rows ``(m, S)`` by which a reading is off another: those of a residual."""
        return np.asarray(predicted - observed)

    @abstractmethod
    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """Rows ``(p, m, S)`` for twists ``(p, 6, S)`` of the tool against its target.

        The derivative of :meth:`difference` where that is ``rows`` (m, S). There are only the
        first three rows of a twist for kinds that see no rotation.
        """

    def whiten(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """Rows ``(..., m, S)`` divided by the noise: unit variance, uncorrelated."""
        return np.asarray(rows / self.sigma[:, None])

    def whiten_derivative(
        self, J: FloatArray, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """Derivative ``(p, m, S)`` of the whitened ``rows`` (m, S), from that of the rows.

        Where the axes of the noise do not turn with the arm it is whitened as the rows are.
        """
        return self.whiten(J, view)

    def colour(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """The inverse of :meth:`whiten`: draws of unit variance as noise of the rows."""
        return np.asarray(rows * self.sigma[:, None])

    def disturb(self, readings: FloatArray, noise: FloatArray) -> FloatArray:
        """Readings ``(m, S)`` off by rows of noise, such that :meth:`difference` gives these."""
        return np.asarray(readings + noise)

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        """What of vectors ``(..., 3, S)`` in base axes the arm has to bring to nothing.

        Nothing, for kinds that are read off.
        """
        return np.zeros_like(vector)


class Contact(Measurement):
    """A kind that moves the arm until tool and target meet: what is read is zero."""

    reads = False

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.gap`: all of it, where a point is brought to a point."""
        return vector

    @abstractmethod
    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """Displacement ``(3, S)`` [m] of the tool point, in base axes, that shows as these rows."""


def check_sigma(sigma: ArrayLike, count: int) -> FloatArray:
    """Standard deviations ``(count,)`` [m], one number meaning the same in every axis.

    Raises
    ------
    InputError
        A number that is not positive and finite, or the wrong count of them.
    """
    given = np.asarray(sigma, dtype=float)
    if given.ndim == 0:
        given = np.full(count, float(given))
    if given.shape != (count,):
        raise InputError(f"the noise needs {count} numbers, {given.size} were given", name="noise")
    bad = ~(np.isfinite(given) & (given > 0))
    if bad.any():
        raise InputError(
            f"a noise of {given[bad][0] * 1e3:g} mm cannot be used: it must be above zero",
            hint="give the standard deviation of a single measurement in each axis",
            name="noise",
            value=float(given[bad][0]),
            bound=0.0,
        )
    return given
