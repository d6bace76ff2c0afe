"""Commands that bring the real arm to where the nominal one was meant to go.

The errors that were identified are known at every posture: zero offsets, link geometry, and what
changes with the posture (compliance, harmonics, lost motion), which no corrected description can
hold. So each pose gets a command of its own, found by Newton's method on the arm with all its
errors, from the posture that the nominal robot takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib.correction.corrected_robot import check_values
from calib.errors import InputError, JointLimitError
from calib.model import CalibrationModel, Setup
from calib.model.context import MeasurementContext
from calib.robots import InverseSolutions, Robot
from calib.robots.chain import twists_at
from calib.robots.inverse.few_axes import AXES_OF_A_POSE
from calib.robots.inverse.solutions import damped_step
from calib.se3 import BoolArray, FloatArray, check_transforms, inverse, rotation_log, transform

CLOSED = 1e-9
"""Largest remaining distance [m] and angle [rad] of a pose that is reached: what the closed forms
of inverse kinematics are held to."""

_ENOUGH = 1e-12
"""Remaining error [m, rad] at which the iteration ends: rounding is a tenth of it."""

_ITERATIONS = 60
"""Steps; four do for most poses. Each leaves of the error what joint errors change by as the joint
turns: a hundredth, where the shaft of a motor is out of true."""

_PATIENCE = 3
"""Steps without any pose getting better after which none will: the last digits are reached."""

_ENOUGH_JOINTS = 6
"""Joints that turn which correct a pose alone: a rail would share in it, and go centimetres."""

_DAMPING = 1e-6
"""Of the least-squares step, relative to the squared error: vanishes at the solution."""

_LARGEST_STEP_RAD = 0.2
"""Longer steps are cut: corrections are a degree at most, but for poses next to a singularity."""

Status = Literal["reached", "outside limits", "not reached", "no posture"]
Point = Literal["tool", "tip"]


@dataclass(frozen=True, eq=False)
class Compensated:
    """Corrected commands for N poses."""

    postures: FloatArray
    """(N, n): joint values to command [rad]; NaN where there is no posture to start from."""
    T_base_tip: FloatArray
    """(N, 4, 4): pose of the tip that the *nominal* robot has at the command [m]: what to give a
    controller that takes Cartesian points, and computes its joint values as described."""
    wanted: FloatArray
    """(N, 4, 4): poses of tool or tip that the real arm was to take, in the base frame [m]."""
    nominal: FloatArray  # (N, n): postures that the nominal robot takes them with [rad]
    error_m: FloatArray
    error_rad: FloatArray
    """error_m, error_rad (N,): what remains between the real arm and the poses wanted; NaN without
    a posture."""
    status: tuple[Status, ...]
    """``reached``, ``outside limits`` (the command is; the arm will not go there), ``not reached``,
    or ``no posture`` (the nominal robot has none)."""
    reasons: tuple[str, ...]  # why a pose is not reached; empty where it is

    @property
    def ok(self) -> BoolArray:
        """Whether each pose is reached inside the limits, ``(N,)``."""
        return np.array([status == "reached" for status in self.status], dtype=bool)

    @property
    def change(self) -> FloatArray:
        """Command less nominal posture, ``(N, n)`` [rad]."""
        return np.asarray(self.postures - self.nominal)

    def T_base_point(self, T_tip_point: ArrayLike) -> FloatArray:
        """Corrected Cartesian points ``(N, 4, 4)`` [m] of a tool as the controller knows it.

        Parameters
        ----------
        T_tip_point : array_like (4, 4)
            The controller's tool frame, of which it takes points, in the tip frame [m].
        """
        return np.asarray(self.T_base_tip @ check_transforms(T_tip_point, "T_tip_point"))


def compensate(
    model: CalibrationModel,
    x: ArrayLike,
    *,
    poses: ArrayLike | None = None,
    postures: ArrayLike | None = None,
    point: Point = "tool",
    setup: Setup | None = None,
    near: ArrayLike | None = None,
) -> Compensated:
    """Find the commands that bring the real arm to poses, in the arm configuration meant.

    What is brought there is the tool as it was identified, or the tip alone. The tool is the
    better known of the two: what touch-ups cannot tell apart (the zero offset of the last joint
    and the tool) is right of both together only. Leave the tool in the controller as it was then:
    its error is in the command.

    Poses are those of the base frame in which the parameters were identified. Where targets took
    up the zero offset of joint 1, that is the frame of the targets as identified.

    Parameters
    ----------
    x : array_like (p,)
        Identified parameters [SI].
    poses : array_like (N, 4, 4), optional
        Wanted poses of tool or tip in the base frame [m]. By default those that the nominal robot,
        with its nominal tool, has at ``postures``.
    postures : array_like (N, n), optional
        Postures of the nominal robot [rad], whose arm configuration is kept. By default those
        that take the poses nearest to ``near``. One of ``poses`` and ``postures`` is needed.
    point : {"tool", "tip"}
    setup : Setup, optional
        Tool and payload at each pose; the first of each by default.
    near : array_like (n,), optional
        See :meth:`Robot.inverse`.

    Raises
    ------
    InputError
        Parameters, poses or postures that cannot be used.
    """
    values = check_values(model, x)
    if point not in get_args(Point):
        raise InputError(f"unknown point {point!r}", hint='one of "tool", "tip"', name="point")
    if postures is None:
        wanted = _listed_poses(poses)
        q, solved = _nominal(model, wanted, point, setup, near)
    else:
        q, solved = model.robot.check_posture(postures), None
        if q.ndim != 2:
            raise InputError("give a list of postures, (N, n)", name="postures")
        if poses is None:
            poses = _taken(model.view(q, None, setup), point) if len(q) else np.empty((0, 4, 4))
        wanted = _listed_poses(poses)
        if len(wanted) != len(q):
            raise InputError(f"{len(wanted)} poses for {len(q)} postures", name="poses")
    known = np.isfinite(q).all(axis=1)
    found, T_nominal = q.copy(), np.full((len(q), 4, 4), np.nan)
    twist = np.full((len(q), 6), np.nan)
    if known.any():
        part = None if setup is None else setup[np.flatnonzero(known)]
        found[known], twist[known] = _newton(model, values, q[known], wanted[known], point, part)
        T_nominal[known] = model.robot.fk(found[known])
    error_m, error_rad = np.linalg.norm(twist[:, :3], axis=1), np.linalg.norm(twist[:, 3:], axis=1)
    verdicts = [
        _verdict(model.robot, found[i], error_m[i], error_rad[i], solved, i) for i in range(len(q))
    ]
    return Compensated(
        postures=found,
        T_base_tip=T_nominal,
        wanted=wanted,
        nominal=q,
        error_m=error_m,
        error_rad=error_rad,
        status=tuple(status for status, _ in verdicts),
        reasons=tuple(reason for _, reason in verdicts),
    )


def _listed_poses(poses: ArrayLike | None) -> FloatArray:
    if poses is None:
        raise InputError("give poses, or postures, or both", name="poses")
    wanted = check_transforms(poses, "poses")
    if wanted.ndim != 3:
        raise InputError("give a list of poses, (N, 4, 4)", name="poses")
    return wanted


def _taken(view: MeasurementContext, point: Point) -> FloatArray:
    """Poses ``(N, 4, 4)`` that tool or tip take."""
    if point == "tip":
        return view.T_base_tip
    columns = np.broadcast_to(view.tool, (3, 3, view.q.shape[1]))
    return transform(view.posture_first(columns), view.tool_points)


def _nominal(
    model: CalibrationModel,
    wanted: FloatArray,
    point: Point,
    setup: Setup | None,
    near: ArrayLike | None,
) -> tuple[FloatArray, InverseSolutions]:
    """Postures ``(N, n)`` that the nominal robot takes, NaN where it has none, and all others."""
    anywhere = np.zeros((len(wanted), model.robot.n))
    view = model.view(anywhere, None, setup)
    T_tip_point = inverse(view.T_base_tip) @ _taken(view, point)
    solved = model.robot.inverse(wanted @ inverse(T_tip_point), near)
    return solved.nearest()[0], solved


def _newton(
    model: CalibrationModel,
    x: FloatArray,
    q: FloatArray,
    wanted: FloatArray,
    point: Point,
    setup: Setup | None,
) -> tuple[FloatArray, FloatArray]:
    """Commands ``(N, n)`` from postures, and the twists ``(N, 6)`` [m, rad] that remain.

    The best command of the way is kept: where there is no solution, steps go to and fro. An arm of
    fewer than six joints brings the point there, moved as little as that takes.
    """
    rows = _rows(model.robot)
    best, left, stale = q, np.full((len(q), 6), np.inf), 0
    for _ in range(_ITERATIONS):
        view = model.view(q, x, setup)
        at = _taken(view, point)
        turn = rotation_log(wanted[:, :3, :3] @ np.swapaxes(at[:, :3, :3], -1, -2))
        twist = np.concatenate([wanted[:, :3, 3] - at[:, :3, 3], turn], axis=1)
        size = np.abs(twist[:, rows]).max(axis=1)
        better = size < np.abs(left[:, rows]).max(axis=1)
        best, left = np.where(better[:, None], q, best), np.where(better[:, None], twist, left)
        stale = 0 if better.any() else stale + 1
        if stale == _PATIENCE or np.abs(left[:, rows]).max() < _ENOUGH:
            break
        J, right = _jacobian(view, at[:, :3, 3])[:, rows], twist[:, rows]
        damping = _DAMPING * np.sum(right**2, axis=1) + 1e-14
        q = q + damped_step(J, right, damping, _LARGEST_STEP_RAD)
    return best, left


def _rows(robot: Robot) -> slice:
    """Return the rows of twists that the joints can correct: of the point alone by fewer than six.

    What it cannot turn is as the arm is built.
    """
    return slice(0, 3 if robot.n < AXES_OF_A_POSE else 6)


def _jacobian(view: MeasurementContext, points: FloatArray) -> FloatArray:
    """Geometric Jacobian ``(N, 6, n)`` of points ``(N, 3)`` of the arm with its errors.

    Zero of external axes beside joints enough to correct a pose: they keep their places.
    """
    external = view.robot.external
    if view.walk.twists is not None:
        return np.asarray(twists_at(view.walk.twists, points.T).transpose(2, 1, 0))
    axes = np.stack([view.axis(j).T for j in range(view.robot.n)], axis=1)  # (N, n, 3)
    origins = view.walk.origins.transpose(2, 0, 1)
    linear = np.cross(axes, points[:, None] - origins)
    slides = view.robot.sliding
    linear[:, slides], axes[:, slides] = axes[:, slides], 0.0
    if view.robot.n - external.count >= _ENOUGH_JOINTS:
        linear[:, : external.count] = axes[:, : external.count] = 0.0
    return np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2)


def _verdict(
    robot: Robot,
    q: FloatArray,
    error_m: float,
    error_rad: float,
    solved: InverseSolutions | None,
    pose: int,
) -> tuple[Status, str]:
    if not np.isfinite(q).all():
        return "no posture", _no_posture(robot, solved, pose)
    if not (error_m <= CLOSED and (error_rad <= CLOSED or robot.n < AXES_OF_A_POSE)):
        return (
            "not reached",
            f"{error_m * 1e3:.3g} mm and {np.rad2deg(error_rad):.3g} deg remain: out of reach, or "
            "next to a singularity",
        )
    try:
        robot.check_limits(q)
    except JointLimitError as error:
        return "outside limits", error.message
    return "reached", ""


def _no_posture(robot: Robot, solved: InverseSolutions | None, pose: int) -> str:
    why = None if solved is None else solved.reason(pose)
    if why is None or (why.joint is None and why.coupled is None):
        far = "" if why is None or np.isnan(why.gap_m) else f" by {why.gap_m * 1e3:.0f} mm"
        return f"the nominal robot does not reach it{far}"
    name = why.coupled if why.joint is None else robot.joint_names[why.joint]
    unit = "deg" if why.joint is None else robot.joint_units[why.joint]
    beyond = why.excess * (1e3 if unit == "mm" else np.rad2deg(1.0))
    return f"the nominal robot would have {name} {beyond:.2f} {unit} outside its limits"
