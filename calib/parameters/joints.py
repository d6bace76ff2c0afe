"""Errors of the joints: zero offsets, and reducers that give way under gravity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError
from calib.parameters.base import (
    ArmErrors,
    ArmView,
    ParameterBlock,
    Payload,
    joint_indices,
)
from calib.robots.robot import Robot
from calib.se3 import FloatArray


class ZeroOffsets(ParameterBlock):
    """Zero-point errors of joints (FANUC: mastering): added to the joint value, URDF sign.

    The Δθ of Eq. 8 and section 3.2 of [Watanabe2006]_. An offset means the joint of the URDF; a
    FANUC controller that holds its own J3 (against the horizontal) shows a J2 offset in J3 too.

    Parameters
    ----------
    robot : Robot
    joints : sequence of str
        Names of the joints with an unknown offset.
    """

    unit = "rad"

    def __init__(self, robot: Robot, joints: Sequence[str]) -> None:
        self._indices = joint_indices(robot, joints)
        self.names = tuple(f"zero_offset.{joint}" for joint in joints)

    @property
    def nominal(self) -> FloatArray:
        """Zero: the robot as mastered."""
        return np.zeros(self.size)

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray) -> None:
        """See :meth:`ParameterBlock.displace`."""
        added = np.zeros((*values.shape[:-1], q.shape[-1]))
        added[..., self._indices] = values
        errors.joints = errors.joints + added

    def motion(self, view: ArmView) -> FloatArray:
        """See :meth:`ParameterBlock.motion`."""
        return view.joint_motion[..., self._indices]


class JointCompliance(ParameterBlock):
    """Elastic reducers: each joint gives way by its compliance times its gravity torque.

    "Elastic deformation occurs mainly in the reducer mounted on each rotation axis" (section 3.2
    of [Watanabe2006]_). To first order the torque is that of the undeflected arm.

    Parameters
    ----------
    robot : Robot
        With link masses.
    joints : sequence of str
        The joints that give way.
    payload : Payload, optional
        What the flange carries.
    nominal : array, optional
        Compliances of the nominal robot [rad/Nm], zero by default: a controller knows of none.
    """

    unit = "rad/Nm"

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        payload: Payload | None = None,
        nominal: FloatArray | None = None,
    ) -> None:
        self._robot = robot
        self._payload = payload
        self._indices = joint_indices(robot, joints)
        self._nominal = np.zeros(len(joints)) if nominal is None else np.asarray(nominal, float)
        if self._nominal.shape != (len(joints),):
            raise InputError(
                f"{self._nominal.size} nominal compliances for {len(joints)} joints", name="nominal"
            )
        self.names = tuple(f"compliance.{joint}" for joint in joints)

    @property
    def nominal(self) -> FloatArray:
        """See :meth:`ParameterBlock.nominal`."""
        return self._nominal

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray) -> None:
        """See :meth:`ParameterBlock.displace`."""
        torque = gravity_torque(self._robot, q, self._payload)
        added = np.zeros(np.broadcast_shapes(torque.shape, (*values.shape[:-1], 1)))
        added[..., self._indices] = values * torque[..., self._indices]
        errors.joints = errors.joints + added

    def motion(self, view: ArmView) -> FloatArray:
        """See :meth:`ParameterBlock.motion`."""
        torque = gravity_torque(self._robot, view.q, self._payload)[..., self._indices]
        return view.joint_motion[..., self._indices] * torque[..., None, :]


def gravity_torque(robot: Robot, q: FloatArray, payload: Payload | None = None) -> FloatArray:
    """Torque that gravity puts on each joint, ``(..., n)`` [Nm].

    Positive where gravity turns the joint in its positive sense: the opposite of what the motors
    hold against it (``pinocchio.computeGeneralizedGravity``).

    Parameters
    ----------
    robot : Robot
        Links without mass weigh nothing.
    q : array (..., n)
        Postures [rad].
    payload : Payload, optional
        Mass carried at the tip.
    """
    state = robot.chain.forward(q)
    com = (state.rotations @ robot.link_com[..., None])[..., 0] + state.origins  # (..., n, 3)
    mass = robot.link_mass
    if payload is not None:
        com = np.concatenate([com, state.point(payload.com_m)[..., None, :]], axis=-2)
        mass = np.append(mass, payload.mass_kg)
    # joint j carries link j and everything behind it: sums from the tip inwards
    moment = np.flip(np.cumsum(np.flip(mass[:, None] * com, axis=-2), axis=-2), axis=-2)
    carried = np.flip(np.cumsum(np.flip(mass)))
    n = robot.n
    if payload is not None:  # the payload belongs to the last link
        moment, carried = moment[..., :n, :], carried[:n]
    lever = moment - carried[:, None] * state.origins
    return np.asarray(np.sum(state.axes * np.cross(lever, robot.gravity), axis=-1))
