"""Errors of the joints: what is added to the joint value that the controller shows.

All of them are a function of the posture as shown, times a parameter: ``dq_j = sum_k x_k f_k(q)``.
They differ in the function only.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import cross
from calib.errors import InputError
from calib.model.context import ArmErrors, MeasurementContext, Setup, reading_label
from calib.model.parameters.base import (
    ParameterBlock,
    Unit,
    joint_indices,
    kept,
    prior_of,
    priors_of_units,
)
from calib.model.parameters.gravity import GravityLoad, Payload
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray


class JointErrors(ParameterBlock):
    """Parameters that each turn one joint by their value times a function of the posture."""

    def __init__(
        self,
        joints: Sequence[int],
        names: Sequence[str],
        unit: Unit | Sequence[Unit],
        prior: float | FloatArray | None = None,
    ) -> None:
        self._joints = list(joints)
        self.names = tuple(names)
        self.units = (unit,) * len(self.names) if isinstance(unit, str) else tuple(unit)
        self.prior = prior_of(prior, len(self.names))

    @abstractmethod
    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """The function of each parameter at postures ``(n, S)``: ``(size, S)`` or ``(size, 1)``."""

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        added = values * self.functions(q, setup)
        width = np.broadcast_shapes(added[0].shape, errors.joints[0].shape) if self.size else (1,)
        if self.size and errors.joints.shape[1:] != width:
            errors.joints = np.broadcast_to(errors.joints, (len(q), *width)).copy()
        for k, joint in enumerate(self._joints):
            errors.joints[joint] += added[k]

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        weights = self.functions(view.q, view.setup)
        done: dict[int, int] = {}
        for k, joint in enumerate(self._joints):
            if joint in done:
                out[k] = out[done[joint]]
            else:
                view.move_joint(joint, out[k])
                done[joint] = k
        if not (weights.shape[1] == 1 and (weights == 1.0).all()):
            out *= weights[:, None, :]


class ZeroOffsets(JointErrors):
    """Zero-point errors of joints (FANUC: mastering): added to the joint value, URDF sign.

    The Δθ of Eq. 8 and section 3.2 of [Watanabe2006]_. An offset means the joint of the URDF; a
    FANUC controller that holds its own J3 (against the horizontal) shows a J2 offset in J3 too.
    """

    beyond_chain = ""

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        prior_rad: float | None = None,
        prior_m: float | None = None,
    ) -> None:
        indices = joint_indices(robot, joints)
        units: list[Unit] = ["m" if robot.sliding[j] else "rad" for j in indices]
        prior = priors_of_units(units, prior_m, prior_rad)
        super().__init__(indices, [f"zero_offset.{joint}" for joint in joints], units, prior)

    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """One: an offset is the same in every posture."""
        return np.ones((self.size, 1))


class TimeOffsets(ParameterBlock):
    """How much later than its joints were read each measurement was taken, by instrument.

    The joints have gone on by then, as ``Setup.motion`` says: ``q + v t + a t²/2``.

    Parameters
    ----------
    instruments : mapping of str to (str, int)
        Name of each camera, say, to where its measurements are told by: ``tool`` or ``target`` of
        the set-up, and the index there.
    """

    nuisance = True
    beyond_chain = ""

    def __init__(
        self,
        instruments: Mapping[str, tuple[Literal["tool", "target"], int]],
        prior_s: float | None = None,
    ) -> None:
        self._where = tuple(instruments.values())
        self.names = tuple(f"{reading_label('time', i, 'camera')}.offset" for i in instruments)
        second: Unit = "s"
        self.units = (second,) * len(self.names)
        self.prior = prior_of(prior_s, len(self.names))

    def _own(self, setup: Setup, width: int) -> BoolArray:
        """Which measurements ``(size, S)`` are of each instrument."""
        own = [getattr(setup, side) == index for side, index in self._where]
        return np.tile(np.array(own), width // max(setup.count, 1))

    def _gone(
        self, values: FloatArray, setup: Setup, width: int
    ) -> tuple[FloatArray, FloatArray] | None:
        """How far joints have gone on ``(n, S)`` [rad], and how fast they are then [rad/s]."""
        if setup.motion is None:
            return None
        late = (values * self._own(setup, width)).sum(axis=0)
        repeated = np.tile(setup.motion.transpose(1, 2, 0), width // max(setup.count, 1))
        velocity, acceleration = repeated
        return late * velocity + late**2 / 2.0 * acceleration, velocity + late * acceleration

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        gone = self._gone(values, setup, q.shape[1])
        if gone is not None:
            errors.joints = errors.joints + gone[0]

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`: by differences of the chain, whatever its joints are."""
        gone = self._gone(values, view.setup, view.q.shape[1])
        if gone is None:
            return
        q, step = view.q + view.errors.joints, _STEP_S * gone[1]
        ahead, behind = (
            view.robot.chain.walk(q + change, view.displacements) for change in (step, -step)
        )
        twist = np.zeros((6, q.shape[1]))
        # columns c of a rotation move by w x c, and the sum of c x (w x c) is 2 w
        turned = ahead.tip - behind.tip
        twist[3:] = sum(cross(view.walk.tip[k], turned[k]) for k in range(3)) / (4.0 * _STEP_S)
        lever = view.point - view.walk.p_base_tip
        twist[:3] = (ahead.p_base_tip - behind.p_base_tip) / (2.0 * _STEP_S)
        twist[:3] += cross(twist[3:], lever)
        out[:] = self._own(view.setup, q.shape[1])[:, None] * twist[: out.shape[1]]


_STEP_S = 1e-4
"""Of differences of the arm's motion: an arm that turns by 10 rad/s is a thousandth of a radian
further, where the differences are right to a millionth of themselves."""


class JointScale(JointErrors):
    """Joints that turn by a little more or less than they show: a wrong ratio in the controller."""

    beyond_chain = "scale of joint values"

    def __init__(self, robot: Robot, joints: Sequence[str], prior: float | None = None) -> None:
        self._indices = joint_indices(robot, joints)
        names = [f"scale.{joint}" for joint in joints]
        units: list[Unit] = ["m/m" if robot.sliding[j] else "rad/rad" for j in self._indices]
        super().__init__(self._indices, names, units, prior)

    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """The joint value itself."""
        return q[self._indices]


class JointHarmonics(JointErrors):
    """Errors of the transmission that come back with every turn of a shaft.

    ``sin(h q)`` and ``cos(h q)`` of each joint: h = 1 is the eccentricity of an encoder or a
    bearing on the joint itself, 2 what is oval; the gear ratio is the eccentricity of the motor's
    shaft, and twice it the two-lobed error of a strain wave gear.
    """

    beyond_chain = "harmonics of transmissions"
    phases: ClassVar[tuple[str, ...]] = ("sin", "cos")

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        harmonics: ArrayLike = (1.0,),
        prior_rad: float | None = None,
    ) -> None:
        waves = np.atleast_1d(np.asarray(harmonics, dtype=float))
        if waves.ndim != 1 or not waves.size or not (np.isfinite(waves) & (waves > 0)).all():
            raise InputError(
                "harmonics are waves in a turn of the joint, numbers above zero",
                hint="1 for the joint itself, the gear ratio for the motor's shaft",
                name="harmonics",
            )
        if len(set(waves.tolist())) != len(waves):
            raise InputError("a harmonic is listed twice", hint="list it once", name="harmonics")
        indices, names, orders = [], [], []
        for joint, index in zip(joints, joint_indices(robot, joints, turning=True), strict=True):
            for wave in waves.tolist():
                for phase in self.phases:
                    indices.append(index)
                    names.append(f"harmonic.{joint}.{phase}{wave:g}")
                    orders.append((wave, phase))
        self._waves = np.array([wave for wave, _ in orders])[:, None]
        # cos(a) = sin(a + 90 deg)
        self._phase = np.array([0.0 if phase == "sin" else np.pi / 2 for _, phase in orders])
        super().__init__(indices, names, "rad", prior_rad)

    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """Sine or cosine of the joint times its harmonic."""
        return np.asarray(np.sin(self._waves * q[self._joints] + self._phase[:, None]))


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
    nominal : array, optional
        Compliances of the nominal robot [rad/Nm], zero by default: a controller knows of none.
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
        indices = joint_indices(robot, joints, turning=True, of_arm=True)
        super().__init__(indices, names, "rad/Nm", prior)
        self._nominal = np.zeros(len(joints)) if nominal is None else np.asarray(nominal, float)
        if self._nominal.shape != (len(joints),):
            raise InputError(
                f"{self._nominal.size} nominal compliances for {len(joints)} joints", name="nominal"
            )

    @property
    def nominal(self) -> FloatArray:
        return self._nominal

    @kept
    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """Torque of gravity [Nm]."""
        return np.asarray(self._load.joint_torque(q, setup)[self._joints])


class LostMotion(JointErrors):
    """Joints that lean by half their play to the side that gravity pushes them.

    ``tanh(torque / T)``: where the torque is well above T all of the lost motion is taken up, and
    friction hides its sign where the torque is small. A compliance grows with the torque; lost
    motion does not.

    Parameters
    ----------
    robot : Robot
        With link masses.
    torque_nm : array_like
        T of each joint, or of all [Nm]: of the size of the friction in the reducer.
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
        indices = joint_indices(robot, joints, turning=True, of_arm=True)
        super().__init__(indices, names, "rad", prior_rad)

    @kept
    def functions(self, q: FloatArray, setup: Setup) -> FloatArray:
        """Side that gravity pushes the joint to, from -1 to 1."""
        torque = self._load.joint_torque(q, setup)[self._joints]
        return np.asarray(np.tanh(torque / self._torque_nm))
