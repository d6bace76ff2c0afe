"""Whether the noise that was given explains what a fit leaves over, kind by kind."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from calib.identification.covariance import column_lengths, information_root
from calib.model import Linearisation
from calib.se3 import FloatArray

MODEL_DOUBT = 0.01
"""Probability of residuals as large as those found below which the noise does not explain them."""

HARDLY = 0.05
"""The same below which it hardly does."""


@dataclass(frozen=True, eq=False)
class NoiseTest:
    """Residuals against the noise.

    Attributes
    ----------
    squares : array (K,)
        Sum of the squared residuals of each kind over their noise.
    redundancy : array (K,)
        How many of the equations of each kind are free to show noise: the others are used up by
        the parameters. What is known besides uses up none.
    """

    squares: FloatArray
    redundancy: FloatArray

    @cached_property
    def chi2(self) -> float:
        """Of all kinds."""
        return float(self.squares.sum())

    @cached_property
    def freedom(self) -> int:
        """Equations left over, of all kinds."""
        return round(float(self.redundancy.sum()))

    @cached_property
    def scale(self) -> float:
        """Residuals over noise, of all kinds; NaN where no equation is left over."""
        return float(np.sqrt(self.chi2 / self.freedom)) if self.freedom > 0 else float("nan")

    @cached_property
    def chance(self) -> float:
        """Probability of residuals as large by the noise alone."""
        if self.freedom <= 0:
            return 1.0
        return float(chdtrc(self.redundancy.sum(), self.chi2))

    @cached_property
    def scales(self) -> FloatArray:
        """Residuals over noise of each kind ``(K,)``; 1 where nothing can be said."""
        free = np.maximum(self.redundancy, 1e-9)
        return np.where(self.redundancy > 1.0, np.sqrt(self.squares / free), 1.0)

    @cached_property
    def found(self) -> FloatArray:
        """What the noise of each kind ``(K,)`` has to be multiplied by: that of doubted ones."""
        out = np.ones(len(self.squares))
        out[self.doubted] = self.scales[self.doubted]
        return out

    @cached_property
    def doubted(self) -> list[int]:
        """Kinds whose residuals are larger than their noise explains."""
        tested = np.flatnonzero(self.redundancy > 1.0).tolist()
        chances = chdtrc(np.maximum(self.redundancy, 1.0), self.squares)
        found = [k for k in tested if chances[k] < MODEL_DOUBT]
        if self.chance < MODEL_DOUBT and not found:  # a little in each of several kinds
            return tested
        return found


def noise_test(linear: Linearisation, x: FloatArray) -> NoiseTest:
    """Test the residuals of a fit to one set, weighted or not, at its solution ``(p,)``.

    After an unweighted fit the residuals are larger than those of the weighted one, by what it
    gives away, and would not have the distribution of chi²: what the parameters could still
    explain is taken out.
    """
    root = information_root(linear, x)
    known, _ = linear.model.known(np.atleast_2d(x))
    rows = np.concatenate([linear.white_rows.ravel(), known[0]])
    used = np.zeros(len(rows))
    if root.shape[1]:
        Q = np.linalg.qr(root / column_lengths(root))[0]
        rows = rows - Q @ (Q.T @ rows)
        used = np.sum(Q**2, axis=1)
    count, m = linear.white_rows.shape
    left = rows[: count * m].reshape(count, m)
    free = 1.0 - used[: count * m].reshape(count, m)
    kinds = linear.view.setup.kind
    squares, redundancy = [], []
    for k, kind in enumerate(linear.model.measurements):
        own = kinds == k
        squares.append(float(np.sum(left[own, : kind.rows] ** 2)))
        redundancy.append(float(np.sum(free[own, : kind.rows])))
    return NoiseTest(np.array(squares), np.array(redundancy))
