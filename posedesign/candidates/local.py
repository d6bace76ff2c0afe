"""Postures next to given ones: the tool turned a little about the point that it touches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.robots import Robot
from calib.robots.bounds import LIMIT_TOLERANCE, Bounds
from calib.robots.inverse import CLOSURE_TOLERANCE, pose_error
from calib.robots.inverse.solutions import close_in
from calib.se3 import BoolArray, FloatArray, rotation_exp
from posedesign.cell import Cell, touching_poses

_STEP_RAD = 0.05
"""Largest turn of the tool that is followed at once. Newton's steps then stay on the branch of the
arm that they started on unless a singularity lies in between."""

_NEWTON_STEPS = 12
"""Of each turn; away from singularities three or four are enough."""


def local_poses(
    cell: Cell, postures: FloatArray, turns: ArrayLike, touched_m: FloatArray | None = None
) -> FloatArray:
    """Postures ``(N, n)`` [rad] with the tool turned about the point that it touches.

    Of the same branch of the arm as those given and next to them, for they are followed along the
    turn. A redundant arm moves its joints as little as it can.

    ``postures`` (N, n): postures to start from [rad]. ``turns`` (N, 3): rotation vectors r [rad] in
    the axes of the tip: its orientation becomes ``R exp(r)``, as in
    :mod:`calib.model.parameters.frames`. In base axes it would be ``R.T @ r``. ``touched_m`` (N,
    3): where the tool point stays [m], base frame, e.g. :attr:`Pool.touched_m`. By default where it
    is; given, the rounding of one step after another does not add up. Returns array (N, n): NaN
    where no such posture lies inside the limits less the margin of the cell, or where the turn
    leads into a singularity. Other constraints are not looked at: see
    :func:`~posedesign.candidates.feasible`. Raises InputError: postures, turns or places do not go
    together.
    """
    robot = cell.robot
    q = np.atleast_2d(robot.check_posture(postures))
    by = np.asarray(turns, dtype=float)
    if by.shape != (len(q), 3) or not np.isfinite(by).all():
        raise InputError(
            f"{len(q)} postures need turns of shape ({len(q)}, 3), not {by.shape}",
            hint="give a rotation vector in radians for each",
            name="turns",
        )
    state = robot.state(q)
    place = state.point(cell.tool_m) if touched_m is None else np.asarray(touched_m, dtype=float)
    if place.shape != (len(q), 3):
        raise InputError(f"{len(q)} postures touch places ({len(q)}, 3)", name="touched_m")
    bounds = Bounds.within(robot.lower, robot.upper, robot.coupled_limits, cell.margin)
    steps = max(1, math.ceil(np.linalg.norm(by, axis=1).max(initial=0.0) / _STEP_RAD))
    found = q
    for k in range(1, steps + 1):
        turned = state.R_base_tip @ rotation_exp(by * (k / steps))
        T = touching_poses(turned, cell.tool_m, place)
        found = _followed(robot, found, T, bounds)
    found[~_same_branch(robot, q, found)] = np.nan
    found[~(bounds.excess(found).max(axis=1) <= LIMIT_TOLERANCE)] = np.nan
    return found


def _followed(robot: Robot, q: FloatArray, T_base_tip: FloatArray, bounds: Bounds) -> FloatArray:
    """Postures closed in on poses, NaN where that failed."""
    there = np.flatnonzero(np.isfinite(q).all(axis=1))
    # only a redundant arm can go on where a joint is at its limit
    free = robot.n <= 6
    lower, upper = (np.full(robot.n, sign * np.inf) for sign in (-1, 1))
    if not free:
        lower, upper = bounds.lower, bounds.upper
    T = T_base_tip[there]
    closed = close_in(robot.chain, q[there], T, lower, upper, _NEWTON_STEPS)
    miss = np.abs(pose_error(robot.chain, closed, T)).max(axis=1, initial=0.0)
    out = np.full(q.shape, np.nan)
    out[there[miss < CLOSURE_TOLERANCE]] = closed[miss < CLOSURE_TOLERANCE]
    return out


def _same_branch(robot: Robot, q: FloatArray, moved: FloatArray) -> BoolArray:
    """Whether no singularity lies between postures: there the Jacobian's determinant is zero."""
    if robot.n != 6:
        return np.ones(len(q), dtype=bool)
    signs = np.full(len(q), np.nan)
    there = np.isfinite(moved).all(axis=1)
    signs[there] = np.linalg.slogdet(robot.jacobian(moved[there]))[0]
    return np.asarray(signs == np.linalg.slogdet(robot.jacobian(q))[0])
