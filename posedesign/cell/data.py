"""A cell as its file gives it, in SI: robot, tool, target, measurement, and models of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.errors import InputError
from calib.geometry import Body
from calib.model import CalibrationModel
from calib.model.measurements import (
    KINDS,
    BoardView,
    CameraPose,
    Measurement,
    TouchUp,
    ViewLine,
)
from calib.model.parameters import (
    JointCompliance,
    LensParameters,
    LinkGeometry,
    ParameterBlock,
    Payload,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, rotation_from_wpr, transform
from posedesign.cell.board_set_up import (
    BoardSetUp,
    CameraFound,
    board_normal_in_base,
    board_set_up,
    board_view,
    fixed_camera,
)
from posedesign.cell.schema import CellConfig
from posedesign.cell.schema_sections import NoiseSection

if TYPE_CHECKING:
    from calib.vision.boards import Board

_FACING = np.diag([1.0, -1.0, -1.0])
"""The target's z points at the camera: turned by 180 deg about x against the tool."""


@dataclass(frozen=True, eq=False)
class CellData:
    """What the planner, the simulation and the identification work on.

    Attributes
    ----------
    config : CellConfig
        As written, in mm and degrees.
    base_posture : array (n,)
        [rad]
    tool_m : array (3,)
        Tool point in the tip frame [m].
    target_m : array (3,)
        Target in the base frame [m].
    offset_joints : tuple of str
        Joints whose zero offset is identified.
    tool_bodies, obstacles : tuple of Body
        What the flange carries, and what stands around.
    camera_found : CameraFound, optional
        Camera, board and lens as they were calibrated before, in place of those described.
    """

    config: CellConfig
    robot: Robot
    base_posture: FloatArray
    tool_m: FloatArray
    target_m: FloatArray
    offset_joints: tuple[str, ...]
    tool_bodies: tuple[Body, ...]
    obstacles: tuple[Body, ...]
    camera_found: CameraFound | None = None

    @property
    def measurement(self) -> Measurement:
        """The measurement with its noise."""
        if self.sees_board:
            return board_view(self)
        return make_measurement(self.config, self.T_tip_camera[:3, :3])

    @property
    def sees_board(self) -> bool:
        """Whether pictures of a board are what is measured."""
        return self.config.measurement.kind == "board"

    @cached_property
    def board_set_up(self) -> BoardSetUp:
        """Camera and board, where pictures of a board are measured.

        Raises
        ------
        InputError
            One of them is not described, or cannot be.
        """
        return board_set_up(self, self.camera_found)

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
        return make_board(**given, **metres)

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
    def tool_axes(self) -> str:
        """Axes along which the tool point is identified by the cell's own measurement."""
        given = self.config.parameters.tool_axes
        return self.tool_axes_of(self.measurement) if given is None else given

    def tool_axes_of(self, measurement: Measurement) -> str:
        """Axes of the tool point that another measurement identifies in this cell.

        Those that the cell asks for; z only by touch-up, which does show it.
        """
        given = self.config.parameters.tool_axes
        asked = "xyz" if given is None else given
        across = asked.replace("z", "")
        if isinstance(measurement, ViewLine):
            return across
        own = self.config.measurement.kind
        return across + "z" if "z" in asked or (own == "view-line" and across) else across

    @property
    def stiffness(self) -> FloatArray:
        """Stiffness of the simulated reducers ``(n,)`` [Nm/rad]; infinite where they are rigid."""
        truth = self.config.truth
        if truth.deflection is False:
            return np.full(self.robot.n, np.inf)
        given = truth.stiffness_nm_per_rad
        return self.robot.stiffness if given is None else np.array(given)

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

    def model(
        self,
        offsets: tuple[str, ...] | None = None,
        *,
        measurement: Measurement | None = None,
        targets: TargetPoints | None = None,
    ) -> CalibrationModel:
        """The model that is identified: zero offsets, tool point, target.

        Where a camera sees the pose of the target: camera on the tip (X of A X = Z B) and target
        in the base (Z), six numbers each. Where it takes pictures of a board, its lens besides.

        Parameters
        ----------
        offsets : tuple of str, optional
            Joints with an unknown offset; those of the cell by default, none for a camera.
        measurement : Measurement, optional
            Another measurement than the cell's; the tool point is then free along the axes that
            it shows, see :meth:`tool_axes_of`.
        targets : TargetPoints, optional
            Other targets than the cell's one.
        """
        measured = self.measurement if measurement is None else measurement
        if isinstance(measured, CameraPose | BoardView):
            X, Z = self.T_tip_camera, self.T_base_target
            if isinstance(measured, BoardView):
                X, Z = self.board_set_up.X, self.board_set_up.Z
            frames = [ToolFrame(X), TargetFrame(Z, self.config.target.name)]
            freed = [] if offsets is None else [ZeroOffsets(self.robot, offsets)]
            lens = [LensParameters.usual(self.board_set_up.lens)] if self.estimates_lens else []
            return CalibrationModel(self.robot, [*freed, *frames, *lens], measured)
        axes = self.tool_axes if measurement is None else self.tool_axes_of(measurement)
        return CalibrationModel(
            self.robot,
            [
                ZeroOffsets(self.robot, self.offset_joints if offsets is None else offsets),
                ToolPoint(self.tool_m, axes),
                targets or TargetPoints([self.target_m], [self.config.target.name]),
            ],
            measured,
        )

    def truth(self, measurement: Measurement | None = None) -> tuple[CalibrationModel, FloatArray]:
        """Model of the simulated robot, all joints with offsets and deflection, and its values."""
        truth = self.config.truth
        given = truth.zero_offsets_deg
        offsets = usual_offsets(self.robot.n) if given is None else np.deg2rad(given)
        tool = ToolPoint(self.tool_m)
        target = TargetPoints([self.target_m], [self.config.target.name])
        blocks: list[ParameterBlock] = [ZeroOffsets(self.robot, self.robot.joint_names)]
        values = [offsets]
        if self.deflects:
            blocks.append(JointCompliance(self.robot, self.robot.joint_names, self.payload))
            values.append(1.0 / self.stiffness)
        if truth.link_error_mm > 0.0 or truth.link_error_deg > 0.0:
            links = LinkGeometry(self.robot)
            blocks.append(links)
            values.append(
                _link_errors(links, truth.link_error_mm, truth.link_error_deg, truth.seed)
            )
        values += [
            tool.nominal + np.array(truth.tool_error_mm) / 1e3,
            target.nominal + np.array(truth.target_error_mm) / 1e3,
        ]
        model = CalibrationModel(
            self.robot,
            [*blocks, tool, target],
            self.measurement if measurement is None else measurement,
        )
        return model, np.concatenate(values)


def _link_errors(links: LinkGeometry, mm: float, deg: float, seed: int) -> FloatArray:
    """Errors of links by chance ``(p,)`` [m, rad], the same for the same seed."""
    sigma = np.where([unit == "m" for unit in links.units], mm / 1e3, np.deg2rad(deg))
    return np.asarray(sigma * np.random.default_rng([seed, 1]).standard_normal(links.size))


def usual_offsets(n: int) -> FloatArray:
    """Zero offsets ``(n,)`` [rad] as on arms mastered by eye: up to a tenth of a degree."""
    if n < 1:
        raise InputError("a robot needs joints")
    pattern = np.deg2rad([0.03, 0.08, -0.06, 0.05, 0.10, -0.04])
    return np.resize(pattern, n)


def make_measurement(config: CellConfig, R_tip_camera: FloatArray) -> Measurement:
    """The measurement that the file describes.

    The noise of a camera is that of ``[[noise]]`` where one is given for its kind: that may differ
    from axis to axis. ``R_tip_camera`` ``(3, 3)`` is how the camera is turned on the tip.
    """
    section = config.measurement
    if section.kind == "camera-pose":
        given = next((noise for noise in config.noise if noise.kind == section.kind), None)
        return CameraPose(
            noise_sigma(
                given
                or NoiseSection(
                    kind=section.kind,
                    three_sigma_mm=section.camera_three_sigma_mm,
                    three_sigma_deg=section.camera_three_sigma_deg,
                )
            )
        )
    if section.kind == "view-line":
        return ViewLine(np.array(section.three_sigma_mm[:2]) / 3e3)
    return make_touch_up(config, R_tip_camera)


def make_touch_up(config: CellConfig, R_tip_camera: FloatArray) -> TouchUp:
    """Touch-ups with the noise that the file gives them, along the axes that it gives."""
    section = config.measurement
    axes = R_tip_camera if section.noise_axes == "camera" else None
    return TouchUp(np.array(section.three_sigma_mm) / 3e3, axes)


def noise_sigma(noise: NoiseSection) -> FloatArray:
    """Standard deviations ``(m,)`` [m, rad] of a kind."""
    kind = KINDS[noise.kind]
    lengths = np.array(noise.three_sigma_mm) / 3e3
    count = kind.rows - kind.turns
    parts = [np.broadcast_to(lengths, (3,))[:count] if lengths.ndim else np.full(count, lengths)]
    if noise.three_sigma_deg is not None:
        parts.append(np.broadcast_to(np.deg2rad(noise.three_sigma_deg) / 3.0, (3,)))
    return np.concatenate(parts)


def cell_text(config: CellConfig, folder: Path, comment: str = "") -> str:
    """Text of a cell; what stands at its default is left out.

    Parameters
    ----------
    folder : Path
        That the paths in the cell are relative to; the text has them in full.
    comment : str
        Lines that stand at the top.
    """
    content = config.model_dump(exclude_defaults=True, exclude_none=True, by_alias=True)
    _in_full(content, folder)
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    return "\n".join([*head, *_table("", content)]) + "\n"


def _in_full(content: dict[str, Any], folder: Path) -> None:
    """Put the full paths of robot and meshes in place of those relative to the folder."""
    robot = content.get("robot", {})
    if "urdf" in robot:
        robot["urdf"] = str((folder / robot["urdf"]).resolve())
    if "packages" in robot:
        robot["packages"] = [str((folder / name).resolve()) for name in robot["packages"]]
    for solid in (*content.get("tool", {}).get("body", ()), *content.get("obstacle", ())):
        if "mesh" in solid:
            solid["mesh"] = str((folder / solid["mesh"]).resolve())


def _table(name: str, content: Mapping[str, Any]) -> list[str]:
    """Lines of a table: its own keys first, then the tables in it."""
    lines, inner = [], []
    for key, value in content.items():
        path = f"{name}.{key}" if name else key
        if isinstance(value, Mapping):
            inner += ["", f"[{path}]", *_table(path, value)]
        elif _is_tables(value):
            for item in value:
                inner += ["", f"[[{path}]]", *_table(path, item)]
        else:
            lines.append(f"{key} = {_value(value)}")
    return lines + inner


def _is_tables(value: object) -> bool:
    return (
        isinstance(value, Sequence) and bool(value) and all(isinstance(v, Mapping) for v in value)
    )


def _value(value: object) -> str:
    """A value as TOML has it; a JSON string is a TOML string, but for DEL, which TOML escapes."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float):
        return repr(value)  # the shortest that reads back as the same number
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return str(value)
