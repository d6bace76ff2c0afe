"""Times of several ways to do the same, taken in turns, and their ratios."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from calib.se3 import FloatArray

Call = Callable[[], object]


def in_turns(calls: Mapping[str, Call], clock: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Median seconds ``(turns,)`` of each call.

    A few rounds of one, then of the next, and again, so that what else runs and the changing clock
    of the processor meet all alike. The first call of a turn is not counted: memory is as the other
    calls left it. Seconds are those of the process, of all its threads.
    """
    found: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(clock["turns"]):
        for name, call in calls.items():
            call()
            found[name].append(_median(call, clock["rounds"], clock["seconds"]))
    return {name: np.array(own) for name, own in found.items()}


def _median(call: Call, rounds: int, seconds: float) -> float:
    times: list[float] = []
    while not times or (len(times) < rounds and sum(times) < seconds):
        times.append(once(call))
    return float(np.median(times))


def once(call: Call) -> float:
    """Seconds of one call."""
    start = time.process_time()
    call()
    return time.process_time() - start


def ratio(theirs: FloatArray, ours: FloatArray) -> dict[str, float]:
    """Their time over ours: the median of the turns, the least and the largest."""
    each = theirs / ours
    return {
        "ratio": float(np.median(each)),
        "ratio_low": float(each.min()),
        "ratio_high": float(each.max()),
        "theirs_ms": 1e3 * float(np.median(theirs)),
        "ours_ms": 1e3 * float(np.median(ours)),
    }
