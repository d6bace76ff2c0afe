"""Coupled limits, what a posture must keep to, and which full turns of its joints do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import InputError
from calib.robots.chain import NO_EXTERNAL_AXES, ExternalAxes
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class CoupledLimit:
    """A bound on a sum of joint values: ``lower <= coefficients @ q <= upper``."""

    name: str  # as reasons say it, e.g. ``J3 to the horizontal``.
    coefficients: FloatArray  # (n,)
    lower: float
    upper: float  # lower, upper [rad]; infinite where there is none

    def margin(self, q: FloatArray) -> FloatArray:
        """Distance [rad] of postures ``(..., n)`` from the nearer bound; negative outside."""
        value = q @ self.coefficients
        return np.asarray(np.minimum(value - self.lower, self.upper - value))


LIMIT_TOLERANCE = 1e-9
"""Excess over a joint limit [rad] that is rounding: a posture on its limit is inside."""

TURN = 2.0 * np.pi

_MOST_TURNED = 5_000_000
"""Postures that full turns may make of some: 240 MB of six joints. Six joints of +-360 deg make 64
of each; only limits of many turns make more than anybody can look at."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Limits of each joint, and those that joints have together, a margin taken off."""

    lower: FloatArray
    upper: FloatArray  # lower, upper (n,) [rad], of joints that slide [m]
    coupled: tuple[CoupledLimit, ...] = ()
    margin: float = 0.0
    """Distance to keep from the coupled limits [rad]; ``lower`` and ``upper`` have it already, but
    for slides."""

    @classmethod
    def within(
        cls,
        lower: FloatArray,
        upper: FloatArray,
        coupled: Sequence[CoupledLimit] = (),
        margin: float = 0.0,
        external: ExternalAxes = NO_EXTERNAL_AXES,
    ) -> Bounds:
        """Bounds that keep a margin [rad] from limits ``(n,)``, but of the joints that slide."""
        kept = np.where(external.slides_of(len(lower)), 0.0, margin)
        return cls(lower + kept, upper - kept, tuple(coupled), margin)

    def behind(self, count: int) -> Bounds:
        """Those of the joints behind the first ones, which have no coupled limits."""
        coupled = [replace(c, coefficients=c.coefficients[count:]) for c in self.coupled]
        return Bounds(self.lower[count:], self.upper[count:], tuple(coupled), self.margin)

    def excess(self, q: FloatArray) -> FloatArray:
        """How far postures ``(S, n)`` break each limit, ``(S, n + coupled)`` [rad].

        Negative inside. One column for each joint, then one for each coupled limit.
        """
        single = np.maximum(self.lower - q, q - self.upper)
        together = [self.margin - limit.margin(q) for limit in self.coupled]
        return np.column_stack([single, *together])

    def coupled_fit(self, q: FloatArray) -> BoolArray:
        """Whether postures ``(S, n)`` keep the limits that joints have together, ``(S,)``."""
        fits = np.ones(len(q), dtype=bool)
        for limit in self.coupled:
            fits &= limit.margin(q) >= self.margin - LIMIT_TOLERANCE
        return fits


def nearest_turns(
    postures: FloatArray, lower: FloatArray, upper: FloatArray, near: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Shift joints of ``(S, n)`` by full turns into limits, as near to a reference as they allow.

    And which are inside ``(S,)``. Where no turn of a joint fits, it is in the one that breaks its
    limit least.
    """
    lowest, highest = _turns(postures, lower, upper)
    wanted = np.rint((near - postures) * (1.0 / TURN))
    picked = postures + TURN * np.minimum(np.maximum(wanted, lowest), highest)
    fits = lowest <= highest
    inside = np.asarray(fits.all(axis=-1))
    if not inside.all():
        row, j = np.nonzero(~fits)
        # where none fits, lowest lands above the range and highest below it
        above = postures[row, j] + TURN * lowest[row, j]
        below = postures[row, j] + TURN * highest[row, j]
        picked[row, j] = np.where(above - upper[j] < lower[j] - below, above, below)
    return picked, inside


def _turns(
    postures: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fewest and most full turns ``(S, n)`` that bring each joint inside; crossed if none does."""
    lowest = np.ceil((lower - LIMIT_TOLERANCE - postures) * (1.0 / TURN))
    highest = np.floor((upper + LIMIT_TOLERANCE - postures) * (1.0 / TURN))
    return lowest, highest


def every_turn(
    postures: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, IntArray]:
    """All combinations of full turns of postures ``(S, n)`` [rad] that lie inside limits ``(n,)``.

    And the row ``(K,)`` that each comes from: those of row 0 first, from the lowest turns up, the
    last joint the quickest. None for a row that does not fit.
    """
    lowest, highest = _turns(postures, lower, upper)
    count = np.maximum(highest - lowest + 1.0, 0.0)
    most = float(count.prod(axis=1).sum())
    if most > _MOST_TURNED:
        raise InputError(
            f"{len(postures)} arm positions have {most:.3g} postures in every turn of their joints",
            hint="give fewer poses, narrower limits, or only the nearest turns",
            name="every_turn",
            value=most,
            bound=_MOST_TURNED,
        )
    choices = count.astype(np.intp)
    total = choices.prod(axis=1)
    source = np.repeat(np.arange(len(postures)), total)
    rank = np.arange(len(source)) - np.repeat(np.cumsum(total) - total, total)
    turned = postures[source] + TURN * lowest[source]
    for j in range(postures.shape[1] - 1, -1, -1):
        rank, digit = np.divmod(rank, choices[source, j])
        turned[:, j] += TURN * digit
    return turned, source


def turned_inside(
    postures: FloatArray, pose: IntArray, bounds: Bounds, near: FloatArray, every: bool
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Postures ``(S, n)`` with full turns chosen, the nearest to a reference or ``every`` one.

    Of poses ``(S,)`` in ascending order: postures ``(K, n)``, their poses ``(K,)``, and which are
    inside ``(K,)``. An arm position of which no turn is inside is given once, in the turn that
    breaks the joints' own limits least.
    """
    picked, inside = nearest_turns(postures, bounds.lower, bounds.upper, near)
    if bounds.coupled:
        inside &= bounds.coupled_fit(picked)
    if not every and (inside.all() or not bounds.coupled):
        return picked, pose, inside
    # an arm position that breaks a coupled limit may keep it in another turn
    again = np.arange(len(postures)) if every else np.flatnonzero(~inside)
    turned, source = every_turn(postures[again], bounds.lower, bounds.upper)
    keep = bounds.coupled_fit(turned)
    turned, source = turned[keep], again[source[keep]]
    if not every:
        distance = np.linalg.norm(turned - near, axis=1)
        best = first_per_group(source, distance, len(postures))
        better = best >= 0
        picked[better], inside[better] = turned[best[better]], True
        return picked, pose, inside
    without = np.ones(len(postures), dtype=bool)
    without[source] = False
    row = np.concatenate([source, np.flatnonzero(without)])
    order = np.argsort(row, kind="stable")
    everything = np.concatenate([turned, picked[without]])[order]
    return everything, pose[row[order]], ~without[row[order]]


def first_per_group(group: IntArray, cost: FloatArray, count: int) -> IntArray:
    """Index of the cheapest entry of each of ``count`` groups, of equals the first; -1: empty."""
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, group, cost)
    cheapest = np.flatnonzero(cost == lowest[group])[::-1]
    first = np.full(count, -1, dtype=np.intp)
    first[group[cheapest]] = cheapest
    return first
