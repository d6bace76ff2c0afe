"""Bearings that give way across the axis of their joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.batch_last import along, turn
from calib.model.context import ArmErrors, MeasurementContext, Setup
from calib.model.parameters.base import ParameterBlock, joint_indices, prior_of
from calib.model.parameters.gravity import GravityLoad, Payload
from calib.robots import Robot
from calib.se3 import FloatArray


class BearingCompliance(ParameterBlock):
    """Elastic bearings: the frame of a joint tilts by their compliance times the gravity torque.

    A bearing is thinner than its link is long: what a heavy arm tilts its joints by across their
    axes may be as much as its reducers give way along them. The frame of the joint, before the
    joint turns it, turns about each of its two axes across the joint axis by a compliance times
    the torque about that axis; to first order the torque is that of the undeflected arm.
    Adds to what :class:`~calib.model.parameters.LinkGeometry` displaces.

    Where the joint axis is no axis of its frame, the two directions are those across it that are
    next to two axes of the frame, and have their names.

    Parameters
    ----------
    robot : Robot
        With link masses.
    joints : sequence of str
        The joints whose bearings give way.
    payload : Payload or sequence of them, optional
        What the flange carries; several where measurements were taken with several
        (``Setup.payload``).
    prior : float, optional
        Standard deviation known before measuring [rad/Nm].
    """

    beyond_chain = "compliance of bearings"

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        payload: Payload | Sequence[Payload] | None = None,
        prior: float | None = None,
    ) -> None:
        self._load = GravityLoad(robot, payload)
        self._joints = joint_indices(robot, joints)
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

    @property
    def nominal(self) -> FloatArray:
        """Zero: bearings that do not give way."""
        return np.zeros(self.size)

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
        """See :meth:`ParameterBlock.displace`."""
        tilts = values * self.torques(q, setup)
        for i, joint in enumerate(self._joints):
            six = np.zeros((6, q.shape[1]))
            six[3:] = self._directions[i].T @ tilts[2 * i : 2 * i + 2]
            errors.displace(joint, six)

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`."""
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
