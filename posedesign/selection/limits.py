"""Limits on a choice: what poses cost, how often one may be measured, and any linear constraint.

A choice is the number of times ``w_i`` that each candidate is measured. Limits are linear in it,
``lower <= A w <= upper``, with ``least <= w <= most`` for each: a budget of minutes, at least three
poses of a target, at most eight behind the arm. Whole numbers are chosen, and fractions bound them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray, IntArray, numbers

SLACK = 1e-9
"""Part of a limit by which it may be passed: sums of decimals are not whole."""

MOST_REPEATS = 100
"""Times that one pose may be measured: what that many agree on is no more than the pose tells."""

MILP_SECONDS = 10.0
"""After which a whole choice is taken as it is found by then."""


class LinearLimit(Protocol):
    """``lb <= A w <= ub`` of the times ``w`` (N,): ``scipy.optimize.LinearConstraint`` is one."""

    @property
    def A(self) -> Any: ...
    @property
    def lb(self) -> Any: ...
    @property
    def ub(self) -> Any: ...


@dataclass(frozen=True, eq=False)
class Limits:
    """What a choice has to keep."""

    rows: FloatArray  # (K, N)
    lower: FloatArray
    upper: FloatArray
    """lower, upper (K,): of the sums ``rows @ times``; infinite where there is no limit."""
    least: FloatArray
    most: FloatArray  # least, most (N,): times that each candidate is measured

    @classmethod
    def of(
        cls,
        N: int,
        *,
        n: int | None = None,
        costs: ArrayLike | None = None,
        budget: float | None = None,
        constraints: Sequence[LinearLimit] = (),
        repeats: int = 1,
        keep: IntArray | Sequence[int] = (),
    ) -> Limits:
        """Limits of a number of poses, of a budget, and of constraints.

        Raises
        ------
        InputError
            One of them cannot be, or there is none that ends a choice.
        """
        _check_repeats(repeats)
        parts = [(np.zeros((0, N)), np.zeros(0), np.zeros(0))]
        if n is not None:
            parts.append((np.ones((1, N)), np.array([float(n)]), np.array([float(n)])))
        if costs is not None or budget is not None:
            each = _checked_costs(costs, budget, N)[None]
            parts.append((each, np.array([-np.inf]), np.array([float(budget or 0.0)])))
        parts += [_checked_constraint(given, k, N) for k, given in enumerate(constraints)]
        rows, lower, upper = (np.concatenate(sides) for sides in zip(*parts, strict=True))
        least = np.zeros(N)
        least[np.asarray(keep, dtype=np.intp)] = 1.0
        most = np.full(N, float(repeats))
        limits = cls(rows, lower, upper, least, most)
        if n is None and budget is None and not np.isfinite(limits.upper).any():
            raise InputError(
                "nothing limits the number of poses",
                hint="give a number, a budget with costs, or a constraint with an upper limit",
                name="n",
            )
        return limits

    def take(self, columns: IntArray) -> Limits:
        """The same of some candidates, where the others are not measured."""
        return Limits(
            self.rows[:, columns], self.lower, self.upper, self.least[columns], self.most[columns]
        )

    def within(self, most: FloatArray) -> Limits:
        """The same with no candidate measured more often than so ``(N,)``, but for the least."""
        return replace(self, most=np.maximum(np.minimum(self.most, most), self.least))

    def keeps(self, sums: FloatArray) -> BoolArray:
        """Which sums ``(K, ...)`` of rows and times are within the limits, ``(...)``."""
        shape = (-1, *[1] * (sums.ndim - 1))
        below = sums <= self._highest.reshape(shape)
        above = sums >= self._lowest.reshape(shape)
        return np.asarray((below & above).all(axis=0))

    def lacking(self, sums: FloatArray) -> BoolArray:
        """Which of the rows ``(K,)`` are below their lower limit."""
        return np.asarray(sums < self._lowest)

    def not_above(self, sums: FloatArray) -> BoolArray:
        """Which sums ``(K, n)`` are not above the upper limits, ``(n,)``."""
        return np.asarray((sums <= self._highest[:, None]).all(axis=0))

    @cached_property
    def _lowest(self) -> FloatArray:
        return self.lower - self._slack(self.lower)

    @cached_property
    def _highest(self) -> FloatArray:
        return self.upper + self._slack(self.upper)

    @staticmethod
    def _slack(limit: FloatArray) -> FloatArray:
        return SLACK * (1.0 + np.where(np.isfinite(limit), np.abs(limit), 0.0))

    def inequalities(self) -> tuple[FloatArray, FloatArray]:
        """``A, b`` of ``A w <= b``."""
        high, low = np.isfinite(self.upper), np.isfinite(self.lower)
        A = np.vstack([self.rows[high], -self.rows[low]])
        return A, np.concatenate([self.upper[high], -self.lower[low]])

    def most_gathered(self, scores: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """The most that times within the limits can gather of scores ``(N,)``.

        Fractions of times are allowed. The value is that of the dual of the linear programme, an
        upper bound by weak duality for whatever multipliers the solver returns.

        Returns
        -------
        float
            What no times gather more than.
        array (N,)
            Times that gather as much.
        array (N,)
            Scores less what the limits ask for each time: above zero where more would help.

        Raises
        ------
        InputError
            No times are within the limits.
        """
        from scipy.optimize import linprog

        A, b = self.inequalities()
        size = float(np.abs(scores).max(initial=0.0)) or 1.0
        found = linprog(
            -scores / size,
            A_ub=A if len(A) else None,
            b_ub=b if len(A) else None,
            bounds=list(zip(self.least.tolist(), self.most.tolist(), strict=True)),
            method="highs",
        )
        if found.x is None:
            raise InputError(
                "no choice keeps all limits at once",
                hint="loosen one of them: a lower limit, the number of poses, or the budget",
                name="constraints",
            )
        y = np.maximum(-found.ineqlin.marginals, 0.0) * size if len(A) else np.zeros(0)
        reduced = scores - y @ A if len(A) else scores
        value = y @ b + np.sum(np.where(reduced > 0.0, reduced * self.most, reduced * self.least))
        return float(value), np.asarray(found.x), np.asarray(reduced)

    def whole(self, scores: FloatArray, cuts: Sequence[Cut] = ()) -> tuple[IntArray, float] | None:
        """Whole times within the limits that gather most of scores ``(N,)``.

        With ``cuts`` those whose largest cut is least are looked for; the scores decide nothing.
        The second number is what no whole times are below: of the largest cut, or of the negative
        sum. None where there are none, or none was found in time.
        """
        from scipy.optimize import Bounds, LinearConstraint, milp

        N, free = len(self.least), int(bool(cuts))
        c = np.append(np.zeros(N), 1.0) if cuts else -scores
        rows = np.hstack([self.rows, np.zeros((len(self.rows), free))])
        limits = [LinearConstraint(rows, self.lower, self.upper)] if len(rows) else []
        if cuts:
            A = np.column_stack([[cut.scores for cut in cuts], np.ones(len(cuts))])
            limits.append(LinearConstraint(A, np.array([cut.level for cut in cuts]), np.inf))
        found = milp(
            c,
            constraints=limits,
            integrality=np.append(np.ones(N), np.zeros(free)),
            bounds=Bounds(
                np.append(self.least, np.full(free, -np.inf)),
                np.append(self.most, np.full(free, np.inf)),
            ),
            options={"time_limit": MILP_SECONDS, "mip_rel_gap": 0.0 if cuts else 1e-6},
        )
        if found.x is None:
            return None
        return np.rint(found.x[:N]).astype(np.intp), float(found.mip_dual_bound)


@dataclass(frozen=True, eq=False)
class Cut:
    """What the logarithm of a convex cost is not below: ``level - scores @ times``."""

    level: float
    scores: FloatArray


def _check_repeats(repeats: int) -> None:
    if isinstance(repeats, bool) or not isinstance(repeats, (int, np.integer)):
        raise InputError("repeats are a whole number", hint="give 1 or more", name="repeats")
    if not 1 <= repeats <= MOST_REPEATS:
        raise InputError(
            f"a pose measured up to {repeats} times",
            hint=f"give 1 to {MOST_REPEATS}",
            name="repeats",
            value=int(repeats),
        )


def _checked_costs(costs: ArrayLike | None, budget: float | None, N: int) -> FloatArray:
    if costs is None or budget is None:
        missing, given = ("a budget", "costs") if budget is None else ("costs", "a budget")
        raise InputError(
            f"{given} without {missing}",
            hint="give costs, one for each candidate, and a budget for all of a choice",
            name="budget",
        )
    each = numbers(costs, "costs")
    if each.shape != (N,) or not (np.isfinite(each).all() and (each >= 0.0).all()):
        raise InputError(
            f"costs of {N} candidates are as many numbers from zero on",
            hint="give one for each",
            name="costs",
        )
    if not (np.isfinite(budget) and budget > 0.0):
        raise InputError(f"a budget of {budget:g}", hint="it must be above zero", name="budget")
    return each


def _checked_constraint(
    given: LinearLimit, k: int, N: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    where = f"constraint {k + 1}"
    if not all(hasattr(given, name) for name in ("A", "lb", "ub")):
        raise InputError(
            f"{where} is a {type(given).__name__}",
            hint="give scipy.optimize.LinearConstraint, or what has A, lb and ub as it has",
            name="constraints",
        )
    dense = given.A.toarray() if hasattr(given.A, "toarray") else given.A
    A = np.atleast_2d(numbers(dense, f"A of {where}"))
    if A.shape[1] != N or not np.isfinite(A).all():
        raise InputError(
            f"{where} has rows of {A.shape[1]} numbers, or some that are not finite, for {N} "
            "candidates",
            hint="give one number for each candidate",
            name="constraints",
        )
    low, high = (
        np.broadcast_to(numbers(side, f"limits of {where}"), len(A)).astype(float)
        for side in (given.lb, given.ub)
    )
    if np.isnan(low).any() or np.isnan(high).any() or (low > high).any():
        raise InputError(
            f"{where} has a lower limit above its upper one, or one that is no number",
            hint="give lb <= ub",
            name="constraints",
        )
    return A, low, high
