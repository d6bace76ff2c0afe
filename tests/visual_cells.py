"""Cells by chance for visual touch-up: arm, camera, target and all that is wrong with them."""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from calib.model import CalibrationModel, Setup
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    GravityLoad,
    JointCompliance,
    LinkGeometry,
    Payload,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.robots import Robot, preset_info
from calib.robots.inverse import NEAR_SINGULAR
from calib.se3 import FloatArray, rotation_exp, rotation_log, transform
from calib.vision.camera import (
    Camera,
    CircleTarget,
    FastObserver,
    ImageObserver,
    Imaging,
    MeasurementNoise,
    Observer,
    circle_image,
    ellipse_axes,
)
from calib.vision.touch_up import SetUp, TrueCell
from calib.vision.touch_up.arms import LostMotion
from calib.vision.touch_up.sighting import LEAST_SIZE_PX

PRESETS = (
    "m20ia",
    "r2000ic165f",
    "lrmate200id",
    "kr6r900sixx",
    "irb120",
    "irb6700_200_260",
    "ur5e",
    "ur10e",
    "gp7",
    "mh5",
    "tx2_60",
    "tx2_90",
    "panda",
)

ROOM = np.deg2rad(20.0)
"""What a taught posture keeps from every joint limit."""

_OUTSTRETCHED = 2.6
"""Reach of the largest arms here [m]: their cameras are mounted up to 0.3 m from the tip."""

_DEFLECTION = 5e-4
"""How far reducers give way in all, about [rad]."""


@dataclass(frozen=True, eq=False)
class Sight:
    """A camera on an arm that is not quite what its controller believes, and its target."""

    preset: str
    q: FloatArray  # (n,): taught: the target is in view [rad]
    true: TrueCell
    camera: Camera
    target: CircleTarget
    imaging: Imaging  # camera, target, imaging: as they really are
    believed: Robot | None = None

    @property
    def robot(self) -> Robot:
        """As the controller knows it: the true one without its errors, or quite another."""
        return self.true.robot if self.believed is None else self.believed

    @cached_property
    def T_seen_target(self) -> FloatArray:
        """Target before the lens at the taught posture ``(4, 4)``."""
        return np.linalg.inv(self.T_true_tip(self.q) @ self.true.T_tip_camera) @ (
            self.true.T_base_target
        )

    def T_true_tip(self, q: FloatArray) -> FloatArray:
        """Where the tip really is ``(..., 4, 4)``, its joints stopped without lost motion."""
        one = np.atleast_2d(q)
        return self.true.model.view(one, self.true.values).T_base_tip.reshape(*q.shape[:-1], 4, 4)

    def observer(self, kind: str) -> Observer:
        """Through images, or fast with the noise that such images have."""
        if kind == "image":
            return ImageObserver(self.camera, self.target, self.imaging)
        seen = circle_image(self.camera, self.target.diameter_m, self.T_seen_target)
        return FastObserver(
            self.camera, self.target, usual_noise(float(ellipse_axes(seen)[0]), self.imaging)
        )

    def errors(self, found: SetUp, T_true_tip: FloatArray | None = None) -> dict[str, float]:
        """By how much a result is off, in mm and degrees.

        The target is compared with where the nominal arm has it when it stands at the first
        touch-up: more an arm that is not calibrated cannot know. ``base`` is how far that is from
        where the target really is. Where the arm really stands at that touch-up may be given, with
        what its joints lose.
        """
        q = found.postures[0]
        T_tip = self.T_true_tip(q) if T_true_tip is None else T_true_tip
        T_shown = self.robot.fk(q) @ np.linalg.inv(T_tip) @ self.true.T_base_target
        T_camera = self.true.T_tip_camera
        turned = rotation_log(T_camera[:3, :3].T @ found.T_tip_camera[:3, :3])
        cosine = float(np.clip(found.facing.normal @ T_shown[:3, 2], -1.0, 1.0))
        return {
            "lens": 1e3 * float(np.linalg.norm(found.T_tip_camera[:3, 3] - T_camera[:3, 3])),
            "turn": float(np.rad2deg(np.linalg.norm(turned))),
            "target": 1e3 * float(np.linalg.norm(found.target_m - T_shown[:3, 3])),
            "normal": float(np.rad2deg(np.arccos(cosine))),
            "base": 1e3 * float(np.linalg.norm(found.target_m - self.true.T_base_target[:3, 3])),
        }


def is_right(errors: dict[str, float]) -> bool:
    """Whether camera and target are within 5 mm and 1 deg."""
    return bool(
        max(errors["lens"], errors["target"]) < 5.0 and max(errors["turn"], errors["normal"]) < 1.0
    )


def usual_noise(size_px: float, imaging: Imaging) -> MeasurementNoise:
    """Noise of images of a target of a size: edges good to a twentieth of a pixel, 1.5 px apart."""
    edge_px = 0.025 * (1.0 + imaging.noise_grey)
    edges = np.pi * size_px / 1.5
    center = edge_px * np.sqrt(2.0 / edges)
    return MeasurementNoise.from_sigma([center, center, np.sqrt(8.0) * center])


@cache
def preset(name: str) -> Robot:
    """A robot, loaded once."""
    return Robot.preset(name)


@cache
def usual_posture(name: str) -> FloatArray:
    """Where an arm of a preset measures [rad]."""
    return np.deg2rad(preset_info(name)["base_posture_deg"])


def taught_posture(name: str, rng: np.random.Generator) -> FloatArray:
    """A posture by chance with room to turn, as an engineer would choose it ``(n,)`` [rad]."""
    robot = preset(name)
    while True:
        q = usual_posture(name) + np.deg2rad(rng.uniform(-20.0, 20.0, robot.n))
        q = np.clip(q, robot.lower + ROOM, robot.upper - ROOM)
        coupled = all(limit.margin(q[None])[0] > ROOM for limit in robot.coupled_limits)
        if coupled and _steadiness(robot, q) > 5.0 * NEAR_SINGULAR:
            return q


def _steadiness(robot: Robot, q: FloatArray) -> float:
    J = robot.jacobian(q)
    J[:3] /= np.linalg.norm(robot.fk(q)[:3, 3])
    return float(np.linalg.svd(J, compute_uv=False)[5])


def true_arm(
    robot: Robot, q: FloatArray, payload: Payload, rng: np.random.Generator
) -> tuple[CalibrationModel, FloatArray]:
    """An arm with usual errors: zero offsets, links, and reducers that give way."""
    names = robot.joint_names
    torque = GravityLoad(robot, payload).joint_torque(q[:, None], Setup.of(1))[:, 0]
    compliance = np.full(robot.n, _DEFLECTION / max(float(np.abs(torque).max()), 1e-3))
    links = LinkGeometry(robot)
    link_sigma = np.where([unit == "m" for unit in links.units], 2e-4, np.deg2rad(0.01))
    tool, target = ToolPoint([0.0, 0.0, 0.1]), TargetPoints([np.zeros(3)], ["T"])
    model = CalibrationModel(
        robot,
        [ZeroOffsets(robot, names), JointCompliance(robot, names, payload), links, tool, target],
        TouchUp(1e-4),
    )
    values = [
        np.deg2rad(0.1) * rng.standard_normal(robot.n),
        compliance * rng.uniform(0.5, 1.5, robot.n),
        link_sigma * rng.standard_normal(links.size),
        tool.nominal,
        target.nominal,
    ]
    return model, np.concatenate(values)


def mounted_camera(scale: float, rng: np.random.Generator) -> FloatArray:
    """T_tip_camera anywhere about the flange, any roll, looking roughly away from it."""
    place = scale * 0.3 * rng.uniform(0.2, 1.0) * _direction(rng)
    place[2] = abs(place[2])
    aside = rng.uniform(0.0, 2.0 * np.pi)
    tilt = np.deg2rad(40.0) * np.sqrt(rng.uniform())
    lean = rotation_exp(tilt * np.array([np.cos(aside), np.sin(aside), 0.0]))
    roll = rotation_exp(np.array([0.0, 0.0, rng.uniform(0.0, 2.0 * np.pi)]))
    return transform(lean @ roll, place)


def _direction(rng: np.random.Generator) -> FloatArray:
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def camera_by_chance(sizes: tuple[tuple[int, int], ...], rng: np.random.Generator) -> Camera:
    """A camera with a mild distortion, its axis a little off the middle of the picture."""
    width, height = sizes[rng.integers(len(sizes))]
    focal = width * rng.uniform(1.2, 3.0)
    off = 0.01 * width * rng.uniform(-1.0, 1.0, 2)
    principal = (width / 2 + off[0], height / 2 + off[1])
    k1 = rng.uniform(-0.1, 0.1)
    return Camera(width, height, focal, principal_px=principal, distortion=(k1, 0, 0, 0, 0))


def placed_target(
    camera: Camera, distance_m: float, size_px: float, tilt: float, rng: np.random.Generator
) -> FloatArray:
    """T_camera_target off the middle of the picture, turned away by an angle [rad]."""
    room = np.array([camera.width_px, camera.height_px]) / 2.0 - 0.75 * size_px - 12.0
    pixel = np.array([camera.width_px, camera.height_px]) / 2.0 + 0.7 * room * rng.uniform(-1, 1, 2)
    ray = camera.rays(pixel)
    aside = rng.uniform(0.0, 2.0 * np.pi)
    tilted = rotation_exp(tilt * np.array([np.cos(aside), np.sin(aside), 0.0]))
    spun = rotation_exp(np.array([0.0, 0.0, rng.uniform(0.0, 2.0 * np.pi)]))
    return transform(tilted @ np.diag([1.0, -1.0, -1.0]) @ spun, distance_m * ray)


def random_sight(
    rng: np.random.Generator,
    presets: tuple[str, ...] = PRESETS,
    sizes: tuple[tuple[int, int], ...] = ((640, 480), (800, 600), (1280, 960)),
) -> Sight:
    """A cell by chance with nothing out of the ordinary."""
    name = presets[rng.integers(len(presets))]
    robot = preset(name)
    q = taught_posture(name, rng)
    reach = float(np.linalg.norm(robot.fk(q)[:3, 3]))
    scale = min(1.0, 0.4 + reach / _OUTSTRETCHED)
    payload = Payload(20.0 * scale**3, np.array([0.0, 0.0, 0.1 * scale]))
    model, values = true_arm(robot, q, payload, rng)
    T_tip_camera = mounted_camera(scale, rng)
    camera = camera_by_chance(sizes, rng)
    distance = scale * rng.uniform(0.2, 0.5)
    size_px = max(camera.height_px * rng.uniform(0.08, 0.25), 1.2 * LEAST_SIZE_PX)
    diameter = size_px * distance / camera.focal_px
    tilt = np.deg2rad(30.0) * np.sqrt(rng.uniform())
    T_camera_target = placed_target(camera, distance, size_px, tilt, rng)
    torque = GravityLoad(robot, payload).joint_torque(q[:, None], Setup.of(1))
    lost = LostMotion.of(
        robot.n,
        backlash_rad=np.deg2rad(rng.uniform(0.0, 0.02, robot.n)),
        friction_nm=rng.uniform(0.01, 0.05) * float(np.abs(torque).max()),
        scatter_rad=np.deg2rad(1.2e-4),
    )
    T_true_tip = model.view(q[None], values).T_base_tip[0]
    true = TrueCell(
        model,
        values,
        T_tip_camera,
        T_true_tip @ T_tip_camera @ T_camera_target,
        lost,
        payload,
        vibration_m=2e-6,
    )
    dark = bool(rng.uniform() < 0.7)
    target = CircleTarget(
        diameter,
        (2.0 * diameter, 2.0 * diameter),
        0.6 * diameter,
        0.1 * diameter,
        circle=0.08 if dark else 0.85,
        face=0.85 if dark else 0.08,
    )
    imaging = Imaging(
        blur_px=rng.uniform(0.5, 1.2),
        noise_grey=rng.uniform(0.5, 3.0),
        gradient=tuple(rng.uniform(-0.4, 0.4, 2)),
        vignetting=rng.uniform(0.0, 0.3),
    )
    return Sight(name, q, true, camera, target, imaging)


def with_true(sight: Sight, **changes: object) -> Sight:
    """The same with something else in its truth."""
    return replace(sight, true=replace(sight.true, **changes))
