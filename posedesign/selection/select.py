"""The choice of n poses out of a pool by a criterion, and its distance from the best there is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, check_type, near_names, one_line
from calib.se3 import IntArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.criteria import Criterion, criterion_by_name
from posedesign.selection.criteria.base import covariance_of_root
from posedesign.selection.relaxation import Relaxation
from posedesign.selection.search import METHODS, Found, Search
from posedesign.selection.selection import Selection

STARTS = 6
"""Starts of the exchange. In small pools many more are made at once (see :mod:`~.small`); in large
ones fewer, where they bring no more."""

TOLERANCE = 1e-3
"""Part to which the bound is sharpened: nobody measures a thousandth of a pose."""


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
    kept = _checked_keep(keep, pool.N)
    offered = np.union1d(pool.distinct(), kept)
    _check_count(n, len(kept), len(offered), pool.N)
    _check_options(method, starts, tolerance, threshold)
    chosen_by = (
        criterion
        if isinstance(criterion, Criterion)
        else criterion_by_name(criterion, pool.p, n, interest)
    )
    pool.check_identifiable()
    work = pool if len(offered) == pool.N else pool.take(offered)
    search = Search(work, chosen_by, n, np.searchsorted(offered, kept))
    tried = search.all_tried(method)
    found, relaxed = tried if tried is not None else (None, None)
    if relaxed is None and (bound or method == "rounding" or threshold is not None):
        relaxed = search.relax(tolerance)
    if threshold is not None and relaxed is not None:
        check_threshold(chosen_by, threshold, relaxed.bound, n)
    if found is None:
        found = search.run(method, starts, relaxed, rng or np.random.default_rng(0))
    return _selection(pool, offered, chosen_by, found, relaxed if bound else None)


def _selection(
    pool: Candidates,
    offered: IntArray,
    criterion: Criterion,
    found: Found,
    relaxed: Relaxation | None,
) -> Selection:
    indices, cost = offered[found.rows], min(found.costs)
    C = covariance_of_root(pool.root(indices))
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
        covariance=(
            np.full((pool.p, pool.p), np.inf) if C is None else C / np.outer(pool.scale, pool.scale)
        ),
        relaxation=relaxed,
        values_of_starts=tuple(criterion.shown(each) for each in found.costs),
        duplicates=pool.N - len(offered),
    )


def check_threshold(criterion: Criterion, threshold: float, bound: float, n: int) -> None:
    """Refuse a value that no choice can reach.

    ``threshold``: as the criterion is shown. ``bound``: proven bound of the cost.
    """
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
