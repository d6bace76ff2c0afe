"""One verdict with its reason for every posture, by all constraints of a cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.constraints.constraint import ROUNDING, Constraint, Situation
from posedesign.constraints.joints import CoupledLimits, JointLimits


@dataclass(frozen=True, eq=False)
class Verdicts:
    """What the constraints say of postures.

    ``arm``: the postures ``(S, n)``. ``room`` (S, C): how far each posture is inside each
    constraint [SI]; negative where it breaks it, NaN where it was not looked at. ``which`` (S, C):
    what comes nearest to breaking it.
    """

    constraints: tuple[Constraint, ...]
    arm: Situation
    room: FloatArray
    which: IntArray

    @property
    def feasible(self) -> BoolArray:
        """Postures ``(S,)`` that break nothing that was looked at."""
        return np.asarray(~(self.room < -ROUNDING).any(axis=1))

    @property
    def slack(self) -> FloatArray:
        """Room of the tightest constraint ``(S,)``, as a part of what counts as plenty for it."""
        return np.asarray(self._parts.min(axis=1, initial=np.inf))

    @property
    def tightest(self) -> IntArray:
        """Index ``(S,)`` of the constraint that has least room, or is broken most."""
        return np.asarray(np.argmin(self._parts, axis=1))

    def says(self, i: int, k: int | None = None) -> str:
        """What constraint k of posture i says, in words; the tightest unless it is given."""
        k = int(self.tightest[i]) if k is None else k
        return self.constraints[k].says(self.arm, i, float(self.room[i, k]), int(self.which[i, k]))

    def remedy(self, i: int, k: int | None = None) -> str:
        """What to change where posture i breaks that constraint, or nothing."""
        k = int(self.tightest[i]) if k is None else k
        return self.constraints[k].remedy(float(self.room[i, k]))

    @property
    def _parts(self) -> FloatArray:
        comfort = np.array([constraint.comfort for constraint in self.constraints])
        return np.asarray(np.where(np.isnan(self.room), np.inf, self.room / comfort))


class Checker:
    """The constraints of a cell, the cheap ones first.

    ``constraints``: besides the limits of the joints, which are always there. ``margin``: distance
    to keep from every joint limit [rad].
    """

    def __init__(
        self, robot: Robot, constraints: Sequence[Constraint] = (), margin: float = 0.0
    ) -> None:
        self.robot = robot
        self.margin = margin
        coupled = [CoupledLimits(robot, margin)] if robot.coupled_limits else []
        self.constraints = (JointLimits(robot, margin), *coupled, *constraints)

    def check(self, q: FloatArray, *, every: bool = True) -> Verdicts:
        """Verdicts on postures ``(S, n)`` [rad].

        ``q`` (S, n). ``every``: False: a posture that breaks one constraint is not looked at by
        those after it, and how deep meshes run into something is not measured. Enough to tell what
        is feasible, not to tell people why something is not.
        """
        arm = Situation(self.robot.chain, q, depths=every)
        room = np.full((len(q), len(self.constraints)), np.nan)
        which = np.zeros(room.shape, dtype=np.intp)
        alive = np.arange(len(q))
        for k, constraint in enumerate(self.constraints):
            if not len(alive):
                break
            some = arm if len(alive) == len(q) else arm.take(alive)
            found, which[alive, k] = constraint.room(some)
            # a room that cannot be computed is none
            room[alive, k] = np.where(np.isnan(found), -np.inf, found)
            if not every:
                alive = alive[room[alive, k] >= -ROUNDING]
        return Verdicts(self.constraints, arm, room, which)
