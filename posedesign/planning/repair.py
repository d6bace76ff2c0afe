"""Step 4 of the paper's algorithm: a posture in place of a pose that cannot be taken.

"Adjust the rotation angles of all axes ... so that their displacements from those of other
measuring poses will become as large as possible to move within the operating range": from a pool
of postures that all keep the tool point on the target and every constraint of the cell, the one
farthest from all postures already chosen is taken, again and again (max-min).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from calib.se3 import FloatArray, rotation_angle, rotation_exp
from posedesign.cell import Cell, touching_poses
from posedesign.cell.orientations import cone_rotations
from posedesign.constraints import ROUNDING
from posedesign.planning.pose_plan import PoseSet, PoseStatus

POOL_ORIENTATIONS = 400
"""Orientations that the pool is made of; twice as many lower C_G by less than a tenth."""

MORE_ORIENTATIONS = 3000
"""Orientations all around that are tried where those near the base pose do not do."""

ENOUGH = 3
"""Postures in the pool for each one that is wanted, so that there is something to choose from."""

NEARLY = 60
"""Orientations nearest to being feasible that are varied while none is."""

_GROWTH_ROUNDS = 30
_GROWTH_TILTS = np.deg2rad([0.5, 30.0])
"""Smallest and largest turn by which postures are varied where few can be found."""

_SAME_PLACE_RAD = np.deg2rad(1.0)
"""A posture that differs by less from one that no clear way leads to shares its fate."""

_POOL_SEED = 2006


class RepairPool:
    """Postures that replacements are taken from, found when they are first needed.

    First all arm configurations over a cone of orientations around the base pose, rolled freely,
    inside the limits less the repair margin, with the first joint near its base value, so that no
    replacement reaches over the arm's back. Where they are too few: orientations all around, the
    first joint anywhere, less the margin of the plan only. Where they are still too few: small
    turns of those that were found, or of those that came nearest to keeping every constraint.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._rng = np.random.default_rng(_POOL_SEED)  # fixed: the same cell gives the same plan
        self._stage = 0
        self._found = np.empty((0, cell.robot.n))
        self._nearly: list[tuple[float, FloatArray]] = []
        self._excluded = np.empty((0, cell.robot.n))

    def postures(self, wanted: int) -> FloatArray:
        """Postures ``(K, n)`` [rad] to choose that many from; fewer where there are no more."""
        while len(self._found) < ENOUGH * wanted and self._stage < 2 + _GROWTH_ROUNDS:
            more = self._offered(self._more(self._stage))
            self._found = np.concatenate([self._found, more])
            self._stage += 1
        return self._found

    def exclude(self, postures: FloatArray) -> None:
        """Offer postures ``(K, n)`` [rad] no more, nor any so near that they would do no better."""
        self._excluded = np.concatenate([self._excluded, postures])
        self._found = self._offered(self._found)

    def _offered(self, postures: FloatArray) -> FloatArray:
        apart = np.abs(postures[:, None] - self._excluded[None]).max(axis=-1, initial=0.0)
        return np.asarray(postures[(apart > _SAME_PLACE_RAD).all(axis=1)])

    def _more(self, stage: int) -> FloatArray:
        plan, base = self._cell.config.plan, self._cell.robot.fk(self._cell.base_posture)[:3, :3]
        if stage == 0:
            tilt = float(np.deg2rad(plan.repair_tilt_deg))
            rotations = cone_rotations(base, tilt, POOL_ORIENTATIONS, self._rng)
            margin = float(np.deg2rad(max(plan.repair_margin_deg, plan.limit_margin_deg)))
            return self._feasible(rotations, margin, float(np.deg2rad(plan.repair_base_joint_deg)))
        if stage == 1:
            # a redundant arm takes each orientation in a hundred ways, and longer to find them
            count = MORE_ORIENTATIONS // (1 if self._cell.robot.n == 6 else 10)
            rotations = cone_rotations(base, np.pi, count, self._rng)
        else:
            seeds = self._found if len(self._found) else self._cell.base_posture[None]
            known = [*self._cell.robot.fk(seeds)[:, :3, :3], *(R for _, R in self._nearly)]
            rotations = self._vary(np.array(known))
        return self._feasible(rotations, self._cell.margin, np.inf)

    def _vary(self, rotations: FloatArray) -> FloatArray:
        """Orientations turned a little, some more than others."""
        picked = rotations[self._rng.integers(len(rotations), size=POOL_ORIENTATIONS)]
        low, high = np.log(_GROWTH_TILTS)
        angle = np.exp(self._rng.uniform(low, high, POOL_ORIENTATIONS))
        axis = self._rng.standard_normal((POOL_ORIENTATIONS, 3))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        return np.asarray(picked @ rotation_exp(axis * angle[:, None]))

    def _feasible(self, rotations: FloatArray, margin: float, swing: float) -> FloatArray:
        """All postures with these orientations that keep every constraint."""
        cell, base = self._cell, self._cell.base_posture
        poses = touching_poses(rotations, cell.tool_m, cell.target_m)
        solutions = cell.robot.inverse(poses, near=base, margin=margin)
        near = np.abs(solutions.postures[:, 0] - base[0]) <= swing
        rows = np.flatnonzero(solutions.inside & near)
        verdicts = cell.checker.check(solutions.postures[rows], every=False)
        feasible = verdicts.feasible
        if not len(self._found) and not feasible.any():
            # how many constraints are kept, and how far the first that is not is broken
            kept = (verdicts.room >= -ROUNDING).sum(axis=1) + np.tanh(verdicts.slack)
            best = np.argsort(-kept, kind="stable")[:NEARLY]
            ranked = zip(kept[best], rotations[solutions.pose[rows[best]]], strict=True)
            self._nearly += [(float(score), R) for score, R in ranked]
            self._nearly = sorted(self._nearly, key=lambda entry: -entry[0])[:NEARLY]
        return np.asarray(solutions.postures[rows[feasible]])


def repair(cell: Cell, poses: PoseSet, pool: RepairPool) -> PoseSet:
    """Replace each dropped pose by a posture of the pool, each as far as possible from all others.

    Of the replacements each pose gets the one that is turned least against it; its reason says
    what shut the pose out and by how much the replacement is turned.
    """
    gaps = np.flatnonzero([status is PoseStatus.DROPPED for status in poses.status])
    available = pool.postures(len(gaps))
    found = farthest_postures(available, poses.kept, len(gaps), cell.robot.joint_range)
    postures, status, turned = poses.postures.copy(), list(poses.status), poses.turned.copy()
    R_found = cell.robot.fk(found)[:, :3, :3]
    turn = rotation_angle(np.swapaxes(poses.orientations[gaps][:, None], -1, -2) @ R_found)
    for row, k in zip(*linear_sum_assignment(turn), strict=True):
        i = int(gaps[row])
        postures[i], turned[i] = found[k], turn[row, k]
        status[i] = PoseStatus.REPAIRED
    return replace(poses, postures=postures, status=tuple(status), turned=turned, searched=True)


def farthest_postures(
    pool: FloatArray, chosen: FloatArray, count: int, joint_range: FloatArray
) -> FloatArray:
    """Pick postures one by one, each as far as possible from all chosen before it.

    ``pool`` (K, n): postures to pick from [rad]. ``chosen`` (N, n): postures already in the set
    [rad]. ``count``: how many to pick; fewer are returned where the pool runs out. ``joint_range``
    (n,): joint differences are divided by it, so that every joint counts by how far it can turn.
    Returns array (count, n): [rad].
    """
    points = pool / joint_range
    distance = np.full(len(pool), np.inf)
    for posture in chosen / joint_range:
        distance = np.minimum(distance, np.linalg.norm(points - posture, axis=1))
    picked: list[int] = []
    for _ in range(min(count, len(pool))):
        best = int(np.argmax(distance))
        if distance[best] == 0.0:  # only repetitions are left
            break
        picked.append(best)
        distance = np.minimum(distance, np.linalg.norm(points - points[best], axis=1))
    return pool[picked]
