"""The cell of the paper's section 3.1 as simulated arms, under conditions of one's choice."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calib.se3 import FloatArray, rotation_exp, transform
from calib.vision.camera import (
    Camera,
    CircleTarget,
    Imaging,
    MeasurementNoise,
    Observer,
    make_observer,
    noise_from_images,
)
from calib.vision.touch_up import (
    Drive,
    ImageJacobian,
    Loop,
    Relation,
    SimulatedArms,
    TouchUps,
    TrueCell,
    follow,
    touch_up,
)
from calib.vision.touch_up.drive import shifted
from calib.vision.touch_up.jacobian import measure_jacobian
from posedesign.cell import Cell, CellConfig, cell_template
from posedesign.simulation import circle_target, true_cell
from posedesign.simulation.rehearsal import imaging_of, true_camera

OF_AN_AXIS = 3.616
"""ISO 9283 repeatability of positions over their standard deviation along an axis, where that is
the same for all: mean of the distance, 1.596, and three times its deviation, .673."""

LARGEST_TURN = np.deg2rad(15.0)
"""Of a tip from a known posture to the next: Newton's iteration follows it without fail."""

_FINDING, _MEASURING, _NOISE, _RUNNING = range(4)
"""Streams of random numbers: each part draws from its own, whatever the others took."""


@dataclass(frozen=True)
class PlainRelation(Relation):
    """The data as they are printed: V and H not scaled by the size."""

    def error(self, ellipses: FloatArray, bias: ArrayLike = 0.0) -> FloatArray:
        """``V - V0``, ``H - H0`` and ``s0 (s0/s - 1)`` of views ``(..., 5)``, ``(..., 3)`` [px]."""
        scaled = super().error(ellipses, bias)
        ratio = 1.0 + scaled[..., 2:] / self.size_px
        return np.concatenate([scaled[..., :2] / ratio, scaled[..., 2:]], axis=-1)


@dataclass(frozen=True, eq=False)
class Bench:
    """A cell, what looks at its target, and the Jacobian that was measured in it."""

    cell: Cell
    true: TrueCell
    observer: Observer
    condition: dict[str, Any]  # as ``study.toml`` has it, over its base
    jacobian: ImageJacobian
    home: FloatArray  # (n,): where the target was first touched up [rad]; all is repeated around it
    stream: tuple[int, int]
    """Seed of the study and number of the set-up: its random numbers are its own."""

    @classmethod
    def of(cls, settings: dict[str, Any], condition: dict[str, Any], set_up: int = 0) -> Bench:
        """Set up a cell: designate the relation, measure the Jacobian, touch up once."""
        how = settings["base"] | condition
        cell = cell_of(settings, how)
        true = true_cell(cell)
        stream = (settings["seed"], set_up)
        jacobian, home = _set_up(settings, how, cell, true, stream)
        observer = _camera(settings, how, cell)
        return cls(cell, true, observer, how, jacobian, home, stream)

    def rng(self, *part: int) -> np.random.Generator:
        """Random numbers of a part of the runs."""
        return np.random.default_rng([*self.stream, _RUNNING, *part])

    @property
    def loop(self) -> Loop:
        """The loop of the condition."""
        how = self.condition
        return Loop(how["center_px"], how["size_px"], looks=how["looks"])

    @property
    def tool_m(self) -> FloatArray:
        """Tip of the virtual pin in the tip frame ``(3,)`` [m], as it truly is."""
        ahead = self.observer.camera.focal_px * self._target_m / self.jacobian.relation.size_px
        return np.asarray(self.true.T_tip_camera @ [0.0, 0.0, ahead, 1.0])[:3]

    @property
    def _target_m(self) -> float:
        return circle_target(self.cell).diameter_m

    @cached_property
    def R_base_camera(self) -> FloatArray:
        """Camera axes at home: H, V and D."""
        return np.asarray((self.cell.robot.fk(self.home) @ self.true.T_tip_camera)[:3, :3])

    def drive(self, count: int, rng: np.random.Generator) -> Drive:
        """Arms at home, moved as the condition says."""
        arms = SimulatedArms(self.true, self.observer, count, rng, self.home)
        return Drive(self.cell.robot, arms, np.deg2rad(self.condition["approach_deg"]))

    def turned(self, turn: FloatArray) -> FloatArray:
        """Posture ``(n,)`` [rad] at which the tip is turned about its pin, in tip axes [rad]."""
        T, tool = self.cell.robot.fk(self.home), self.tool_m
        steps = max(int(np.ceil(np.linalg.norm(turn) / LARGEST_TURN)), 1)
        q = self.home[None]
        for part in np.arange(1, steps + 1) / steps:
            R = rotation_exp(part * turn)
            q = self._follow(q, (T @ transform(R, tool - R @ tool))[None])
        return np.asarray(q[0])

    def starts(self, posture: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
        """Postures ``(count, n)`` [rad] spread about one, turned about the tip of the pin."""
        far = self.condition["start_mm"] / 1e3
        shift = rng.uniform(-far, far, (count, 3))
        turn = np.deg2rad(self.condition["start_deg"]) * rng.uniform(-1.0, 1.0, (count, 3))
        R = rotation_exp(turn)
        about = transform(R, self.tool_m - R @ self.tool_m + shift)
        return self._follow(np.tile(posture, (count, 1)), self.cell.robot.fk(posture) @ about)

    def away(self, posture: FloatArray, along_m: float) -> FloatArray:
        """Posture ``(n,)`` [rad] with the tip moved along the line of sight [m]."""
        shift = along_m * self.jacobian.R_tip_camera[:, 2]
        return np.asarray(
            self._follow(posture[None], shifted(self.cell.robot.fk(posture), shift)[None])[0]
        )

    def _follow(self, q: FloatArray, T: FloatArray) -> FloatArray:
        out, found = follow(self.cell.robot, q, T)
        if not found.all():
            raise RuntimeError("the arm cannot take a pose of the study")
        return out

    def ends(self, done: TouchUps) -> FloatArray:
        """Where the nominal arm has the tip of the pin ``(S, 3)`` [m], in the base frame."""
        T = self.cell.robot.fk(done.q)
        return np.asarray(T[:, :3, :3] @ self.tool_m + T[:, :3, 3])


def cell_of(settings: dict[str, Any], how: dict[str, Any]) -> Cell:
    """The bare cell of a preset, with the truth of a condition."""
    content = tomllib.loads(cell_template(settings["robot"], surroundings=False))
    content["tool"]["camera_stand_off_mm"] = settings["stand_off_mm"]
    content["target"]["radius_mm"] = settings["target_mm"] / 2.0
    cell = Cell.from_config(CellConfig.model_validate(content), Path("cell.toml"))
    content["truth"] |= {
        "backlash_deg": how["backlash_arcmin"] / 60.0,
        "friction_nm": how["friction_nm"],
        "scatter_deg": float(np.rad2deg(joint_scatter(cell, how["repeatability_mm"] / 1e3))),
        "target_turn_deg": how["target_turn_deg"],
        "camera_error_deg": how["camera_error_deg"],
        "imaging": {name: how[name] for name in ("noise_grey", "blur_px", "vibration_mm")},
    }
    return Cell.from_config(CellConfig.model_validate(content), Path("cell.toml"))


def joint_scatter(cell: Cell, repeatability_m: float) -> float:
    """Standard deviation [rad] of each joint that gives the tool a repeatability at the base."""
    state = cell.robot.state(cell.base_posture)
    lever = np.cross(state.axes, state.point(cell.tool_m) - state.origins)
    return float(repeatability_m / OF_AN_AXIS / np.sqrt((lever**2).sum() / 3.0))


def _set_up(
    settings: dict[str, Any],
    how: dict[str, Any],
    cell: Cell,
    true: TrueCell,
    stream: tuple[int, int],
) -> tuple[ImageJacobian, FloatArray]:
    """Through pictures, by one arm: the Jacobian, and where the target is touched up."""
    rng = np.random.default_rng([*stream, _FINDING])
    camera = true_camera(cell)
    target, imaging = circle_target(cell), imaging_of(cell)
    pictures = make_observer("image", camera, target, imaging)
    arms = SimulatedArms(true, pictures, 1, rng, cell.base_posture)
    drive = Drive(cell.robot, arms)
    size = camera.focal_px * settings["target_mm"] / settings["stand_off_mm"]
    right, down = camera.center_px
    relation = Relation((float(right), float(down)), size)
    step = settings["jacobian_mm"] / 1e3
    q = cell.base_posture
    for loop in (Loop(), Loop(how["center_px"], how["size_px"])):
        jacobian = _in_depth(drive, q, _measured(drive, q, relation, step), settings["depth_mm"])
        q = touch_up(drive, q[None], jacobian, loop).q[0]
    if how["jacobian"] != "linear":
        arms.reseed(np.random.default_rng([*stream, _MEASURING]))
        jacobian = as_printed(drive, q, jacobian, how["jacobian"], step, settings["off_mm"] / 1e3)
    return jacobian, q


def _measured(drive: Drive, q: FloatArray, relation: Relation, step_m: float) -> ImageJacobian:
    found = measure_jacobian(drive, q, relation, step_m, both_ways=True)
    if found.jacobian is None:
        raise RuntimeError(f"no Jacobian: {found.reason}")
    return found.jacobian


def _in_depth(drive: Drive, q: FloatArray, known: ImageJacobian, depth_mm: float) -> ImageJacobian:
    """The Jacobian after longer moves along the view line, as in
    :mod:`calib.vision.touch_up.set_up`.
    """
    only = np.zeros(1, dtype=np.intp)
    along = depth_mm / 1e3 * known.R_tip_camera[:, 2]
    errors = []
    for shift in (along, -along):
        drive.to_pose(only, q[None], shifted(drive.robot.fk(q), shift)[None])
        errors.append(known.relation.error(drive.arms.look(only).ellipses)[0])
    return known.updated(2.0 * along, errors[0] - errors[1])


def as_printed(
    drive: Drive, q: FloatArray, known: ImageJacobian, reading: str, step_m: float, off_m: float
) -> ImageJacobian:
    """Eq. 2 letter by letter, from differences of V and H as they are.

    With s the size that is seen now, measured at s0, the factor ``s/s0`` is that of every step of
    the loop: dividing the Jacobian's rows is multiplying the data by s0/s. With s the size where
    it was measured, it is one matrix for all steps.
    """
    relation = known.relation
    plain = PlainRelation(relation.center_px, relation.size_px)
    if reading == "printed":
        return ImageJacobian(_measured(drive, q, plain, step_m).matrix, relation)
    back = -off_m * known.R_tip_camera[:, 2]
    there, _ = follow(drive.robot, q[None], shifted(drive.robot.fk(q), back)[None])
    matrix = _measured(drive, there[0], plain, step_m).matrix.copy()
    drive.to_posture(np.zeros(1, dtype=np.intp), there)
    views = drive.arms.look(np.zeros(1, dtype=np.intp))
    matrix[:2] *= views.vhs_px[0, 2] / relation.size_px
    return ImageJacobian(matrix, plain)


def _camera(settings: dict[str, Any], how: dict[str, Any], cell: Cell) -> Observer:
    camera, target, imaging = true_camera(cell), circle_target(cell), imaging_of(cell)
    if how["seen"] == "image":
        return make_observer("image", camera, target, imaging)
    stream = (settings["seed"], _NOISE)
    true = true_cell(cell)
    R_base_camera = (cell.robot.fk(cell.base_posture) @ true.T_tip_camera)[:3, :3]
    R = R_base_camera.T @ true.T_base_target[:3, :3]
    seen = transform(R, np.array([0.0, 0.0, settings["stand_off_mm"] / 1e3]))
    key = tuple(seen.ravel().tolist())
    noise = _noise(camera, target, imaging, key, settings["noise_pictures"], stream)
    return make_observer("fast", camera, target, noise=noise)


@cache
def _noise(
    camera: Camera,
    target: CircleTarget,
    imaging: Imaging,
    pose: tuple[float, ...],
    pictures: int,
    stream: tuple[int, ...],
) -> MeasurementNoise:
    """Of pictures of the target at a pose ``(16,)``: the same for all conditions that share it."""
    T = np.array(pose).reshape(4, 4)
    rng = np.random.default_rng(stream)
    return noise_from_images(camera, target, T, imaging, pictures, rng)


def exact(bench: Bench) -> Bench:
    """The same arm without scatter and vibration: what a hand with a pin waits for."""
    still = replace(bench.true.lost_motion, scatter_rad=np.zeros(bench.cell.robot.n))
    return replace(bench, true=replace(bench.true, lost_motion=still, vibration_m=0.0))
