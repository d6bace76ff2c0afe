"""The cell as its ``[truth]`` has it, for arms that touch up by what a simulated camera sees."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, rotation_from_wpr, transform
from calib.vision.camera import (
    Camera,
    CircleTarget,
    Imaging,
    MeasurementNoise,
    Observer,
    make_observer,
    noise_from_images,
)
from calib.vision.camera.observers import Kind
from calib.vision.touch_up import SimulatedArms, TrueCell
from calib.vision.touch_up.simulated import LostMotion
from posedesign.cell import Cell
from posedesign.simulation.robot import SimulatedRobot

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

    Parameters
    ----------
    cell : Cell
    kind : {"image", "fast"}
    noise : MeasurementNoise, optional
        Of the fast one; by default calibrated from pictures at the stand-off of the cell.
    """
    camera, target, imaging = true_camera(cell), circle_target(cell), imaging_of(cell)
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
