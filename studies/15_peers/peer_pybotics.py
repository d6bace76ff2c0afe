"""The same touch-ups by pybotics: its handler, its residuals, scipy's least squares.

The distance of tool point and target is the residual, one of each pose; the optimizer is called as
its documentation has it. Touch-ups are positions of zero, in a world that is the unknown target.
"""

from __future__ import annotations

import importlib
from functools import cache
from types import ModuleType

import numpy as np
from peer_arm import modified_dh
from peer_touch_ups import TouchUps
from scipy.optimize import least_squares

from calib import se3
from calib.se3 import FloatArray

THETA = 2
"""Place of the joint's own angle among the four of a link."""


@cache
def modules() -> tuple[ModuleType, ...]:
    """Of robots, of their chains, tools and optimisation; imported once."""
    names = ("robot", "kinematic_chain", "tool", "optimization")
    return tuple(importlib.import_module(f"pybotics.{name}") for name in names)


class Pybotics:
    """An arm of pybotics with the ten parameters of the study freed.

    Parameters
    ----------
    problem : TouchUps
    """

    def __init__(self, problem: TouchUps) -> None:
        robot, chain, tool, self._optimization = modules()
        self._model = problem.model
        links, self._first, self._last = modified_dh(problem.model.robot)
        flange = self._last @ se3.transform(np.eye(3), problem.model.nominal[4:7])
        world = self._first.copy()
        world[:3, 3] -= problem.model.nominal[7:]
        mask = np.zeros(links.size, dtype=bool)
        mask[4 * np.arange(1, 5) + THETA] = True
        position = np.array([True] * 3 + [False] * 3)
        self._handler = self._optimization.OptimizationHandler(
            robot=robot.Robot(
                kinematic_chain=chain.MDHKinematicChain(links.ravel()),
                tool=tool.Tool(flange),
                world_frame=world,
            ),
            kinematic_chain_mask=mask,
            tool_mask=position,
            world_mask=position,
        )
        self._start = self._handler.generate_optimization_vector()

    def points(self, q: FloatArray) -> FloatArray:
        """Tool points ``(N, 3)`` seen from the target, in base axes [m]."""
        return np.array([self._handler.robot.fk(one)[:3, 3] for one in q])

    def fit(self, q: FloatArray) -> FloatArray:
        """The ten parameters ``(10,)`` as the model of this project has them."""
        found = least_squares(
            self._optimization.optimize_accuracy,
            self._start,
            args=(self._handler, q, np.zeros((len(q), 3))),
        ).x
        change = found - self._start
        tool = self._last[:3, :3].T @ (found[4:7] - self._last[:3, 3])
        target = self._first[:3, 3] - found[7:]
        return np.concatenate([change[:4], tool, target])
