"""Points that fill a cube evenly, rows that are there once, and why no pose is left of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.errors import InputError, UnreachableError
from calib.robots import InverseSolutions
from calib.robots.inverse import first_per_group
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints import ROUNDING, Checker, Verdicts

_ITERATIONS = 60
"""Each brings the root nearer by a factor of four at least; 60 reach the last digit."""

MOST = 10_000_000
"""Points of a pool: more would fill the memory of a computer with their postures alone."""

SAME_RAD = 1e-6
"""Postures that differ by less in every joint are one: see
:data:`calib.robots.inverse.closed_form.SAME_POSTURE_RAD`."""


def even_points(count: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Points ``(count, dimensions)`` of the unit cube, spread more evenly than independent ones.

    The additive sequence of Kronecker with the steps of [Roberts2018]_: powers of the root of
    ``x**(d + 1) = x + 1``. A random shift makes each point alone uniform over the cube. Of 3,000
    points in three dimensions the largest gap is 0.060, that of scrambled Sobol points 0.075, and
    of independent ones 0.094; from 100 points on and up to seven dimensions the order is the same.

    References
    ----------
    .. [Roberts2018] M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
    """
    root = 2.0
    for _ in range(_ITERATIONS):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    return np.asarray(np.remainder(rng.random(dimensions) + np.arange(count)[:, None] * steps, 1.0))


def check_count(count: int) -> int:
    """A number of draws that can be made."""
    if not (1 <= count <= MOST and count == int(count)):
        raise InputError(
            f"{count} draws: a pool is made of 1 to {MOST}", name="count", value=count, bound=1
        )
    return int(count)


def once(rows: FloatArray, tolerance: float = SAME_RAD) -> BoolArray:
    """Whether rows ``(S, k)`` are there for the first time, ``(S,)``.

    Those of which no number differs by as much as the tolerance are the same.
    """
    # along any line the same rows lie together, and hardly any others
    line = np.sqrt(np.arange(2.0, rows.shape[1] + 2.0))
    place = rows @ line
    order = np.argsort(place, kind="stable")
    width = tolerance * line.sum()
    first = np.ones(len(rows), dtype=bool)
    later, back = np.arange(len(rows)), 1
    while len(later):
        later = later[later >= back]
        one, other = order[later], order[later - back]
        near = place[one] - place[other] <= width
        later, one, other = later[near], one[near], other[near]
        same = np.abs(rows[one] - rows[other]).max(axis=1, initial=0.0) < tolerance
        first[np.maximum(one, other)[same]] = False
        back += 1
    return first


_LOOKED_AT = 200
"""Poses that the reason is sought at."""

_HINT = "make room around the base pose, or choose another base posture"


def no_pose(
    checker: Checker,
    T_base_tip: FloatArray,
    base: FloatArray,
    asked_for: Callable[[InverseSolutions], BoolArray],
    otherwise: tuple[str, str],
) -> UnreachableError:
    """The error of a pool of poses ``(N, 4, 4)`` without a posture: the reason met most often.

    Of each pose the branch counts that comes nearest to being possible, and of the poses that break
    the same constraint the one that comes nearest is told of.

    ``T_base_tip`` (N, 4, 4). ``base`` (n,): [rad]. ``asked_for``: which postures would have been
    taken. ``otherwise``: what is to be said where there are only others, and what to do then.
    """
    some = T_base_tip[_some(len(T_base_tip))]
    solutions = checker.robot.inverse(some, near=base, margin=checker.margin)
    verdicts = checker.check(solutions.postures)
    branch = first_per_group(solutions.pose, -_nearness(verdicts), len(some))
    reached = branch >= 0
    unasked = np.zeros(len(some), dtype=bool)
    unasked[solutions.pose[verdicts.feasible & ~asked_for(solutions)]] = True
    constraint, count = _most_often(verdicts, branch[reached & ~unasked])
    counts = [count, int((~reached).sum()), int(unasked.sum())]
    most = int(np.argmax(counts))
    if most == 0:
        reason, remedy = _said(verdicts, branch[reached & ~unasked], constraint)
    else:
        far = "out of reach", "move the target, or the base posture"
        reason, remedy = (far, otherwise)[most - 1]
    return _error(len(T_base_tip), "poses can be taken", counts[most] / len(some), reason, remedy)


def no_posture(checker: Checker, postures: FloatArray, tried: int) -> UnreachableError:
    """The same for postures ``(S, n)`` [rad] that were drawn, of so many."""
    verdicts = checker.check(postures[_some(len(postures))])
    rows = np.arange(len(verdicts.room))
    most, count = _most_often(verdicts, rows)
    reason, remedy = _said(verdicts, rows, most)
    return _error(tried, "postures keep every constraint", count / len(rows), reason, remedy)


def _some(count: int) -> IntArray:
    return np.linspace(0, count - 1, min(count, _LOOKED_AT)).astype(np.intp)


def _nearness(verdicts: Verdicts) -> FloatArray:
    """How many constraints postures keep ``(S,)``, and how far they are from the tightest."""
    return np.asarray((verdicts.room >= -ROUNDING).sum(axis=1) + np.tanh(verdicts.slack))


def _most_often(verdicts: Verdicts, rows: IntArray) -> tuple[int, int]:
    """The constraint that most postures break, and how many do; of several the one broken worst."""
    if not len(rows):
        return 0, 0
    broken = (verdicts.room[rows] < -ROUNDING).sum(axis=0)
    worst = np.bincount(verdicts.tightest[rows], minlength=len(broken))
    most = int(np.lexsort((worst, broken))[-1])
    return most, int(broken[most])


def _said(verdicts: Verdicts, rows: IntArray, k: int) -> tuple[str, str]:
    rows = rows[verdicts.room[rows, k] < -ROUNDING]
    best = int(rows[np.argmax(_nearness(verdicts)[rows])])
    name = verdicts.constraints[k].name
    return f"{name}, e.g. {verdicts.says(best, k)}", verdicts.remedy(best, k)


def _error(tried: int, what: str, share: float, reason: str, remedy: str) -> UnreachableError:
    return UnreachableError(
        f"none of {tried} {what}; {share:.0%} of them: {reason}", hint=remedy or _HINT, name="pool"
    )
