"""Errors that follow each other along a sequence of poses, and what they do to the deviations.

Poses are measured one after the other, along a path, and what is off at one of them is off in much
the same way at the next: a lens, a print, an arm, a filter. Standard deviations that count every
pair as a witness of its own are then too small, on real pairs by a factor of two to five. Where
residuals of neighbours are more alike than chance makes them, X and Z are compared without runs of
consecutive pairs (the jackknife over blocks: Künsch, Ann. Statist. 17, 1989), which counts whatever
makes the pairs of a run alike, noise that is not the same everywhere and errors of the model
included. The larger of this and of the covariance by the noise is what is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from calib.robot_world.fit import Fit
from calib.se3 import BoolArray, FloatArray

FEWEST_PAIRS = 12
"""Pairs from which on runs of them are compared: five runs of more than two."""

CHANCE = 0.01
"""Probability that independent errors are taken for ones that follow each other. Where they are
not, nothing is changed: the runs of a set are few, and the larger of two numbers, one of them that
uncertain, would be too large by a tenth and more."""

_RUNS = (5, 8, 12, 20)
"""Numbers of runs; the one that shows most counts. Runs have to be longer than errors stay alike,
and to be many for what they show to be certain: how long that is, nobody knows beforehand."""

_LEAST_LEFT = 0.1
"""Least part of the information, in any direction, that counts as left without a run: what stays of
a direction that only one run shows is no measure of how far X and Z may be off."""

_FEWEST_WITNESSES = 4.0
"""Independent pairs that a set is worth at least: of three the noise could not be told."""


@dataclass(frozen=True)
class Following:
    """How alike the residuals of consecutive pairs of one set are.

    Attributes
    ----------
    correlation : float
        Of a pair's white rows with those of the next.
    significance : float
        The same in standard deviations of what independent errors make.
    """

    correlation: float
    significance: float

    @property
    def is_certain(self) -> bool:
        """Whether independent errors would hardly be as alike."""
        return bool(self.significance > norm.isf(CHANCE))


def following(fit: Fit, trial: int, used: BoolArray) -> Following:
    """Compare neighbours of one set, made up for what the fit makes of independent errors.

    Parameters
    ----------
    fit : Fit
    trial : int
        Which set.
    used : ndarray of bool (N,)
        The pairs that count; those that do not stand between no neighbours.
    """
    white, J = _rows(fit, trial, used)
    count = len(white)
    free = max(6.0 * count - 12.0, 1.0)
    variance = float((white**2).sum()) / free
    if count < FEWEST_PAIRS or variance <= 0.0:
        return Following(0.0, 0.0)
    # residuals are what the errors leave: C = s² (1 - H), so that neighbours have -H in common
    taken = float(np.einsum("iak,kl,ial->", J[:-1], fit.covariance[trial], J[1:]))
    alike = float((white[:-1] * white[1:]).sum()) / variance + taken
    products = 6.0 * (count - 1)
    return Following(float(np.clip(alike / products, -1.0, 1.0)), alike / np.sqrt(products))


def widening(
    fit: Fit, used: BoolArray, excess: FloatArray | None = None, *, noise_known: bool = False
) -> FloatArray:
    """Factors ``(T, 12)`` of the standard deviations of X and Z by errors that follow each other.

    The same for the three numbers of the rotation, and of the translation, of X and of Z: a
    covariance with rows and columns times these stays one. 1 where residuals do not show any.

    Parameters
    ----------
    fit : Fit
        With the pairs as they were measured, one after the other.
    used : ndarray of bool (T, N)
        Those that count.
    excess : ndarray (T,), optional
        By how much these standard deviations are scaled up already.
    noise_known : bool
        Whether they are by a noise that was given, not by that of the residuals.
    """
    factors = np.ones((len(fit.X), 12))
    for trial, own in enumerate(used):
        shown = following(fit, trial, own)
        if not shown.is_certain:
            continue
        more = 1.0 if excess is None else float(excess[trial])
        factors[trial] = np.maximum(_of_runs(fit, trial, own) / more, 1.0)
        if more > 1.0 or not noise_known:
            factors[trial] *= _fewer(shown.correlation, int(own.sum()))
    return factors


def _of_runs(fit: Fit, trial: int, used: BoolArray) -> FloatArray:
    """Standard deviations ``(12,)`` by the jackknife over runs, over those by the noise."""
    white, J = _rows(fit, trial, used)
    root = _root(fit.covariance[trial])
    # in units in which the information on X and Z is the identity
    scores = np.einsum("lc,ial,ia->ic", root, J, white)
    J = J @ root
    most = np.zeros(12)
    diagonal = (root**2).sum(axis=1)
    for runs in _RUNS:
        if 2 * runs > len(white):
            break
        square = np.zeros(12)
        for part in np.array_split(np.arange(len(white)), runs):
            rows = J[part].reshape(-1, 12)
            values, vectors = np.linalg.eigh(np.eye(12) - rows.T @ rows)
            inverse = vectors / np.maximum(values, _LEAST_LEFT) @ vectors.T
            square += (root @ (inverse @ scores[part].sum(axis=0))) ** 2
        ratio = square * (runs - 1) / runs / np.where(diagonal > 0.0, diagonal, 1.0)
        most = np.maximum(most, np.repeat(ratio.reshape(4, 3).mean(axis=1), 3))
    return np.asarray(np.sqrt(most))


def _fewer(correlation: float, count: int) -> float:
    """Factor for the noise itself, which fewer independent pairs show as too small.

    X and Z take up twelve of the numbers of as many pairs as the set is worth.
    """
    worth = max(count * (1.0 - correlation) / (1.0 + correlation), _FEWEST_WITNESSES)
    return float(np.sqrt((6.0 * count - 12.0) / (6.0 * count) * 6.0 * worth / (6.0 * worth - 12.0)))


def _rows(fit: Fit, trial: int, used: BoolArray) -> tuple[FloatArray, FloatArray]:
    """White rows ``(n, 6)`` of the pairs used of one set, and their derivatives ``(n, 6, 12)``."""
    white = fit.white[:, trial, used].T
    return white, fit.jacobian[:, :, trial, used].transpose(2, 1, 0)


def _root(covariance: FloatArray) -> FloatArray:
    """A matrix ``(12, 12)`` whose square is the covariance, also where that is singular."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None)))
