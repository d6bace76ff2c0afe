"""Backlash and friction: joints that lean to the side that gravity pushes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model.context import Setup
from calib.model.parameters.base import joint_indices
from calib.model.parameters.gravity import GravityLoad, Payload
from calib.model.parameters.joints import JointErrors
from calib.robots import Robot
from calib.se3 import FloatArray


class LostMotion(JointErrors):
    """Joints that lean by half their play to the side that gravity pushes them.

    ``tanh(torque / T)``: where the torque is well above T all of the lost motion is taken up, and
    friction hides its sign where the torque is small. A compliance grows with the torque; lost
    motion does not.

    Parameters
    ----------
    robot : Robot
        With link masses.
    joints : sequence of str
    torque_nm : array_like
        T of each joint, or of all [Nm]: of the size of the friction in the reducer.
    payload : Payload or sequence of them, optional
        What the flange carries; several where measurements were taken with several
        (``Setup.payload``).
    prior_rad : float, optional
        Standard deviation known before measuring [rad].

    Raises
    ------
    InputError
        A torque that is not above zero, or another number of them than joints.
    """

    beyond_chain = "lost motion"

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        torque_nm: ArrayLike,
        payload: Payload | Sequence[Payload] | None = None,
        prior_rad: float | None = None,
    ) -> None:
        torque = np.asarray(torque_nm, dtype=float)
        if torque.shape not in ((), (len(joints),)):
            raise InputError(
                f"{torque.size} torques for the lost motion of {len(joints)} joints",
                hint="give one for each joint, or one for all",
                name="torque_nm",
            )
        if not (np.isfinite(torque) & (torque > 0)).all():
            raise InputError(
                "the torque that takes up lost motion must be a number above zero",
                name="torque_nm",
            )
        self._load = GravityLoad(robot, payload)
        self._torque_nm = np.broadcast_to(torque, (len(joints),))[:, None]
        names = [f"lost_motion.{joint}" for joint in joints]
        super().__init__(joint_indices(robot, joints), names, "rad", prior_rad)

    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """Side that gravity pushes the joint to, from -1 to 1."""
        torque = self._load.joint_torque(q, setup)[self._joints]
        return np.asarray(np.tanh(torque / self._torque_nm))
