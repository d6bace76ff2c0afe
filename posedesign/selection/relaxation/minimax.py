"""The weights for which the largest of several mean square errors is least.

A primal-dual interior-point method for ``min τ`` such that ``log v_k(w) <= τ`` for every function
k: the logarithm of each error is a convex function of the weights. Each has a slack of its own,
which meets the error only in the end: held to it at every step, steps would be as short as the
errors are curved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg

from calib.se3 import FloatArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.relaxation.certificate import Certificate
from posedesign.selection.relaxation.relaxation import Smooth, room

MOST_STEPS = 60
"""Newton steps; about ten are seen."""

BOLD, TIMID, LONG = 0.1, 0.4, 0.7
"""What the complementarity is aimed at, after a step that was longer than ``LONG`` or shorter."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Mean square errors at some weights.

    ``squares`` (K,). ``slopes`` (n, K): less the derivatives of their logarithms.
    """

    squares: FloatArray
    slopes: FloatArray


class MinimaxObjective(Protocol):
    """What is minimised here."""

    def errors(self, candidates: Candidates, weights: FloatArray) -> Errors:
        """Of weights ``(n,)``."""

    def lagrangian(self, candidates: Candidates, weights: FloatArray, shares: FloatArray) -> Smooth:
        """The largest error with the derivatives of the mean of the logarithms by ``shares``."""

    def certificate_of(self, smooth: Smooth) -> Certificate:
        """The proof that the shares at some weights give."""


def minimise_largest(
    objective: MinimaxObjective, part: Candidates, count: int, tolerance: float
) -> tuple[FloatArray, Smooth]:
    """Weights ``(n,)`` in 0 .. 1 whose sum is ``count``, of a cost within a part ``tolerance``.

    ``count`` is less than there are candidates.
    """
    n = part.N
    w = np.full(n, count / n)
    rest = 1.0 - w
    now = objective.errors(part, w)
    top = float(np.log(now.squares).max()) + 1.0
    slack = top - np.log(now.squares)
    shares = 1.0 / slack / (1.0 / slack).sum()
    mu = float(shares @ slack) / len(shares)
    low, high = mu / w, mu / rest
    best_w, best = w, objective.lagrangian(part, w, shares)
    proof, proven, aim = best, 0.0, BOLD
    for _ in range(MOST_STEPS):
        smooth = objective.lagrangian(part, w, shares)
        if smooth.cost < best.cost:
            best_w, best = w, smooth
        bound = objective.certificate_of(smooth).bound(part, count)
        if bound > proven:
            proven, proof = bound, smooth
        if proven >= (1.0 - tolerance) * best.cost:
            break
        gap = float(shares @ slack + w @ low + rest @ high)
        mu = aim * gap / (len(shares) + 2 * n)
        # what the slacks miss of the errors, which are curved; a step takes it up to first order
        missing = top - np.log(now.squares) - slack
        pull = (mu - shares * missing) / slack
        try:
            dw, d_top = _step(
                smooth.curvature + np.diag(low / w + high / rest),
                now.slopes,
                shares / slack,
                np.append(mu / w - mu / rest + now.slopes @ pull, pull.sum() - 1.0),
                count - float(w.sum()),
            )
        except np.linalg.LinAlgError:
            break
        d_slack = missing + d_top + now.slopes.T @ dw
        d_shares = pull - shares - shares / slack * (d_top + now.slopes.T @ dw)
        d_low, d_high = mu / w - low - low / w * dw, mu / rest - high + high / rest * dw
        length = min(room(w, dw), room(rest, -dw), room(slack, d_slack))
        dual = min(room(shares, d_shares), room(low, d_low), room(high, d_high))
        w, rest, top = w + length * dw, rest - length * dw, top + length * d_top
        slack = slack + length * d_slack
        now = objective.errors(part, w)
        shares = shares + dual * d_shares
        low, high = low + dual * d_low, high + dual * d_high
        aim = BOLD if min(length, dual) > LONG else TIMID
    return best_w, Smooth(best.cost, proof.Z, best.curvature, proof.weights_of_functions)


def _step(
    matrix: FloatArray, slopes: FloatArray, steep: FloatArray, right: FloatArray, missing: float
) -> tuple[FloatArray, float]:
    """Step of the weights ``(n,)``, whose sum changes by ``missing``, and of the largest error."""
    n = len(matrix)
    whole = np.empty((n + 1, n + 1))
    whole[:n, :n] = matrix + (slopes * steep) @ slopes.T
    whole[:n, n] = whole[n, :n] = slopes @ steep
    whole[n, n] = steep.sum()
    ones = np.append(np.ones(n), 0.0)
    factor = scipy.linalg.cho_factor(whole, lower=True, overwrite_a=True, check_finite=False)
    a, b = scipy.linalg.cho_solve(factor, np.column_stack([right, ones]), check_finite=False).T
    change = a + (missing - a[:n].sum()) / b[:n].sum() * b
    return change[:n], float(change[n])
