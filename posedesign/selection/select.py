"""The choice of n poses by a criterion, how far it is from the best, and the fewest that do.

The fewest, from above: poses are taken in one by one until the value is reached, then exchange is
tried with fewer and fewer. From below: the relaxation of a number of poses proves that none of as
many can reach it. Where the two meet the number is proven.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import comb
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, check_type, near_names, one_line
from calib.one_thread import one_blas_thread, one_numpy_thread
from calib.se3 import FloatArray, IntArray
from calib.shown import Shown
from posedesign.selection.candidates import Candidates
from posedesign.selection.certificate import Relaxation
from posedesign.selection.criteria import criterion_by_name
from posedesign.selection.criterion import Criterion, covariance_of_root
from posedesign.selection.limits import Limits, LinearLimit
from posedesign.selection.search import ENUMERATED, METHODS, MOST_PASSES, Found, Search

PROVEN = 0.9995
"""Efficiency from which a choice is called the best there is."""

STARTS = 6
"""Starts of the exchange. In small pools many more are made at once; in large
ones fewer, where they bring no more."""

TOLERANCE = 1e-3
"""Part to which the bound is sharpened: nobody measures a thousandth of a pose."""

ROUGH = 0.02
"""Part to which bounds are sharpened while the number of poses is looked for."""

MOST_TIMES = 1_000_000
"""Measurements of each pose, beyond which more are no advice."""

MOST_CONDITION_POSES = 200
"""Poses that a condition number is tried with at most: more of them need not lower it."""


@dataclass(frozen=True, eq=False, repr=False)
class Selection(Shown):
    """Poses chosen out of a pool.

    ``indices`` (n,): into the pool, ascending, with those that were kept. ``criterion``: what they
    were chosen by. ``value``: of the choice, as the criterion is known; see ``criterion.title``.
    ``bound``: what no choice of as many poses can be better than; NaN where it was not asked for.
    ``efficiency``: in terms of information, 0 to 1: .97 proves that no choice of less than .97 n
    poses can be as good. Of condition numbers the bound over the value. ``covariance`` (p, p):
    predicted, in the units of the blocks; infinite where not all is identified. ``relaxation``:
    where the bound is from.  ``duplicates``:
    candidates that are there more than once, and were offered once.
    """

    indices: IntArray
    criterion: Criterion
    value: float
    bound: float
    efficiency: float
    covariance: FloatArray
    relaxation: Relaxation | None
    duplicates: int

    @property
    def count(self) -> int:
        return len(self.indices)

    @property
    def sigma(self) -> FloatArray:
        """Predicted standard deviations ``(p,)``, in the units of the blocks."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def status(self) -> str:
        """``"best"`` (proven), ``"bounded"``, ``"no bound"`` or ``"not identifiable"``."""
        if not np.isfinite(self.sigma).all():
            return "not identifiable"
        if np.isnan(self.efficiency):
            return "no bound"
        return "best" if self.efficiency >= PROVEN else "bounded"

    @property
    def headline(self) -> str:
        return self.message

    def rows(self) -> list[dict[str, object]]:
        """The chosen candidates by their index in the pool."""
        return [{"candidate": int(k)} for k in self.indices]

    @property
    def message(self) -> str:
        name = self.criterion.name
        text = f"{self.count} poses: {name} {self.value:.4g}"
        if self.status == "not identifiable":
            return f"{self.count} poses do not determine all parameters"
        if np.isfinite(self.efficiency):
            side = "below" if self.criterion.smaller_is_better else "above"
            text += (
                f"; proven: none of {self.count} is {side} {self.bound:.4g} "
                f"(efficiency {self.efficiency:.3f})"
            )
        if self.duplicates:
            text += f"; {self.duplicates} candidates are there more than once and were offered once"
        return text


@dataclass(frozen=True, eq=False)
class Fewest:
    """The fewest poses that reach a value.

    ``selection``: the poses; where the value is out of reach, the best that was found. ``fewer``:
    the best choice found of one pose fewer, which does not reach it. ``wanted``: the value asked
    for. ``at_least``: proven: fewer poses than that cannot reach it. ``times``: how often all poses
    would have to be measured where the value is out of reach; 0 where that does not help.
    """

    selection: Selection
    fewer: Selection | None
    wanted: float
    reached: bool
    at_least: int
    times: int = 0

    @property
    def message(self) -> str:
        found, name = self.selection, self.selection.criterion.name
        if not self.reached:
            if not np.isfinite(found.value) or found.status == "not identifiable":
                return f"all {found.count} poses together do not determine all parameters"
            text = (
                f"out of reach: the best that the pool gives is {name} {found.value:.4g} with "
                f"{found.count} poses, {self.wanted:.4g} is wanted"
            )
            if self.times:
                text += f": each of them would have to be measured {self.times} times"
            return text
        text = f"{found.count} poses reach {name} {found.value:.4g} ({self.wanted:.4g} wanted)"
        if self.fewer is not None:
            text += f"; {self.fewer.count} were found to reach {self.fewer.value:.4g} only"
        if self.at_least >= found.count:
            return text + "; proven: fewer cannot"
        return text + f"; proven: fewer than {self.at_least} cannot"


@one_numpy_thread
def select(
    blocks: ArrayLike,
    n: int | None = None,
    criterion: str | Criterion = "D",
    method: str = "exchange",
    *,
    costs: ArrayLike | None = None,
    budget: float | None = None,
    constraints: Sequence[LinearLimit] = (),
    repeats: int = 1,
    known: ArrayLike | None = None,
    keep: Sequence[int] = (),
    interest: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    threshold: float | None = None,
    starts: int = STARTS,
    passes: int = MOST_PASSES,
    tolerance: float = TOLERANCE,
    bound: bool = True,
    rng: np.random.Generator | None = None,
) -> Selection:
    """Choose n poses out of candidates.

    Parameters
    ----------
    blocks : array_like (N, m, p)
        Whitened Jacobians of the candidates: rows of unit variance. For condition numbers, the
        regressor. A, E and O depend on the units of the columns.
    n : int, optional
        Poses to choose, those of ``keep`` included; may be left to a budget or to constraints.
    criterion : str or Criterion
        A name of :data:`~posedesign.selection.criteria.CRITERIA`, or one that is made of linear
        functions of the parameters.
    method : str
        One of :data:`METHODS`. Where there are costs, constraints or repeats, ``exchange``.
    costs : array_like (N,), optional
        What each candidate costs each time that it is measured, such as seconds.
    budget : float, optional
        What a choice may cost.
    constraints : sequence of scipy.optimize.LinearConstraint, optional
        Of the times (N,) that each candidate is measured.
    repeats : int
        Most times that a candidate may be measured; it then stands in ``indices`` as often.
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
    passes : int
        Most passes of the exchange over the chosen poses. Two come within 1.4 % of as many as
        help; limits and repeats know no such bound.
    tolerance : float
        Part to which the bound is sharpened.
    bound : bool
        False: no relaxation; starts are drawn from all, and no efficiency is known.
    rng : numpy.random.Generator, optional
        For the starts of the exchange; the same choice every time by default.

    Raises
    ------
    InputError
        Blocks that cannot be used, more poses than candidates, an unknown criterion or method, or
        a threshold that no choice reaches.
    NotIdentifiableError
        All together cannot identify some of the parameters, which are named.
    """
    pool = Candidates(blocks, known, names)
    kept = _checked_keep(keep, pool.N)
    _check_options(method, starts, tolerance, threshold)
    rng = rng or np.random.default_rng(0)
    if n is None or costs is not None or budget is not None or constraints or repeats != 1:
        if n is not None:
            _check_count(n, len(kept), pool.N * max(repeats, 1), pool.N)
        limits = Limits.of(
            pool.N,
            n=n,
            costs=costs,
            budget=budget,
            constraints=constraints,
            repeats=repeats,
            keep=kept,
        )
        return _select_under(
            pool, criterion, n, limits, interest, threshold, starts, tolerance, rng
        )
    offered = np.union1d(pool.distinct(), kept)
    _check_count(n, len(kept), len(offered), pool.N)
    if not isinstance(criterion, Criterion):
        criterion = criterion_by_name(criterion, pool.p, n, interest)
    pool.check_identifiable()
    work = pool if len(offered) == pool.N else pool.take(offered)
    search = Search(work, criterion, n, np.searchsorted(offered, kept))
    tried = search.all_tried(method)
    found, relaxed = tried if tried is not None else (None, None)
    if relaxed is None and (bound or method == "rounding" or threshold is not None):
        relaxed = search.relax(tolerance)
    if threshold is not None and relaxed is not None:
        _check_threshold(criterion, threshold, relaxed.bound, n)
    if found is None:
        found = search.run(method, starts, relaxed, rng, passes)
    return _selection(pool, offered, criterion, found, relaxed if bound else None)


@one_blas_thread
def _select_under(
    pool: Candidates,
    criterion: str | Criterion,
    n: int | None,
    limits: Limits,
    interest: Sequence[int] | None,
    threshold: float | None,
    starts: int,
    tolerance: float,
    rng: np.random.Generator,
) -> Selection:
    """The choice under limits, with what no other within them beats."""
    from posedesign.selection.limited import (
        CLOSED,
        SMALL,
        best_under,
        mean_objective,
        relax_under,
        search_under,
    )

    if not isinstance(criterion, Criterion):
        criterion = criterion_by_name(criterion, pool.p, n or 1, interest)
    if n is None and criterion.name == "O1":
        raise InputError("O1 is of a number of poses", hint="give it, or take D", name="criterion")
    objective = mean_objective(criterion, pool)
    pool.check_identifiable()
    relaxed, scores = relax_under(objective, pool, limits, tolerance)
    if threshold is not None:
        _check_threshold(criterion, threshold, relaxed.bound, n)
    if pool.N > SMALL:
        found = search_under(criterion, pool, limits, relaxed, scores, starts, rng)
        return _selection(pool, np.arange(pool.N), criterion, found, relaxed)
    found = search_under(criterion, pool, limits, relaxed, scores, 1, rng)
    found, relaxed = best_under(objective, pool, limits, relaxed, found)
    if relaxed.bound < (1.0 - CLOSED) * min(found.costs):  # not proven: chance may find a better
        other = search_under(criterion, pool, limits, relaxed, scores, starts, rng)
        found = min(found, other, key=lambda each: min(each.costs))
    return _selection(pool, np.arange(pool.N), criterion, found, relaxed)


def _selection(
    pool: Candidates,
    offered: IntArray,
    criterion: Criterion,
    found: Found,
    relaxed: Relaxation | None,
) -> Selection:
    indices, cost = offered[found.rows], min(found.costs)
    C = covariance_of_root(pool.root(indices))
    unscaled = np.full((pool.p, pool.p), np.inf)
    if C is not None:
        unscaled = C / np.outer(pool.scale, pool.scale)
    efficiency = np.nan
    if relaxed is not None and np.isfinite(cost) and cost > 0.0:
        efficiency = min(1.0, relaxed.bound / cost)
    if relaxed is not None and len(offered) < pool.N:
        weights = np.zeros(pool.N)
        weights[offered] = relaxed.weights
        relaxed = replace(relaxed, weights=weights)
    return Selection(
        indices=indices,
        criterion=criterion,
        value=criterion.shown(cost),
        bound=criterion.shown(relaxed.bound) if relaxed is not None else np.nan,
        efficiency=float(efficiency),
        covariance=unscaled,
        relaxation=relaxed,
        duplicates=pool.N - len(offered),
    )


def _check_threshold(criterion: Criterion, threshold: float, bound: float, n: int | None) -> None:
    """Refuse a value that no choice can reach; ``bound`` is the proven one of the cost."""
    if criterion.cost_of(threshold) >= bound:
        return
    side = "below" if criterion.smaller_is_better else "above"
    raise InputError(
        f"no set of {n or 'allowed'} poses from this pool can be {side} {threshold:.4g}: "
        f"{criterion.name} of "
        f"the best is proven not to be {side} {criterion.shown(bound):.4g}",
        hint="take more poses, a wider pool, or another threshold",
        name="threshold",
        value=threshold,
        bound=criterion.shown(bound),
    )


def _checked_keep(keep: Sequence[int], N: int) -> IntArray:
    given = np.asarray(keep)
    if given.size and not np.issubdtype(given.dtype, np.integer):
        raise InputError(
            f"poses to keep are whole numbers, not of type {given.dtype}",
            hint=f"give indices 0 to {N - 1}",
            name="keep",
        )
    rows = np.unique(given.astype(np.intp))
    if len(rows) != len(keep) or (len(rows) and (rows[0] < 0 or rows[-1] >= N)):
        raise InputError(
            f"poses to keep must be different candidates, 0 to {N - 1}",
            hint="count from 0",
            name="keep",
        )
    return rows


def _check_options(method: str, starts: int, tolerance: float, threshold: float | None) -> None:
    check_type(method, str, "method")
    if method not in METHODS:
        raise InputError(
            f"there is no method {method[:40]!r}",
            hint=near_names(method, list(METHODS)),
            name="method",
        )
    if starts < 1:
        raise InputError(
            f"{starts} starts", hint="give 1 or more", name="starts", value=starts, bound=1
        )
    if not 0.0 < tolerance < 1.0:
        raise InputError(
            f"a tolerance of {tolerance:g}",
            hint="give a part between 0 and 1, such as 1e-3",
            name="tolerance",
            value=tolerance,
        )
    if threshold is not None and not (np.isfinite(threshold) and threshold > 0.0):
        raise InputError(
            f"a threshold of {threshold:g}",
            hint="it must be above zero",
            name="threshold",
            value=threshold,
        )


def _check_count(n: int, kept: int, offered: int, N: int) -> None:
    if not isinstance(n, Integral):
        raise InputError(
            f"{one_line(n)} poses", hint="the number of poses is a whole number", name="n", value=n
        )
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


@one_blas_thread
def select_fewest(
    blocks: ArrayLike,
    criterion: str | Criterion,
    value: float = 1.0,
    *,
    known: ArrayLike | None = None,
    keep: Sequence[int] = (),
    interest: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    starts: int = STARTS,
) -> Fewest:
    """Choose the fewest poses that reach a value of a criterion.

    The options are those of :func:`select`; ``value`` is as the criterion is shown: 1 for
    :func:`~posedesign.selection.criteria.wanted_deviations`.

    Raises
    ------
    InputError
        Blocks or a value that cannot be used.
    NotIdentifiableError
        All together cannot identify some of the parameters, which are named.
    """
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"a wanted value of {value:g}", hint="it must be above zero", name="value")
    pool = Candidates(blocks, known, names)
    pool.check_identifiable()

    def of_count(count: int) -> Criterion:  # O1 is another one for each number of poses
        if isinstance(criterion, Criterion):
            return criterion
        return criterion_by_name(criterion, pool.p, count, interest)

    monotone = of_count(pool.N).falls_with_poses  # an unknown name is told before anything else
    least = max(1, len(keep), 0 if known is not None else int(np.ceil(pool.p / pool.m)))

    def choose(count: int) -> Selection:
        given = partial(select, known=known, keep=keep, interest=interest, names=names)
        return given(blocks, count, criterion, starts=starts, tolerance=ROUGH)

    return _FewestSearch(pool, of_count, value, keep, choose, least).run(monotone=monotone)


@dataclass(frozen=True, eq=False)
class _FewestSearch:
    """Between the most that are needed and the fewest that are proven."""

    pool: Candidates
    criterion_of: Callable[[int], Criterion]
    value: float
    keep: Sequence[int]
    select: Callable[[int], Selection]
    least: int
    found: dict[int, Selection] = field(default_factory=dict)

    def run(self, *, monotone: bool) -> Fewest:
        offered = len(np.union1d(self.pool.distinct(), np.asarray(self.keep, dtype=np.intp)))
        most = offered if monotone else min(offered, MOST_CONDITION_POSES)
        upper = None
        if not monotone or self._enough(self._cost_of_all(offered), offered):
            upper = self._reached_from(most)
        if upper is None:
            at_least, found = most if monotone else self.least, self._choose(most)
            return Fewest(
                found, None, self.value, reached=False, at_least=at_least, times=self._times(found)
            )
        low = lower = self._proven_from(upper, offered) if monotone else self.least
        while low < upper:
            middle = (low + upper) // 2
            if self._does(middle):
                upper = middle
            else:
                low = middle + 1
        fewer = self._choose(upper - 1) if upper > self.least else None
        return Fewest(self._choose(upper), fewer, self.value, reached=True, at_least=lower)

    def _enough(self, cost: float, count: int) -> bool:
        # rounding of the last digits must not ask for a pose more
        return bool(cost <= self.criterion_of(count).cost_of(self.value) * (1.0 + 1e-9))

    def _choose(self, count: int) -> Selection:
        if count not in self.found:
            self.found[count] = self.select(count)
        return self.found[count]

    def _does(self, count: int) -> bool:
        found = self._choose(count)
        return self._enough(found.criterion.cost_of(found.value), count)

    def _cost_of_all(self, offered: int) -> float:
        return self.criterion_of(offered).on(self.pool).cost(np.arange(self.pool.N))

    def _times(self, found: Selection) -> int:
        """Times that all poses would have to be measured; 0 where that does not help.

        Costs fall with the number, as variances do; what is known besides stays as it is.
        """
        criterion, pool = found.criterion, self.pool
        if not criterion.falls_with_poses or not np.isfinite(found.value):
            return 0
        wanted = criterion.cost_of(self.value)
        if not pool.known.any():
            return int(np.ceil(criterion.cost_of(found.value) / wanted))
        R = np.asarray(np.linalg.qr(pool.J.reshape(-1, pool.p), mode="r"))

        def enough(times: int) -> bool:
            again = pool.with_blocks(np.sqrt(times) * R[None])
            return self._enough(criterion.on(again).cost(np.arange(1)), found.count)

        if not enough(MOST_TIMES):
            return 0
        low, high = 1, MOST_TIMES
        while low + 1 < high:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        return high

    def _reached_from(self, most: int) -> int | None:
        """A number of poses that does, by doubling."""
        count = min(max(self.least, 4), most)
        while not self._does(count):
            if count == most:
                return None
            count = min(2 * count, most)
        return count

    def _proven_from(self, upper: int, offered: int) -> int:
        """The fewest poses that are not proven to be too few."""
        low, high, kept = self.least, upper, len(self.keep)
        objective = None if kept else self.criterion_of(upper).on(self.pool)
        while low < high:
            middle = (low + high) // 2
            # where all choices are tried, what that proves is the most there is to prove
            few = comb(offered - kept, middle - kept) <= ENUMERATED
            if objective is None or few or middle in self.found:
                chosen = self._choose(middle)
                bound = chosen.criterion.cost_of(chosen.bound)
            else:
                bound = objective.relax(middle, ROUGH).bound
            if self._enough(bound, middle):
                high = middle
            else:
                low = middle + 1
        return low
