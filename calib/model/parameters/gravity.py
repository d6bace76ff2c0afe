"""The torque of gravity on the joints: what elastic reducers, bearings and backlash answer to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.batch_last import cross, turn
from calib.errors import InputError
from calib.model.context import Setup
from calib.robots import Robot
from calib.robots.chain import Walk, twists_at
from calib.se3 import FloatArray, skew


@dataclass(frozen=True, eq=False)
class Payload:
    """What the flange carries besides itself; its centre of mass ``(3,)`` [m] in the tip frame."""

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


class GravityLoad:
    """The masses of an arm and of what it carries.

    Parameters
    ----------
    robot : Robot
        Links without mass weigh nothing.
    payload : Payload or sequence of them, optional
        What the flange carries; several where measurements were taken with several
        (``Setup.payload``).
    """

    def __init__(self, robot: Robot, payload: Payload | Sequence[Payload] | None = None) -> None:
        self.robot = robot
        given = [payload] if isinstance(payload, Payload) else list(payload or [])
        self.payloads = tuple(given) or (NOTHING,)
        self._mass = np.array([p.mass_kg for p in self.payloads], dtype=float)
        self._links = robot.link_mass[:, None, None]
        self._carried = np.cumsum(robot.link_mass[::-1])[::-1, None]
        self._com = np.stack([p.com_m for p in self.payloads], axis=-1)

    def torques(self, q: FloatArray, setup: Setup) -> tuple[FloatArray, Walk]:
        """Torque vectors ``(n, 3, S)`` [Nm] in base axes at postures ``(n, S)``, and the arm there.

        About the origin of each joint, of all that the joint carries. The arm is the nominal one,
        not deflected: the torque does not depend on the parameters.
        """
        if setup.payload.max(initial=0) >= len(self.payloads):
            raise InputError(
                f"a measurement has payload {setup.payload.max() + 1}, "
                f"{len(self.payloads)} are known",
                name="payload",
            )
        index = setup.payload
        if q.shape[1] != setup.count:
            index = np.tile(index, q.shape[1] // setup.count)
        mass, com = self._mass[index], self._com[:, index]
        chain = self.robot.chain
        walk = chain.walk(q)
        # of all that a joint carries, from the tip down
        moment = self._links * chain.in_base(walk, self.robot.link_com)
        moment[-1] += mass * (walk.p_base_tip + turn(walk.tip, com))
        for j in reversed(range(self.robot.n - 1)):
            moment[j] += moment[j + 1]
        moment -= (self._carried + mass)[:, None] * walk.origins
        floor, down = self.robot.floor, self.robot.gravity
        if not floor:
            return np.asarray(-skew(down) @ moment), walk
        turned = turn(chain.link_columns(walk, floor - 1), down[:, None])
        return np.stack([cross(each, turned) for each in moment]), walk

    def joint_torque(self, q: FloatArray, setup: Setup) -> FloatArray:
        """The parts along the joint axes ``(n, S)`` [Nm]: see :func:`gravity_torque`.

        Zero of external axes: nothing here gives way along slides, and what a positioner carries is
        not described.
        """
        torque, walk = self.torques(q, setup)
        if walk.twists is not None:  # the links weigh nothing there: what is carried alone
            return self._by_twists(walk, walk.twists, setup)
        along = np.asarray((self.robot.chain.all_axes(walk) * torque).sum(axis=1))
        along[: self.robot.n_external] = 0.0
        return along

    def _by_twists(self, walk: Walk, twists: FloatArray, setup: Setup) -> FloatArray:
        """Return the power of the payload's weight ``(n, S)`` by unit rates of the joints [Nm]."""
        count = walk.tip.shape[2]
        index = np.tile(setup.payload, count // max(setup.count, 1))
        at = walk.p_base_tip + turn(walk.tip, self._com[:, index])
        moved = twists_at(twists, at)[:, :3]
        power = np.einsum("i,nis->ns", self.robot.gravity, moved) * self._mass[index]
        power[self.robot.sliding] = 0.0
        return np.asarray(power)


def gravity_torque(robot: Robot, q: FloatArray, payload: Payload | None = None) -> FloatArray:
    """Torque that gravity puts on each joint of the arm, ``(..., n)`` [Nm]; zero of external axes.

    Positive where gravity turns the joint in its positive sense: the opposite of what the motors
    hold against it (``pinocchio.computeGeneralizedGravity``). Links without mass weigh nothing.
    """
    last = np.ascontiguousarray(q.reshape(-1, robot.n).T)
    load = GravityLoad(robot, payload)
    return np.asarray(load.joint_torque(last, Setup.of(last.shape[1])).T.reshape(q.shape))
