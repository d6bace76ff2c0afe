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
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib import Robot, se3
from calib.se3 import FloatArray

from .peer_touch_ups import TouchUps

PARALLEL = 1e-9
"""Sine of the angle of two axes below which they are parallel."""


def modified_dh(robot: Robot) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``alpha, a, theta, d`` of each link ``(n, 4)`` [rad, m], and what comes before and after.

    Craig's frames on the axes of the joints, found from forward kinematics alone. Returns also
    ``T_base_first`` and ``T_last_tip`` ``(4, 4)``: the arm is their product with the links between.
    """
    n = robot.n
    frames = _frames(*_axes(robot))
    links = np.zeros((n, 4))
    for k in range(1, n):
        T = np.linalg.inv(frames[k - 1]) @ frames[k]
        alpha = np.arctan2(-T[1, 2], T[2, 2])
        theta = np.arctan2(-T[0, 1], T[0, 0])
        d = T[2, 3] * np.cos(alpha) - T[1, 3] * np.sin(alpha)
        links[k] = alpha, T[0, 3], theta, d
    return links, frames[0], np.linalg.inv(frames[-1]) @ robot.fk(np.zeros(n))


def _axes(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Points on the axes of the joints and their directions ``(n, 3)``, all joints at zero."""
    turned = robot.fk(0.5 * np.pi * np.eye(robot.n)) @ np.linalg.inv(robot.fk(np.zeros(robot.n)))
    direction = Rotation.from_matrix(turned[:, :3, :3]).as_rotvec() / (0.5 * np.pi)
    point = [np.linalg.lstsq(np.eye(3) - T[:3, :3], T[:3, 3], rcond=None)[0] for T in turned]
    return np.array(point), direction


def _frames(point: FloatArray, z: FloatArray) -> list[FloatArray]:
    """Frames on the axes: z along each, x along the common normal to the next."""
    frames: list[FloatArray] = []
    origin = point[0]
    for k in range(len(z)):
        if k + 1 < len(z):
            cross, between = np.cross(z[k], z[k + 1]), point[k + 1] - point[k]
            if np.linalg.norm(cross) > PARALLEL:
                x = cross / np.linalg.norm(cross)
                columns = np.stack([z[k], -z[k + 1], x], axis=1)
                origin = point[k] + np.linalg.solve(columns, between)[0] * z[k]
            else:  # the normal through where the last one met this axis
                origin = point[k] + z[k] * ((origin - point[k]) @ z[k])
                across = point[k + 1] - origin
                across = across - z[k] * (across @ z[k])
                x = across / np.linalg.norm(across)
        else:
            x = frames[-1][:3, 0] - z[k] * (frames[-1][:3, 0] @ z[k])
            x = x / np.linalg.norm(x)
            origin = point[k] + z[k] * ((origin - point[k]) @ z[k])
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z[k], x), z[k]], axis=1), origin
        frames.append(T)
    return frames


THETA = 2
"""Place of the joint's own angle among the four of a link."""


@cache
def modules() -> tuple[ModuleType, ...]:
    """Of robots, of their chains, tools and optimisation; imported once."""
    names = ("robot", "kinematic_chain", "tool", "optimization")
    return tuple(importlib.import_module(f"pybotics.{name}") for name in names)


class Pybotics:
    """An arm of pybotics with the ten parameters of the study freed."""

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
