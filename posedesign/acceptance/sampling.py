"""How many places prove that errors are below a limit, and the chance that they will.

A place is good where its error is within the limit. Of n places drawn at random of which at most a
are not good, the statement "at least the part P of all places is good" holds with confidence C
where a box with no more than P good places would show so few bad ones with a chance of at most
1 - C (Clopper and Pearson 1934; Wilks 1941 for a = 0, where it is P^n <= 1 - C, and n = 59 for 95 %
and 95 %):

    sum over k = 0 .. a of (n choose k) (1 - P)^k P^(n-k)  <=  1 - C.

Nothing is assumed of how errors are distributed. Places may be drawn one in each of n parts of
equal volume: the sum is then at most what it is for places drawn anywhere (Hoeffding 1956, theorem
4, for a <= n (1 - P) - 1; for a = 0 by the inequality of the means), and the statement still holds.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from calib.errors import InputError
from calib.se3 import FloatArray

MOST_PLACES = 1000
"""More is no acceptance test, but a slip of the keyboard."""


def places_needed(content: float, confidence: float, allowed: int = 0) -> int:
    """The fewest places that can prove it.

    ``content``, ``confidence``: P and C, between 0 and 1. ``allowed``: places that may be beyond
    the limit. Raises InputError: a number that is none, or more than :data:`MOST_PLACES` places.
    """
    for name, value in (("content", content), ("confidence", confidence)):
        if not 0.0 < value < 1.0:
            raise InputError(
                f"a {name} of {value:g}", hint="give a part between 0 and 1: 0.95", name=name
            )
    if not 0 <= allowed < MOST_PLACES:
        raise InputError(f"{allowed} places beyond the limit", name="allowed")
    counts = np.arange(allowed + 1, MOST_PLACES + 1)
    chance = np.asarray(stats.binom.cdf(allowed, counts, 1.0 - content))
    enough = chance <= (1.0 - confidence) * (1 + 1e-12)
    if not enough.any():
        raise InputError(
            f"{100 * content:g} % with confidence {100 * confidence:g} % takes more than "
            f"{MOST_PLACES} places",
            hint="ask for less, or allow fewer beyond the limit",
            name="content",
        )
    return int(counts[np.argmax(enough)])


def content_proven(count: int, beyond: int, confidence: float) -> float:
    """The part of all places that is good with this confidence (Clopper and Pearson, one-sided)."""
    if beyond >= count:
        return 0.0
    return float(1.0 - stats.beta.ppf(confidence, beyond + 1, count - beyond))


def chance_to_pass(errors: FloatArray, limit: float, allowed: int = 0) -> float:
    """Part of tests ``(T, n)`` of errors in which no more places than allowed are beyond it."""
    return float(np.mean((np.asarray(errors) > limit).sum(axis=1) <= allowed))


def spread_points(low: FloatArray, high: FloatArray, count: int) -> list[tuple[FloatArray, ...]]:
    """A box as ``count`` boxes of equal volume, each by its corners ``(3,)``.

    It is halved across its longest edge, or cut so that both sides have their share, again and
    again.
    """
    if count == 1:
        return [(np.asarray(low, dtype=float), np.asarray(high, dtype=float))]
    first = count // 2
    axis = int(np.argmax(high - low))
    cut = low[axis] + (high[axis] - low[axis]) * first / count
    upper, lower = np.array(high, dtype=float), np.array(low, dtype=float)
    upper[axis] = lower[axis] = cut
    return [*spread_points(low, upper, first), *spread_points(lower, high, count - first)]
