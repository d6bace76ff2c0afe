"""Why a pool is empty: what most of its poses fail at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.errors import UnreachableError
from calib.robots import InverseSolutions
from calib.robots.inverse import first_per_group
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints import ROUNDING, Checker, Verdicts

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

    Parameters
    ----------
    checker : Checker
    T_base_tip : array (N, 4, 4)
    base : array (n,)
        [rad]
    asked_for : callable
        Which postures would have been taken.
    otherwise : tuple of str
        What is to be said where there are only others, and what to do then.
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
        f"none of {tried} {what}; {share:.0%} of them: {reason}",
        hint=remedy or _HINT,
        name="pool",
    )
