"""Passed postures short of those that are measured, so that all joints arrive from one side.

A reducer loses motion when its joint turns round: backlash, and friction that winds it up. Which
side the loss lies on depends on the side that the joint came from, so it differs from pose to pose
unless every joint makes its last movement in the same direction at all of them; then it is a
constant, and part of the zero offset. [Watanabe2006]_, section 2.1, asks the touch-up to suppress
"the effect of lost motion in robot reducers including backlash": of all reducers, also of the first
and the last joint, whose offsets are not identified but whose loss would still scatter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from calib.se3 import FloatArray
from posedesign.constraints import Checker
from posedesign.motion.known_motions import KnownMotions

MOST_DIRECTIONS = 16
"""Combinations of directions whose ways are checked: postures that keep a distance with so short a
way between them that does not are rare, and every joint can be turned alone within as many."""


@dataclass(frozen=True, eq=False)
class Approaches:
    """Where the arm stands before its last movement to each posture.

    ``postures`` (N, n): short of those that are measured, by the same joint angles for all [rad].
    ``direction`` (n,): of the last movement of each joint: 1 or -1. ``lost``: postures, by index,
    that cannot be approached so, and why.
    """

    postures: FloatArray
    direction: FloatArray
    lost: dict[int, str]


def find_approaches(
    postures: FloatArray, angle_rad: float, passing: Checker, passages: KnownMotions
) -> Approaches:
    """Stop short of postures ``(N, n)`` [rad] by an angle in every joint.

    All joints arrive from below where that does for all postures. Otherwise the directions, one a
    joint, are those that do for most postures, with the fewest joints that arrive from above.

    ``postures`` (N, n): [rad]. ``angle_rad``: of the last movement of every joint. ``passing``:
    what a posture that the arm only passes through must keep. ``passages``: the ways from the
    passed postures must be clear.
    """
    best: Approaches | None = None
    for direction, bound in islice(_directions(postures, angle_rad, passing), MOST_DIRECTIONS):
        if best is not None and bound <= len(postures) - len(best.lost):
            break
        short = postures - angle_rad * direction
        lost = _lost(postures, short, passing, passages)
        if best is None or len(lost) < len(best.lost):
            best = Approaches(short, direction, lost)
        if not lost:
            break
    if best is None:  # no postures
        return Approaches(postures, np.ones(postures.shape[1]), {})
    return best


def _directions(
    postures: FloatArray, angle_rad: float, passing: Checker
) -> Iterator[tuple[FloatArray, int]]:
    """Directions ``(n,)`` by how many passed postures they allow, the most first, and how many."""
    count, n = postures.shape
    if not count:
        return
    if passing.check(postures - angle_rad).feasible.all():
        yield np.ones(n), count
    signs = np.array(list(product((1.0, -1.0), repeat=n)))  # shape (2 ** n, n)
    signs = signs[np.argsort((signs < 0).sum(axis=1), kind="stable")]
    short = postures[None] - angle_rad * signs[:, None]  # shape (2 ** n, N, n)
    good = passing.check(short.reshape(-1, n), every=False).feasible.reshape(-1, count).sum(axis=1)
    order = np.argsort(-good, kind="stable")
    for k in order:
        yield signs[k], int(good[k])


def _lost(
    postures: FloatArray, short: FloatArray, passing: Checker, passages: KnownMotions
) -> dict[int, str]:
    """Postures that a passed posture or the way from it keeps from being approached, and why."""
    verdicts = passing.check(short)
    lost = {i: verdicts.says(i) for i in np.flatnonzero(~verdicts.feasible).tolist()}
    rows = [i for i in range(len(postures)) if i not in lost]
    passages.check([(short[i], postures[i]) for i in rows])
    lost |= {i: why for i in rows if (why := passages.reason(short[i], postures[i]))}
    return {i: f"cannot be approached from one side: {why}" for i, why in sorted(lost.items())}
