"""The cell: a robot with its tool, its target and its measurement, ready to be planned for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError, JointLimitError
from calib.geometry import Body, Scene
from calib.model import CalibrationModel
from calib.model.measurements import CameraPose, Measurement, ViewLine
from calib.model.parameters import (
    JointCompliance,
    LinkGeometry,
    ParameterBlock,
    Payload,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.robots import CoupledLimit, Robot
from calib.robots.arm_shapes import with_capsules, with_shapes_of
from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.cell.checks import check_cell, naming
from posedesign.cell.measurement import make_measurement
from posedesign.cell.schema import CellConfig, RobotSection, parse_text, read_config
from posedesign.cell.surroundings import (
    Whereabouts,
    build_checker,
    build_collisions,
    build_retreat,
    build_scene,
    meeting_pairs,
    nearest_body,
    obstacles,
    tool_bodies,
    what_is_not_checked,
    what_is_odd,
)
from posedesign.constraints import Checker, Collision, Retreat, WayChecker

_FACING = np.diag([1.0, -1.0, -1.0])
"""The target's z points at the camera: turned by 180 deg about x against the tool."""

MOST_RADIANS = np.pi
"""A base posture whose values all lie within this, most of them with a fraction, was written in
radians: no arm stands within three degrees of its zero to measure."""


@dataclass(frozen=True, eq=False)
class Cell:
    """What the planner, the simulation and the identification work on.

    Attributes
    ----------
    config : CellConfig
        As written, in mm and degrees.
    robot : Robot
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
    """

    config: CellConfig
    robot: Robot
    base_posture: FloatArray
    tool_m: FloatArray
    target_m: FloatArray
    offset_joints: tuple[str, ...]
    tool_bodies: tuple[Body, ...]
    obstacles: tuple[Body, ...]

    @classmethod
    def load(cls, path: Path | str) -> Cell:
        """Read a ``cell.toml`` and the robot that it names.

        Raises
        ------
        FileFormatError
            Something in the file cannot be used; file and key are named.
        RobotModelError
            The robot cannot be loaded.
        """
        file = Path(path)
        return cls.from_config(read_config(file), file)

    @classmethod
    def from_text(cls, text: str, path: Path | str = "cell.toml") -> Cell:
        """The cell of a ``cell.toml`` given as text; ``path`` is named in errors."""
        return cls.from_config(parse_text(text, Path(path)), Path(path))

    @classmethod
    def from_config(cls, config: CellConfig, path: Path) -> Cell:
        """Build the cell; relative paths in it are relative to the folder of ``path``."""
        source = config.robot
        with naming(path, "robot"):
            if source.preset is not None:
                robot = Robot.preset(source.preset, tip=source.tip, base=source.base)
            else:
                urdf = path.parent / str(source.urdf)
                robot = Robot.from_urdf(
                    urdf,
                    tip=source.tip,
                    base=source.base,
                    lock=source.lock,
                    packages=[path.parent / folder for folder in source.packages],
                    xacro_args=source.xacro_args,
                )
        robot = _with_shapes(robot, source, path)
        if source.controller is not None:
            with naming(path, "robot.controller"):
                robot = robot.controlled_by(source.controller)
        robot = _with_coupled_limits(robot, source, path)
        posture = _base_posture(config, robot, path)
        tool = np.array(config.tool.point_mm) / 1e3
        given = config.target.position_mm
        target = robot.state(posture).point(tool) if given is None else np.array(given) / 1e3
        listed = config.parameters.zero_offsets
        with naming(path, "tool.body"):
            carried = tool_bodies(config.tool.body, robot, path.parent)
        with naming(path, "obstacle"):
            around = obstacles(config.obstacle, path.parent)
        cell = cls(
            config=config,
            robot=robot,
            base_posture=posture,
            tool_m=tool,
            target_m=target,
            # the first and the last joint are absorbed by target and tool point (section 3.2)
            offset_joints=robot.joint_names[1:-1] if listed is None else listed,
            tool_bodies=tuple(carried),
            obstacles=tuple(around),
        )
        with naming(path, "parameters.zero_offsets"):
            ZeroOffsets(robot, cell.offset_joints)
        if config.measurement.kind == "view-line" and "z" in cell.tool_axes:
            raise FileFormatError(
                "a view line does not show where the tool point is along z",
                path=path,
                key="parameters.tool_axes",
                hint='set it to "xy"',
            )
        check_cell(cell, path)
        return cell

    @property
    def measurement(self) -> Measurement:
        """The measurement with its noise."""
        return make_measurement(self.config, self.T_tip_camera[:3, :3])

    @property
    def is_hand_eye(self) -> bool:
        """Whether camera and target are what is identified, and the robot is taken as it is."""
        return self.config.measurement.kind == "camera-pose"

    @property
    def has_camera(self) -> bool:
        """Whether something on the flange sees: it is described, or is what is calibrated."""
        return self.is_hand_eye or self.config.camera is not None

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

        By default with the axes of the tip, the lens behind the tool point along its z.
        """
        lens = self.tool_m - [0.0, 0.0, self.config.tool.camera_stand_off_mm / 1e3]
        section = self.config.camera
        if section is None:
            return transform(np.eye(3), lens)
        if section.position_mm is not None:
            lens = np.array(section.position_mm) / 1e3
        return transform(rotation_from_wpr(np.deg2rad(section.wpr_deg)), lens)

    @property
    def T_base_target(self) -> FloatArray:
        """Target in the base frame, facing the camera of the base pose."""
        return transform(self.robot.fk(self.base_posture)[:3, :3] @ _FACING, self.target_m)

    @property
    def target_normal(self) -> FloatArray:
        """Unit vector ``(3,)`` out of the face of the target, in base axes.

        By default towards the camera at the base pose.
        """
        given = self.config.target.normal
        way = self.lens_m - self.target_m if given is None else np.array(given)
        length = np.linalg.norm(way)
        if length == 0.0:  # a lens on the target: there is no camera to speak of
            return np.asarray(-self.robot.fk(self.base_posture)[:3, 2])
        return np.asarray(way / length)

    @property
    def lens_m(self) -> FloatArray:
        """The lens at the base pose ``(3,)`` [m], the tool point on the target; base frame."""
        R = self.robot.fk(self.base_posture)[:3, :3]
        return np.asarray(self.target_m + R @ (self.T_tip_camera[:3, 3] - self.tool_m))

    @cached_property
    def scene(self) -> Scene:
        """Arm, tool and obstacles, with the pairs that measuring poses are checked for."""
        return build_scene(self, self.config.constraints.ignore)

    @cached_property
    def checker(self) -> Checker:
        """All constraints that a measuring posture must keep."""
        return build_checker(self)

    @cached_property
    def passing(self) -> Checker:
        """What postures that the arm only passes through must keep."""
        return Checker(self.robot, self.solid_passing, self.margin)

    @cached_property
    def solid(self) -> tuple[Collision, ...]:
        """What arm and tool must keep clear of at a measuring posture."""
        return build_collisions(self, self.scene)

    @cached_property
    def solid_passing(self) -> tuple[Collision, ...]:
        """The same on the ways between postures: of bodies that meet at the target only, too."""
        met = meeting_pairs(self)
        if not met:
            return self.solid
        lasting = [pair for pair in self.config.constraints.ignore if pair not in met]
        return build_collisions(self, build_scene(self, lasting))

    @cached_property
    def retreat(self) -> Retreat | None:
        """How the tool comes to its poses along its axis; None where it comes straight to them."""
        return build_retreat(self)

    @cached_property
    def ways(self) -> WayChecker:
        """What the ways between postures must keep."""
        section = self.config.constraints
        travel = section.largest_travel_deg
        return WayChecker(
            self.solid_passing if section.ways else (),
            np.inf if travel is None else float(np.deg2rad(travel)),
        )

    @cached_property
    def whereabouts(self) -> Whereabouts:
        """Where target and tool point are, for people to see before anything is planned."""
        return Whereabouts(
            self.robot.base_frame,
            self.config.target.name,
            self.target_m,
            self.robot.state(self.base_posture).point(self.tool_m),
            nearest_body(self.robot, self.obstacles, self.target_m),
        )

    @property
    def notices(self) -> list[str]:
        """What was decided while reading the robot, and what is odd about the cell, in words."""
        return [*self.robot.notices, *what_is_odd(self)]

    @property
    def not_checked(self) -> tuple[str, ...]:
        """What planning and checking do not look at, in words."""
        return what_is_not_checked(self)

    def model(
        self,
        offsets: tuple[str, ...] | None = None,
        *,
        measurement: Measurement | None = None,
        targets: TargetPoints | None = None,
    ) -> CalibrationModel:
        """The model that is identified: zero offsets, tool point, target.

        Where a camera sees the pose of the target: camera on the tip (X of A X = Z B) and target
        in the base (Z), six numbers each.

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
        if isinstance(measured, CameraPose):
            name = self.config.target.name
            frames = [ToolFrame(self.T_tip_camera), TargetFrame(self.T_base_target, name)]
            freed = [] if offsets is None else [ZeroOffsets(self.robot, offsets)]
            return CalibrationModel(self.robot, [*freed, *frames], measured)
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


def _with_shapes(robot: Robot, section: RobotSection, path: Path) -> Robot:
    """The robot with what its cell says of links that the description gives no shape."""
    if section.shapes is not None:
        with naming(path, "robot.shapes"):
            robot = with_shapes_of(robot, section.shapes)
    if section.capsule_radius_mm is not None:
        with naming(path, "robot.capsule_radius_mm"):
            robot = with_capsules(robot, np.atleast_1d(section.capsule_radius_mm) / 1e3)
    return robot


def _with_coupled_limits(robot: Robot, section: RobotSection, path: Path) -> Robot:
    limits = [*robot.coupled_limits] if section.keep_coupled_limits else []
    for given in section.coupled_limit:
        if len(given.coefficients) != robot.n:
            raise FileFormatError(
                f"{given.name}: {len(given.coefficients)} coefficients for {robot.n} joints",
                path=path,
                key="robot.coupled_limit",
                hint="give one for each joint, 0 for those that have no part in it",
            )
        lower, upper = np.deg2rad([given.lower_deg, given.upper_deg]).tolist()
        limits.append(CoupledLimit(given.name, np.array(given.coefficients), lower, upper))
    return replace(robot, coupled_limits=tuple(limits))


def _base_posture(config: CellConfig, robot: Robot, path: Path) -> FloatArray:
    degrees = np.array(config.base_pose.posture_deg)
    key = "base_pose.posture_deg"
    with naming(path, key):
        posture = robot.check_posture(np.deg2rad(degrees))
    fractions = np.count_nonzero(degrees % 1.0)
    if np.abs(degrees).max() <= MOST_RADIANS and fractions >= min(3, robot.n):
        raise FileFormatError(
            f"looks like radians (largest value {np.abs(degrees).max():g})",
            path=path,
            key=key,
            hint="give degrees",
        )
    try:
        robot.check_limits(posture)
    except JointLimitError as error:
        raise FileFormatError(
            f"the base pose is outside the limits: {error.message}",
            path=path,
            key=key,
            hint="choose a posture inside the limits",
            value=error.value,
        ) from error
    return posture


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
