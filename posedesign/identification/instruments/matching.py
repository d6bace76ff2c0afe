"""Readings and joints that belong together: by the names of poses, by time, or in order.

An arm that is recorded without end stands still at its poses: there the mean is taken, and what was
read while it moved belongs to no pose. Rows of joints that were written one a pose are such stops
themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.se3 import BoolArray, FloatArray, IntArray

GAP = 5.0
"""Times the usual time between two rows of a record from which it has a gap."""

CREEP = 3.0
"""Times the range of a standstill that one stop may have over all its time."""

_MOST_SHOWN = 3


@dataclass(frozen=True, eq=False)
class Stops:
    """Where something stood still.

    ``first``, ``last`` (K,): rows of the record that each is the mean of. ``creeping``: those that
    were no standstill: too slow to be seen in a short time.
    """

    first: IntArray
    last: IntArray
    creeping: tuple[int, ...] = ()

    @property
    def middle(self) -> Stops:
        """The middle half of each: at its ends an arm still moves, within the range."""
        quarter = (self.last - self.first) // 4
        return Stops(self.first + quarter, self.last - quarter)

    def mean(self, values: FloatArray) -> FloatArray:
        """Means ``(K, m)`` of rows ``(N, m)`` over each stop."""
        return np.array(
            [values[a : b + 1].mean(axis=0) for a, b in zip(self.first, self.last, strict=True)]
        ).reshape(len(self.first), values.shape[1])


def stops_of(times: FloatArray, values: FloatArray, still_s: float, bound: float) -> Stops:
    """Where rows ``(N, m)`` of a record stay within a range for a time.

    ``times`` (N,): rising [s]. ``still_s``: least time. ``bound``: largest range of each column in
    this time.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    usual = float(np.median(np.diff(times)))
    width = max(2, round(still_s / usual) + 1)
    if width > len(times):
        return Stops(*np.zeros((2, 0), dtype=np.intp))
    to_first = -(width // 2)  # the range of each window stands at its first row
    span = maximum_filter1d(values, width, axis=0, origin=to_first) - minimum_filter1d(
        values, width, axis=0, origin=to_first
    )
    count = len(times) - width + 1
    steady = (span[:count] <= bound).all(axis=1)
    whole = times[width - 1 :] - times[:count] <= (width - 1) * usual + GAP * usual
    begins = np.flatnonzero(steady & whole)
    inside = np.zeros(len(times) + 1, dtype=int)
    np.add.at(inside, begins, 1)
    np.add.at(inside, begins + width, -1)
    still = np.cumsum(inside)[:-1] > 0
    broken = np.append(np.diff(times) > GAP * usual, True)
    ends = np.flatnonzero(still & (~np.append(still[1:], False) | broken))
    firsts = np.flatnonzero(still & (~np.append(False, still[:-1]) | np.append(True, broken[:-1])))
    creeping = [
        k
        for k, (a, b) in enumerate(zip(firsts.tolist(), ends.tolist(), strict=True))
        if (np.ptp(values[a : b + 1], axis=0) > CREEP * bound).any()
    ]
    kept = np.setdiff1d(np.arange(len(firsts)), creeping)
    return Stops(firsts[kept], ends[kept], tuple(firsts[creeping].tolist()))


def is_record(times: FloatArray, still_s: float) -> bool:
    """Whether rows are many a standstill, and not one a pose."""
    return len(times) > 2 and float(np.median(np.diff(times))) < 0.5 * still_s


@dataclass(frozen=True, eq=False)
class Matched:
    """Which stop each reading belongs to.

    ``stop`` (N,): below zero for none. ``reason``: why there is none; empty for those that have
    one. ``how``: in words.
    """

    stop: IntArray
    reason: tuple[str, ...]
    how: str

    @property
    def is_found(self) -> BoolArray:
        return np.asarray(self.stop >= 0)

    def unmatched(self, lines: Sequence[int]) -> list[str]:
        """What belongs to no stop, in words: lines by their reason."""
        by_reason: dict[str, list[int]] = {}
        for i in np.flatnonzero(~self.is_found).tolist():
            by_reason.setdefault(self.reason[i], []).append(lines[i])
        return [f"{in_ranges(rows)}: {reason}" for reason, rows in by_reason.items()]


def in_ranges(lines: Sequence[int]) -> str:
    """Lines in words, neighbours as a range: ``lines 4 to 9 and 12``."""
    numbers = np.unique(np.asarray(lines))
    cut = np.flatnonzero(np.diff(numbers) > 1)
    starts, ends = numbers[np.append(0, cut + 1)], numbers[np.append(cut, len(numbers) - 1)]
    shown = [
        f"{a}" if a == b else f"{a} to {b}"
        for a, b in zip(starts[:_MOST_SHOWN].tolist(), ends[:_MOST_SHOWN].tolist(), strict=True)
    ]
    more = int((ends[_MOST_SHOWN:] - starts[_MOST_SHOWN:] + 1).sum())
    which = ", ".join(shown) + (f" and {more} more" if more else "")
    return f"line{'s' if len(numbers) > 1 else ''} {which}"


def match_names(wanted: Sequence[str], known: Sequence[str]) -> Matched:
    """By the names of poses."""
    index = {name: k for k, name in enumerate(known)}
    stop = np.array([index.get(name, -1) for name in wanted], dtype=np.intp)
    reason = tuple("" if name in index else f"there are no joints of {name}" for name in wanted)
    return Matched(stop, reason, "by name")


def match_times(
    times: FloatArray, start: FloatArray, end: FloatArray, record: FloatArray, tolerance_s: float
) -> Matched:
    """By time: the stop that a reading falls into, or the nearest one within a tolerance.

    ``times`` (N,): of the readings, on the clock of the joints [s]. ``start``, ``end`` (K,): of
    each stop, rising. ``record`` (R,): times of all rows of joints: empty where each is a stop.
    Within a record there is no tolerance: joints are known at any time, and an arm that moves
    stands at no pose.
    """
    k = np.searchsorted(start, times, side="right") - 1
    before, after = np.maximum(k, 0), np.minimum(k + 1, len(start) - 1)
    late = np.where(k < 0, np.inf, np.maximum(times - end[before], 0.0))
    early = np.where(k + 1 > len(start) - 1, np.inf, start[after] - times)
    stop, off = np.where(late <= early, before, after), np.minimum(late, early)
    stop = np.where(off <= (0.0 if record.size else tolerance_s), stop, -1)
    reason = [""] * len(times)
    for i in np.flatnonzero(stop < 0).tolist():
        reason[i] = _why(float(times[i]), float(off[i]), record, tolerance_s)
    return Matched(stop, tuple(reason), "by time")


def _why(time: float, off: float, record: FloatArray, tolerance_s: float) -> str:
    """Why no stop is at a time."""
    if not np.isfinite(time):
        return "it has no time"
    if not record.size:
        return f"no joints within {tolerance_s:g} s"
    if time < record[0]:
        return "read before the record of joints begins"
    if time > record[-1]:
        return "read after the record of joints ends"
    i = int(np.searchsorted(record, time))
    gap = float(record[min(i, len(record) - 1)] - record[max(i - 1, 0)])
    if gap > GAP * float(np.median(np.diff(record))):
        return "in a gap of the record of joints"
    return "the arm was not at rest"
