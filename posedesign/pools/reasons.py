"""Why a pool is empty: what most of its poses fail at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.errors import UnreachableError
from calib.robots import InverseSolutions
from calib.robots.inverse import first_per_group
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.feasibility import Checker, Verdicts
from posedesign.feasibility.constraint import ROUNDING

_LOOKED_AT = 200
"""Poses that the reason is sought at."""

_OUT_OF_REACH, _NOT_ASKED_FOR = -1, -2

_HINT = "make room around the base pose, or choose another base posture"


def no_pose(
    checker: Checker,
    T_base_tip: FloatArray,
    base: FloatArray,
    asked_for: Callable[[InverseSolutions], BoolArray],
    otherwise: tuple[str, str],
) -> UnreachableError:
    """The error of a pool of poses ``(N, 4, 4)`` without a posture: the reason met most often.

    Of each pose the branch counts that comes nearest to being possible, and of the poses that fail
    at the same constraint the one that comes nearest is told of.

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
    verdicts = checker.check(solutions.postures, every=False)
    branch = first_per_group(solutions.pose, -_nearness(verdicts), len(some))
    kind = np.full(len(some), _OUT_OF_REACH)
    kind[branch >= 0] = verdicts.tightest[branch[branch >= 0]]
    kind[solutions.pose[verdicts.feasible & ~asked_for(solutions)]] = _NOT_ASKED_FOR
    most, share = _most_often(kind)
    if most == _OUT_OF_REACH:
        reason, remedy = "out of reach", "move the target, or the base posture"
    elif most == _NOT_ASKED_FOR:
        reason, remedy = otherwise
    else:
        reason, remedy = _said(verdicts, branch[kind == most])
    return _error(len(T_base_tip), "poses can be taken", share, reason, remedy)


def no_posture(checker: Checker, postures: FloatArray, tried: int) -> UnreachableError:
    """The same for postures ``(S, n)`` [rad] that were drawn, of so many."""
    verdicts = checker.check(postures[_some(len(postures))], every=False)
    most, share = _most_often(verdicts.tightest)
    reason, remedy = _said(verdicts, np.flatnonzero(verdicts.tightest == most))
    return _error(tried, "postures keep every constraint", share, reason, remedy)


def _some(count: int) -> IntArray:
    return np.linspace(0, count - 1, min(count, _LOOKED_AT)).astype(np.intp)


def _nearness(verdicts: Verdicts) -> FloatArray:
    """How many constraints postures keep ``(S,)``, and how far the first is broken that is not."""
    return np.asarray((verdicts.room >= -ROUNDING).sum(axis=1) + np.tanh(verdicts.slack))


def _most_often(kind: IntArray) -> tuple[int, float]:
    kinds, counts = np.unique(kind, return_counts=True)
    most = int(np.argmax(counts))
    return int(kinds[most]), float(counts[most] / len(kind))


def _said(verdicts: Verdicts, rows: IntArray) -> tuple[str, str]:
    best = int(rows[np.argmax(_nearness(verdicts)[rows])])
    name = verdicts.constraints[int(verdicts.tightest[best])].name
    return f"{name}, e.g. {verdicts.says(best)}", verdicts.remedy(best)


def _error(tried: int, what: str, share: float, reason: str, remedy: str) -> UnreachableError:
    return UnreachableError(
        f"none of {tried} {what}; {share:.0%} of them: {reason}",
        hint=remedy or _HINT,
        name="pool",
    )
