"""Reducers that give way under gravity."""

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


class JointCompliance(JointErrors):
    """Elastic reducers: each joint gives way by its compliance times its gravity torque.

    "Elastic deformation occurs mainly in the reducer mounted on each rotation axis" (section 3.2
    of [Watanabe2006]_). To first order the torque is that of the undeflected arm.

    Parameters
    ----------
    robot : Robot
        With link masses.
    joints : sequence of str
        The joints that give way.
    payload : Payload or sequence of them, optional
        What the flange carries; several where measurements were taken with several
        (``Setup.payload``).
    nominal : array, optional
        Compliances of the nominal robot [rad/Nm], zero by default: a controller knows of none.
    prior : float or array, optional
        Standard deviation known before measuring [rad/Nm], of all joints or of each.
    """

    beyond_chain = "compliance of joints"

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        payload: Payload | Sequence[Payload] | None = None,
        nominal: ArrayLike | None = None,
        prior: float | FloatArray | None = None,
    ) -> None:
        self._load = GravityLoad(robot, payload)
        names = [f"compliance.{joint}" for joint in joints]
        super().__init__(joint_indices(robot, joints), names, "rad/Nm", prior)
        self._nominal = np.zeros(len(joints)) if nominal is None else np.asarray(nominal, float)
        if self._nominal.shape != (len(joints),):
            raise InputError(
                f"{self._nominal.size} nominal compliances for {len(joints)} joints", name="nominal"
            )

    @property
    def nominal(self) -> FloatArray:
        """See :meth:`ParameterBlock.nominal`."""
        return self._nominal

    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """Torque of gravity [Nm]."""
        return np.asarray(self._load.joint_torque(q, setup)[self._joints])
