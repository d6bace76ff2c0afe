"""Information matrices of many choices out of a small pool at once."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.selection.candidates import Candidates

SEEN = 1e-9
"""Smallest eigenvalue, columns of unit length, from which a choice is taken to see everything; the
information is a square, and has lost half of the digits already."""

_FAINT = 1e-15
"""What is added to the information, columns of unit length: about its rounding."""


class Informations:
    """Of choices of poses.

    ``choices`` (T, n). ``M`` (T, p, p): scaled, with the known.
    """

    def __init__(self, candidates: Candidates, choices: IntArray) -> None:
        self._candidates, self._choices = candidates, choices
        T, p = len(choices), candidates.p
        member = np.zeros((T, candidates.N))
        member[np.arange(T)[:, None], choices] = 1.0
        each = (np.swapaxes(candidates.J, 1, 2) @ candidates.J).reshape(candidates.N, -1)
        self.M = (member @ each).reshape(T, p, p) + candidates.known

    @cached_property
    def length(self) -> FloatArray:
        """Of the columns ``(T, p)``; 1 where it is zero."""
        squares = np.einsum("tpp->tp", self.M)
        return np.asarray(np.sqrt(np.where(squares > 0.0, squares, 1.0)))

    @cached_property
    def covariance(self) -> tuple[FloatArray, BoolArray]:
        """Covariances ``(T, p, p)``, and which of the choices ``(T,)`` see all parameters."""
        unit = self.length[:, :, None] * self.length[:, None, :]
        # what is not seen is seen a little, so that there is an inverse, by which it is known
        inverse = np.linalg.inv(self.M / unit + _FAINT * np.eye(unit.shape[1]))
        trace = np.einsum("tpp->t", inverse)
        seen = (trace > 0.0) & (trace < 1.0 / SEEN)
        inverse[~seen] = np.eye(unit.shape[1])
        return inverse / unit, seen

    @cached_property
    def largest(self) -> FloatArray:
        """Largest absolute entry of each column of the regressor ``(T, p)``; 1 where all are 0."""
        found = np.max(self._candidates.largest[self._choices], axis=1, initial=0.0)
        found = np.maximum(found, self._candidates.largest_known)
        return np.where(found > 0.0, found, 1.0)
