"""The best weights where the cost is not smooth: the longest axis, and conditions.

A primal-dual interior-point method for weights of candidates under matrix inequalities::

    min  c·x   over weights 0 <= w <= 1 with sum n, and further unknowns x, such that
    S_k = a_k M(w) + sum_e x_e E_ke   is positive semidefinite for every k, and  R x >= 0

Steps are those of Helmberg et al. 1996, Kojima et al. 1997 and Monteiro 1997: with the dual
``Y_k`` of each inequality, ``Y + dY = μ S⁻¹ - sym(Y dS S⁻¹)``. As M is linear in the weights with
blocks of few rows, the matrix of a step is made of thin products; a general solver has to be told
every entry of every block. What the method returns is only believed as far as the proof that its
dual gives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from calib.se3 import FloatArray
from posedesign.selection.candidates import Candidates, products_by_pairs
from posedesign.selection.certificate import ConditionCertificate, MeanCertificate, Relaxation
from posedesign.selection.relaxation import (
    BOLD,
    LONG,
    TIMID,
    Solved,
    newton_step,
    reach,
    relax_on_sets,
)

MOST_STEPS = 60
"""Newton steps; fifteen are usual."""

TO_THE_WALL = 0.95
"""Part of the way to the border of what is allowed that a step goes at most."""

MOST_RATIOS = 25
"""Ratios tried in the search for the smallest; about six are seen."""

INNER = 0.3
"""Part of the tolerance to which a working set is solved."""

SEEN = 1e-3
"""Weights above are taken to count; the method leaves others a little above zero."""

HOPELESS = 1e14
"""Ratio from which nothing is tried: eigenvalues so far apart are rounding."""

DECIDED = 0.1
"""Part of the slack at which a trial of a ratio has said what it can."""


@dataclass(frozen=True, eq=False)
class Inequality:
    """``share M(w) + sum_e x_e extra_e`` is positive semidefinite."""

    share: float
    extra: FloatArray  # shape (q, p, p)


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
        """The points after each step, from one that is strictly inside, till none can be made.

        ``mu``: complementarity to begin with.
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
            walls, pushed = low / point.w + high / rest, mu / point.w - mu / rest
            try:
                dw, dx, dS, dY = self._step(point, S, walls, pushed, dual, mu)
            except np.linalg.LinAlgError:
                return
            d_low = mu / point.w - low - low / point.w * dw
            d_high = mu / rest - high + high / rest * dw
            Rx, dRx = self._rows @ point.x, self._rows @ dx
            d_dual = mu / Rx - dual - dual / Rx * dRx
            primal = min(
                reach(point.w, dw), reach(rest, -dw), reach(Rx, dRx), *map(_matrix_reach, S, dS)
            )
            walls_reach = min(reach(low, d_low), reach(high, d_high), reach(dual, d_dual))
            length = min(walls_reach, *map(_matrix_reach, point.Y, dY))
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
        change = newton_step(matrix, right, n, self._count - point.w.sum())
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


def _matrix_reach(matrix: FloatArray, change: FloatArray) -> float:
    """How far a step may go before a matrix is no longer positive definite."""
    from scipy.linalg import solve_triangular

    try:
        L = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return 0.0
    half = solve_triangular(L, change, lower=True, check_finite=False)
    inner = solve_triangular(L, half.T, lower=True, check_finite=False)
    least = float(np.linalg.eigvalsh(_symmetric(inner))[0])
    return 1.0 if least >= 0.0 else min(1.0, TO_THE_WALL / -least)


def relax_smallest(
    candidates: Candidates, K: FloatArray, count: int, tolerance: float
) -> Relaxation:
    """The weights with the largest smallest eigenvalue of the information about ``Kᵀ x``.

    ``max t`` with ``M(w) - t K Kᵀ`` positive semidefinite; its dual variable is the proof.
    """

    def solve(part: Candidates) -> Solved:
        w, Z, cost = _smallest(part, K, count, INNER * tolerance)
        return Solved(w, cost, MeanCertificate(Z, K, np.inf), lambda pool: pool.scores(Z))

    known = MeanCertificate(np.eye(candidates.p), K, np.inf)
    return relax_on_sets(solve, candidates, count, tolerance, _sizes(candidates, count), known)


def _smallest(
    part: Candidates, K: FloatArray, count: int, tolerance: float
) -> tuple[FloatArray, FloatArray, float]:
    """Weights, the dual, and the cost, on a working set."""

    def cost_of(w: FloatArray) -> float:
        return float(np.linalg.eigvalsh(K.T @ np.linalg.solve(part.weighted(w), K))[-1])

    best_w = np.full(part.N, min(1.0, count / part.N))
    best, proven, best_Z = cost_of(best_w), 0.0, np.eye(part.p)
    if count >= part.N:
        return best_w, best_Z, best
    B = K @ K.T / (2.0 * best)  # in units of which the first t is 1
    M = part.weighted(best_w)
    program = Program(part, count, [Inequality(1.0, -B[None])], np.array([-1.0]))
    mu = 1.0 / float(np.sum(np.linalg.inv(M - B) * B))
    for point in program.points(best_w, np.ones(1), mu):
        found = cost_of(point.w)
        if found < best:
            best, best_w = found, point.w
        reached = MeanCertificate(point.Y[0], K, np.inf).bound(part, count)
        if reached > proven:
            proven, best_Z = reached, point.Y[0]
        if proven >= (1.0 - tolerance) * best:
            break
    return best_w, best_Z, best


def relax_condition(
    candidates: Candidates,
    count: int,
    tolerance: float,
    lowest: FloatArray,
    highest: FloatArray,
    *,
    root: bool,
) -> Relaxation:
    """The weights with the smallest ratio of extreme eigenvalues, parameters rescaled at best.

    ``F <= M(w) <= ratio F`` with a diagonal F between the bounds, up to a common factor: for a
    given ratio a linear program over matrices. The solution of one ratio has a smaller one of its
    own, its duals prove another, and the next ratio tried lies between the two.

    ``lowest``, ``highest`` (p,): between which the squares of the scales lie. ``root``: the cost is
    the root of the ratio.
    """
    inner = INNER * tolerance * (2.0 if root else 1.0)  # of the square

    def solve(part: Candidates) -> Solved:
        search = _RatioSearch(part, count, lowest, highest)
        search.run(inner)
        Y, Z, proven = search.Y, search.Z, search.proven
        return Solved(
            search.w,
            float(np.sqrt(search.ratio)) if root else search.ratio,
            ConditionCertificate(Y, Z, lowest, highest, root),
            # what raises the small eigenvalues more than it raises the large ones is wanted
            lambda pool: pool.scores(Y) - pool.scores(Z) / proven,
        )

    return relax_on_sets(solve, candidates, count, tolerance, _sizes(candidates, count))


class _RatioSearch:
    """The smallest ratio on a working set.

    ``w`` (n,): the best weights found. ``ratio``: of these. ``Y``, ``Z`` (p, p): duals of the
    strongest proof, on the working set. ``proven``: what it proves there.
    """

    def __init__(
        self, part: Candidates, count: int, lowest: FloatArray, highest: FloatArray
    ) -> None:
        self._part, self._count = part, count
        self._lowest, self._highest = lowest, highest
        self._shape, self._rows, start = _diagonals(lowest, highest)
        self.w = np.full(part.N, min(1.0, count / part.N))
        if not np.isfinite(highest).all():
            start = np.diag(part.weighted(self.w))
        self._f = self._fitted(self.w, start)
        self.ratio = self._own(self.w, self._f)
        self.Y = self.Z = np.eye(part.p)
        self.proven = 1.0

    def _fitted(self, w: FloatArray, f: FloatArray) -> FloatArray:
        """Unknowns of a diagonal F, times what makes it as large as it may be below ``M(w)``."""
        scale = np.sqrt(f @ self._shape)
        values = np.linalg.eigvalsh(self._part.weighted(w) / np.outer(scale, scale))
        return np.asarray(f * max(values[0], np.finfo(float).eps * values[-1]))

    def _own(self, w: FloatArray, f: FloatArray) -> float:
        F = f @ self._shape
        if not (F > 0.0).all():
            return np.inf
        scale = np.sqrt(F)
        values = np.linalg.eigvalsh(self._part.weighted(w) / np.outer(scale, scale))
        return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf

    def run(self, tolerance: float) -> None:
        """Try ratios until the best is as small as what is proven, but for a part ``tolerance``."""
        if self._count >= self._part.N or not self.ratio < HOPELESS:
            return
        for _ in range(MOST_RATIOS):
            before = (self.ratio, self.proven)
            self._try(float(np.sqrt(self.ratio * max(self.proven, self.ratio / 16.0))), tolerance)
            if self.proven >= (1.0 - tolerance) * self.ratio or (self.ratio, self.proven) == before:
                break

    def _try(self, ratio: float, tolerance: float) -> None:
        """Look for ``F <= M(w) <= ratio F``, with as little slack as there must be."""
        part, q = self._part, len(self._shape)
        w0 = 0.9 * self.w + 0.1 * self._count / part.N  # off the walls
        f0 = self._fitted(w0, self._f)
        F = f0 @ self._shape
        diagonal = np.zeros((q + 1, part.p, part.p))
        j = np.arange(part.p)
        diagonal[:q, j, j] = self._shape
        below, above = -diagonal, diagonal.copy()
        below[q, j, j] = above[q, j, j] = F
        rules = [Inequality(1.0, below), Inequality(-1.0 / ratio, above)]
        cost = np.concatenate([np.zeros(q), [1.0]])
        rows = np.column_stack([self._rows, np.zeros(len(self._rows))])
        program = Program(part, self._count, rules, cost, rows)
        slack = max(0.5, 2.0 * self._own(w0, f0) / ratio)
        M = part.weighted(w0)
        inside = [M + np.diag((slack - 1.0) * F), np.diag((1.0 + slack) * F) - M / ratio]
        mu = 1.0 / sum(float(np.diag(np.linalg.inv(S)) @ F) for S in inside)
        for point in program.points(w0, np.concatenate([f0, [slack]]), mu):
            own = self._own(point.w, point.x[:q])
            if own < self.ratio:
                self.ratio, self.w, self._f = own, point.w, point.x[:q]
            proof = ConditionCertificate(point.Y[0], point.Y[1], self._lowest, self._highest)
            reached = proof.of_ratio(part, self._count)
            if reached > self.proven:
                self.proven, (self.Y, self.Z) = reached, point.Y
            near = self.proven >= (1.0 - tolerance) * self.ratio
            if near or point.gap <= DECIDED * abs(point.x[q]):
                break


def _diagonals(
    lowest: FloatArray, highest: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unknowns of which a diagonal between bounds, up to a common factor, is made.

    Returns the diagonal for each unknown ``(q, p)``, rows ``(l, q)`` of what must not be negative,
    and the unknowns in the middle ``(q,)``.
    """
    p = len(lowest)
    if not np.isfinite(highest).all():
        return np.eye(p), np.zeros((0, p)), np.ones(p)
    free = np.flatnonzero(highest - lowest > 1e-6 * highest)
    fixed = np.ones(p, dtype=bool)
    fixed[free] = False
    shape = np.zeros((1 + len(free), p))
    shape[0] = np.where(fixed, highest, 0.0)
    shape[1 + np.arange(len(free)), free] = 1.0
    k = np.arange(len(free))
    rows = np.zeros((2 * len(free), 1 + len(free)))
    rows[k, 1 + k], rows[k, 0] = 1.0, -lowest[free]
    rows[len(free) + k, 1 + k], rows[len(free) + k, 0] = -1.0, highest[free]
    start = np.concatenate([[1.0], (lowest[free] + highest[free]) / 2.0])
    return shape, rows, start


def _sizes(candidates: Candidates, count: int) -> tuple[int, int, float]:
    return max(4 * count, 6 * candidates.p, 100), max(2 * count, 60), SEEN
