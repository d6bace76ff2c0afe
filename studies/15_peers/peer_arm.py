"""Modified Denavit-Hartenberg parameters of an arm: what pybotics describes arms by."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib import Robot
from calib.se3 import FloatArray

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
