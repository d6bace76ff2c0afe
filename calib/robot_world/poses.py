"""Poses that an arm has visited more than once, and the deviation that their pairs share.

An arm stops off in much the same manner each time that it visits a pose, and a pattern or lens
error is much the same each time as well. Pairs of one pose then tell less than as many pairs of
different poses. Rows of a pair are therefore the noise of the pair itself and a deviation of its
pose, both independent normal numbers. The variances are estimated by restricted maximum likelihood
(Patterson and Thompson, Biometrika 58, 1971). They decide how certain X and Z are, not X and Z
themselves: weights by these variances predicted pairs left out of real sets no better.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.se3 import BoolArray, FloatArray, IntArray

_NEAR = 5e-3
"""Difference of two A, in parts of the motion of all, up to which they are the same pose. Arms come
back to a tenth of a millimetre, and poses that differ are farther from each other."""

_LARGEST_SHARE, _LEAST_SHARE = 1e8, 1e-4
"""Variance of the deviation, in parts of the noise of a pair, that is looked for at most, and below
which it counts as none."""

_SHOWN = 13.8
"""Twice the logarithm of the likelihood that a deviation has to gain beside noise that was given: a
chance of 1 in 1,000 of two variances, both of them at their bound by chance in most sets."""

_LIKELIER = 6.0
"""The same beside noise that is estimated, which a deviation makes no smaller: a chance of 1 in 20.
The few poses that come back in a usual set tell none."""

_STARTS = (1e-2, 1.0, 1e2)
"""First shares that are tried."""

_LARGEST_CHANGE = 7.0
"""Logarithm of the largest change of the noise of a pair in one round."""

_MOST_COMPARED = 64
"""Pairs up to which all A are compared with all."""

_TINY, _UNLIKELY = 1e-300, 1e12


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the pairs of one set, and how much of the variance the pairs of a pose share."""

    member: FloatArray
    """(G, N): 1 where a pair that is used is of a pose, else 0."""
    share: FloatArray
    """(2,): variance of the deviation of a pose in units of the own noise of its pairs, of rotation
    and of translation."""
    own: FloatArray = field(default_factory=lambda: np.ones(2))
    """(2,): standard deviations of the own noise of a pair, of rotation and of translation, over
    those that the rows are in units of."""

    @cached_property
    def counts(self) -> FloatArray:
        """Pairs of each pose ``(G,)``."""
        return np.asarray(self.member.sum(axis=1))

    def decorrelated(self, rows: FloatArray) -> FloatArray:
        """Make rows ``(..., 6, N)`` independent and of unit variance.

        The mean of the k rows of a pose has the variance ``(1 + k share) / k``, and their
        differences from the mean have that of the noise.
        """
        return self._with_means(rows, 1.0 / np.sqrt(1.0 + self._more) - 1.0)

    def information(self, jacobian: FloatArray) -> FloatArray:
        """Variance ``(p, p)`` of the gradient by derivatives ``(p, 6, N)`` of the rows."""
        spread = np.sqrt(1.0 + self._more) - 1.0
        rows = self._with_means(jacobian, spread) * np.repeat(self.own, 3)[:, None]
        return np.asarray(np.tensordot(rows, rows, axes=((1, 2), (1, 2))))

    @cached_property
    def _more(self) -> FloatArray:
        return np.repeat(self.share, 3)[:, None] * self.counts

    def _with_means(self, rows: FloatArray, factor: FloatArray) -> FloatArray:
        means = rows @ (self.member / self.counts[:, None]).T
        return np.asarray(rows + (means * factor) @ self.member)


def near_pairs(A: FloatArray) -> list[IntArray]:
    """Return for each set ``(T, N, 4, 4)`` the pairs of rows ``(k, 2)``, i < j, of nearly equal A.

    Differences of rotation and of translation count in parts of the motion of the set.
    """
    T, N = A.shape[:2]
    p = A[..., :3, 3] - A[..., :3, 3].mean(axis=1, keepdims=True)
    R = A[..., :3, :3].reshape(T, N, 9)
    R = R - R.mean(axis=1, keepdims=True)
    parts = []
    for part in (R, p):
        size = np.sqrt(np.maximum((part**2).sum(axis=2).mean(axis=1), _TINY))
        parts.append(part / (_NEAR * size)[:, None, None])
    where = np.concatenate(parts, axis=2)
    if N > _MOST_COMPARED:
        from scipy.spatial import cKDTree

        found = [sorted(cKDTree(each).query_pairs(1.0)) for each in where]
        return [np.array(each, dtype=np.intp).reshape(-1, 2) for each in found]
    square = (where**2).sum(axis=2)
    distance = square[:, :, None] + square[:, None] - 2.0 * where @ np.swapaxes(where, 1, 2)
    trial, i, j = np.nonzero(np.triu(np.ones((N, N), dtype=bool), 1) & (distance <= 1.0))
    both = np.stack([i, j], axis=1)
    return np.split(both, np.searchsorted(trial, np.arange(1, T)))


def poses_of(near: IntArray, used: BoolArray) -> Poses | None:
    """Group the pairs used ``(N,)`` of one set by nearly equal A; None where no A comes back.

    A pair is of the first pose that it is near to, so that a slow motion makes no chain of poses.

    Parameters
    ----------
    near : ndarray (k, 2)
        See :func:`near_pairs`.
    """
    near = near[used[near].all(axis=1)]
    if not len(near):
        return None
    label = np.full(len(used), -1)
    for i in np.flatnonzero(used).tolist():
        if label[i] < 0:
            label[i] = i
            others = near[near[:, 0] == i, 1]
            label[others] = np.where(label[others] < 0, i, label[others])
    member = (label == np.unique(label[used])[:, None]).astype(float)
    return Poses(member, np.zeros(2))


def is_first(A: FloatArray, B: FloatArray, near: IntArray) -> BoolArray:
    """Return False for the pairs ``(N,)`` of one set that are copies of earlier ones.

    A copy is equal number by number. Two measurements differ in their last digits.
    """
    first = np.ones(len(A), dtype=bool)
    same = (A[near[:, 0]] == A[near[:, 1]]).all(axis=(1, 2))
    same &= (B[near[:, 0]] == B[near[:, 1]]).all(axis=(1, 2))
    first[near[same, 1]] = False
    return first


def restricted(white: FloatArray, jacobian: FloatArray, *, poses: Poses, own: bool) -> Poses | None:
    """Estimate the variances of one set by restricted maximum likelihood.

    Parameters
    ----------
    white, jacobian : ndarray (6, N), (p, 6, N)
        Rows of the pairs in units of their noise, and their derivatives by the p errors of the
        frames.
    own : bool
        Whether the noise of a pair is estimated with the deviations of the poses.

    Returns
    -------
    Poses or None
        The same poses with the variances that were found; None where pairs share no deviation.
    """
    from scipy.optimize import minimize

    sums = _Sums(white, jacobian, poses)
    scales = 2 if own else 0

    def parts(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (np.exp(2.0 * x[:2]) if own else np.ones(2)), np.exp(x[scales:])

    def worse(x: FloatArray) -> float:
        return sums.minus_twice_log_likelihood(*parts(x))

    bounds = [(-_LARGEST_CHANGE, _LARGEST_CHANGE)] * scales
    bounds += [(np.log(_LEAST_SHARE), np.log(_LARGEST_SHARE))] * 2
    starts = [np.concatenate([np.zeros(scales), np.log([start] * 2)]) for start in _STARTS]
    found = minimize(worse, min(starts, key=worse), bounds=bounds, method="L-BFGS-B")
    variance, share = parts(np.asarray(found.x))
    share = np.where(share > 2.0 * _LEAST_SHARE, share, 0.0)
    none, least = np.full(2, np.log(_LEAST_SHARE)), _SHOWN
    if own:  # the noise of a pair alone, as large as it is then
        nothing = none

        def worse_alone(x: FloatArray) -> float:
            return worse(np.concatenate([x, nothing]))

        alone = minimize(worse_alone, np.zeros(2), bounds=bounds[:2], method="L-BFGS-B")
        none, least = np.concatenate([alone.x, nothing]), _LIKELIER
    if worse(none) - found.fun < least or not share.any():
        return None
    return replace(poses, share=share, own=np.sqrt(variance))


class _Sums:
    """Sums of squares of one set, within poses and of the means of poses with so many pairs."""

    def __init__(self, white: FloatArray, jacobian: FloatArray, poses: Poses) -> None:
        self._p = len(jacobian)
        rows = np.concatenate([jacobian, white[None]]).reshape(self._p + 1, 2, 3, -1)
        used = poses.member.any(axis=0)
        means = rows @ (poses.member / poses.counts[:, None]).T
        within = (rows - means @ poses.member)[..., used]
        sizes = np.unique(poses.counts)
        groups = [within, *(np.sqrt(k) * means[..., poses.counts == k] for k in sizes)]
        every = np.stack([_gram(group) for group in groups])  # (1 + sizes, 2, p + 1, p + 1)
        self._unit = np.sqrt(np.maximum(np.einsum("ksii->i", every), _TINY))
        self._unit[self._p] = 1.0
        self._every = every / np.outer(self._unit, self._unit)
        self._pairs = np.concatenate([[0.0], sizes])
        numbers = [(poses.counts == k).sum() for k in sizes]
        self._count = 3.0 * np.array([int(used.sum()) - len(poses.counts), *numbers])

    def minus_twice_log_likelihood(self, own: FloatArray, share: FloatArray) -> float:
        """Of variances ``(2,)`` of the noise and shares ``(2,)`` of the deviation in them."""
        variance = own * (1.0 + self._pairs[:, None] * share)
        both = (self._every / variance[..., None, None]).sum(axis=(0, 1))
        # as Schur's complement: what X and Z do not take up of the squares
        p = self._p
        sign, whole = np.linalg.slogdet(both[:p, :p])
        if sign <= 0:
            return _UNLIKELY
        left = both[p, p] - both[p, :p] @ np.linalg.solve(both[:p, :p], both[:p, p])
        return float((self._count[:, None] * np.log(variance)).sum() + whole + left)


def _gram(rows: FloatArray) -> FloatArray:
    """Sums of products ``(2, q, q)`` of rows ``(q, 2, 3, n)``, of rotation and translation."""
    flat = rows.transpose(1, 0, 2, 3).reshape(2, len(rows), -1)
    return np.asarray(flat @ np.swapaxes(flat, -1, -2))
