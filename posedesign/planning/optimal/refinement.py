"""Poses made better off the pool: the tool turned about the target, inside all constraints.

Each pose in turn is offered a few turns down the gradient of the criterion, and a few along the
axes of the tool for where the gradient leads into a limit, or the criterion has a kink. What breaks
a constraint is not offered; what helps is taken. The tool point stays on the target throughout.

How good poses stay when the robot is not as described, and poses that are chosen for that: the
parameters are drawn from what is known of them before measuring. A robot with such parameters
takes other postures to touch the same target, and what it then tells is another: the Jacobian at
those parameters, at the postures that it really takes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.model import CalibrationModel, touch
from calib.se3 import FloatArray, IntArray, apply
from posedesign.candidates import CandidatePoses, feasible, local_poses
from posedesign.cell import Cell
from posedesign.planning.optimal.request import PlanObjective
from posedesign.selection import Candidates
from posedesign.selection.information import FewAtOnce

LENGTH_M = 5e-3
"""Standard deviation of lengths before measuring: tool and target as they are drawn or measured
with a rule."""

TOUCHED_M = 1e-9
"""Distance from the target at which it counts as touched."""

SCENARIOS = 6
"""Robots that poses are chosen for, the one as described among them: a choice takes about so many
times as long as a plain one. Whether more of them would choose otherwise was not tried."""

ANGLE_RAD = float(np.deg2rad(1.0))
"""The same of angles that nothing is known of."""

DOWN_RAD = (0.2, 0.1, 0.05, 0.02, 0.01, 0.003)
"""Turns down the gradient that are offered."""

ALONG_RAD = (0.1, 0.02)
"""Turns about the axes of the tool, both ways."""

PROBE_RAD = 1e-4
"""Turn by which the gradient is found, by central differences."""

MOST_SWEEPS = 30
"""Sweeps over all poses."""

ENOUGH = 1e-4
"""Relative gain of a sweep below which no other follows."""


def draw_parameters(model: CalibrationModel, count: int, rng: np.random.Generator) -> FloatArray:
    """Parameters ``(count, p)`` [SI] as they may be, the nominal ones first.

    By their priors; tool and targets by :data:`LENGTH_M` and :data:`ANGLE_RAD`.
    """
    usual = np.array([LENGTH_M if unit == "m" else ANGLE_RAD for unit in model.units])
    size = np.where(np.isfinite(model.prior), model.prior, usual)
    drawn = model.nominal + size * rng.normal(size=(count, model.p))
    drawn[0] = model.nominal
    return np.asarray(drawn)


def blocks_of_robots(
    model: CalibrationModel, objective: PlanObjective, pool: CandidatePoses, parameters: FloatArray
) -> FloatArray:
    """Blocks ``(S, N, m, p)`` of postures, as robots with parameters ``(S, p)`` take them.

    Where such a robot cannot touch the target from a posture, its block is zero: it tells nothing.
    """
    setup = pool.setup(model)
    q, miss = pool.postures, np.zeros(len(pool))
    if setup.together == 1:  # several at once are read, at the postures as they are
        q, miss = touch(model, q, parameters, setup)
    blocks = objective.blocks(model.linearise(q, parameters, setup))
    return np.where((miss < TOUCHED_M)[..., None, None], blocks, 0.0)


def refine(
    cell: Cell,
    model: CalibrationModel,
    objective: PlanObjective,
    chosen: CandidatePoses,
    *,
    fixed: int = 0,
) -> CandidatePoses:
    """Turn the tool at chosen poses for as long as the criterion gets better.

    Tilts against the base pose stay within the widest of the poses given.

    The first ``fixed`` poses stay as they are; all stay on the branch of the arm that they are on.
    """
    search = _Refinement(cell, model, objective, chosen, fixed)
    cost = search.cost()
    for _ in range(MOST_SWEEPS):
        search.sweep()
        following = search.cost()
        if not following < (1.0 - ENOUGH) * cost:
            break
        cost = following
    return search.pool


class _Refinement:
    """The poses as they are, and what is offered to each."""

    def __init__(
        self,
        cell: Cell,
        model: CalibrationModel,
        objective: PlanObjective,
        chosen: CandidatePoses,
        fixed: int,
    ) -> None:
        self._fixed = fixed
        self._cell, self._model, self._objective = cell, model, objective
        self.pool = chosen
        # where the target is met already, its own place does not gather rounding
        self._tool = chosen.tools_m(cell.tool_m)
        T = cell.robot.fk(chosen.postures)
        self._place = apply(T, self._tool)
        self._axis = cell.robot.fk(cell.base_posture)[:3, 2]
        self._widest = float(self._tilts(chosen.orientations).max())

    def _tilts(self, R: FloatArray) -> FloatArray:
        return np.asarray(np.arccos(np.clip(R[:, :, 2] @ self._axis, -1.0, 1.0)))

    def cost(self) -> float:
        return self._objective.cost_of_blocks(self._blocks(self.pool))

    def _blocks(self, pool: CandidatePoses) -> FloatArray:
        return self._objective.of_pool(self._model, pool)

    def sweep(self) -> None:
        """Offer every pose its turns, once."""
        n = len(self.pool)
        slopes = self._slopes()
        length = np.linalg.norm(slopes, axis=1, keepdims=True)
        down = -np.divide(slopes, length, out=np.zeros_like(slopes), where=length > 0.0)
        axes = np.vstack([np.eye(3), -np.eye(3)])
        turns = np.concatenate(
            [down[:, None] * np.array(DOWN_RAD)[:, None]]
            + [np.broadcast_to(angle * axes, (n, 6, 3)) for angle in ALONG_RAD],
            axis=1,
        )  # (n, offers, 3)
        turns = turns[self._fixed :]
        owner = np.repeat(np.arange(self._fixed, n), turns.shape[1])
        offered, row = self._turned(owner, turns.reshape(-1, 3))
        if len(row):
            self._take_best(offered, owner[row])

    def _turned(self, owner: IntArray, turns: FloatArray) -> tuple[CandidatePoses, IntArray]:
        """The pool of those turned poses that can be taken, and which they are."""
        start = self.pool.take(owner)
        q = local_poses(self._cell, start.postures, turns, self._place[owner], self._tool[owner])
        found = np.flatnonzero(np.isfinite(q).all(axis=1))
        R = self._cell.robot.fk(q[found])[:, :3, :3]
        found = found[self._tilts(R) <= self._widest + 1e-9]
        at = start.target[found]
        good = feasible(self._cell, q[found], at, start.targets_m)
        row = found[good]
        R = self._cell.robot.fk(q[row])[:, :3, :3]
        return replace(start.take(row), postures=q[row], orientations=R), row

    def _slopes(self) -> FloatArray:
        """Derivative ``(n, 3)`` of the logarithm of the cost by turns of each tool."""
        n = len(self.pool)
        probes = np.concatenate([PROBE_RAD * np.eye(3), -PROBE_RAD * np.eye(3)])
        owner = np.repeat(np.arange(n), 6)
        start = self.pool.take(owner)
        q = local_poses(
            self._cell,
            start.postures,
            np.tile(probes, (n, 1)),
            self._place[owner],
            self._tool[owner],
        )
        q = np.where(np.isfinite(q).all(axis=1, keepdims=True), q, start.postures)
        moved = self._blocks(replace(start, postures=q))
        costs = np.log(self._costs_in_place(moved, owner)).reshape(n, 2, 3)
        slopes = (costs[:, 0] - costs[:, 1]) / (2.0 * PROBE_RAD)
        return np.where(np.isfinite(slopes), slopes, 0.0)

    def _costs_in_place(self, blocks: FloatArray, owner: IntArray) -> FloatArray:
        """Cost of the set with each block in the place of its owner."""
        n = len(self.pool)
        candidates = Candidates(
            np.concatenate([self._blocks(self.pool), blocks]), self._objective.known
        )
        objective = self._objective.criterion.on(candidates)
        state = FewAtOnce(candidates, np.arange(n), n)
        out = np.empty(len(owner))
        for k in range(n):
            mine = np.flatnonzero(owner == k)
            state.drop(k)
            out[mine] = objective.costs(state, n + mine, 1.0)
            state.take(k)
        return out

    def _take_best(self, offered: CandidatePoses, owner: IntArray) -> None:
        n = len(self.pool)
        candidates = Candidates(
            np.concatenate([self._blocks(self.pool), self._blocks(offered)]), self._objective.known
        )
        objective = self._objective.criterion.on(candidates)
        state = FewAtOnce(candidates, np.arange(n), n)
        q, R = self.pool.postures.copy(), self.pool.orientations.copy()
        for k in range(n):
            mine = np.append(n + np.flatnonzero(owner == k), k)
            state.drop(k)
            costs = objective.costs(state, mine, 1.0)
            best = int(mine[np.argmin(costs)]) if costs.min() < (1 - 1e-9) * costs[-1] else k
            state.take(best)
            if best != k:
                q[k], R[k] = offered.postures[best - n], offered.orientations[best - n]
        self.pool = replace(self.pool, postures=q, orientations=R)
