"""Touch-up: the arm is moved until its tool point meets the target; the joints are the result."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.measurement.base import Measurement, check_sigma
from calib.se3 import FloatArray


class TouchUp(Measurement):
    """All three coordinates of the tool point meet the target (visual or with a pin).

    What is measured is zero: the rows are Eq. 4 of [Watanabe2006]_, ``e_i = p_i - p_M``, in base
    axes. The noise is that of bringing the point there, in the axes of the camera (V, H, D).

    Parameters
    ----------
    sigma_m : float or array_like (3,)
        Standard deviations [m] along the tip's x, y, z (the camera's V, H, D).
    """

    rows = 3

    def __init__(self, sigma_m: ArrayLike) -> None:
        self.sigma_m = check_sigma(sigma_m, 3)

    def observe(self, error: FloatArray, R_base_tip: FloatArray) -> FloatArray:
        """See :meth:`Measurement.observe`: the error itself."""
        return error

    def differentiate(
        self, motion: FloatArray, error: FloatArray, R_base_tip: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`."""
        return motion[..., :3, :]

    def whiten(self, rows: FloatArray, R_base_tip: FloatArray) -> FloatArray:
        """See :meth:`Measurement.whiten`: turned into camera axes, then divided."""
        return np.swapaxes(R_base_tip, -1, -2) @ rows / self.sigma_m[:, None]

    def sample(self, R_base_tip: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See :meth:`Measurement.sample`."""
        drawn = rng.standard_normal((*R_base_tip.shape[:-1], 1)) * self.sigma_m[:, None]
        return np.asarray((R_base_tip @ drawn)[..., 0])


class ViewLine(Measurement):
    """Only that the target lies on the view line is measured: two coordinates across it.

    Section 2.1 and Fig. 10 of [Watanabe2006]_. The view line runs along the tip's z through the
    tool point, so the position of the tool point along z cannot be identified.

    Parameters
    ----------
    sigma_m : float or array_like (2,)
        Standard deviations [m] along the tip's x and y (the camera's V and H).
    """

    rows = 2

    def __init__(self, sigma_m: ArrayLike) -> None:
        self.sigma_m = check_sigma(sigma_m, 2)

    def observe(self, error: FloatArray, R_base_tip: FloatArray) -> FloatArray:
        """See :meth:`Measurement.observe`: the error across the view line."""
        return (np.swapaxes(R_base_tip, -1, -2) @ error[..., None])[..., :2, 0]

    def differentiate(
        self, motion: FloatArray, error: FloatArray, R_base_tip: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`.

        The axes turn with the tool: ``d(Rᵀe) = Rᵀ(de - w x e)``.
        """
        turned = np.cross(np.swapaxes(motion[..., 3:, :], -1, -2), error[..., None, :])
        moved = motion[..., :3, :] - np.swapaxes(turned, -1, -2)
        return (np.swapaxes(R_base_tip, -1, -2) @ moved)[..., :2, :]

    def whiten(self, rows: FloatArray, R_base_tip: FloatArray) -> FloatArray:
        """See :meth:`Measurement.whiten`: the rows are in camera axes already."""
        return np.asarray(rows / self.sigma_m[:, None])

    def sample(self, R_base_tip: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See :meth:`Measurement.sample`: across the line; the arm is taken to hold its depth."""
        sigma = np.append(self.sigma_m, 0.0)
        drawn = rng.standard_normal((*R_base_tip.shape[:-1], 1)) * sigma[:, None]
        return np.asarray((R_base_tip @ drawn)[..., 0])
