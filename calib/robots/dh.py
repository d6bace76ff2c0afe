"""Denavit-Hartenberg parameters of an arm, with the base and the tool that make them exact.

Joint axes are lines, and a table of rows of four numbers places each line against the one before it
[DenavitHartenberg1955]_; in Craig's form the numbers of a link come in the row of the next joint
[Craig1986]_. Of axes that are nearly parallel the common normal is anywhere, and the offset along
the axis has hundreds of metres: there a row of Hayati's leaves it out, and has a second angle
instead [Hayati1983]_.

=========  =====================================================================================
standard   ``T_0_n``: product of ``Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)`` of each row
modified   ``T_0_n``: product of ``Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)`` of each row
=========  =====================================================================================

``theta`` is the joint value of the description and the offset of the row; ``beta`` is zero but in
Hayati's rows, in which ``d`` is: of the same row, in the modified form of the one before it.

References
----------
.. [DenavitHartenberg1955] J. Denavit, R. S. Hartenberg, A kinematic notation for lower-pair
   mechanisms based on matrices, J. Applied Mechanics 22, 1955, 215-221.
.. [Craig1986] J. J. Craig, Introduction to robotics: mechanics and control, 1986, chapter 3.
.. [Hayati1983] S. A. Hayati, Robot arm geometric link parameter estimation, 22nd IEEE Conf. on
   Decision and Control, 1983, 1477-1483.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, RobotModelError, model_error, near_names
from calib.robots.geared_chain import GearedChain
from calib.robots.robot import Robot
from calib.se3 import FloatArray, inverse, rotation_exp, transform

Form = Literal["standard", "modified"]

PARALLEL_RAD = np.deg2rad(5.0)
"""Angle of two axes up to which a row of Hayati's is written. Axes that are meant to be parallel
are off by a milliradian; no arm has any that are meant to be off by this."""

_EXACT = 1e-12
"""Angle [rad] of axes that are parallel to the last digit: any common normal is right."""

_TOO_FAR_RAD = 1e-6
"""Angle of axes below which their common normal is so far away that rounding is a nanometre."""

_SOME_LENGTH_M = 1e-3
"""Distance of axes that is one by design: x then points from one to the next."""

_HALF_TURN_WITHIN_RAD = np.deg2rad(2.0)

_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True, eq=False)
class DHTable:
    """A table of an arm of n joints."""

    form: Form
    theta: FloatArray
    d: FloatArray
    a: FloatArray
    alpha: FloatArray
    beta: FloatArray
    """theta, d, a, alpha, beta (n,): see the module [rad, m]; ``theta`` is the offset."""
    T_base_0: FloatArray
    T_n_tip: FloatArray
    """T_base_0, T_n_tip (4, 4): before the first row and behind the last one [m]."""

    def fk(self, q: ArrayLike) -> FloatArray:
        """Poses of the tip ``(..., 4, 4)`` [m] at postures ``(..., n)`` [rad]."""
        q = np.asarray(q, dtype=float)
        T = np.broadcast_to(self.T_base_0, (*q.shape[:-1], 4, 4))
        for j in range(len(self.theta)):
            turned = _along(_Z, q[..., j] + self.theta[j], self.d[j])
            link = _along(_X, self.alpha[j], self.a[j]) @ _along(_Y, self.beta[j], 0.0)
            T = T @ turned @ link if self.form == "standard" else T @ link @ turned
        return np.asarray(T @ self.T_n_tip)


def dh_table(robot: Robot, form: Form = "standard", parallel_rad: float = 0.0) -> DHTable:
    """The table of an arm; joints are counted from the zero of the description.

    Its frame 0 is on the first axis, as near to the controller's world as can be (to the base,
    where no controller is known); frame n is the tip where that is on the last axis.

    Parameters
    ----------
    parallel_rad : float
        Angle of axes up to which rows are Hayati's; 0: none are. `PARALLEL_RAD` is the usual one.

    Raises
    ------
    InputError
        An unknown form.
    RobotModelError
        Axes are nearly parallel, and rows of Hayati's were not asked for.
    """
    if form not in get_args(Form):
        raise InputError(
            f"unknown form {form!r} of a table", hint=near_names(form, get_args(Form)), name="form"
        )
    own = robot.chain.arm
    if own.external.any_slides or isinstance(own, GearedChain):
        raise model_error(
            robot.name,
            "has joints that slide, or follow others, and the table is of joints that turn",
            "leave the table out",
        )
    if robot.n_external:
        raise model_error(
            robot.name,
            f"{robot.joint_names[0]} is an external axis, and the table is of the arm alone",
            "hold it, or name a base behind it",
            robot.joint_names[0],
        )
    at_zero = robot.chain.forward(np.zeros(robot.n))
    world = np.eye(4) if robot.controller is None else robot.controller.T_base_world
    T_base_0 = T = _first_frame(at_zero.axes[0], at_zero.origins[0], world)
    rows = np.zeros((robot.n, 5))  # theta, d, a, alpha, beta
    for j in range(robot.n - 1):
        axis = T[:3, :3].T @ at_zero.axes[j + 1]
        point = T[:3, :3].T @ (at_zero.origins[j + 1] - T[:3, 3])
        apart = float(np.hypot(axis[0], axis[1]))
        if apart <= max(np.sin(parallel_rad), _EXACT):
            rows[j] = _hayati(axis, point)
        elif apart < _TOO_FAR_RAD:
            raise RobotModelError(
                f"the axes of {robot.joint_names[j]} and {robot.joint_names[j + 1]} are parallel "
                f"but for {apart:.1g} rad: their common normal is kilometres away",
                hint="write Hayati's parameters",
                name=robot.joint_names[j],
            )
        else:
            rows[j] = _common_normal(axis, point)
        theta, d, a, alpha, beta = rows[j]
        T = T @ _along(_Z, theta, d) @ _along(_X, alpha, a) @ _along(_Y, beta, 0.0)
    T_n_tip = inverse(T) @ at_zero.T_base_tip
    if abs(T_n_tip[2, 2]) > np.cos(PARALLEL_RAD):
        rows[-1, :2] = np.arctan2(T_n_tip[1, 0], T_n_tip[0, 0]), T_n_tip[2, 3]
        T_n_tip = inverse(_along(_Z, *rows[-1, :2])) @ T_n_tip
    theta, d, a, alpha, beta = rows.T
    if form == "modified":  # of a link in the row of the joint behind it
        a, alpha, beta = (np.concatenate([[0.0], values[:-1]]) for values in (a, alpha, beta))
    return DHTable(form, theta, d, a, alpha, beta, T_base_0, T_n_tip)


def _along(axis: FloatArray, angle: ArrayLike, distance: float) -> FloatArray:
    """Rotations about an axis and a translation along it, ``(..., 4, 4)``; they commute."""
    turn = rotation_exp(np.asarray(angle)[..., None] * axis)
    return transform(turn, np.broadcast_to(distance * axis, (*turn.shape[:-2], 3)))


def _first_frame(z: FloatArray, point: FloatArray, T_base_world: FloatArray) -> FloatArray:
    """A frame ``(4, 4)`` on an axis: its origin next to that of the world, x along the world's."""
    to_world = T_base_world[:3, 3] - point
    x = T_base_world[:3, 0] if abs(T_base_world[:3, 0] @ z) < 0.9 else T_base_world[:3, 1]
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return transform(np.column_stack([x, np.cross(z, x), z]), point + (to_world @ z) * z)


def _common_normal(axis: FloatArray, point: FloatArray) -> tuple[float, ...]:
    """Row of a line, by its direction and a point in the frame of the axis before it."""
    theta = np.arctan2(axis[0], -axis[1])
    x = np.array([np.cos(theta), np.sin(theta), 0.0])
    if _is_turned(float(theta), float(point @ x)):
        theta, x = theta - np.sign(theta) * np.pi, -x
    y = np.array([-x[1], x[0], 0.0])
    along = -(point @ y) / (axis @ y)
    alpha = np.arctan2(np.cross(_Z, axis) @ x, axis[2])
    return float(theta), float(point[2] + along * axis[2]), float(point @ x), float(alpha), 0.0


def _hayati(axis: FloatArray, point: FloatArray) -> tuple[float, ...]:
    """The same of a line that is nearly parallel: where it meets the plane z = 0."""
    place = point - axis * (point[2] / axis[2])
    a = float(np.hypot(place[0], place[1]))
    theta = float(np.arctan2(place[1], place[0])) if a > 0.0 else 0.0
    if _is_turned(theta, a):
        theta, a = theta - np.sign(theta) * np.pi, -a
    x, y, z = rotation_exp(-theta * _Z) @ axis
    return theta, 0.0, a, float(np.arctan2(-y, z)), float(np.arcsin(x))


def _is_turned(theta: float, a: float) -> bool:
    """Whether x is better turned round: it points to the next axis, half turns left out."""
    if abs(a) < _SOME_LENGTH_M:
        return abs(theta) > np.pi / 2
    half = abs(theta) > np.pi - _HALF_TURN_WITHIN_RAD
    straight = abs(theta) < _HALF_TURN_WITHIN_RAD
    return half or (a < 0.0 and not straight)
