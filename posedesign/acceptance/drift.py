"""The test of whether an arm is still the one that was identified: arrays only.

At a few poses the identified model predicts what will be read. Whitened by the noise, what is read
less what is predicted is of the covariance

    S = I + J C Jᵀ

of noise and of what the identification left open: J (M, p) the derivative of the predictions, C its
covariance. Where instrument or target stand anew since then, their columns are projected out. What
is left, y of M' numbers of unit variance, tells a change: |y|² is of chi-square with M' degrees of
freedom while nothing has changed, and of the non-central one, lambda = |D d|², after a change d
with columns D. One test of everything, so that 5 % of false alarms are 5 % in all; the power
against each change follows, and the smallest change that is found with a chance of 90 %. (Neyman
and Pearson; Kay, Fundamentals of Statistical Signal Processing II, 7.7.)

A cause is judged by what it leaves: |y|² less what its columns explain, and by Akaike's criterion,
2 for each of them, against the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.linalg import solve_triangular
from scipy.optimize import brentq

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray

FALSE_ALARM, POWER = 0.05, 0.90

ALIKE = 4.0
"""Difference of Akaike's criterion within which causes are not told apart: a likelihood ratio of
e², some seven."""

UNEXPLAINED = 0.01
"""Chance of what the likeliest cause leaves, below which no single one explains what was measured:
so rarely a true one is passed over."""

_SEEN = 1e-9
"""Singular value, over the largest or over the noise, below which nothing shows."""

STARTS = 6
"""Sets drawn at random that the exchange begins from."""


@dataclass(frozen=True, eq=False)
class Cause:
    """A change that one thing makes.

    ``columns`` (k,): of the model's Jacobian. ``combined``: (P, k) how its k numbers move all P
    parameters. ``unit``: "rad" or "m", of the first three of the k numbers.
    """

    name: str
    combined: FloatArray
    unit: str

    @property
    def k(self) -> int:
        return int(self.combined.shape[1])


@dataclass(frozen=True, eq=False)
class Whitened:
    """What a set of poses tells: rows of unit variance while nothing has changed."""

    freedom: int
    effects: Mapping[str, FloatArray]  # by cause, columns ``(M', k)``
    y: FloatArray | None = None  # (M',): None before measuring

    def smallest(self, cause: str, power: float = POWER) -> float:
        """Smallest change [rad, m] that is found with this chance, in the worst direction.

        Of causes of more than three numbers the first three count, a shift. Infinite where the
        poses tell nothing of it.
        """
        D = self.effects[cause][:, :3]
        weakest = float(np.linalg.svd(D, compute_uv=False)[-1]) if len(D) >= D.shape[1] else 0.0
        if weakest < _SEEN:  # a radian, or a metre, would not show
            return np.inf
        return float(np.sqrt(non_centrality(self.freedom, power)) / weakest)

    def power(self, cause: str, change: FloatArray) -> float:
        """Chance that a change ``(k,)`` [SI] is found."""
        moved = float(np.sum((self.effects[cause] @ change) ** 2))
        return float(stats.ncx2.sf(alarm_from(self.freedom), self.freedom, moved))


def alarm_from(freedom: int) -> float:
    """Sum of squares above which something has changed."""
    return float(stats.chi2.isf(FALSE_ALARM, freedom))


def non_centrality(freedom: int, power: float) -> float:
    """Lambda from which on a change is found with this chance."""
    crit = alarm_from(freedom)
    return float(brentq(lambda x: stats.ncx2.sf(crit, freedom, x) - power, 1e-6, 1e4))


def whiten(
    J: FloatArray,
    covariance: FloatArray,
    causes: Sequence[Cause],
    anew: FloatArray,
    off: FloatArray | None = None,
) -> Whitened:
    """What poses tell.

    ``J`` (M, P): derivative of the predictions over the noise. ``covariance`` (P, P): of the
    parameters [SI]; zero where one is taken to be as described. ``anew`` (P, f): what of the set-up
    stands anew; (P, 0) for nothing. ``off`` (M,): what was read less what was predicted, over the
    noise. Raises InputError: nothing is left that a change could show in.
    """
    rows = np.flatnonzero((J != 0.0).any(axis=1))
    J = J[rows]
    L = np.linalg.cholesky(np.eye(len(J)) + J @ covariance @ J.T)
    moved = np.column_stack([J @ anew, *(J @ cause.combined for cause in causes)])
    white = solve_triangular(L, moved, lower=True)
    base = _complement(white[:, : anew.shape[1]])
    if not base.shape[1]:
        raise InputError(
            "the poses tell nothing besides where the set-up stands",
            hint="take more poses, or leave the set-up where it was",
            name="poses",
        )
    white = base.T @ white[:, anew.shape[1] :]
    ends = np.cumsum([cause.k for cause in causes])
    effects = {c.name: white[:, e - c.k : e] for c, e in zip(causes, ends, strict=True)}
    y = None if off is None else base.T @ solve_triangular(L, off[rows], lower=True)
    return Whitened(base.shape[1], effects, y)


def _complement(columns: FloatArray) -> FloatArray:
    """Orthonormal basis ``(M, M')`` of what is orthogonal to columns ``(M, f)``."""
    if not columns.shape[1]:
        return np.eye(len(columns))
    length = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns / np.where(length > 0.0, length, 1.0))
    rank = int((s > _SEEN * s[0]).sum()) if s.size and s[0] > 0.0 else 0
    return np.asarray(U[:, rank:])


@dataclass(frozen=True, eq=False)
class Explanation:
    """A single cause of what was measured.

    ``change`` (k,), ``sigma`` (k,): estimate and standard deviations [SI]. ``left``: sum of squares
    that it leaves, ``p_left``: chance of as much.
    """

    cause: str
    unit: str
    change: FloatArray
    sigma: FloatArray
    left: float
    p_left: float

    @property
    def akaike(self) -> float:
        """Criterion, smaller is likelier."""
        return self.left + 2.0 * len(self.change)


@dataclass(frozen=True, eq=False)
class Recheck:
    """Outcome of the test. ``explanations``: the likeliest first, where something has changed."""

    freedom: int
    square: float
    p_value: float
    explanations: tuple[Explanation, ...]

    @property
    def same(self) -> bool:
        return self.p_value >= FALSE_ALARM

    @property
    def possible(self) -> tuple[Explanation, ...]:
        """Single causes that explain it as well as the likeliest; none where none explains it."""
        if self.same or not self.explanations or self.explanations[0].p_left < UNEXPLAINED:
            return ()
        best = self.explanations[0].akaike
        return tuple(e for e in self.explanations if e.akaike <= best + ALIKE)


def judge_change(told: Whitened, causes: Sequence[Cause]) -> Recheck:
    """Test what was measured, and judge every single cause."""
    if told.y is None:
        raise InputError("nothing was measured", name="measurements")
    y = told.y
    square = float(y @ y)
    found = []
    for cause in causes:
        D = told.effects[cause.name]
        U, s, Vt = np.linalg.svd(D, full_matrices=False)
        if not s.size or len(D) <= cause.k or s[-1] <= _SEEN * s[0]:
            continue  # nothing tells it, or not all of it
        left = square - float(np.sum((U.T @ y) ** 2))
        found.append(
            Explanation(
                cause.name,
                cause.unit,
                Vt.T @ ((U.T @ y) / s),
                np.sqrt(np.sum((Vt.T / s) ** 2, axis=1)),
                left,
                float(stats.chi2.sf(left, told.freedom - cause.k)),
            )
        )
    found.sort(key=lambda each: each.akaike)
    return Recheck(told.freedom, square, float(stats.chi2.sf(square, told.freedom)), tuple(found))


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates for a recheck: blocks ``(N, m, P)`` over the noise, and what is known."""

    blocks: FloatArray
    covariance: FloatArray
    watched: FloatArray
    """Single-number causes ``(P, w)`` whose smallest change is to be as small as can be."""
    anew: FloatArray

    def information(self, sets: IntArray) -> FloatArray:
        """Squares ``(S, w)`` of what each watched change moves y by, of sets ``(S, k)`` of rows."""
        count, k = sets.shape
        J = self.blocks[sets].reshape(count, k * self.blocks.shape[1], -1)
        S = np.eye(J.shape[1]) + J @ self.covariance @ np.swapaxes(J, -1, -2)
        L = np.linalg.cholesky(S)
        white = np.linalg.solve(L, J @ np.hstack([self.watched, self.anew]))
        D, F = np.split(white, [self.watched.shape[1]], axis=2)
        squares = np.sum(D**2, axis=1)
        if F.shape[2]:
            length = np.linalg.norm(F, axis=1, keepdims=True)
            U, s, _ = np.linalg.svd(F / np.where(length > 0.0, length, 1.0), full_matrices=False)
            U = U * (s > _SEEN * s[:, :1])[:, None, :]
            squares = squares - np.sum((np.swapaxes(U, -1, -2) @ D) ** 2, axis=1)
        return np.asarray(np.maximum(squares, 0.0))


def choose(pool: Pool, count: int, rng: np.random.Generator) -> tuple[IntArray, float]:
    """Poses for which the weakest of the watched changes is told best, and its information.

    By exchange from random sets: each pose in turn is replaced by the best of the pool, until none
    is better.
    """
    N = len(pool.blocks)
    if not 1 <= count <= N:
        raise InputError(f"{count} poses out of {N}", hint="ask for fewer poses", name="poses")
    best, value = np.arange(count), -1.0
    for _ in range(STARTS):
        chosen = rng.choice(N, count, replace=False)
        now = float(pool.information(chosen[None]).min())
        while True:
            before = now
            for place in range(count):
                others = np.delete(chosen, place)
                free = np.setdiff1d(np.arange(N), others)
                sets = np.column_stack([np.tile(others, (len(free), 1)), free])
                each = pool.information(sets).min(axis=1)
                k = int(np.argmax(each))
                if each[k] > now * (1.0 + 1e-9):
                    chosen, now = sets[k], float(each[k])
            if now <= before * (1.0 + 1e-6):
                break
        if now > value:
            best, value = chosen, now
    return np.sort(best), value
