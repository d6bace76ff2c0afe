"""Results of relaxations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.se3 import FloatArray

if TYPE_CHECKING:
    from posedesign.selection.relaxation.certificate import Certificate


@dataclass(frozen=True, eq=False)
class Smooth:
    """Cost of weighted candidates, and the derivatives of its logarithm.

    ``Z`` (p, p): less the derivative by the information: ``trace(Z Jᵀ J)`` is by how much a
    candidate lowers the logarithm. ``curvature`` (n, n): second derivatives by the weights.
    ``weights_of_functions`` (K,): of the functions of the parameters of which the largest counts.
    """

    cost: float
    Z: FloatArray
    curvature: FloatArray
    weights_of_functions: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Relaxation:
    """The best that fractions of candidates can be.

    ``weights`` (N,): from 0 to 1; their sum is the number of poses. ``cost``: of these weights.
    ``certificate``: proof that no weights, and so no choice, cost less than ``bound``; None where
    the bound is put together from several, or where all choices were tried: the weights are then
    those of the best.
    """

    weights: FloatArray
    cost: float
    certificate: Certificate | None
    bound: float

    @property
    def gap(self) -> float:
        """How far the proven bound is below the cost of the weights, as a part of it."""
        return 1.0 - self.bound / self.cost if self.cost > 0.0 else 0.0


def sum_of_largest(scores: FloatArray, count: int) -> float:
    """Sum of the ``count`` largest of ``scores`` (N,): the best that any choice can gather."""
    if count >= len(scores):
        return float(scores.sum())
    return float(np.partition(scores, len(scores) - count)[len(scores) - count :].sum())


def room(values: FloatArray, change: FloatArray, to_the_wall: float = 0.98) -> float:
    """How far a step may go before some value is no longer above zero; 1 at most."""
    falling = change < 0.0
    if not falling.any():
        return 1.0
    return min(1.0, to_the_wall * float((values[falling] / -change[falling]).min()))
