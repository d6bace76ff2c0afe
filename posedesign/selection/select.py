"""The choice of n poses out of a pool by a criterion, and its distance from the best there is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, near_names
from calib.se3 import IntArray
from posedesign.selection import exchange as steps
from posedesign.selection import small
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria.base import Criterion, Objective, covariance_of_root
from posedesign.selection.criteria.registry import criterion_by_name
from posedesign.selection.relaxation.relaxation import Relaxation
from posedesign.selection.selection import Selection

METHODS = {
    "exchange": "each pose exchanged for the best of the pool, until none helps; several starts",
    "detmax": "exchange, then excursions to more and to fewer poses (DetMax)",
    "greedy": "the best single pose taken in, again and again",
    "rounding": "the poses that count most in the convex relaxation, as they are",
}

STARTS = 6
"""Starts of the exchange. In 200 random pools of 20 candidates, 8 of which were chosen, one start
found the best choice in 87 %, six in all."""

TOLERANCE = 1e-3
"""Part to which the bound is sharpened: nobody measures a thousandth of a pose."""

GOOD_ENOUGH, SMALL = 0.98, 1000
"""Efficiency from which no further start is made, in pools of more than so many candidates: what
it could still gain is less than a pose in fifty. Small pools cost nothing, and are done in full."""

SHORTLIST = 20_000
"""Candidates that the exchange works on: the best by the relaxation, where there are more."""


def select(
    blocks: ArrayLike,
    n: int,
    criterion: str | Criterion = "D",
    method: str = "exchange",
    *,
    known: ArrayLike | None = None,
    keep: Sequence[int] = (),
    interest: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    threshold: float | None = None,
    starts: int = STARTS,
    tolerance: float = TOLERANCE,
    bound: bool = True,
    rng: np.random.Generator | None = None,
) -> Selection:
    """Choose n poses of a pool.

    Parameters
    ----------
    blocks : array_like (N, m, p)
        Whitened Jacobians of the candidates: rows of unit variance. For condition numbers, the
        regressor. A, E and O depend on the units of the columns.
    n : int
        Poses to choose, those of ``keep`` included.
    criterion : str or Criterion
        A name of :data:`~posedesign.selection.criteria.registry.CRITERIA`, or one that is made of
        linear functions of the parameters.
    method : str
        One of :data:`METHODS`.
    known : array_like (..., p), optional
        Rows that are there anyway: poses already measured, priors.
    keep : sequence of int
        Candidates that are to be among the chosen.
    interest : sequence of int, optional
        Columns of the parameters of interest, of D, A and E; the others are marginalised.
    names : sequence of str, optional
        Of the parameters, for errors.
    threshold : float, optional
        Value that has to be reached; refused at once where no choice can.
    starts : int
        Starts of the exchange.
    tolerance : float
        Part to which the bound is sharpened.
    bound : bool
        False: no relaxation; starts are drawn from the pool, and no efficiency is known.
    rng : numpy.random.Generator, optional
        For the starts; the same choice every time by default.

    Raises
    ------
    InputError
        Blocks that cannot be used, more poses than candidates, an unknown criterion or method, or
        a threshold that no choice reaches.
    NotIdentifiableError
        The whole pool cannot identify some of the parameters, which are named.
    """
    pool = Candidates(blocks, known, names)
    pool.check_identifiable()
    distinct = pool.distinct()
    kept = _checked_keep(keep, pool.N)
    offered = np.union1d(distinct, kept)
    _check_count(n, len(kept), len(offered), pool.N)
    if method not in METHODS:
        raise InputError(
            f"there is no method {method[:40]!r}",
            hint=near_names(method, list(METHODS)),
            name="method",
        )
    chosen_by = (
        criterion
        if isinstance(criterion, Criterion)
        else criterion_by_name(criterion, pool.p, n, interest)
    )
    work = pool if len(offered) == pool.N else pool.take(offered)
    return _Choice(work, offered, chosen_by, n, np.searchsorted(offered, kept)).make(
        method, starts, tolerance, bound, threshold, rng or np.random.default_rng(0), pool
    )


class _Choice:
    """One choice of n out of distinct candidates."""

    def __init__(
        self, work: Candidates, offered: IntArray, criterion: Criterion, n: int, kept: IntArray
    ) -> None:
        self._work, self._offered, self._criterion = work, offered, criterion
        self._n, self._kept = n, kept
        self._objective = criterion.on(work)

    def make(
        self,
        method: str,
        starts: int,
        tolerance: float,
        bound: bool,
        threshold: float | None,
        rng: np.random.Generator,
        pool: Candidates,
    ) -> Selection:
        """Bound, search, result."""
        relaxed = self._relax(tolerance) if bound or method == "rounding" else None
        if threshold is not None and relaxed is not None:
            check_threshold(self._criterion, threshold, relaxed.bound, self._n)
        rows, costs = self._search(method, starts, relaxed, rng)
        cost = min(costs)
        C = covariance_of_root(self._work.root(rows))
        p = self._work.p
        scale = self._work.scale
        efficiency = np.nan
        if relaxed is not None and np.isfinite(cost) and cost > 0.0:
            efficiency = min(1.0, relaxed.bound / cost)
        return Selection(
            indices=self._offered[rows],
            criterion=self._criterion,
            value=self._criterion.shown(cost),
            bound=self._criterion.shown(relaxed.bound) if relaxed is not None else np.nan,
            efficiency=float(efficiency),
            covariance=np.full((p, p), np.inf) if C is None else C / np.outer(scale, scale),
            relaxation=relaxed,
            values_of_starts=tuple(self._criterion.shown(found) for found in costs),
            duplicates=pool.N - len(self._offered),
        )

    def _relax(self, tolerance: float) -> Relaxation:
        """The relaxation over what is free, with what is kept taken for known."""
        free = np.setdiff1d(np.arange(self._work.N), self._kept)
        part = self._work
        if len(self._kept):
            part = self._work.knowing(self._kept).take(free)
        found = self._criterion.on(part).relax(self._n - len(self._kept), tolerance)
        weights = np.ones(self._work.N)
        weights[free] = found.weights
        return Relaxation(weights, found.cost, found.certificate, found.bound)

    def _search(
        self, method: str, number: int, relaxed: Relaxation | None, rng: np.random.Generator
    ) -> tuple[IntArray, list[float]]:
        """The best choice found, and the cost of each start."""
        weights = None if relaxed is None else relaxed.weights
        short, objective, kept = self._shortlist(relaxed)
        if method == "greedy":
            rows = short[steps.greedy(objective, self._n, kept)]
            return rows, [self._objective.cost(rows)]
        improve: Callable[[Objective, IntArray, IntArray], IntArray] = {
            "exchange": steps.exchange,
            "detmax": steps.excursions,
            "rounding": steps.as_given,
        }[method]
        own = None if weights is None else weights[short]
        first = steps.starts(
            objective.candidates, own, self._n, kept, 1 if method == "rounding" else number, rng
        )
        bound = 0.0 if relaxed is None else relaxed.bound
        best, rows, costs, ends = np.inf, short[first[0]], [], []
        for start in first:
            found = short[improve(objective, start, kept)]
            ends.append(found)
            costs.append(self._objective.cost(found))
            if costs[-1] < best:
                best, rows = costs[-1], found
            enough = GOOD_ENOUGH if self._work.N > SMALL else 1.0 - 1e-6
            if relaxed is not None and enough * best <= relaxed.bound:
                break
        if method in ("exchange", "detmax") and best > (1.0 + 1e-6) * bound:
            many = small.starts_for(self._work, self._n, self._kept)
            if many:
                found = small.many_starts(self._objective, np.array(ends), self._kept, many, rng)
                costs.append(self._objective.cost(found))
                rows = found if costs[-1] < best else rows
        return rows, costs

    def _shortlist(self, relaxed: Relaxation | None) -> tuple[IntArray, Objective, IntArray]:
        """Candidates that the exchange works on: those that add most at the relaxation."""
        N = self._work.N
        if N <= SHORTLIST:
            return np.arange(N), self._objective, self._kept
        weights = np.ones(N) if relaxed is None else relaxed.weights
        C = np.linalg.inv(self._work.weighted(weights * self._n / weights.sum()))
        scores = self._work.scores(C)
        scores[weights > 1e-6 if relaxed is not None else self._kept] = np.inf
        scores[self._kept] = np.inf
        short = np.sort(np.argpartition(scores, N - SHORTLIST)[N - SHORTLIST :])
        part = self._work.take(short)
        return short, self._criterion.on(part), np.searchsorted(short, self._kept)


def check_threshold(criterion: Criterion, threshold: float, bound: float, n: int) -> None:
    """Refuse a value that no choice can reach.

    Parameters
    ----------
    criterion : Criterion
    threshold : float
        As the criterion is shown.
    bound : float
        Proven bound of the cost.
    n : int

    Raises
    ------
    InputError
    """
    if not np.isfinite(threshold) or threshold <= 0.0:
        raise InputError(f"a threshold of {threshold:g}", hint="it must be above zero")
    if criterion.cost_of(threshold) >= bound:
        return
    side = "below" if criterion.smaller_is_better else "above"
    raise InputError(
        f"no set of {n} poses from this pool can be {side} {threshold:.4g}: {criterion.name} of "
        f"the best is proven not to be {side} {criterion.shown(bound):.4g}",
        hint="take more poses, a wider pool, or another threshold",
        name="threshold",
        value=threshold,
        bound=criterion.shown(bound),
    )


def _checked_keep(keep: Sequence[int], N: int) -> IntArray:
    rows = np.unique(np.asarray(keep, dtype=np.intp))
    if len(rows) != len(keep) or (len(rows) and (rows[0] < 0 or rows[-1] >= N)):
        raise InputError(
            f"poses to keep must be different candidates, 0 to {N - 1}",
            hint="count from 0",
            name="keep",
        )
    return rows


def _check_count(n: int, kept: int, offered: int, N: int) -> None:
    if n > offered:
        doubles = f" ({N - offered} more are there twice)" * (offered < N)
        raise InputError(
            f"{n} poses of {offered} candidates{doubles}",
            hint="ask for fewer poses, or offer more",
            name="n",
            value=n,
            bound=offered,
        )
    if n < max(kept, 1):
        raise InputError(
            f"{n} poses, {kept} of which are kept", hint="ask for more poses", name="n", value=n
        )
