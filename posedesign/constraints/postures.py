"""Whether the robot can take a pose, with which posture, and in words why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.robots import InverseSolutions
from calib.robots.inverse import first_per_group
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints.checker import Checker


@dataclass(frozen=True, eq=False)
class Postures:
    """For each pose of a list the posture that the robot takes, or why it cannot.

    ``q`` (N, n): [rad]; NaN where the pose cannot be taken. ``feasible`` (N,). ``reasons``: empty
    where the pose can be taken, else e.g. ``J5 131.2 deg is above 125.0 deg``. ``remedies``: what
    to change in the cell, where something helps.
    """

    q: FloatArray
    feasible: BoolArray
    reasons: tuple[str, ...]
    remedies: tuple[str, ...]


def nearest_postures(checker: Checker, T_base_tip: FloatArray, reference: FloatArray) -> Postures:
    """Of all arm configurations that keep every constraint, the one nearest to a reference.

    ``T_base_tip`` (N, 4, 4). ``reference`` (n,): posture to stay near [rad], by the Euclidean norm
    of the joint difference.
    """
    solutions = checker.robot.inverse(T_base_tip, near=reference, margin=checker.margin)
    count = len(T_base_tip)
    q = np.full((count, checker.robot.n), np.nan)
    feasible = np.zeros(count, dtype=bool)
    slack = np.full(count, np.nan)  # NaN until a posture of the pose has been looked at
    best = np.full((count, checker.robot.n), np.nan)
    for rows in _nearest_first(solutions, reference):
        rows = rows[~feasible[solutions.pose[rows]]]
        if not len(rows):
            continue
        verdicts = checker.check(solutions.postures[rows], every=False)
        good = verdicts.feasible
        poses = solutions.pose[rows]
        q[poses[good]] = solutions.postures[rows[good]]
        feasible[poses[good]] = True
        # of all branches, the one that comes nearest to being possible is worth talking about
        nearer = ~good & ~(verdicts.slack <= slack[poses])
        slack[poses[nearer]], best[poses[nearer]] = verdicts.slack[nearer], verdicts.arm.q[nearer]
    reasons, remedies = [""] * count, [""] * count
    blocked = np.flatnonzero(~feasible & ~np.isnan(slack))
    verdicts = checker.check(best[blocked])  # by all constraints: the first broken is not the worst
    for i, pose in enumerate(blocked):
        reasons[pose], remedies[pose] = verdicts.says(i), verdicts.remedy(i)
    unreached = np.flatnonzero(~feasible & np.isnan(slack))
    if len(unreached):
        why = _unreached(checker, solutions)
        for pose in unreached:
            reasons[pose], remedies[pose] = why[pose]
    return Postures(q, feasible, tuple(reasons), tuple(remedies))


def _nearest_first(solutions: InverseSolutions, reference: FloatArray) -> list[IntArray]:
    """Rows of the solutions inside the limits: the nearest of each pose, the second nearest, ..."""
    inside = np.flatnonzero(solutions.inside)
    distance = np.linalg.norm(solutions.postures[inside] - reference, axis=1)
    order = inside[np.lexsort((distance, solutions.pose[inside]))]
    pose = solutions.pose[order]
    starts = np.flatnonzero(np.diff(pose, prepend=-1))
    rank = np.arange(len(pose)) - np.repeat(starts, np.diff(np.append(starts, len(pose))))
    return [order[rank == k] for k in range(int(rank.max(initial=-1)) + 1)]


def _unreached(checker: Checker, solutions: InverseSolutions) -> list[tuple[str, str]]:
    """Why each pose fails: the limit broken least over all branches, or how far out of reach.

    Beside the reason stands what to change, where something helps.
    """
    verdicts = Checker(checker.robot, margin=checker.margin).check(solutions.postures)
    # the branch that comes nearest to being possible is the one worth talking about
    best = first_per_group(solutions.pose, -verdicts.slack, len(solutions.gap_m))
    reasons = []
    for pose, branch in enumerate(best):
        if branch >= 0:
            reasons.append((verdicts.says(int(branch)), verdicts.remedy(int(branch))))
        else:
            gap = solutions.gap_m[pose]
            far = "" if np.isnan(gap) else f" by {gap * 1e3:.0f} mm"
            reasons.append((f"out of reach{far}", ""))
    return reasons
