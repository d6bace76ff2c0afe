"""Reducers that give way under gravity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.arm_view import Setup
from calib.errors import InputError
from calib.parameters.base import joint_indices
from calib.parameters.joints import JointErrors
from calib.robots.robot import Robot
from calib.se3 import FloatArray


@dataclass(frozen=True, eq=False)
class Payload:
    """What the flange carries besides itself.

    Attributes
    ----------
    mass_kg : float
    com_m : array (3,)
        Centre of mass in the tip frame [m].
    """

    mass_kg: float
    com_m: FloatArray

    def __post_init__(self) -> None:
        com = np.asarray(self.com_m, dtype=float)
        if not (np.isfinite(self.mass_kg) and self.mass_kg >= 0 and com.shape == (3,)):
            raise InputError(
                "a payload needs a mass of zero or more and a centre of mass of three numbers",
                name="payload",
                value=self.mass_kg,
            )
        object.__setattr__(self, "com_m", com)


NOTHING = Payload(0.0, np.zeros(3))


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
    prior : float, optional
        Standard deviation known before measuring [rad/Nm].
    """

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        payload: Payload | Sequence[Payload] | None = None,
        nominal: ArrayLike | None = None,
        prior: float | None = None,
    ) -> None:
        self._robot = robot
        given = [payload] if isinstance(payload, Payload) else list(payload or [])
        self.payloads = tuple(given) or (NOTHING,)
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
        if setup.payload.max(initial=0) >= len(self.payloads):
            raise InputError(
                f"a measurement has payload {setup.payload.max() + 1}, "
                f"{len(self.payloads)} are known",
                name="payload",
            )
        index = np.tile(setup.payload, q.shape[1] // setup.count)
        mass = np.array([p.mass_kg for p in self.payloads], dtype=float)[index]
        com = np.stack([p.com_m for p in self.payloads], axis=-1)[:, index]
        torque = _gravity_torque(self._robot, q, mass, com)
        return np.asarray(torque[self._joints])


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
    carried = NOTHING if payload is None else payload
    last = np.ascontiguousarray(q.reshape(-1, robot.n).T)
    mass = np.full(last.shape[1], float(carried.mass_kg))
    com = np.broadcast_to(carried.com_m[:, None], (3, last.shape[1]))
    return np.asarray(_gravity_torque(robot, last, mass, com).T.reshape(q.shape))


def _gravity_torque(robot: Robot, q: FloatArray, mass: FloatArray, com: FloatArray) -> FloatArray:
    """Torque ``(n, S)`` at ``(n, S)``, with masses ``(S,)`` at ``(3, S)`` in the tip frame."""
    chain = robot.chain
    walk = chain.walk(q)
    moment = np.empty((3, q.shape[1]))  # mass times place of all that a joint carries
    for axis in range(3):
        place = walk.p_base_tip[axis] + sum(walk.tip[k, axis] * com[k] for k in range(3))
        moment[axis] = mass * place
    weight = mass.copy()
    torque = np.empty_like(q)
    for j in reversed(range(robot.n)):
        if robot.link_mass[j]:
            columns = chain.link_columns(walk, j)
            for axis in range(3):
                place = walk.origins[j, axis] + sum(
                    columns[k, axis] * robot.link_com[j, k] for k in range(3)
                )
                moment[axis] += robot.link_mass[j] * place
            weight += robot.link_mass[j]
        lever = moment - weight * walk.origins[j]
        force = np.cross(chain.axes_of(walk, j), robot.gravity[:, None], axis=0)
        # axis . (lever x g) = lever . (g x axis)
        torque[j] = -(lever * force).sum(axis=0)
    return torque
