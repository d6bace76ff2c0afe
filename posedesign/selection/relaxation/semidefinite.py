"""A primal-dual interior-point method for weights of candidates under matrix inequalities.

::

    min  c·x   over weights 0 <= w <= 1 with sum n, and further unknowns x, such that
    S_k = a_k M(w) + sum_e x_e E_ke   is positive semidefinite for every k, and  R x >= 0

Steps are those of Helmberg et al. 1996, Kojima et al. 1997 and Monteiro 1997: with the dual
``Y_k`` of each inequality, ``Y + dY = μ S⁻¹ - sym(Y dS S⁻¹)``. As M is linear in the weights with
blocks of few rows, the matrix of a step is made of thin products; a general solver has to be told
every entry of every block.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from calib.se3 import FloatArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.products import products_by_pairs
from posedesign.selection.relaxation.relaxation import room

MOST_STEPS = 60
"""Newton steps; fifteen are usual."""

TO_THE_WALL = 0.95
"""Part of the way to the border of what is allowed that a step goes at most."""

BOLD, TIMID = 0.1, 0.4
"""What the complementarity is aimed at, as a part of what it is: after a long step, a short one."""

LONG = 0.7
"""Length from which a step is called a long one."""


@dataclass(frozen=True, eq=False)
class Inequality:
    """``share M(w) + sum_e x_e extra_e`` is positive semidefinite.

    ``extra`` (q, p, p).
    """

    share: float
    extra: FloatArray


@dataclass(eq=False)
class Point:
    """Where the method is.

    ``w`` (n,). ``x`` (q,). ``Y`` (p, p): duals of the inequalities. ``gap``: between the cost and
    that of the duals, where both keep to the rules.
    """

    w: FloatArray
    x: FloatArray
    Y: list[FloatArray] = field(default_factory=list)
    gap: float = np.inf


class Program:
    """Weights of some candidates, and further unknowns, under matrix inequalities.

    ``count``: sum of the weights; less than there are candidates. ``cost`` (q,). ``rows`` (l, q):
    of what must not be negative, ``R x``.
    """

    def __init__(
        self,
        part: Candidates,
        count: int,
        inequalities: list[Inequality],
        cost: FloatArray,
        rows: FloatArray | None = None,
    ) -> None:
        self._part, self._count, self._cost = part, count, cost
        self._inequalities = inequalities
        self._rows = np.zeros((0, len(cost))) if rows is None else rows
        self._each = (np.swapaxes(part.J, 1, 2) @ part.J).reshape(part.N, -1)

    def points(self, w: FloatArray, x: FloatArray, mu: float) -> Iterator[Point]:
        """The points after each step, from one that is strictly inside.

        Ends where no further step can be made.

        ``w`` (n,). ``x`` (q,). ``mu``: complementarity to begin with.
        """
        point = Point(w.copy(), x.copy())
        S = self._matrices(point.w, point.x)
        point.Y = [np.asarray(mu * np.linalg.inv(matrix)) for matrix in S]
        # the distance to 1 is kept apart: a difference would round to zero
        rest = 1.0 - w
        low, high = mu / w, mu / rest
        dual = mu / (self._rows @ x)
        aim, parts = BOLD, len(S) * self._part.p + 2 * len(w) + len(dual)
        point.gap = self._complementarity(point, S, float(rest @ high), low, dual)
        for _ in range(MOST_STEPS):
            mu = aim * point.gap / parts
            try:
                step = self._step(
                    point, S, low / point.w + high / rest, mu / point.w - mu / rest, dual, mu
                )
            except np.linalg.LinAlgError:
                return
            dw, dx, dS, dY = step
            d_low = mu / point.w - low - low / point.w * dw
            d_high = mu / rest - high + high / rest * dw
            Rx, dRx = self._rows @ point.x, self._rows @ dx
            d_dual = mu / Rx - dual - dual / Rx * dRx
            primal = min(room(point.w, dw), room(rest, -dw), room(Rx, dRx), *map(_reach, S, dS))
            length = min(
                room(low, d_low),
                room(high, d_high),
                room(dual, d_dual),
                *map(_reach, point.Y, dY),
            )
            if min(primal, length) < 1e-4:
                return
            point = Point(
                point.w + primal * dw,
                point.x + primal * dx,
                [Y + length * d for Y, d in zip(point.Y, dY, strict=True)],
            )
            rest = rest - primal * dw
            low, high = low + length * d_low, high + length * d_high
            dual = dual + length * d_dual
            S = self._matrices(point.w, point.x)
            point.gap = self._complementarity(point, S, float(rest @ high), low, dual)
            aim = BOLD if min(primal, length) > LONG else TIMID
            yield point

    def _matrices(self, w: FloatArray, x: FloatArray) -> list[FloatArray]:
        M = self._part.known + (w @ self._each).reshape(self._part.p, self._part.p)
        return [rule.share * M + np.tensordot(x, rule.extra, axes=1) for rule in self._inequalities]

    def _complementarity(
        self, point: Point, S: list[FloatArray], total: float, low: FloatArray, dual: FloatArray
    ) -> float:
        total += sum(float(np.sum(Y * matrix)) for Y, matrix in zip(point.Y, S, strict=True))
        return total + float(point.w @ low + dual @ (self._rows @ point.x))

    def _step(
        self,
        point: Point,
        S: list[FloatArray],
        walls: FloatArray,
        pushed: FloatArray,
        dual: FloatArray,
        mu: float,
    ) -> tuple[FloatArray, FloatArray, list[FloatArray], list[FloatArray]]:
        n, q = len(point.w), len(point.x)
        Rx = self._rows @ point.x
        matrix = np.zeros((n + q, n + q))
        right = np.concatenate([pushed, self._rows.T @ (mu / Rx) - self._cost])
        matrix[np.arange(n), np.arange(n)] = walls
        matrix[n:, n:] = self._rows.T @ (self._rows * (dual / Rx)[:, None])
        inverses = [np.asarray(np.linalg.inv(each)) for each in S]
        for rule, Y, inverse in zip(self._inequalities, point.Y, inverses, strict=True):
            flat = rule.extra.reshape(q, -1)
            moved = _symmetric(Y @ rule.extra @ inverse).reshape(q, -1)
            matrix[:n, :n] += rule.share**2 * products_by_pairs(self._part, Y, inverse)
            matrix[:n, n:] += rule.share * (self._each @ moved.T)
            matrix[n:, n:] += flat @ moved.T
            right[:n] += mu * rule.share * (self._each @ inverse.ravel())
            right[n:] += mu * (flat @ inverse.ravel())
        matrix[n:, :n] = matrix[:n, n:].T
        matrix[n:, n:] = _symmetric(matrix[n:, n:])
        ones = np.concatenate([np.ones(n), np.zeros(q)])
        factor = scipy.linalg.cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
        a, b = scipy.linalg.cho_solve(factor, np.column_stack([right, ones]), check_finite=False).T
        change = a + (self._count - point.w.sum() - a[:n].sum()) / b[:n].sum() * b
        if not np.isfinite(change).all():
            raise np.linalg.LinAlgError
        dw, dx = change[:n], change[n:]
        dM = (dw @ self._each).reshape(S[0].shape)
        dS = [rule.share * dM + np.tensordot(dx, rule.extra, 1) for rule in self._inequalities]
        dY = [
            mu * inverse - Y - _symmetric(Y @ d @ inverse)
            for Y, d, inverse in zip(point.Y, dS, inverses, strict=True)
        ]
        return dw, dx, dS, dY


def _symmetric(matrices: FloatArray) -> FloatArray:
    return np.asarray((matrices + np.swapaxes(matrices, -1, -2)) / 2.0)


def _reach(matrix: FloatArray, change: FloatArray) -> float:
    """How far a step may go before a matrix is no longer positive definite."""
    try:
        L = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return 0.0
    half = scipy.linalg.solve_triangular(L, change, lower=True, check_finite=False)
    inner = scipy.linalg.solve_triangular(L, half.T, lower=True, check_finite=False)
    least = float(np.linalg.eigvalsh(_symmetric(inner))[0])
    return 1.0 if least >= 0.0 else min(1.0, TO_THE_WALL / -least)
