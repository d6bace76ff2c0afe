"""The arm configurations in which poses are taken: the nearest, those in front, or all."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from calib.errors import InputError, near_names
from calib.robots import InverseSolutions
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints import Checker

Configurations = Literal["nearest", "front", "all"]
"""``nearest``: of each pose the one posture nearest to the base posture, as in the paper's loop.
``front``: every branch of the arm, elbow and wrist, with the first joint on the side of the base
posture. ``all``: those that reach over the arm's back, too."""

CONFIGURATIONS: tuple[Configurations, ...] = get_args(Configurations)

IN_WORDS = {
    "nearest": "the nearest posture of each",
    "front": "every branch with the arm in front",
    "all": "every branch, over the arm's back too",
}

FRONT_RAD = np.pi / 2
"""Turn of the first joint from the base posture up to which the arm is in front."""

MOST_PER_POSE = 8
"""Postures of one pose that a redundant arm gives a pool: as many as a six-axis arm has branches.
It has a hundred and more of each, most of which differ by a few degrees of its elbow."""

_AT_ONCE = 10_000
"""Poses solved at once, so that what is looked at stays within some 20 MB."""


def check_configurations(name: str) -> Configurations:
    """One of :data:`CONFIGURATIONS`.

    Raises InputError: there is none of that name.
    """
    for known in CONFIGURATIONS:
        if known == name:
            return known
    raise InputError(
        f"there are no configurations {name!r}",
        hint=near_names(str(name), CONFIGURATIONS),
        name="configurations",
        value=name,
    )


def feasible_postures(
    checker: Checker, T_base_tip: FloatArray, base: FloatArray, configurations: Configurations
) -> tuple[FloatArray, IntArray]:
    """Postures that take poses and keep every constraint, and the pose of each.

    ``T_base_tip`` (N, 4, 4). ``base`` (n,): posture to stay near [rad]: each joint takes that full
    turn inside the limits which lies nearest to it. Returns ``postures`` (S, n): [rad]. ``pose``
    (S,): in ascending order.
    """
    postures, pose = [np.empty((0, len(base)))], [np.empty(0, dtype=np.intp)]
    for start in range(0, len(T_base_tip), _AT_ONCE):
        part = T_base_tip[start : start + _AT_ONCE]
        solutions = checker.robot.inverse(part, near=base, margin=checker.margin)
        if configurations == "nearest":
            rows = _nearest(checker, solutions)
        else:
            rows = np.flatnonzero(solutions.inside & asked_for(solutions, configurations))
            rows = rows[checker.check(solutions.postures[rows], every=False).feasible]
            rows = rows[evenly(solutions.pose[rows], MOST_PER_POSE)]
        postures.append(solutions.postures[rows])
        pose.append(solutions.pose[rows] + start)
    return np.concatenate(postures), np.concatenate(pose)


def asked_for(solutions: InverseSolutions, configurations: Configurations) -> BoolArray:
    """Whether each posture ``(S,)`` is of the configurations asked for."""
    if configurations != "front":
        return np.ones(len(solutions.pose), dtype=bool)
    turn = solutions.postures[:, 0] - solutions.near[0]
    return np.asarray(np.abs(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi) <= FRONT_RAD)


def _nearest(checker: Checker, solutions: InverseSolutions) -> IntArray:
    """Row of each pose's posture that keeps every constraint and is nearest to the reference."""
    inside = np.flatnonzero(solutions.inside)
    distance = np.linalg.norm(solutions.postures[inside] - solutions.near, axis=1)
    waiting = inside[np.lexsort((distance, solutions.pose[inside]))]
    done = np.zeros(len(solutions.gap_m), dtype=bool)
    taken = [np.empty(0, dtype=np.intp)]
    while len(waiting):  # the nearest of each pose, then the second nearest where that failed, ...
        first = np.diff(solutions.pose[waiting], prepend=-1) != 0
        rows = waiting[first]
        taken.append(rows[checker.check(solutions.postures[rows], every=False).feasible])
        done[solutions.pose[taken[-1]]] = True
        waiting = waiting[~first]
        waiting = waiting[~done[solutions.pose[waiting]]]
    return np.sort(np.concatenate(taken))


def evenly(pose: IntArray, most: int) -> BoolArray:
    """Rows to keep ``(S,)`` so that no pose has more than so many, spread over its rows."""
    first = np.searchsorted(pose, pose)
    count = np.searchsorted(pose, pose, side="right") - first
    rank, wanted = np.arange(len(pose)) - first, np.minimum(count, most)
    return np.asarray(rank * wanted // count > (rank - 1) * wanted // count)
