"""Whether the robot can take a pose, and in words why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import limit_reason
from calib.robots import InverseSolutions, Robot
from calib.robots.inverse import first_per_group
from calib.se3 import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Postures:
    """For each pose of a list the posture that the robot takes, or why it cannot.

    Attributes
    ----------
    q : array (N, n)
        [rad]; NaN where the pose cannot be taken.
    feasible : array (N,) of bool
    reasons : tuple of str
        Empty where the pose can be taken, else e.g. ``J5 131.2 deg is above 125.0 deg``.
    """

    q: FloatArray
    feasible: BoolArray
    reasons: tuple[str, ...]


def nearest_postures(
    robot: Robot, T_base_tip: FloatArray, reference: FloatArray, margin: float = 0.0
) -> Postures:
    """Of all arm configurations the one nearest to a reference posture, inside the limits.

    Parameters
    ----------
    robot : Robot
    T_base_tip : array (N, 4, 4)
    reference : array (n,)
        Posture to stay near [rad], by the Euclidean norm of the joint difference.
    margin : float
        Distance to keep from every limit [rad].
    """
    solutions = robot.inverse(T_base_tip, near=reference, margin=margin)
    q, feasible = solutions.nearest()
    if feasible.all():
        return Postures(q, feasible, ("",) * len(q))
    reasons = _reasons(robot, solutions, margin)
    return Postures(
        q, feasible, tuple("" if ok else why for ok, why in zip(feasible, reasons, strict=True))
    )


def _reasons(robot: Robot, solutions: InverseSolutions, margin: float) -> list[str]:
    """Why each pose fails: the limit broken least over all branches, or how far out of reach."""
    lower, upper = robot.lower + margin, robot.upper - margin
    excess = np.maximum(lower - solutions.postures, solutions.postures - upper)  # (S, n)
    worst = np.argmax(excess, axis=1)
    # the branch that comes nearest to being possible is the one worth talking about
    best = first_per_group(
        solutions.pose, excess.max(axis=1, initial=-np.inf), len(solutions.gap_m)
    )
    reasons = []
    for pose, branch in enumerate(best):
        if branch >= 0:
            j = worst[branch]
            value, low, high = np.rad2deg([solutions.postures[branch, j], lower[j], upper[j]])
            reasons.append(limit_reason(f"J{j + 1}", float(value), float(low), float(high)))
        else:
            gap = solutions.gap_m[pose]
            far = "" if np.isnan(gap) else f" by {gap * 1e3:.0f} mm"
            reasons.append(f"out of reach{far}")
    return reasons
