"""A cell as its file gives it, in SI: robot, tool, target, and where everything is."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import InputError
from calib.geometry import Body
from calib.lens import Lens
from calib.model.measurements.board_view import Carried
from calib.model.parameters import Payload
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, rotation_exp, rotation_from_wpr, transform
from posedesign.cell.schema import CameraSection, CellConfig

if TYPE_CHECKING:
    from calib.vision.boards import Board

_FACING = np.diag([1.0, -1.0, -1.0])
"""The target's z points at the camera: turned by 180 deg about x against the tool."""


@dataclass(frozen=True, eq=False)
class CameraFound:
    """Camera, board and lens as pictures showed them: see :class:`.BoardSetUp`."""

    lens: Lens
    carried: Carried
    X: FloatArray
    Z: FloatArray


@dataclass(frozen=True, eq=False)
class CellData:
    """What a cell is, without what is made of it."""

    config: CellConfig  # as written, in mm and degrees
    robot: Robot
    base_posture: FloatArray  # (n,) [rad]
    tool_m: FloatArray  # (3,): tool point in the tip frame [m]
    target_m: FloatArray  # (3,): target in the base frame [m]
    offset_joints: tuple[str, ...]  # joints whose zero offset is identified
    tool_bodies: tuple[Body, ...]
    obstacles: tuple[Body, ...]
    """tool_bodies, obstacles: what the flange carries, and what stands around."""
    camera_found: CameraFound | None = None
    """Camera, board and lens as they were calibrated before, in place of those described."""
    singularity_setting: str = "constraints.smallest_singular_value"
    """Key of the setting that the distance from singularities is taken from."""

    @property
    def sees_board(self) -> bool:
        """Whether pictures of a board are what is measured."""
        return self.config.measurement.kind == "board"

    @cached_property
    def board(self) -> Board | None:
        """The calibration board that a camera sees; None where the cell describes none.

        Raises
        ------
        InputError
            A board that cannot be.
        """
        section = self.config.board
        if section is None:
            return None
        from calib.vision.boards import make_board  # not loaded for cells without

        given = section.model_dump(exclude_none=True)
        lengths = {key: given.pop(key) for key in list(given) if key.endswith("_mm")}
        metres = {f"{key.removesuffix('mm')}m": length / 1e3 for key, length in lengths.items()}
        try:
            return make_board(**given, **metres)
        except InputError as error:  # its arguments are in metres, the keys of a cell are not
            raise InputError(
                re.sub(r"_m\b", "_mm", error.message), hint=error.hint, name=error.name
            ) from error

    @property
    def is_hand_eye(self) -> bool:
        """Whether camera and target are what is identified, and the robot is taken as it is."""
        return self.config.measurement.kind == "camera-pose" or self.sees_board

    @property
    def estimates_lens(self) -> bool:
        """Whether the lens is identified with camera and board."""
        return self.sees_board and self.config.measurement.estimate_lens

    @property
    def has_camera(self) -> bool:
        """Whether something on the flange sees: it is described, or is what is calibrated."""
        return self.is_hand_eye or self.config.camera is not None

    @property
    def camera_stands(self) -> bool:
        """Whether the camera stands around the arm, and the board is on the flange."""
        section = self.config.camera
        return section is not None and section.mount == "fixed"

    @property
    def stiffness(self) -> FloatArray:
        """Stiffness of the simulated reducers of joints that turn [Nm/rad]; infinite: rigid."""
        truth = self.config.truth
        if truth.deflection is False:
            return np.full(len(self.robot.turning_joints), np.inf)
        given = truth.stiffness_nm_per_rad
        return self.robot.stiffness[self.robot.arm_turns] if given is None else np.array(given)

    @property
    def deflects(self) -> bool:
        """Whether the simulated robot gives way under gravity."""
        loaded = self.payload is not None or bool(self.robot.link_mass.any())
        return loaded and bool(np.isfinite(self.stiffness).any())

    @property
    def payload(self) -> Payload | None:
        """What the flange carries."""
        tool = self.config.tool
        return Payload(tool.mass_kg, np.array(tool.com_mm) / 1e3) if tool.mass_kg else None

    @property
    def margin(self) -> float:
        """Distance [rad] that planned poses keep from the joint limits."""
        return float(np.deg2rad(self.config.plan.limit_margin_deg))

    @property
    def target_offset_m(self) -> float:
        """How far the target is from where the base posture puts the tool point [m]."""
        point = self.robot.state(self.base_posture).point(self.tool_m)
        return float(np.linalg.norm(self.target_m - point))

    @property
    def T_tip_camera(self) -> FloatArray:
        """Camera in the tip frame.

        By default with the axes of the tip, the lens behind the tool point along its z. A camera
        that stands around the arm is there at the base pose only.
        """
        lens = self.tool_m - [0.0, 0.0, self.config.tool.camera_stand_off_mm / 1e3]
        section = self.config.camera
        if section is None:
            return transform(np.eye(3), lens)
        if section.mount == "fixed":
            return np.asarray(
                inverse(self.robot.fk(self.base_posture)) @ fixed_camera(self, section)
            )
        if section.position_mm is not None:
            lens = np.array(section.position_mm) / 1e3
        wpr_deg = section.wpr_deg or (0.0, 0.0, 0.0)
        return transform(rotation_from_wpr(np.deg2rad(wpr_deg)), lens)

    @property
    def T_base_target(self) -> FloatArray:
        """Target in the base frame, facing the camera of the base pose."""
        return transform(self.robot.fk(self.base_posture)[:3, :3] @ _FACING, self.target_m)

    @property
    def target_normal(self) -> FloatArray:
        """Unit vector ``(3,)`` out of the face of the target, in base axes.

        By default towards the camera at the base pose. That of a board on the flange is the one
        that it has there.
        """
        if self.camera_stands:
            return board_normal_in_base(self)
        given = self.config.target.normal
        way = self.lens_m - self.target_m if given is None else np.array(given)
        length = np.linalg.norm(way)
        if length == 0.0:  # a lens on the target: there is no camera to speak of
            return np.asarray(-self.robot.fk(self.base_posture)[:3, 2])
        return np.asarray(way / length)

    @property
    def lens_m(self) -> FloatArray:
        """The lens at the base pose ``(3,)`` [m], the tool point on the target; base frame."""
        section = self.config.camera
        if section is not None and section.mount == "fixed":
            return np.asarray(fixed_camera(self, section)[:3, 3])
        R = self.robot.fk(self.base_posture)[:3, :3]
        return np.asarray(self.target_m + R @ (self.T_tip_camera[:3, 3] - self.tool_m))


def fixed_camera(cell: CellData, camera: CameraSection) -> FloatArray:
    """Pose ``T_base_camera (4, 4)`` of a camera that stands around the arm.

    Looking at the target, the board upright in its picture, where nothing else is given.
    """
    R_base_tip = cell.robot.fk(cell.base_posture)[:3, :3]
    if camera.position_mm is None:
        away_m = cell.config.tool.camera_stand_off_mm / 1e3
        lens = cell.target_m + away_m * R_base_tip @ _board_normal(cell)
    else:
        lens = np.array(camera.position_mm) / 1e3
    if camera.wpr_deg is not None:
        return transform(rotation_from_wpr(np.deg2rad(camera.wpr_deg)), lens)
    sight = cell.target_m - lens
    length = float(np.linalg.norm(sight))
    if length == 0.0:
        raise InputError("the camera is where the board is", name="camera.position_mm")
    return transform(_with_axes(sight / length, R_base_tip @ board_axes(cell)[:, 0]), lens)


def _board_normal(cell: CellData) -> FloatArray:
    """Unit vector ``(3,)`` out of the face of a board on the flange, in the axes of the tip."""
    given = cell.config.target.normal
    normal = np.array([0.0, 0.0, 1.0] if given is None else given)
    return np.asarray(normal / np.linalg.norm(normal))


def board_normal_in_base(cell: CellData) -> FloatArray:
    """The same ``(3,)`` at the base pose, in base axes."""
    return np.asarray(cell.robot.fk(cell.base_posture)[:3, :3] @ _board_normal(cell))


def board_axes(cell: CellData) -> FloatArray:
    """Axes ``(3, 3)`` of a board on the flange, in those of the tip."""
    return facing(cell, _board_normal(cell), np.array([1.0, 0.0, 0.0]))


def facing(cell: CellData, normal: FloatArray, along: FloatArray) -> FloatArray:
    """Axes ``(3, 3)`` of a board: z into it, x as near to a direction as it goes, then rolled."""
    roll = np.deg2rad(cell.config.target.roll_deg)
    return np.asarray(_with_axes(-normal, along) @ rotation_exp([0.0, 0.0, roll]))


_PARALLEL = 1e-3
"""Sine of the angle below which a direction tells nothing of what is across it."""


def _with_axes(z: FloatArray, along: FloatArray) -> FloatArray:
    """A rotation ``(3, 3)`` with this z, a unit vector, and its x as near to a direction."""
    x = along - z * (z @ along)
    if np.linalg.norm(x) < _PARALLEL:
        other = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = other - z * (z @ other)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
