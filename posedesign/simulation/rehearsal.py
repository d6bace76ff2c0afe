"""The cell as its ``[truth]`` has it, for arms that touch up by what a simulated camera sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.model import CalibrationModel, simulate
from calib.model.measurements import Measurement, Measurements
from calib.se3 import FloatArray, IntArray, inverse, rotation_exp, rotation_from_wpr, transform
from calib.vision.camera import (
    Camera,
    CircleTarget,
    Imaging,
    MeasurementNoise,
    Observer,
    make_observer,
    noise_from_images,
)
from calib.vision.camera.observers import Kind, Target
from calib.vision.touch_up import BoardTarget, SimulatedArms, TrueCell
from calib.vision.touch_up.arms import LostMotion
from posedesign.cell import Cell

NOISE_IMAGES = 60
"""Pictures that the noise of the fast camera is calibrated from: standard deviations to 9 %."""

_USUAL_DIAMETER_M = 0.020
_USUAL_WIND_UP_RAD = np.deg2rad(0.003)
"""By which friction winds up a reducer in good order, either way: a fifth of an arc minute."""

_PLATE_OF_DIAMETER = 2.0
"""Sides of the plate, where the cell does not say, in diameters of the circle."""

_CROSS_OF_DIAMETER = (0.6, 0.1)


def true_camera(cell: Cell) -> Camera:
    """The camera of the cell with the lens of the truth; that of the paper without a camera."""
    section = cell.config.camera
    distortion = cell.config.truth.imaging.distortion
    if section is None:
        return Camera.from_sensor((640, 480), (4.8, 3.6), 12.0, distortion)
    width, height = section.image_px
    return Camera(width, height, section.focal_px, distortion=distortion)


def circle_target(cell: Cell) -> CircleTarget:
    """The round target of the cell; 20 mm across where it does not say."""
    section = cell.config.target
    diameter = 2e-3 * section.radius_mm or _USUAL_DIAMETER_M
    plate = section.plate_mm
    cross = section.cross_mm
    length, width = (diameter * part for part in _CROSS_OF_DIAMETER)
    dark, light = 0.08, 0.85
    return CircleTarget(
        diameter,
        (_PLATE_OF_DIAMETER * diameter,) * 2 if plate is None else (plate[0] / 1e3, plate[1] / 1e3),
        length if cross is None else cross[0] / 1e3,
        width if cross is None else cross[1] / 1e3,
        circle=dark if section.dark else light,
        face=light if section.dark else dark,
    )


def target_of(cell: Cell) -> Target:
    """What a camera touches up: the board of the cell, or its round target."""
    return circle_target(cell) if cell.board is None else BoardTarget(cell.board)


def imaging_of(cell: Cell) -> Imaging:
    """How the simulated camera takes pictures."""
    section = cell.config.truth.imaging
    return Imaging(
        blur_px=section.blur_px,
        noise_grey=section.noise_grey,
        gradient=section.gradient,
        vignetting=section.vignetting,
    )


def true_cell(cell: Cell) -> TrueCell:
    """The arm with its errors, what its joints lose, and where camera and target really are."""
    robot = SimulatedRobot.of(cell)
    truth = cell.config.truth
    T_tip_camera = robot.T_tip_camera
    T_tip_camera[:3, :3] @= rotation_from_wpr(np.deg2rad(truth.camera_error_deg))
    turned = rotation_from_wpr(np.deg2rad(truth.target_turn_deg))
    return TrueCell(
        robot.model,
        robot.values,
        T_tip_camera,
        transform(_facing(cell.target_normal) @ turned, robot.target_m),
        LostMotion.of(
            cell.robot.n,
            np.deg2rad(truth.backlash_deg),
            _friction_nm(cell),
            cell.stiffness,
            np.deg2rad(truth.scatter_deg),
        ),
        cell.payload,
        truth.imaging.vibration_mm / 1e3,
    )


def true_observer(cell: Cell, kind: Kind, noise: MeasurementNoise | None = None) -> Observer:
    """What looks at the target: through pictures, or fast with the noise of such pictures.

    ``kind`` {"image", "fast"}. ``noise``: of the fast one; by default calibrated from pictures at
    the stand-off of the cell.
    """
    camera, target, imaging = true_camera(cell), target_of(cell), imaging_of(cell)
    if kind == "fast" and noise is None:
        distance = float(np.linalg.norm(cell.lens_m - cell.target_m))
        facing = transform(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, distance])
        rng = np.random.default_rng([cell.config.truth.seed, 2])
        noise = noise_from_images(camera, target, facing, imaging, NOISE_IMAGES, rng)
    return make_observer(kind, camera, target, imaging, noise)


def simulated_arms(cell: Cell, observer: Observer, seed: int) -> SimulatedArms:
    """One arm as the cell's ``[truth]`` has it, at the base posture, and the seed of its noise."""
    rng = np.random.default_rng(seed)
    return SimulatedArms(true_cell(cell), observer, 1, rng, cell.base_posture)


def _friction_nm(cell: Cell) -> FloatArray:
    """Friction of the joints ``(n,)`` [Nm], usual where the cell does not say."""
    given = cell.config.truth.friction_nm
    if given is not None:
        return np.broadcast_to(np.array(given, dtype=float), (cell.robot.n,))
    stiff = cell.stiffness
    return np.where(
        np.isfinite(stiff), _USUAL_WIND_UP_RAD * np.where(np.isfinite(stiff), stiff, 0.0), 0.0
    )


def _facing(normal: FloatArray) -> FloatArray:
    """A rotation ``(3, 3)`` whose z is the normal; its x lies in the base's x-y plane if it can."""
    aside = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(aside, normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


@dataclass(frozen=True, eq=False)
class SimulatedRobot:
    """The robot as it really is, known to nothing but the simulation."""

    cell: Cell
    model: CalibrationModel  # with zero offsets of all joints and, where asked for, deflection
    values: FloatArray  # (p,): true parameters [SI]

    @classmethod
    def of(cls, cell: Cell, measurement: Measurement | None = None) -> SimulatedRobot:
        """The robot of the ``[truth]`` section, measured as the cell says or otherwise."""
        return cls(cell, *cell.truth(measurement))

    def value(self, name: str) -> float:
        """True value of one parameter [SI]."""
        return float(self.values[self.model.names.index(name)])

    @property
    def tool_m(self) -> FloatArray:
        """Where the tool point really is on the tip ``(3,)`` [m]; a view line shows no depth."""
        tool = self.cell.tool_m.copy()
        for k, name in enumerate(("tool.x", "tool.y", "tool.z")):
            if name in self.model.names:
                tool[k] = self.value(name)
        return tool

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
        offset with its value at the base pose. Of a positioner it is the joint that moves the base.
        """
        robot = self.cell.robot
        return inverse(self._turned_by(0 if robot.floor else robot.n_external))

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

    def measure(
        self,
        q: FloatArray,
        which: IntArray,
        names: Sequence[str],
        rng: np.random.Generator | None,
        trials: int | None = None,
    ) -> Measurements:
        """Measure whatever the poses of a plan are of, one measurement for each tool that is seen.

        ``q`` (N, n): planned postures [rad]. ``which`` (N,): observation of the cell that each is
        of. ``names``: of the poses.
        """
        row, setup = self.cell.one_by_one(self.model, q, which)
        found = simulate(self.model, self.values, q[row], rng, trials=trials, setup=setup)
        return replace(found, names=tuple(names[i] for i in row))

    def joint_errors(self, q: FloatArray) -> FloatArray:
        """Offset plus deflection of each joint at postures ``(N, n)`` [rad], ``(N, n)`` [rad]."""
        return self.model.view(q, self.values).joint_errors

    def camera_poses(
        self, q: FloatArray, rng: np.random.Generator | None
    ) -> tuple[FloatArray, FloatArray]:
        """What robot and camera report at recorded postures: pairs of A X = Z B.

        ``q`` (..., N, n): joint values as the controller shows them [rad]. ``rng``: source of the
        camera's noise; none: no noise. Returns ``A`` (..., N, 4, 4), ``T_base_tip`` that the
        controller computes, without the arm's errors, and ``B`` (..., N, 4, 4), ``T_target_camera``
        that the camera measures, with its noise in camera axes. In a cell of hand-eye calibration
        it is that of the measurement: of the target as it is seen.
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
