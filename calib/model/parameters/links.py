"""Link geometry: where each joint really sits on the link before it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.batch_last import along, cross, product, turn
from calib.errors import InputError
from calib.model.context import ArmErrors, MeasurementContext, Setup
from calib.model.parameters.base import (
    ParameterBlock,
    joint_indices,
    kept,
    prior_of,
    priors_of_units,
)
from calib.model.parameters.gravity import GravityLoad, Payload
from calib.robots import Robot
from calib.se3 import FloatArray

AXES = ("x", "y", "z", "rx", "ry", "rz")
"""Degrees of freedom of a frame: along its axes [m], then a rotation vector [rad]."""


class LinkGeometry(ParameterBlock):
    """Errors of the places of joint frames, six a joint, in the axes of the description.

    The frame of a joint is displaced by (x, y, z) and then turned by the rotation vector
    (rx, ry, rz), before the joint turns it: the ``origin`` of a URDF joint. The last link's end is
    the business of the tool, the base that of the targets.

    Not all six of all joints can be told apart: a turn about the joint's own axis is its zero
    offset, a shift along parallel axes shows alike on both. Free all and reduce
    (:func:`calib.identification.reduce`), list what is wanted, or give priors.

    Parameters
    ----------
    freed : sequence of str, optional
        Names of parameters to free, such as ``link.joint_2.x``; all six of all joints by default,
        but for the joint of a positioner that moves the base: targets are on that.
    """

    beyond_chain = ""

    def __init__(
        self,
        robot: Robot,
        freed: Sequence[str] | None = None,
        prior_m: float | None = None,
        prior_rad: float | None = None,
    ) -> None:
        self._robot, self._prior_m, self._prior_rad = robot, prior_m, prior_rad
        # where the first joint of a positioner sits in the base is where targets sit on it
        own = robot.joint_names[1:] if robot.floor else robot.joint_names
        every = [f"link.{joint}.{axis}" for joint in robot.joint_names for axis in AXES]
        known = [f"link.{joint}.{axis}" for joint in own for axis in AXES]
        wanted = known if freed is None else list(freed)
        strange = next((name for name in wanted if name not in known), None)
        if strange is not None:
            joint = strange.removeprefix("link.").rpartition(".")[0]
            joint_indices(robot, [joint])  # raises, with near names
            raise InputError(
                f"{strange!r} is no parameter of a link",
                hint=f"link.JOINT. and one of {', '.join(AXES)}",
                name=strange,
            )
        self.names = tuple(name for name in known if name in set(wanted))  # from base to tip
        places = [divmod(every.index(name), len(AXES)) for name in self.names]
        self._placements = robot.chain.placements
        self._joints = sorted({joint for joint, _ in places})
        self._rows = {
            joint: [(k, axis) for k, (j, axis) in enumerate(places) if j == joint]
            for joint in self._joints
        }
        self.units = tuple("m" if axis < 3 else "rad" for _, axis in places)
        self.prior = priors_of_units(self.units, prior_m, prior_rad)

    def only(self, names: Sequence[str]) -> LinkGeometry:
        """The same links with only some of their parameters free."""
        return LinkGeometry(self._robot, names, self._prior_m, self._prior_rad)

    def displacement(self, values: FloatArray, joint: int) -> FloatArray:
        """The six numbers of a joint's frame ``(6, S)``, zero where they are not free."""
        six = np.zeros((6, values.shape[1]))
        for k, axis in self._rows.get(joint, ()):
            six[axis] = values[k]
        return six

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        for joint in self._joints:
            errors.displace(joint, self.displacement(values, joint))

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        for joint in self._joints:
            columns = [axis for _, axis in self._rows[joint]]
            if min(columns) < 3:  # along the axes of the frame before it is turned
                rotation = view.displacements[joint].rotation  # its rows: its inverse's columns
                before = product(view.walk.placed[joint], rotation)
            if max(columns) >= 3:
                about = view.frame_axes(joint)
                swept = cross(about, view.point - view.frame_origin(joint))
            for k, axis in self._rows[joint]:
                if axis < 3:
                    out[k, :3] = before[axis]
                else:
                    out[k, :3] = swept[axis - 3]
                    out[k, 3:] = about[axis - 3][: out.shape[1] - 3]

    def scaling(self, values: FloatArray) -> FloatArray:
        """See :meth:`ParameterBlock.scaling`: what lies between one joint and the next."""
        out = np.zeros(self.size)
        for joint in self._joints:
            T = self._placements[joint]
            own = T[:3, :3].T @ T[:3, 3] + self.displacement(values[:, None], joint)[:3, 0]
            for k, axis in self._rows[joint]:
                if axis < 3:
                    out[k] = own[axis]
        return out


class BearingCompliance(ParameterBlock):
    """Elastic bearings: the frame of a joint tilts by their compliance times the gravity torque.

    A bearing is thinner than its link is long: what a heavy arm tilts its joints by across their
    axes may be as much as its reducers give way along them. The frame of the joint, before the
    joint turns it, turns about each of its two axes across the joint axis by a compliance times
    the torque about that axis; to first order the torque is that of the undeflected arm.
    Adds to what :class:`~calib.model.parameters.LinkGeometry` displaces.

    Where the joint axis is no axis of its frame, the two directions are those across it that are
    next to two axes of the frame, and have their names.
    """

    beyond_chain = "compliance of bearings"

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        payload: Payload | Sequence[Payload] | None = None,
        prior: float | FloatArray | None = None,
    ) -> None:
        self._load = GravityLoad(robot, payload)
        self._joints = joint_indices(robot, joints, turning=True, of_arm=True)
        self._axes = robot.chain.axes[self._joints]
        found = [_across(axis) for axis in self._axes]
        self._directions = [directions for _, directions in found]  # (2, 3) each
        self.names = tuple(
            f"bearing.{joint}.{'xyz'[k]}"
            for joint, (letters, _) in zip(joints, found, strict=True)
            for k in letters
        )
        self.units = tuple("rad/Nm" for _ in self.names)
        self.prior = prior_of(prior, len(self.names))

    @kept
    def torques(self, q: FloatArray, setup: Setup) -> FloatArray:
        """Gravity torque about the axis of each parameter ``(size, S)`` [Nm] at ``(n, S)``."""
        torque, walk = self._load.torques(q, setup)
        chain = self._load.robot.chain
        out = np.empty((self.size, q.shape[1]))
        for i, (joint, axis) in enumerate(zip(self._joints, self._axes, strict=True)):
            columns = chain.link_columns(walk, joint)
            sine, cosine = np.sin(q[joint]), np.cos(q[joint])
            for k, direction in enumerate(self._directions[i]):
                # the link has turned: what stands still in the placement turns back in the link
                back = np.outer(direction, cosine) - np.outer(np.cross(axis, direction), sine)
                out[2 * i + k] = along(turn(columns, back), torque[joint])
        return out

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        tilts = values * self.torques(q, setup)
        for i, joint in enumerate(self._joints):
            six = np.zeros((6, q.shape[1]))
            six[3:] = self._directions[i].T @ tilts[2 * i : 2 * i + 2]
            errors.displace(joint, six)

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        torque = self.torques(view.q, view.setup)
        for i, joint in enumerate(self._joints):
            about = view.frame_axes(joint)
            for k, direction in enumerate(self._directions[i], start=2 * i):
                axis = turn(about, direction[:, None]) * torque[k]
                view.turn_about(axis, view.walk.origins[joint], out[k])


def _across(axis: FloatArray) -> tuple[tuple[int, int], FloatArray]:
    """Indices of the two frame axes next to two unit vectors across an axis, and these (2, 3)."""
    first, second, _ = np.argsort(np.abs(axis), kind="stable").tolist()
    x = np.eye(3)[first] - axis * axis[first]
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    y *= np.sign(y[second])
    low, high = sorted([(first, x), (second, y)], key=lambda pair: pair[0])
    return (low[0], high[0]), np.stack([low[1], high[1]])
