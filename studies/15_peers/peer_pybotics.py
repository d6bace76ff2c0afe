"""The same touch-ups by pybotics: its arm, its handler of parameters, scipy's least squares.

Touch-ups are positions of zero, in a world that is the unknown target. Its own residuals are the
distances of tool point and target, one of each pose, which have a kink at zero; the optimizer is
called as its example has it. What a user can do about that is to take the three coordinates.
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

    def fit(self, q: FloatArray, *, coordinates: bool = False) -> FloatArray:
        """The ten parameters ``(10,)`` as the model of this project has them.

        Parameters
        ----------
        q : ndarray (N, n)
            Postures of the touch-ups [rad].
        coordinates : bool
            Take the coordinates for residuals, by its kinematics, in place of its own distances.
        """
        if coordinates:
            found = least_squares(lambda v: self._coordinates(v, q), self._start).x
        else:
            arguments = (self._handler, q, np.zeros((len(q), 3)))
            residuals = self._optimization.optimize_accuracy
            found = least_squares(residuals, self._start, args=arguments).x
        tool = self._last[:3, :3].T @ (found[4:7] - self._last[:3, 3])
        target = self._first[:3, 3] - found[7:]
        return np.concatenate([found[:4] - self._start[:4], tool, target])

    def _coordinates(self, vector: FloatArray, q: FloatArray) -> FloatArray:
        self._handler.apply_optimization_vector(vector)
        return self.points(q).ravel()
