"""Error that an identified arm has to be expected to have where it will work.

A reference model, with everything of the arm that could be off and held by priors of the right
size, says after the measurements what the true arm may be: its mean and its covariance. Any model
is judged by it, the arm as described too: by how far its tool point is from the one of arms drawn
from there, at postures where the arm will work. Unlike residuals, this sees what the measurements
do not: where touch-ups leave the scale of the arm open, every drawn arm has another one.

The base is placed anew for each, as an operator does who teaches a user frame: rigid motions of all
points alike do not count. (Decision theory: the mean of the loss after the data, Berger,
Statistical Decision Theory and Bayesian Analysis, 2nd ed., section 4.4.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.identification.carried import Expectation
from calib.model import CalibrationModel
from calib.model.context import Setup
from calib.se3 import FloatArray

DRAWS = 400
"""Arms drawn: their mean square is known to some five per cent, and models are compared on the
same ones."""

INTERVAL = 0.95


@dataclass(frozen=True, eq=False)
class Workplace:
    """Where an arm will work.

    Attributes
    ----------
    postures : array (K, n)
        [rad]
    setup : Setup
        Tool and payload at each.
    words : str
        What they are, for reports.
    """

    postures: FloatArray
    setup: Setup
    words: str


@dataclass(frozen=True)
class ExpectedError:
    """Distance of the tool point from where the arm takes it to be, in the mean over a workplace.

    Attributes
    ----------
    rms_m : float
        Root mean square over arms and workplace [m].
    low_m, high_m : float
        Of the root mean square over the workplace: 95 % of the arms are between [m].
    """

    rms_m: float
    low_m: float
    high_m: float


class DrawnArms:
    """Arms drawn from what a reference model says of the true one: what errors others have by it.

    Parameters
    ----------
    model : CalibrationModel
    x : array (p,)
        Mean of its parameters [SI].
    covariance : array (p, p)
    workplace : Workplace

    Raises
    ------
    InputError
        A covariance that is not finite.
    """

    def __init__(
        self, model: CalibrationModel, x: FloatArray, covariance: FloatArray, workplace: Workplace
    ) -> None:
        self.workplace = workplace
        self._mean = Expectation(model, x, covariance, workplace.postures, workplace.setup)
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        # the same draws for all models, and without what chance gives the mean of so few
        draws = np.random.default_rng(0).standard_normal((model.p, DRAWS // 2))
        drawn = np.concatenate([draws, -draws], axis=1)
        self._off_mean = self._mean.jacobian @ root @ drawn  # shape (3 K, DRAWS)

    def error_of(self, model: CalibrationModel, x: FloatArray) -> ExpectedError:
        """Error of an arm whose controller knew the parameters ``(p,)`` of a model [SI]."""
        errors = self._mean.displaced(model, x)[0][:, None] + self._off_mean
        squares = 3.0 * np.mean(errors**2, axis=0)
        tails = (1.0 - INTERVAL) / 2.0, (1.0 + INTERVAL) / 2.0
        low, high = np.sqrt(np.quantile(squares, tails))
        return ExpectedError(float(np.sqrt(squares.mean())), float(low), float(high))
