"""Limits that joints have together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray


@dataclass(frozen=True, eq=False)
class CoupledLimit:
    """A bound on a sum of joint values: ``lower <= coefficients @ q <= upper``.

    Attributes
    ----------
    name : str
        As reasons say it, e.g. ``J3 to the horizontal``.
    coefficients : array (n,)
    lower, upper : float
        [rad]; infinite where there is none.
    """

    name: str
    coefficients: FloatArray
    lower: float
    upper: float

    def room(self, q: FloatArray) -> FloatArray:
        """Distance [rad] of postures ``(..., n)`` from the nearer bound; negative outside."""
        value = q @ self.coefficients
        return np.asarray(np.minimum(value - self.lower, self.upper - value))
