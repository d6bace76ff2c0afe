"""The fewest poses whose standard deviations are as small as wanted.

Forward, the pose that lowers the deviations most is taken in again and again; then poses are taken
out again one by one, and after each the rest are exchanged for better ones of the pool, for as long
as the deviations stay small enough. Taking a pose in changes the covariance C by an update of as
many ranks as it has rows::

    C - C Jᵀ (1 + J C Jᵀ)⁻¹ J C

so that one pass over the pool judges all its poses, without a matrix of parameters being inverted.
No step of this looks at more than one pose at a time: the choice may be a pose or so away from the
fewest that there are.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray
from posedesign.selection.selection import OUT_OF_REACH, REACHED, Selection, largest_share

SHARPNESS = (2, 8, 32)
"""Powers of the variances that are summed up, each over the one wanted, one exchange after the
other. The larger, the nearer is the sum to the largest of them alone, which counts in the end, and
the less does it say of how to lower the others on the way there."""

FORWARD_SHARPNESS = 4
"""The same where poses are taken in or out one by one."""

FAINT = 1e-6
"""Part of the information of the whole pool that is there before the first pose: what is not yet
determined is then known a thousand times worse than by the whole pool, not infinitely badly."""

RANK_TOLERANCE = 1e-9
"""Smallest singular value, relative to the largest, of columns of unit length that still counts."""

RESTARTS = 4
"""Choices at random that are exchanged, too, before one pose fewer is taken not to do."""

_NO_GAIN = 1e-9
"""Relative gains below are rounding: exchanging for them could go on for ever."""

_MOST_PASSES = 20
"""Passes of exchange over all chosen poses; more than a handful are not seen."""


def select_fewest(blocks: ArrayLike, wanted: ArrayLike) -> Selection:
    """Choose the fewest poses of a pool whose standard deviations are as small as wanted.

    Parameters
    ----------
    blocks : array_like (N, m, p)
        Whitened Jacobians of the poses of the pool: rows of unit variance. Of any model, such as
        :func:`calib.robot_world.design.blocks` or the ``white_jacobian`` of a
        :class:`~calib.linearisation.Linearisation`.
    wanted : float or array_like (p,)
        Largest standard deviation of each parameter, in the units of the columns; infinite for
        those that may have any. One number is meant for all.

    Returns
    -------
    Selection
        Each pose is taken once at most. Where the whole pool does not reach what is wanted, the
        whole pool, with the status ``"out of reach"``.

    Raises
    ------
    InputError
        Blocks of another shape, numbers that are not finite, or nothing that is wanted.
    """
    J = np.asarray(blocks, dtype=float)
    if J.ndim != 3 or 0 in J.shape or not np.isfinite(J).all():
        raise InputError(
            f"a pool needs finite blocks (N, m, p), not an array of shape {J.shape}", name="blocks"
        )
    limits = _limits(wanted, J.shape[2])
    everything = np.arange(len(J))
    best = deviations(J)
    if not largest_share(best, limits) <= 1.0:
        return Selection(everything, best, limits, OUT_OF_REACH, everything, best)
    # rounding of the last digits must not ask for a pose more than the whole pool has
    search = _Search(J, limits * (1.0 + _NO_GAIN), best)
    chosen, fewer = search.fewest()
    return Selection(chosen, deviations(J[chosen]), limits, REACHED, fewer, deviations(J[fewer]))


def _limits(wanted: ArrayLike, p: int) -> FloatArray:
    given = np.asarray(wanted, dtype=float)
    if given.ndim > 1 or (given.ndim == 1 and len(given) != p):
        raise InputError(
            f"wanted deviations of shape {given.shape} for {p} parameters",
            hint="give one number, or one for each column",
            name="wanted",
        )
    limits = np.array(np.broadcast_to(given, p))
    if not (limits > 0.0).all():
        raise InputError(
            "a wanted standard deviation is not above zero",
            hint="leave parameters that may have any infinite",
            name="wanted",
            bound=0.0,
        )
    if np.isinf(limits).all():
        raise InputError("no standard deviation is wanted", hint="give one", name="wanted")
    return limits


def deviations(blocks: FloatArray) -> FloatArray:
    """Standard deviations ``(p,)`` from blocks ``(n, m, p)``; infinite where any is not seen."""
    rows = blocks.reshape(-1, blocks.shape[-1])
    length = np.linalg.norm(rows, axis=0)
    if len(rows) < len(length) or not length.all():
        return np.full(len(length), np.inf)
    _, values, Vt = np.linalg.svd(rows / length, full_matrices=False)
    if values[-1] <= RANK_TOLERANCE * values[0]:
        return np.full(len(length), np.inf)
    return np.asarray(np.linalg.norm(Vt / values[:, None], axis=0) / length)


class _Search:
    """A pool with its columns scaled so that the wanted deviations are 1."""

    def __init__(self, blocks: FloatArray, limits: FloatArray, best: FloatArray) -> None:
        self._limited = np.isfinite(limits)
        self._J = blocks * np.where(self._limited, limits, best)
        self._each = np.swapaxes(self._J, 1, 2) @ self._J  # (N, p, p)
        self._faint = FAINT * self._each.sum(axis=0)

    def fewest(self) -> tuple[IntArray, IntArray]:
        """The smallest choice found that will do, and the best of one pose fewer."""
        order = np.array(self._forward())
        chosen = order
        while len(chosen) > 1:
            fewer = self._best_of(self._starts(chosen, order))
            if not self._will_do(fewer):
                return np.sort(chosen), np.sort(fewer)
            chosen = fewer
        return chosen, chosen[:0]

    def _starts(self, chosen: IntArray, order: IntArray) -> Iterator[IntArray]:
        """Choices of one pose fewer to be exchanged: without the least, the first, any."""
        count = len(chosen) - 1
        yield np.delete(chosen, self._least(chosen))
        yield order[:count]
        rng = np.random.default_rng(count)  # fixed: the same pool gives the same choice
        for _ in range(RESTARTS):
            yield rng.choice(len(self._J), count, replace=False)

    def _best_of(self, starts: Iterator[IntArray]) -> IntArray:
        """The best choice that exchange makes of these, or the first that will do."""
        found = []
        for start in starts:
            found.append(self._exchanged(start))
            if self._will_do(found[-1]):
                return found[-1]
        return found[int(np.argmin([self._share(choice) for choice in found]))]

    def _forward(self) -> list[int]:
        """Poses in the order in which they are taken in, until they will do."""
        order: list[int] = []
        while not self._will_do(np.array(order, dtype=np.intp)):
            value = self._values_with(np.array(order, dtype=np.intp), FORWARD_SHARPNESS)
            value[order] = np.inf
            order.append(int(np.argmin(value)))
        return order

    def _exchanged(self, chosen: IntArray) -> IntArray:
        """The choice with one pose after the other put in place of a better one."""
        for power in SHARPNESS:
            if not self._will_do(chosen):
                chosen = self._exchanged_by(chosen, power)
        return chosen

    def _exchanged_by(self, chosen: IntArray, power: int) -> IntArray:
        chosen = chosen.copy()
        for _ in range(_MOST_PASSES):
            before = chosen.copy()
            for k in range(len(chosen)):
                others = np.delete(chosen, k)
                value = self._values_with(others, power)
                value[others] = np.inf
                best = int(np.argmin(value))
                if value[best] < (1.0 - _NO_GAIN) * value[chosen[k]]:
                    chosen[k] = best
            if np.array_equal(chosen, before):
                break
        return chosen

    def _least(self, chosen: IntArray) -> int:
        """Place of the chosen pose that is missed least."""
        remaining = self._information(chosen) - self._each[chosen]
        variances = np.diagonal(np.linalg.inv(remaining), axis1=1, axis2=2)
        return int(np.argmin(self._value(variances, FORWARD_SHARPNESS)))

    def _will_do(self, chosen: IntArray) -> bool:
        return self._share(chosen) <= 1.0

    def _share(self, chosen: IntArray) -> float:
        sigma = deviations(self._J[chosen])
        return float(sigma[self._limited].max())

    def _information(self, chosen: IntArray) -> FloatArray:
        return np.asarray(self._faint + self._each[chosen].sum(axis=0))

    def _value(self, variances: FloatArray, power: int) -> FloatArray:
        """What is made small, of variances ``(..., p)`` over those wanted."""
        relevant = variances[..., self._limited]
        largest = relevant.max(axis=-1, keepdims=True)
        mean = np.mean((relevant / largest) ** power, axis=-1) ** (1.0 / power)
        return np.asarray(largest[..., 0] * mean)

    def _values_with(self, chosen: IntArray, power: int) -> FloatArray:
        """The value ``(N,)`` of a choice with each pose of the pool taken in besides."""
        C = np.asarray(np.linalg.inv(self._information(chosen)), dtype=float)
        return self._value(np.diag(C) - variance_gains(self._J, C), power)


def variance_gains(blocks: FloatArray, covariance: FloatArray) -> FloatArray:
    """By how much each pose of a pool would lower the variances of the parameters ``(N, p)``.

    Parameters
    ----------
    blocks : ndarray (N, m, p)
    covariance : ndarray (p, p)
        Without the pose.
    """
    K = np.moveaxis(blocks @ covariance, 1, 0).copy()  # (m, N, p)
    rows = np.moveaxis(blocks, 1, 0)
    S = np.einsum("anp,bnp->abn", K, rows)
    S[np.arange(len(S)), np.arange(len(S))] += 1.0
    # Cholesky and forward substitution over all poses at once, row by row
    for a in range(len(S)):
        root = np.sqrt(S[a, a])
        K[a] /= root[:, None]
        S[a, a:] /= root
        for b in range(a + 1, len(S)):
            K[b] -= S[a, b][:, None] * K[a]
            S[b, b:] -= S[a, b] * S[a, b:]
    return np.asarray((K * K).sum(axis=0))
