"""One verdict with its reason for every posture, by all constraints of a cell."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.errors import limit_reason
from calib.robots import ChainState, InverseSolutions, Robot, SerialChain
from calib.robots.inverse import first_per_group
from calib.se3 import BoolArray, FloatArray, IntArray

ROUNDING = 1e-9
"""A bound that is broken by no more [SI] is kept: computing a posture rounds that much."""


STAYS = 10.0
"""Times as far as the arm's joints external axes count where the nearest of several postures is
taken: a table stays, and the arm follows."""


class Situation:
    """An arm at postures ``(S, n)`` [rad].

    ``q`` (S, n). ``in_full``: whether somebody reads margins of what is kept, and how deep meshes
    are in what they run into.
    """

    def __init__(
        self,
        chain: SerialChain,
        q: FloatArray,
        state: ChainState | None = None,
        *,
        in_full: bool = False,
    ) -> None:
        self.chain = chain
        self.q = q
        self.in_full = in_full
        if state is not None:
            self.state = state

    @cached_property
    def state(self) -> ChainState:
        """Where joints and tip are."""
        return self.chain.forward(self.q)

    def take(self, rows: IntArray) -> Situation:
        """The same at some of the postures."""
        state = self.__dict__.get("state")
        if state is not None:
            parts = {f.name: getattr(state, f.name) for f in fields(state)}
            cut = {key: part[rows] for key, part in parts.items() if isinstance(part, np.ndarray)}
            state = replace(state, **cut)
        return Situation(self.chain, self.q[rows], state, in_full=self.in_full)


class Constraint(ABC):
    """A bound that postures keep or break, and by how much.

    ``name``: what is bounded, as tables head it. ``unit``: of the margin as people read it.
    ``display``: factor from SI to that unit. ``measured``: whether the margin is a measure, or only
    says yes or no. ``comfort``: margin [SI] that counts as plenty. Divided by it, margins of
    different kinds can be compared. ``hint_words``: what to change where it is broken.
    """

    name: str
    unit: ClassVar[str] = ""
    display: ClassVar[float] = 1.0
    comfort: ClassVar[float] = 1.0
    measured: ClassVar[bool] = True
    hint_words: str

    @abstractmethod
    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """How far postures are inside the bound ``(S,)`` [SI], and what is nearest to breaking it.

        Negative where the bound is broken, infinite where nothing is near. What comes nearest is
        the index of the joint, the pair of bodies, ... that :meth:`reason` will be asked for.
        """

    @abstractmethod
    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        """In words, how posture i keeps or breaks the bound."""

    def hint(self, margin: float) -> str:
        """What to change in ``cell.toml`` where the bound is broken by this much, or nothing."""
        return self.hint_words


class _Limits(Constraint):
    """Limits less a margin: an uncalibrated joint is not where it says."""

    unit = "deg"
    display = float(np.rad2deg(1.0))
    comfort = np.deg2rad(10.0)

    def __init__(self, robot: Robot, margin: float) -> None:
        self._robot, self._margin = robot, margin

    @abstractmethod
    def _limit(self, q: FloatArray, which: int) -> tuple[str, float, float, float]:
        """Name, value at a posture ``(n,)`` and bounds [rad]."""

    @abstractmethod
    def _inside(self, q: FloatArray) -> FloatArray:
        """How far postures are inside each limit ``(S, L)`` [rad]."""

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        return _least(self._inside(arm.q) - self._margin)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        name, value, lower, upper = self._limit(arm.q[i], which)
        kept = 0.0 if not lower - ROUNDING <= value <= upper + ROUNDING else self._margin
        value_deg, low_deg, high_deg = np.rad2deg([value, lower + kept, upper - kept]).tolist()
        ending = f" ({np.rad2deg(kept):g} deg inside the limit)" if kept else ""
        if min(value - lower, upper - value) - kept < -ROUNDING:
            return limit_reason(name, value_deg, low_deg, high_deg) + ending
        side, bound_deg = ("upper", high_deg) if 2 * value > lower + upper else ("lower", low_deg)
        return f"{name} {value_deg:.1f} deg, {side} bound {bound_deg:.1f} deg{ending}"

    def hint(self, margin: float) -> str:
        """A margin is worth lowering only where the limit itself is kept."""
        kept = 0.0 <= margin + self._margin < self._margin
        return "lower plan.limit_margin_deg" if kept else ""


class JointLimits(_Limits):
    """Every joint that turns inside its limits, less the margin."""

    name = "joint limits"

    def _limit(self, q: FloatArray, which: int) -> tuple[str, float, float, float]:
        robot, j = self._robot, int(self._turning[which])
        return robot.joint_labels[j], q[j], robot.lower[j], robot.upper[j]

    def _inside(self, q: FloatArray) -> FloatArray:
        return _room(self._robot, q)[:, self._turning]

    @cached_property
    def _turning(self) -> IntArray:
        return np.flatnonzero(~self._robot.sliding)


class SlideLimits(Constraint):
    """Every joint that slides inside its limits: it stands where it says."""

    name = "slide limits"
    unit = "mm"
    display = 1e3
    comfort = 0.1
    hint_words = "lower plan.slide_margin_mm"

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        return _least(_room(self._robot, arm.q)[:, self._robot.sliding])

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        j = int(np.flatnonzero(self._robot.sliding)[which])
        value, low, high = (
            1e3 * float(v[j]) for v in (arm.q[i], self._robot.lower, self._robot.upper)
        )
        name = self._robot.joint_labels[j]
        if margin < -ROUNDING:
            return limit_reason(name, value, low, high, "mm")
        return f"{name} {value:.1f} mm, {1e3 * margin:.1f} mm inside its limits"


def _least(margins: FloatArray) -> tuple[FloatArray, IntArray]:
    """The smallest of margins ``(S, L)`` of each posture, and which that is."""
    return margins.min(axis=1), margins.argmin(axis=1)


def _room(robot: Robot, q: FloatArray) -> FloatArray:
    """How far postures ``(S, n)`` are inside the limits of each joint [rad, m]."""
    return np.minimum(q - robot.lower, robot.upper - q)


class CoupledLimits(_Limits):
    """Limits that joints have together, less the margin."""

    name = "coupled limits"

    def _limit(self, q: FloatArray, which: int) -> tuple[str, float, float, float]:
        limit = self._robot.coupled_limits[which]
        return limit.name, float(q @ limit.coefficients), limit.lower, limit.upper

    def _inside(self, q: FloatArray) -> FloatArray:
        return np.stack([limit.margin(q) for limit in self._robot.coupled_limits], axis=1)


class Singularity(Constraint):
    """The smallest singular value of the tip's Jacobian, its lengths divided by the arm's reach."""

    name = "singularity"
    comfort = 0.05

    def __init__(
        self, smallest: float, setting: str = "constraints.smallest_singular_value"
    ) -> None:
        self._smallest = smallest
        self.hint_words = f"lower {setting}"

    def margin(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        value = arm.chain.smallest_singular_values(arm.state)
        return value - self._smallest, np.zeros(len(value), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        return f"smallest singular value {margin + self._smallest:.3f}, bound {self._smallest:g}"


@dataclass(frozen=True, eq=False)
class Verdicts:
    """What the constraints say of postures."""

    constraints: tuple[Constraint, ...]
    arm: Situation  # the postures ``(S, n)``
    margin: FloatArray
    """(S, C): how far each posture is inside each constraint [SI]; negative where it breaks it, NaN
    where it was not looked at."""
    which: IntArray  # (S, C): what comes nearest to breaking it

    @property
    def feasible(self) -> BoolArray:
        """Postures ``(S,)`` that break nothing that was looked at."""
        return np.asarray(~(self.margin < -ROUNDING).any(axis=1))

    @property
    def slack(self) -> FloatArray:
        """Room of the tightest constraint ``(S,)``, as a part of what counts as plenty for it."""
        return np.asarray(self._parts.min(axis=1, initial=np.inf))

    @property
    def tightest(self) -> IntArray:
        """Index ``(S,)`` of the constraint that has least margin, or is broken most."""
        return np.asarray(np.argmin(self._parts, axis=1))

    @property
    def nearness(self) -> FloatArray:
        """How many constraints postures keep ``(S,)``, and how far they are from the tightest."""
        return np.asarray((self.margin >= -ROUNDING).sum(axis=1) + np.tanh(self.slack))

    def reason(self, i: int, k: int | None = None) -> str:
        """What constraint k of posture i says, in words; the tightest unless it is given."""
        k = int(self.tightest[i]) if k is None else k
        margin, which = float(self.margin[i, k]), int(self.which[i, k])
        return self.constraints[k].reason(self.arm, i, margin, which)

    def hint(self, i: int, k: int | None = None) -> str:
        """What to change where posture i breaks that constraint, or nothing."""
        k = int(self.tightest[i]) if k is None else k
        return self.constraints[k].hint(float(self.margin[i, k]))

    @property
    def _parts(self) -> FloatArray:
        comfort = np.array([constraint.comfort for constraint in self.constraints])
        return np.asarray(np.where(np.isnan(self.margin), np.inf, self.margin / comfort))


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
        slides = [SlideLimits(robot)] if robot.sliding.any() else []
        turns = [] if robot.sliding.all() else [JointLimits(robot, margin)]
        self.constraints = (*turns, *slides, *coupled, *constraints)

    def check(self, q: FloatArray, *, every: bool = True) -> Verdicts:
        """Verdicts on postures ``(S, n)`` [rad].

        ``q`` (S, n). ``every``: False: a posture that breaks one constraint is not looked at by
        those after it. Distances that are kept are not measured, nor how deep meshes run into
        something. Enough to tell what is feasible, not to tell people why something is not.
        """
        arm = Situation(self.robot.chain, q, in_full=every)
        margin = np.full((len(q), len(self.constraints)), np.nan)
        which = np.zeros(margin.shape, dtype=np.intp)
        alive = np.arange(len(q))
        for k, constraint in enumerate(self.constraints):
            if not len(alive):
                break
            some = arm if len(alive) == len(q) else arm.take(alive)
            found, which[alive, k] = constraint.margin(some)
            # a margin that cannot be computed is none
            margin[alive, k] = np.where(np.isnan(found), -np.inf, found)
            if not every:
                alive = alive[margin[alive, k] >= -ROUNDING]
        return Verdicts(self.constraints, arm, margin, which)


@dataclass(frozen=True, eq=False)
class Postures:
    """For each pose of a list the posture that the robot takes, or why it cannot."""

    q: FloatArray  # (N, n) [rad]; NaN where the pose cannot be taken
    feasible: BoolArray  # (N,)
    explain: Callable[[], list[tuple[str, str]]]
    """Finds reasons and hints; how deep meshes run into something takes long, and not everybody
    asks."""

    @cached_property
    def _explained(self) -> list[tuple[str, str]]:
        return self.explain()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Empty where the pose can be taken, else e.g. ``J5 131.2 deg is above 125.0 deg``."""
        return tuple(reason for reason, _ in self._explained)

    @property
    def hints(self) -> tuple[str, ...]:
        """What to change in the cell, where something helps."""
        return tuple(hint for _, hint in self._explained)


def nearest_postures(checker: Checker, T_base_tip: FloatArray, reference: FloatArray) -> Postures:
    """Of all arm configurations that keep every constraint, the one nearest to a reference.

    ``T_base_tip`` (N, 4, 4). ``reference`` (n,): posture to stay near [rad], by the Euclidean norm
    of the joint difference.
    """
    solutions = checker.robot.inverse(T_base_tip, near=reference, margin=checker.margin)
    row, nearly = nearest_rows(checker, solutions)
    feasible = row >= 0
    q = np.full((len(T_base_tip), checker.robot.n), np.nan)
    q[feasible] = solutions.postures[row[feasible]]

    def explain() -> list[tuple[str, str]]:
        unreached = np.flatnonzero(~feasible & (nearly < 0))
        why = _unreached(checker, solutions) if len(unreached) else []
        said = [("", "")] * len(q)
        for pose in unreached:
            said[pose] = why[pose]
        blocked = np.flatnonzero(~feasible & (nearly >= 0))
        # by all constraints: the first that is broken is not the worst
        verdicts = checker.check(solutions.postures[nearly[blocked]])
        for i, pose in enumerate(blocked):
            said[pose] = verdicts.reason(i), verdicts.hint(i)
        return said

    return Postures(q, feasible, explain)


def nearest_rows(checker: Checker, solutions: InverseSolutions) -> tuple[IntArray, IntArray]:
    """Of each pose the posture nearest to the reference that keeps every constraint.

    Rows ``(N,)`` of the solutions, -1 where none keeps them; and where none does, of the one inside
    the limits that comes nearest to it and is worth talking about, -1 where there is none.
    """
    row, nearly = np.full((2, len(solutions.gap_m)), -1, dtype=np.intp)
    slack = np.full(len(row), -np.inf)
    for rows in _nearest_first(solutions):
        rows = rows[row[solutions.pose[rows]] < 0]
        verdicts = checker.check(solutions.postures[rows], every=False)
        found, first = np.unique(solutions.pose[rows[verdicts.feasible]], return_index=True)
        row[found] = rows[verdicts.feasible][first]
        best = first_per_group(solutions.pose[rows], -verdicts.slack, len(row))
        poses = np.flatnonzero(best >= 0)
        better = (nearly[poses] < 0) | (verdicts.slack[best[poses]] > slack[poses])
        poses = poses[better]
        slack[poses], nearly[poses] = verdicts.slack[best[poses]], rows[best[poses]]
    return row, nearly


def _nearest_first(solutions: InverseSolutions) -> Iterator[IntArray]:
    """Rows of the solutions inside the limits: the nearest of each pose, the next two, four, ...

    Ordered by pose, then by distance. Most poses are taken by their nearest posture; a redundant
    arm has hundreds, and looking at them one by one takes long.
    """
    inside = np.flatnonzero(solutions.inside)
    moved = solutions.postures[inside] - solutions.near
    moved[:, : solutions.chain.external.count] *= STAYS
    distance = np.linalg.norm(moved, axis=1)
    order = inside[np.lexsort((distance, solutions.pose[inside]))]
    pose = solutions.pose[order]
    rank = np.arange(len(pose)) - np.searchsorted(pose, pose)
    batch = np.frexp(rank + 1.0)[1]
    for k in range(1, int(batch.max(initial=0)) + 1):
        yield order[batch == k]


def _unreached(checker: Checker, solutions: InverseSolutions) -> list[tuple[str, str]]:
    """Why each pose fails: the limit broken least over all branches, or how far out of reach.

    Beside the reason stands what to change, where something helps.
    """
    verdicts = Checker(checker.robot, margin=checker.margin).check(solutions.postures)
    # the branch that comes nearest to being possible is the one worth talking about
    best = first_per_group(solutions.pose, -verdicts.slack, len(solutions.gap_m))
    gaps = ("" if np.isnan(gap) else f" by {gap * 1e3:.0f} mm" for gap in solutions.gap_m)
    return [
        (verdicts.reason(i), verdicts.hint(i)) if i >= 0 else (f"out of reach{far}", "")
        for i, far in zip(best.tolist(), gaps, strict=True)
    ]
