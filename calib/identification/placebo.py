"""Placebos: what detectors find where there is nothing, by the residuals of the set itself.

A detector looks for the likeliest of many effects. How likely the likeliest one is where there is
none depends on what the model lacks: reflectors share the deviation of their pose, residuals have
heavy tails, and errors of the arm that no parameter describes are alike at similar postures. So the
null distribution is that of the same statistic over placebos:

reordered
    The poses in another order, each with its residuals. For changes in the course of the
    measurements; exact where the order says nothing of the poses (a permutation test).
exchanged
    The residuals of whole poses are exchanged between postures. For patterns over the postures
    (Freedman and Lane, J. Bus. Econ. Stat. 1, 1983).
smooth
    Residuals that are as smooth over the postures as the measured ones: the signs of their
    components along the eigenvectors of the distances between postures are drawn at random (Moran
    spectral randomization: Wagner and Dray, Methods Ecol. Evol. 6, 2015). Poses that were visited
    in blocks or on a short tour have neighbours in time that are neighbours in space. An effect
    then has to explain more than such a pattern does.

An effect has to be beyond the placebos of two kinds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.identification.held import Held, ScoreTests
from calib.se3 import FloatArray, IntArray

DRAWS, _AT_ONCE = 1600, 100
"""Placebos of each kind, and how many of them are tested at once."""

_TAIL = 0.25
"""Share of the largest log odds that their scale is taken from."""

_SAME = 1e-6
"""Difference of log odds within which an order splits the poses as the measured one does: it is the
same explanation, not another one."""

_SEED = 0

Tried = tuple[ScoreTests, float]
"""Effects that are tested, and the logarithm of how many others are tried beside them."""


@dataclass(frozen=True)
class Chance:
    """Comparison of the log odds of several effects together with those of placebos."""

    probability: float  # of placebos as large; an upper bound of no use where it is not small
    scale: float
    """Log odds that placebos exceed a bound by, on average: 1 at least, as likelihood ratios do of
    a model that lacks nothing. So many are worth a unit of log odds."""


Draw = Callable[[int], FloatArray]
"""Log odds ``(B,)`` of all effects together in so many placebos; of none: in what was measured."""


def chance_of(held: Held, tried: Sequence[Tried], level: float, *, course: bool) -> Chance:
    """Return how probable log odds as large as those of the residuals are without any effect.

    Parameters
    ----------
    level : float
        Probability of interest. Where it is clear that the probability is larger, no further
        placebos are drawn.
    course : bool
        The effects are changes in the course of the measurements, not patterns of all of them.
    """
    worst, scale = 0.0, 1.0
    of_order = _reordered if course else _exchanged
    for draw in (_smooth(held, tried), of_order(held, tried)):
        own, found, as_large = draw(0)[0], np.zeros(0), 0
        while len(found) < DRAWS and as_large <= level * DRAWS:
            found = np.append(found, draw(_AT_ONCE))
            as_large = int(np.sum(found > own + _SAME))
        worst = max(worst, (1 + as_large) / (1 + len(found)))
        bound = np.quantile(found, 1.0 - _TAIL)
        scale = max(scale, float(np.mean(np.maximum(found - bound, 0.0))) / _TAIL)
        if worst > level:
            break
    return Chance(worst, scale)


def _together(tried: Sequence[Tried], odds: Callable[[ScoreTests], FloatArray]) -> FloatArray:
    return np.asarray(np.logaddexp.reduce([odds(test) - log for test, log in tried], axis=0))


def _reordered(held: Held, tried: Sequence[Tried]) -> Draw:
    rng, count = np.random.default_rng(_SEED), int(held.data.pose.max()) + 1

    def draw(draws: int) -> FloatArray:
        orders = np.tile(np.arange(count), (max(draws, 1), 1))
        orders = rng.permuted(orders, axis=1) if draws else orders
        return _together(tried, lambda test: test.odds_in_orders(orders))

    return draw


def _exchanged(held: Held, tried: Sequence[Tried]) -> Draw:
    table, rng = _Poses.of(held), np.random.default_rng(_SEED)

    def draw(draws: int) -> FloatArray:
        orders = np.tile(np.arange(len(table.rows)), (draws, 1))
        return np.asarray(table.rows[rng.permuted(orders, axis=1)])

    return _of_residuals(table, tried, draw)


def _smooth(held: Held, tried: Sequence[Tried]) -> Draw:
    table, rng = _Poses.of(held), np.random.default_rng(_SEED)
    q = held.data.postures[np.unique(table.pose, return_index=True)[1]]
    D = np.linalg.norm(q[:, None] - q, axis=2)
    centred = D - D.mean(axis=0) - D.mean(axis=1)[:, None] + D.mean()
    basis = np.linalg.eigh(centred)[1]
    along = basis.T @ table.rows

    def draw(draws: int) -> FloatArray:
        return np.asarray(basis @ (rng.choice([-1.0, 1.0], (draws, len(along), 1)) * along))

    return _of_residuals(table, tried, draw)


def _of_residuals(table: _Poses, tried: Sequence[Tried], drawn: Draw) -> Draw:
    """Log odds where residuals ``(B, P, w)`` of poses are drawn."""

    def draw(draws: int) -> FloatArray:
        rows = table.fitted(drawn(draws)) if draws else table.held.rows[..., None]
        return _together(tried, lambda test: test.odds_of_all(rows))

    return draw


@dataclass(frozen=True, eq=False)
class _Poses:
    """Residuals of a set, a row for each pose."""

    held: Held
    pose: IntArray  # (N,)
    place: IntArray  # (N,): of each measurement among those of its pose, by kind and tool
    rows: FloatArray  # (P, w)

    @classmethod
    def of(cls, held: Held) -> _Poses:
        """Arrange the residuals by poses; noughts where a pose lacks what others have."""
        pose, place = held.data.pose, _places(held)
        rows = np.zeros((int(pose.max()) + 1, int(place.max()) + 1, held.rows.shape[1]))
        rows[pose, place] = held.rows
        return cls(held, pose, place, rows.reshape(len(rows), -1))

    def fitted(self, drawn: FloatArray) -> FloatArray:
        """Return ``V⁻¹y`` ``(N, m, B)`` of residuals ``(B, P, w)``, of the squares measured."""
        held = self.held
        by_place = drawn.reshape(*drawn.shape[:2], -1, held.rows.shape[1])
        y = np.moveaxis(by_place[:, self.pose, self.place], 0, -1)
        left = held.without(y)
        squares = np.sum(y * left, axis=(0, 1))
        return np.asarray(left * np.sqrt(held.squares / np.maximum(squares, 1e-300)))


def _places(held: Held) -> IntArray:
    """Place ``(N,)`` of each measurement among those of its pose: by kind and tool."""
    data = held.data
    seen: dict[tuple[int, int, int], int] = {}
    found: dict[tuple[int, int, int], int] = {}
    out = np.zeros(data.count, dtype=np.intp)
    keys = zip(data.pose.tolist(), data.setup.kind.tolist(), data.setup.tool.tolist(), strict=True)
    for i, (pose, kind, tool) in enumerate(keys):
        again = seen[pose, kind, tool] = seen.get((pose, kind, tool), -1) + 1
        out[i] = found.setdefault((kind, tool, again), len(found))
    return out
