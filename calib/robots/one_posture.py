"""An arm at one posture at a time, by Pinocchio.

An array of one posture takes as long as one of a hundred: loops that drive one arm wait for that.
What comes out is that of :mod:`calib.robots.chain` to rounding.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from calib.robots.geared_chain import GearedChain
from calib.robots.robot import Robot
from calib.se3 import FloatArray

_DAMPING, _LEAST_DAMPING = 1e-4, 1e-14
"""Of the damped least squares, relative to the squared pose error, and where that vanishes."""

_LARGEST_STEP_RAD = 0.5


class OnePosture:
    """Kinematics and gravity of an arm with a mass at ``com_m`` [m] on its tip; of one thread."""

    def __init__(self, robot: Robot, mass_kg: float = 0.0, com_m: FloatArray | None = None) -> None:
        chain, joint = robot.chain, 0
        self._gears, self._rest = np.eye(robot.n), np.zeros(robot.n)
        masses, coms, slides = robot.link_mass, robot.link_com, robot.sliding
        if isinstance(chain, GearedChain):
            self._gears, self._rest = chain.gears, chain.rest
            chain = chain.whole
            # links of such arms weigh nothing
            masses, coms = np.zeros(chain.n), np.zeros((chain.n, 3))
            slides = chain.external.slides_of(chain.n)
        model, nowhere = pin.Model(), pin.SE3.Identity()
        bodies = zip(masses, coms, strict=True)
        frames = zip(chain.placements, chain.axes, bodies, strict=True)
        sliding = slides.tolist()
        for k, (placement, axis, (mass, com)) in enumerate(frames):
            kind = (
                pin.JointModelPrismaticUnaligned if sliding[k] else pin.JointModelRevoluteUnaligned
            )
            joint = model.addJoint(joint, kind(axis), pin.SE3(placement), f"joint {k + 1}")
            model.appendBodyToJoint(joint, pin.Inertia(mass, com, np.zeros((3, 3))), nowhere)
        self._tip = pin.SE3(chain.T_link_tip)
        if com_m is not None:
            carried = pin.Inertia(mass_kg, np.asarray(com_m, dtype=float), np.zeros((3, 3)))
            model.appendBodyToJoint(joint, carried, self._tip)
        model.gravity.linear = self._gravity = robot.gravity
        self._floor = robot.floor
        self._last, self._model, self._data = joint, model, model.createData()
        self._lower, self._upper = robot.lower, robot.upper

    def gravity_torque(self, q: FloatArray) -> FloatArray:
        """Torque of gravity on each joint ``(n,)`` [Nm] at a posture ``(n,)`` [rad].

        Positive where it turns the joint in its positive sense.
        """
        q = self._gears @ q + self._rest
        if self._floor:  # the base turns against the floor
            pin.forwardKinematics(self._model, self._data, q)
            turned = self._data.oMi[self._floor].rotation @ self._gravity
            self._model.gravity.linear = turned
        torque = pin.computeGeneralizedGravity(self._model, self._data, q)
        return np.asarray(-torque @ self._gears)

    def tip(self, q: FloatArray) -> FloatArray:
        """Pose of the tip in the base frame ``(4, 4)`` at a posture ``(n,)`` [rad]."""
        pin.forwardKinematics(self._model, self._data, self._gears @ q + self._rest)
        return np.asarray((self._data.oMi[self._last] * self._tip).homogeneous)

    def close_in(
        self, q: FloatArray, T_wanted: FloatArray, closed: float, iterations: int
    ) -> tuple[FloatArray, float]:
        """Posture ``(n,)`` [rad] that steps inside the limits bring to a pose ``(4, 4)`` [m].

        Damped least squares, as :func:`~calib.robots.inverse.solutions.close_in` has it; and how
        far off the pose it is at most, along or about any axis [m, rad].
        """
        R, p = T_wanted[:3, :3], T_wanted[:3, 3]
        for _ in range(iterations + 1):
            every = self._gears @ q + self._rest
            J = pin.computeJointJacobians(self._model, self._data, every)
            tip = self._data.oMi[self._last] * self._tip
            error = np.concatenate([p - tip.translation, pin.log3(R @ tip.rotation.T)])
            off = float(np.abs(error).max())
            if off <= closed or iterations == 0:
                break
            iterations -= 1
            # velocities of the tip's origin, where Pinocchio has those of the base's
            J[:3] -= pin.skew(tip.translation) @ J[3:]
            J = J @ self._gears
            gradient = J.T @ error
            held = ((q <= self._lower) & (gradient < 0)) | ((q >= self._upper) & (gradient > 0))
            J[:, held] = 0.0
            damping = _DAMPING * float(error @ error) + _LEAST_DAMPING
            step = J.T @ np.linalg.solve(J @ J.T + damping * _IDENTITY, error)
            largest = float(np.abs(step).max())
            if largest > _LARGEST_STEP_RAD:
                step *= _LARGEST_STEP_RAD / largest
            q = np.minimum(np.maximum(q + step, self._lower), self._upper)
        return q, off


_IDENTITY = np.eye(6)
