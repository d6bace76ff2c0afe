"""Stills of a recording: one picture of each stand-still of the arm, and why others were not taken.

An arm whose joints or poses are known by time stands where it moves slower than
:data:`~.arm_streams.STILL_PER_S` over :data:`~.arm_streams.WINDOW_S`. Of the pictures taken
meanwhile that are still themselves, the sharpest is taken. Where nothing is known of the arm, it
stands where pictures show the same for as long.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.hand_eye.recordings.arm_streams import (
    STILL_PER_S,
    WINDOW_S,
    ArmStream,
    speeds,
    stand_stills,
)
from posedesign.hand_eye.recordings.stillness import MOST_MOVED, StillnessOfPictures, still_runs

SAME_M_RAD = 2e-3
"""An arm that went on by less since the picture before stands at the same pose."""

_NO_PICTURE = "no picture was taken meanwhile"
_SHORT = "too short"
_MOVES = "the picture moves while the arm stands"
_SAME = "the arm did not go on since the still before"
_SHOWN_BEFORE = "shows what the still before shows"

LONGEST_OFFSET_S = 3.0
"""Offset of two clocks that is looked for."""

_COMPARED_S = 600.0
"""From the begin of a recording on, in which clocks are compared."""

_FEWEST_STARTS = 4
"""Times that the arm starts to move, from which on two clocks are compared."""

_LEAST_M_RAD = 1e-3
"""From one picture to the next, by which an arm moves at least that is seen to."""

_AGREEMENT, _GAIN = 0.85, 0.03
"""Share of the time in which arm and pictures must move and stand together for an offset to be
believed, and by how much it must be more than without an offset."""


@dataclass(frozen=True)
class StandStill:
    """A stand-still of the arm, and the picture taken of it."""

    begin_s: float
    end_s: float
    picture: int = -1  # index in the recording; -1 where none is taken
    reason: str = ""  # why none is taken


def stills_with_arm(
    seconds: FloatArray,
    seen: StillnessOfPictures,
    arm: ArmStream,
    arm_seconds: FloatArray,
    shortest_s: float = WINDOW_S,
) -> list[StandStill]:
    """Return the stand-stills of an arm, with a picture of each.

    ``seconds`` (K,): times of the pictures; ``arm_seconds`` (M,): of the arm, rising, by the same
    clock. Raises InputError: the arm never stands.
    """
    coordinates = arm.coordinates
    stands = stand_stills(arm_seconds, coordinates)
    long = [(begin, end) for begin, end in stands if end - begin >= shortest_s]
    if not long:
        slowest = float(speeds(arm_seconds, coordinates).min())
        raise InputError(
            f"{arm.source}: the arm never stands still for {shortest_s:g} s; at its slowest it "
            f"moves by {slowest:.2g} rad/s or m/s",
            hint="let it stand for a second at each pose; or take pictures of the moving arm, with "
            "`moving`: how much later than its joints they are is estimated then",
            name="recording",
        )
    is_still = _still_pictures(seconds, seen)
    sharpness = seen.sharpness
    found: list[StandStill] = []
    last: FloatArray | None = None
    for begin, end in stands:
        one = StandStill(begin, end)
        inside = np.flatnonzero((seconds >= begin) & (seconds <= end))
        if end - begin < shortest_s:
            found.append(replace(one, reason=_SHORT))
            continue
        if not len(inside):
            found.append(replace(one, reason=_NO_PICTURE))
            continue
        fine = inside[is_still[inside]]
        if not len(fine):
            found.append(replace(one, reason=_MOVES))
            continue
        best = int(fine[np.argmax(sharpness[fine])])
        at = coordinates[nearest(arm_seconds, seconds[best])]
        if last is not None and float(np.abs(at - last).max()) < SAME_M_RAD:
            found.append(replace(one, reason=_SAME))
            continue
        last = at
        found.append(replace(one, picture=best))
    return found


def stills_of_pictures(
    seconds: FloatArray, seen: StillnessOfPictures, shortest_s: float = WINDOW_S
) -> list[StandStill]:
    """Return the stand-stills that the pictures show themselves, with a picture of each.

    Raises InputError: they never stand.
    """
    runs, sharpness = seen.runs, seen.sharpness
    long = still_runs(seconds, runs, shortest_s)
    found: list[StandStill] = []
    last: int | None = None
    for run in np.unique(runs[long]).tolist():
        of = np.flatnonzero(runs == run)
        one = StandStill(float(seconds[of[0]]), float(seconds[of[-1]]))
        of = of[1:-1] if len(of) > 2 else of  # the arm may come and go in the first and the last
        if last is not None and seen.are_same(last, run):
            found.append(replace(one, reason=_SHOWN_BEFORE))
            continue
        last = run
        found.append(replace(one, picture=int(of[np.argmax(sharpness[of])])))
    if not found:
        raise InputError(
            f"the picture never stands still for {shortest_s:g} s",
            hint="let the arm stand for a second at each pose, and let nothing else move",
            name="recording",
        )
    return found


def _still_pictures(seconds: FloatArray, seen: StillnessOfPictures) -> BoolArray:
    """Pictures ``(K,)`` that are still, or have no other near enough in time to tell."""
    gap = np.diff(seconds, prepend=-np.inf, append=np.inf)
    alone = (gap[:-1] > WINDOW_S) & (gap[1:] > WINDOW_S)
    return np.asarray(still_runs(seconds, seen.runs, 0.5 * WINDOW_S) | alone)


def nearest(rising: FloatArray, at: float) -> int:
    """Return the index of the nearest of rising numbers."""
    return int(np.argmin(np.abs(rising - at)))


def why_not(stands: Iterable[StandStill]) -> str:
    """Return in words why stand-stills have no picture; empty where all have one."""
    counts = Counter(one.reason for one in stands if one.reason)
    return "; ".join(f"{count} {reason}" for reason, count in counts.most_common())


def check_clocks(
    seconds: FloatArray,
    seen: StillnessOfPictures,
    arm: ArmStream,
    arm_seconds: FloatArray,
    stands: Sequence[StandStill],
) -> str:
    """Return what to say of the clocks of pictures and arm; empty where they agree.

    Raises InputError: they differ by so much that pictures may be of another stand-still.
    """
    offsets = clock_offsets(seconds, seen.moved, arm_seconds, arm.coordinates)
    if not offsets:
        return ""
    offset = offsets[0]
    lengths = [one.end_s - one.begin_s for one in stands if one.picture >= 0]
    later = "later" if offset > 0 else "earlier"
    said = f"pictures move and stand {abs(offset):.2f} s {later} than {arm.source}"
    if lengths and abs(offset) < 0.5 * float(np.median(lengths)):
        return f"{said}: stills are from when both stand"
    others = " or ".join(f"{-other:.2f}" for other in offsets[1:3])
    raise InputError(
        f"{said}: their times are of two clocks",
        hint=f"if that is so, shift them: `time_offset_s` {-offset:.2f}"
        + (f"; the stops follow each other so evenly that it may be {others}" if others else ""),
        name="time_offset_s",
    )


def clock_offsets(
    seconds: FloatArray, moved: FloatArray, arm_seconds: FloatArray, coordinates: FloatArray
) -> list[float]:
    """Return by how much pictures move and stand later than the arm [s], the smallest first.

    Several where the stops follow each other evenly. None where it is within two pictures, or
    cannot be told: the arm moves too seldom, or they do not move together at any offset.
    """
    if len(seconds) < 2 * _FEWEST_STARTS:
        return []
    step = max(float(np.median(np.diff(seconds))), 0.02)
    begin, end = max(seconds[0], arm_seconds[0]), min(seconds[-1], arm_seconds[-1])
    grid = np.arange(begin, min(end, begin + _COMPARED_S), step)
    most = min(int(LONGEST_OFFSET_S / step), len(grid) // 4)
    if step > WINDOW_S or most < 3:
        return []
    at = np.column_stack([np.interp(grid, arm_seconds, column) for column in coordinates.T])
    went = np.abs(np.diff(at, axis=0, prepend=at[:1])).max(axis=1)
    arm = went > max(STILL_PER_S * step, _LEAST_M_RAD)
    picture = (moved > MOST_MOVED)[_nearest_of(seconds, grid)]
    if int((np.diff(arm.astype(int)) > 0).sum()) < _FEWEST_STARTS:
        return []
    lags = np.arange(-most, most + 1)
    middle = slice(most, len(grid) - most)
    agree = np.array([(np.roll(picture, -lag)[middle] == arm[middle]).mean() for lag in lags])
    best = float(agree.max())
    if best < _AGREEMENT or best < agree[most] + _GAIN:
        return []
    # the highest of neighbours, and as high as the best but for what chance does
    inner = np.pad(agree, 1)
    peaks = (agree >= inner[:-2]) & (agree > inner[2:]) & (agree > best - _GAIN)
    found = sorted((lags[peaks] * step).tolist(), key=abs)
    return found if abs(found[0]) > 2 * step else []


def _nearest_of(rising: FloatArray, at: FloatArray) -> IntArray:
    """Indices of the nearest of rising numbers, for many."""
    after = np.clip(np.searchsorted(rising, at), 1, len(rising) - 1)
    before = at - rising[after - 1] < rising[after] - at
    return np.asarray(after - before)
