"""How good poses stay when the robot is not as described, and poses that are chosen for that.

The parameters are drawn from what is known of them before measuring. A robot with such parameters
takes other postures to touch the same target, and what it then tells is another: the Jacobian at
those parameters, at the postures that it really takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.model import CalibrationModel, touch
from calib.se3 import FloatArray
from posedesign.candidates import Pool
from posedesign.cell import Cell
from posedesign.planning.optimal.objective import Goal

LENGTH_M = 5e-3
"""Standard deviation of lengths before measuring: tool and target as they are drawn or measured
with a rule."""

TOUCHED_M = 1e-9
"""Distance from the target at which it counts as touched."""

SCENARIOS = 6
"""Robots that poses are chosen for, the one as described among them: a choice takes about so many
times as long as a plain one. Whether more of them would choose otherwise was not tried."""

TRIALS = 50
"""Robots that a choice is tried on."""


@dataclass(frozen=True, eq=False)
class Robustness:
    """What a choice is worth for robots that are not as described.

    ``nominal``, ``median``, ``worst``: of the criterion, as it is shown; over the trials.
    """

    nominal: float
    median: float
    worst: float
    trials: int


def draw_parameters(
    cell: Cell, model: CalibrationModel, count: int, rng: np.random.Generator
) -> FloatArray:
    """Parameters ``(count, p)`` [SI] as they may be, the nominal ones first.

    Angles by ``parameters.prior_offset_deg`` of the cell, lengths by :data:`LENGTH_M`.
    """
    angle = np.deg2rad(cell.config.parameters.prior_offset_deg)
    size = np.array([angle if unit == "rad" else LENGTH_M for unit in model.units])
    drawn = model.nominal + size * rng.normal(size=(count, model.p))
    drawn[0] = model.nominal
    return np.asarray(drawn)


def blocks_of_robots(
    model: CalibrationModel, goal: Goal, pool: Pool, parameters: FloatArray
) -> FloatArray:
    """Blocks ``(S, N, m, p)`` of postures, as robots with parameters ``(S, p)`` take them.

    Where such a robot cannot touch the target from a posture, its block is zero: it tells nothing.
    """
    setup = pool.setup(model)
    blocks = []
    for x in parameters:
        q, miss = touch(model, pool.postures, x, setup)
        found = goal.blocks(model.linearise(q, x, setup))
        found[~(miss < TOUCHED_M)] = 0.0
        blocks.append(found)
    return np.array(blocks)


def robustness(cell: Cell, model: CalibrationModel, goal: Goal, chosen: Pool) -> Robustness:
    """Try a choice on robots that are not as described."""
    rng = np.random.default_rng(TRIALS)  # fixed, and others than those that poses are chosen for
    drawn = draw_parameters(cell, model, TRIALS + 1, rng)
    costs = np.array(
        [goal.cost_of_blocks(each) for each in blocks_of_robots(model, goal, chosen, drawn)]
    )
    shown = goal.criterion.shown
    return Robustness(
        shown(float(costs[0])),
        shown(float(np.median(costs[1:]))),
        shown(float(costs[1:].max())),
        TRIALS,
    )
