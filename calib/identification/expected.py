"""Error that an identified arm has to be expected to have where it will work.

Models of everything that could be off on the arm, held by priors of the right size, say after the
measurements what the true arm may be: their probability, mean and covariance. Any model is judged
by that, the arm as described too: by how far its tool point is from the one of arms drawn from
there, at postures where the arm will work. Unlike residuals, this sees what the measurements do
not: where touch-ups leave the scale of the arm open, every drawn arm has another one.

The base is placed anew for each, as an operator does who teaches a user frame: rigid motions of all
points alike do not count. (Decision theory: the mean of the loss after the data, Berger,
Statistical Decision Theory and Bayesian Analysis, 2nd ed., section 4.4.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.identification.prediction import Expectation
from calib.model import CalibrationModel, Setup
from calib.se3 import FloatArray

DRAWS = 1000
"""Arms drawn: their mean square is known to some three per cent, and models are compared on the
same ones."""

LEAST_PROBABILITY = 0.01
"""Of arms of one kind, below which none is drawn."""

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


@dataclass(frozen=True, eq=False)
class Posterior:
    """What is known of the true arm after the measurements, if it is of one kind.

    Attributes
    ----------
    model : CalibrationModel
    x : array (p,)
        Mean of its parameters [SI].
    covariance : array (p, p)
    probability : float
        That it is of this kind.
    """

    model: CalibrationModel
    x: FloatArray
    covariance: FloatArray
    probability: float = 1.0


class DrawnArms:
    """Arms drawn from what is known of the true one: what errors models have by it.

    Parameters
    ----------
    kinds : sequence of Posterior
        With probabilities that add up to one.
    workplace : Workplace

    Raises
    ------
    InputError
        A covariance that is not finite.
    """

    def __init__(self, kinds: Sequence[Posterior], workplace: Workplace) -> None:
        self.workplace = workplace
        self._drawn = [
            _drawn(kind, workplace) for kind in kinds if kind.probability >= LEAST_PROBABILITY
        ]

    def error_of(self, model: CalibrationModel, x: FloatArray) -> ExpectedError:
        """Error of an arm whose controller knew the parameters ``(p,)`` of a model [SI]."""
        squares = np.concatenate(
            [
                3.0 * np.mean((mean.displaced(model, x)[0][:, None] + off) ** 2, axis=0)
                for mean, off in self._drawn
            ]
        )
        tails = (1.0 - INTERVAL) / 2.0, (1.0 + INTERVAL) / 2.0
        low, high = np.sqrt(np.quantile(squares, tails))
        return ExpectedError(float(np.sqrt(squares.mean())), float(low), float(high))


def _drawn(kind: Posterior, workplace: Workplace) -> tuple[Expectation, FloatArray]:
    """The mean of a kind, and how far arms drawn from it are from that, ``(3 K, draws)`` [m].

    As many of the draws as the kind is probable.
    """
    mean = Expectation(kind.model, kind.x, kind.covariance, workplace.postures, workplace.setup)
    values, vectors = np.linalg.eigh(kind.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # the same draws for all models, and without what chance gives the mean of so few
    pairs = round(kind.probability * DRAWS / 2)
    draws = np.random.default_rng(0).standard_normal((kind.model.p, pairs))
    return mean, mean.jacobian @ root @ np.concatenate([draws, -draws], axis=1)
