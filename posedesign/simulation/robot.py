"""Rehearsal of the measurement: what a robot with errors would bring back from a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.model import CalibrationModel, simulate
from calib.model.measurements import Measurement, Measurements
from calib.se3 import FloatArray, inverse, rotation_exp, transform
from posedesign.cell import Cell


@dataclass(frozen=True, eq=False)
class SimulatedRobot:
    """The robot as it really is, known to nothing but the simulation.

    Attributes
    ----------
    cell : Cell
    model : CalibrationModel
        With zero offsets of all joints and, where asked for, deflection.
    values : array (p,)
        True parameters [SI].
    """

    cell: Cell
    model: CalibrationModel
    values: FloatArray

    @classmethod
    def of(cls, cell: Cell, measurement: Measurement | None = None) -> SimulatedRobot:
        """The robot of the ``[truth]`` section, measured as the cell says or otherwise."""
        return cls(cell, *cell.truth(measurement))

    def value(self, name: str) -> float:
        """True value of one parameter [SI]."""
        return float(self.values[self.model.names.index(name)])

    @property
    def target_m(self) -> FloatArray:
        """Where the target really is ``(3,)`` [m]."""
        name = self.cell.config.target.name
        return np.array([self.value(f"target.{name}.{axis}") for axis in "xyz"])

    @property
    def T_tip_camera(self) -> FloatArray:
        """X: where the camera really is on the tip."""
        T = self.cell.T_tip_camera.copy()
        T[:3, 3] += np.array(self.cell.config.truth.tool_error_mm) / 1e3
        return T

    @property
    def T_base_target(self) -> FloatArray:
        """Z: where the target really is, facing the camera of the base pose."""
        return transform(self.cell.T_base_target[:3, :3], self.target_m)

    @property
    def T_shown_base(self) -> FloatArray:
        """The base as measurements show it, turned by the error of a first joint that is not freed.

        Nothing measured tells a zero offset of the first joint from a turned base, or one of the
        last joint from a turned tip (section 3.2 of Watanabe et al. 2006). What identification
        and AX=ZB can find is target and tool in the frames so turned. Deflection counts as an
        offset with its value at the base pose.
        """
        return inverse(self._turned_by(0))

    @property
    def T_shown_tip(self) -> FloatArray:
        """The tip as measurements show it; see :attr:`T_shown_base`."""
        robot = self.cell.robot
        T_base_tip = robot.fk(self.cell.base_posture)
        return inverse(T_base_tip) @ self._turned_by(robot.n - 1) @ T_base_tip

    def _turned_by(self, joint: int) -> FloatArray:
        """Motion ``(4, 4)`` by the error of a joint at the base pose, in base axes; or none."""
        robot, q = self.cell.robot, self.cell.base_posture
        if robot.joint_names[joint] in self.cell.offset_joints:
            return np.eye(4)
        angle = self.joint_errors(q[None])[0, joint]
        state = robot.state(q)
        rotation = rotation_exp(angle * state.axes[joint])
        origin = state.origins[joint]
        return transform(rotation, origin - rotation @ origin)

    def touch_up(
        self, q: FloatArray, rng: np.random.Generator | None, trials: int | None = None
    ) -> Measurements:
        """Touch up the target from planned postures ``(N, n)`` [rad]."""
        return simulate(self.model, self.values, q, rng, trials=trials)

    def joint_errors(self, q: FloatArray) -> FloatArray:
        """Offset plus deflection of each joint at postures ``(N, n)`` [rad], ``(N, n)`` [rad]."""
        return self.model.view(q, self.values).joint_errors

    def camera_poses(
        self, q: FloatArray, rng: np.random.Generator | None
    ) -> tuple[FloatArray, FloatArray]:
        """What robot and camera report at recorded postures: pairs of A X = Z B.

        Parameters
        ----------
        q : array (..., N, n)
            Joint values as the controller shows them [rad].
        rng : numpy.random.Generator, optional
            Source of the camera's noise; none: no noise.

        Returns
        -------
        A : array (..., N, 4, 4)
            ``T_base_tip`` that the controller computes, without the arm's errors.
        B : array (..., N, 4, 4)
            ``T_target_camera`` that the camera measures, with its noise in camera axes. In a cell
            of hand-eye calibration it is that of the measurement: of the target as it is seen.
        """
        T_base_camera = self.model.view(q, self.values).T_base_tip @ self.T_tip_camera
        B = inverse(self.T_base_target) @ T_base_camera
        if rng is not None and self.cell.is_hand_eye:
            sigma = self.cell.measurement.sigma
            shift, turn = np.split(rng.standard_normal((*q.shape[:-1], 6)) * sigma, 2, axis=-1)
            seen = inverse(B)
            rotation = rotation_exp(turn) @ seen[..., :3, :3]
            B = inverse(transform(rotation, seen[..., :3, 3] + shift))
        elif rng is not None:
            section = self.cell.config.measurement
            turn, shift = rng.standard_normal((2, *q.shape[:-1], 3))
            noise = transform(
                rotation_exp(turn * np.deg2rad(section.camera_three_sigma_deg) / 3.0),
                shift * section.camera_three_sigma_mm / 3e3,
            )
            B = B @ noise
        return self.cell.robot.fk(q), B
