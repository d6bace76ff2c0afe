"""How a measurement sees the tool point and the target, and how well."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import FloatArray


class Measurement(ABC):
    """One way of measuring, with its noise.

    Attributes
    ----------
    rows : int
        Equations m that one posture gives.
    sigma_m : array (m,)
        Standard deviation of each row in the axes of the sensor [m].
    """

    rows: int
    sigma_m: FloatArray

    @property
    def mean_sigma_m(self) -> float:
        """Root mean square of the noise over the rows [m]."""
        return float(np.sqrt(np.mean(self.sigma_m**2)))

    @abstractmethod
    def observe(self, error: FloatArray, R_base_tip: FloatArray) -> FloatArray:
        """Measured rows ``(..., m)`` for the tool point off its target by ``(..., 3)`` [m]."""

    @abstractmethod
    def differentiate(
        self, motion: FloatArray, error: FloatArray, R_base_tip: FloatArray
    ) -> FloatArray:
        """Rows ``(..., m, p)`` for motions ``(..., 6, p)`` of the tool against the target."""

    @abstractmethod
    def whiten(self, rows: FloatArray, R_base_tip: FloatArray) -> FloatArray:
        """Rows ``(..., m, k)`` divided by the noise: unit variance, uncorrelated."""

    @abstractmethod
    def sample(self, R_base_tip: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Noise drawn for rotations ``(..., 3, 3)``: displacement ``(..., 3)`` [m] of the tool."""


def check_sigma(sigma_m: ArrayLike, count: int) -> FloatArray:
    """Standard deviations ``(count,)`` [m], one number meaning the same in every axis.

    Raises
    ------
    InputError
        A number that is not positive and finite, or the wrong count of them.
    """
    sigma = np.asarray(sigma_m, dtype=float)
    if sigma.ndim == 0:
        sigma = np.full(count, float(sigma))
    if sigma.shape != (count,):
        raise InputError(f"the noise needs {count} numbers, {sigma.size} were given", name="noise")
    bad = ~(np.isfinite(sigma) & (sigma > 0))
    if bad.any():
        raise InputError(
            f"a noise of {sigma[bad][0] * 1e3:g} mm cannot be used: it must be above zero",
            hint="give the standard deviation of a single measurement in each axis",
            name="noise",
            value=float(sigma[bad][0]),
            bound=0.0,
        )
    return sigma
