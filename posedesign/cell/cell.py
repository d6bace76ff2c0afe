"""The cell read and built: what its postures and motions must keep, ready to be planned for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, JointLimitError
from calib.geometry import Scene
from calib.model import CalibrationModel, Linearisation, Setup
from calib.model.measurements import BoardView, CameraPose, Measurement
from calib.model.parameters import TargetPoints, ZeroOffsets
from calib.robots import CoupledLimit, Robot
from calib.robots.arm_shapes import with_capsules, with_shapes_of
from calib.robots.controller import Coupling
from calib.robots.description.srdf import Srdf, allowed_contacts, load_srdf
from calib.robots.description.urdf import joint_links
from calib.robots.dh import PARALLEL_RAD
from calib.robots.geared_chain import GearedChain
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.cell.board_set_up import BoardSetUp, board_set_up
from posedesign.cell.data import CellData
from posedesign.cell.file import parse_text, read_config
from posedesign.cell.models import (
    WEIGH,
    board_view,
    camera_pose,
    free_tool_axes,
    hand_eye_model,
    has_weight,
    measuring_model,
    noise_of_kind,
    touching_model,
    true_set_up,
    truth_of,
)
from posedesign.cell.observations import (
    Observation,
    mark_named,
    mark_sight,
    observations_of,
    place_of,
    setup_of,
    touched_by_tool,
    which_observations,
)
from posedesign.cell.schema import BasePoseSection, CellConfig, RobotSection
from posedesign.cell.surroundings import (
    Whereabouts,
    build_checker,
    build_collisions,
    build_retreat,
    build_scene,
    check_board,
    check_cell,
    check_observations,
    in_base,
    meeting_pairs,
    naming,
    nearest_body,
    obstacles,
    tool_bodies,
    what_is_not_checked,
    what_is_odd,
    what_may_be_wrong,
)
from posedesign.constraints import Checker, Collision, MotionChecker, Retreat
from posedesign.constraints.mark_sight import MarkSight
from posedesign.files.measurements import TOOL

SAME_LINE_M = 0.01
"""Joints whose axes are parallel and nearer to each other turn about one line: the zero of one
would be told by ten micrometres for a milliradian."""

_MOST_METRES = 5.0
"""A slide that stands at fewer millimetres than this, with a fraction, was written in metres."""

MOST_RADIANS = np.pi
"""A base posture whose values all lie within this, most of them with a fraction, was written in
radians: no arm stands within three degrees of its zero to measure."""


@dataclass(frozen=True, eq=False)
class Cell(CellData):
    """A cell with what its postures and motions must keep: what the planner works on."""

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
        source, srdf = config.robot, None
        state: dict[str, float] = {}
        base, tip = source.base, source.tip
        if source.srdf is not None:
            with naming(path, "robot.srdf"):
                srdf = load_srdf(
                    path.parent / source.srdf, [path.parent / name for name in source.packages]
                )
                if source.group is not None:
                    joints = (
                        joint_links(
                            path.parent / source.urdf,
                            [path.parent / folder for folder in source.packages],
                            source.xacro_args,
                        )
                        if source.urdf is not None and source.group in srdf.listed
                        else {}
                    )
                    chain = srdf.chain(source.group, joints)
                    base, tip = base or chain[0], tip or chain[1]
                for name in source.held_states:
                    state |= srdf.state(name)
        with naming(path, "robot"):
            if source.preset is not None:
                robot = Robot.preset(source.preset, tip=tip, base=base)
            else:
                urdf = path.parent / str(source.urdf)
                robot = Robot.from_urdf(
                    urdf,
                    tip=tip,
                    base=base,
                    lock=source.lock,
                    held_rad={name: np.deg2rad(v) for name, v in source.held_deg.items()},
                    held_m={name: v / 1e3 for name, v in source.held_mm.items()},
                    state=state,
                    packages=[path.parent / folder for folder in source.packages],
                    xacro_args=source.xacro_args,
                )
        robot = _with_shapes(robot, source, path)
        if srdf is not None:
            robot = replace(robot, allowed_contacts=allowed_contacts(robot.bodies, srdf))
        config = _with_posture_of_state(config, robot, srdf, path)
        robot = _with_controller(robot, source, path)
        robot = _with_coupled_limits(robot, source, path)
        robot = _with_slide_margin(robot, config.plan.slide_margin_mm, path)
        posture = _base_posture(config, robot, path)
        tool = np.array(config.tool.point_mm) / 1e3
        given = config.target.position_mm if touched_by_tool(config) else None
        target = robot.state(posture).point(tool) if given is None else np.array(given) / 1e3
        listed = config.parameters.zero_offsets
        with naming(path, "tool.body"):
            carried = tool_bodies(config.tool.body, robot, path.parent)
        with naming(path, "obstacle"):
            around = obstacles(config.obstacle, robot, path.parent)
        cell = cls(
            config=config,
            robot=robot,
            base_posture=posture,
            tool_m=tool,
            target_m=target,
            offset_joints=usual_offset_joints(robot) if listed is None else listed,
            tool_bodies=tuple(carried),
            obstacles=tuple(around),
        )
        with naming(path, "parameters.zero_offsets"):
            ZeroOffsets(robot, cell.offset_joints)
        _check_planned(cell, path)
        if config.measurement.kind == "view-line" and "z" in cell.tool_axes:
            raise FileFormatError(
                "a view line does not show where the tool point is along z",
                path=path,
                key="parameters.tool_axes",
                hint='set it to "xy"',
            )
        check_observations(cell, path)
        with naming(path, "board"):
            cell.board  # noqa: B018  what cannot be is said now
        check_board(cell, path)
        check_cell(cell, lambda: cell.scene, path)
        return cell

    @cached_property
    def board_set_up(self) -> BoardSetUp:
        """Camera and board, where pictures of a board are measured.

        Raises
        ------
        InputError
            One of them is not described, or cannot be.
        """
        return board_set_up(self)

    @property
    def measurement(self) -> Measurement:
        """The measurement with its noise; of several kinds the first."""
        if self.sees_board:
            return board_view(self, self.board_set_up)
        if self.is_hand_eye:
            return camera_pose(self.config)
        return noise_of_kind(self, self.observations[0].kind)

    @cached_property
    def observations(self) -> tuple[Observation, ...]:
        """All that a pose can be of: one, but for several targets, pins or payloads."""
        return observations_of(self.config)

    @property
    def is_plain(self) -> bool:
        """Whether one target is touched by the tool point, with the load of the tool alone."""
        if self.is_hand_eye:
            return False
        first, *others = self.observations
        return not others and first.tools == (TOOL,) and not first.reads

    @cached_property
    def sights(self) -> tuple[MarkSight | None, ...]:
        """What of each observation an instrument has to see; None where the tool touches."""
        return tuple(mark_sight(self, seen, self.scene) for seen in self.observations)

    @cached_property
    def parts(self) -> tuple[Cell, ...]:
        """The cell as each of its observations has it: with one target, and one point to touch."""
        if self.is_hand_eye:
            return (self,)
        first, *others = self.observations
        if not others and (first.reads or first.tools == (TOOL,)):
            return (self,)
        return tuple(self._part(seen) for seen in self.observations)

    def _part(self, seen: Observation) -> Cell:
        config = self.config
        target = next(t for t in config.targets if t.name == seen.target)
        measurement = config.measurement.model_copy(update={"kind": seen.kind, "payloads": ()})
        alone = {"target": target, "other_targets": (), "measurement": measurement}
        tool_m = self.tool_m
        if not seen.reads:
            alone["tool"] = config.tool.model_copy(update={"mark": ()})
            tool_m = mark_named(self, seen.tools[0]).point_m
        return replace(
            self,
            config=config.model_copy(update=alone),
            tool_m=tool_m,
            target_m=self.target_m if seen.reads else place_of(self, target),
        )

    def one_by_one(
        self, model: CalibrationModel, postures: FloatArray, which: IntArray
    ) -> tuple[IntArray, Setup]:
        """Measurements at postures ``(N, n)`` [rad], each by itself: the row of its posture.

        One for each tool that is seen, as in a table of measurements.
        """
        setup = self.setup(model, postures, which)
        rows = np.repeat(np.arange(len(postures)), setup.together)
        if setup.seen is None:
            return rows, setup
        seen = setup.seen[:, 0]
        return rows[seen], replace(setup[seen], seen=None)

    def which(self, labels: Sequence[Mapping[str, str]]) -> IntArray:
        """Index ``(N,)`` of the observation that each pose is of, by its labels in a list."""
        if self.is_hand_eye:
            return np.zeros(len(labels), dtype=np.intp)
        return which_observations(self.observations, labels)

    def checkers(self, which: IntArray) -> list[tuple[Checker, IntArray]]:
        """What poses of observations ``(N,)`` must keep, and which of them."""
        if self.is_hand_eye or len(self.observations) == 1:
            return [(self.checker, np.arange(len(which)))]
        rows = ((part, np.flatnonzero(which == k)) for k, part in enumerate(self.parts))
        return [(part.checker, own) for part, own in rows if len(own)]

    def model_for(self, which: IntArray) -> CalibrationModel:
        """:meth:`model` of poses of these observations ``(N,)``: without targets of others."""
        if self.is_hand_eye or len(self.observations) == 1:
            return self.model()
        return measuring_model(self, self.observations_among(which))

    def observations_among(self, which: IntArray) -> list[Observation]:
        """The observations that poses ``(N,)`` are of, in the order of the cell."""
        return [self.observations[k] for k in np.unique(which)]

    def rows(self, model: CalibrationModel) -> int:
        """Rows of the block of a pose in a model of the cell: of all that is measured there."""
        if self.is_hand_eye:
            return model.rows
        return model.rows * max(len(seen.tools) for seen in self.observations)

    def linearise(
        self, model: CalibrationModel, postures: FloatArray, which: IntArray | None = None
    ) -> Linearisation:
        """What a model of the cell makes of postures ``(N, n)`` [rad] at its nominal parameters.

        ``which`` (N,): the observation of each; the first by default.
        """
        return model.linearise(postures, setup=self.setup(model, postures, which))

    def setup(
        self, model: CalibrationModel, postures: FloatArray, which: IntArray | None = None
    ) -> Setup:
        """What is measured at postures ``(N, n)`` [rad], as a model of the cell takes it.

        ``which`` (N,): the observation of each; the first by default. Hand-eye cells have one.
        """
        if self.is_hand_eye:
            return Setup.of(len(postures))
        index = np.zeros(len(postures), dtype=np.intp) if which is None else which
        return setup_of(self, model, self.observations, index, self.sights, postures)

    @property
    def tool_axes(self) -> str:
        """Axes along which the tool point is identified by the cell's own measurement."""
        given = self.config.parameters.tool_axes
        return free_tool_axes(self, self.measurement) if given is None else given

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
            it shows, see :func:`free_tool_axes`.
        targets : TargetPoints, optional
            Other targets than the cell's one.
        """
        measured = self.measurement if measurement is None else measurement
        if isinstance(measured, CameraPose | BoardView):
            set_up = self.board_set_up if isinstance(measured, BoardView) else None
            return hand_eye_model(self, measured, set_up, offsets or ())
        if measurement is None and offsets is None and targets is None:
            return measuring_model(self, self.observations)
        axes = self.tool_axes if measurement is None else free_tool_axes(self, measurement)
        freed = self.offset_joints if offsets is None else offsets
        return touching_model(self, measured, axes, freed, targets)

    def truth(self, measurement: Measurement | None = None) -> tuple[CalibrationModel, FloatArray]:
        """Model of the simulated robot, all joints with offsets and deflection, and its values."""
        if self.is_hand_eye or measurement is not None:
            touched = Observation("touch-up", (TOOL,), self.config.target.name)
            blocks, placed, _ = true_set_up(self, [touched])
            return truth_of(self, blocks, placed, [measurement or self.measurement])
        return truth_of(self, *true_set_up(self, self.observations))

    @cached_property
    def scene(self) -> Scene:
        """Arm, tool and obstacles, with the pairs that measuring poses are checked for."""
        return build_scene(self, self.config.constraints.ignore)

    @cached_property
    def checker(self) -> Checker:
        """All constraints that a measuring posture must keep."""
        seen = None if self.is_hand_eye else self.sights[0]
        return build_checker(self, self.scene, self.solid, self.retreat, seen)

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
        return build_retreat(self, self.passing, self.solid, self.ways.largest_travel)

    @cached_property
    def ways(self) -> MotionChecker:
        """What the ways between postures must keep."""
        section = self.config.constraints
        travel = section.largest_travel_deg
        return MotionChecker(
            self.solid_passing if section.ways else (),
            np.inf if travel is None else float(np.deg2rad(travel)),
            self.robot.external,
        )

    @cached_property
    def whereabouts(self) -> Whereabouts:
        """Where target and tool point are, for people to see before anything is planned."""
        return Whereabouts(
            self.robot.base_frame,
            self.config.target.name,
            target_m := self.target_m if self.is_hand_eye else place_of(self, self.config.target),
            self.robot.state(self.base_posture).point(self.tool_m),
            nearest_body(
                self.robot, in_base(self.robot, self.obstacles, self.base_posture), target_m
            ),
            tuple((other.name, place_of(self, other)) for other in self.config.other_targets),
        )

    @property
    def notices(self) -> list[str]:
        """What was decided while reading the robot, and what is odd about the cell, in words."""
        return [*self.doubts, *self.remarks]

    @property
    def doubts(self) -> list[str]:
        """What looks like a mistake, in words."""
        return what_may_be_wrong(self)

    @property
    def remarks(self) -> list[str]:
        """What was decided while reading the robot, and what else is to be known, in words."""
        return [*self.robot.notices, *what_is_odd(self)]

    @property
    def not_checked(self) -> tuple[str, ...]:
        """What planning and checking do not look at, in words."""
        return what_is_not_checked(self, self.scene.excluded)


def _with_shapes(robot: Robot, section: RobotSection, path: Path) -> Robot:
    """The robot with what its cell says of links that the description gives no shape."""
    if section.shapes is not None:
        with naming(path, "robot.shapes"):
            robot = with_shapes_of(robot, section.shapes)
    if section.capsule_radius_mm is not None:
        with naming(path, "robot.capsule_radius_mm"):
            robot = with_capsules(robot, np.atleast_1d(section.capsule_radius_mm) / 1e3)
    return robot


def _with_controller(robot: Robot, section: RobotSection, path: Path) -> Robot:
    maker = section.controller
    if maker is None and section.coupling:
        if robot.controller is None:
            raise FileFormatError(
                "a coupling is what a controller shows, and the controller is not known",
                path=path,
                key="robot.coupling",
                hint="set robot.controller",
            )
        maker = robot.controller.maker
    if maker is None:
        return robot
    couplings = [Coupling(given.joint, given.of, given.ratio) for given in section.coupling]
    with naming(path, "robot.coupling" if couplings else "robot.controller"):
        return robot.controlled_by(maker, couplings)


def _with_coupled_limits(robot: Robot, section: RobotSection, path: Path) -> Robot:
    limits = [*robot.coupled_limits] if section.keep_coupled_limits else []
    for given in section.coupled_limit:
        if len(given.coefficients) != len(robot.arm_joints):
            raise FileFormatError(
                f"{given.name}: {len(given.coefficients)} coefficients for "
                f"{len(robot.arm_joints)} joints of the arm",
                path=path,
                key="robot.coupled_limit",
                hint="give one for each joint, 0 for those that have no part in it",
            )
        lower, upper = np.deg2rad([given.lower_deg, given.upper_deg]).tolist()
        coefficients = np.concatenate([np.zeros(robot.n_external), given.coefficients])
        limits.append(CoupledLimit(given.name, coefficients, lower, upper))
    return replace(robot, coupled_limits=tuple(limits))


def _with_posture_of_state(
    config: CellConfig, robot: Robot, srdf: Srdf | None, path: Path
) -> CellConfig:
    """The same with the posture of the base pose written out, where it names a group state."""
    name = config.base_pose.state
    if name is None:
        return config
    key = "base_pose.state"
    if srdf is None:
        raise FileFormatError(
            f"{name!r} is the name of a group state, and the cell has no SRDF",
            path=path,
            key=key,
            hint="give robot.srdf, or posture_deg",
        )
    with naming(path, key):
        values = srdf.state(name, config.robot.group)
    missing = [joint for joint in robot.joint_names if joint not in values]
    if missing:
        raise FileFormatError(
            f"the state {name!r} has no value of {', '.join(missing)}",
            path=path,
            key=key,
            hint="name a state of all joints of the arm, or give posture_deg",
        )
    pose = posture_section(robot, np.array([values[joint] for joint in robot.joint_names]))
    return config.model_copy(update={"base_pose": pose})


def _with_slide_margin(robot: Robot, margin_mm: float, path: Path) -> Robot:
    """The robot with the ends of its slides left out, as far as plans keep away from them."""
    if not robot.sliding.any():
        return robot
    kept = np.where(robot.sliding, margin_mm / 1e3, 0.0)
    narrow = np.flatnonzero(robot.joint_range <= 4.0 * kept)
    if narrow.size and margin_mm:
        raise FileFormatError(
            f"{margin_mm:g} mm leaves little of the range of {robot.joint_names[narrow[0]]}",
            path=path,
            key="plan.slide_margin_mm",
            hint="give less, or hold it where it is: robot.held_mm",
        )
    return replace(robot, lower=robot.lower + kept, upper=robot.upper - kept)


def _check_planned(cell: Cell, path: Path) -> None:
    """Refuse to plan for what gives way under gravity on an arm that weighs nothing.

    Payloads that are measured with and without tell it, too.
    """
    words = [word for word in cell.config.parameters.planned or () if word in WEIGH]
    if words and not has_weight(cell) and not cell.config.payload:
        raise FileFormatError(
            f"plans for {', '.join(words)} need the masses of the links, and the description of "
            f"{cell.robot.name} has none",
            path=path,
            key="parameters.planned",
            hint=f"leave {', '.join(words)} out, take a URDF with <inertial> of every link, or "
            "measure with a [[payload]] and without",
            value=words[0],
        )


def usual_offset_joints(robot: Robot) -> tuple[str, ...]:
    """Joints whose zero offset is identified where nothing is listed.

    Target and tool point take up those of the first and the last joint (section 3.2 of
    Watanabe et al. 2006); not of the first one of an arm that slides across its axis, for a rail
    has a direction, nor of one beside a positioner, which stands somewhere. Slides that carry the
    arm have no zero that matters.
    """
    carrying = robot.joint_names[robot.external.sliding]
    taken_up = {*moved_as_base(robot), *moved_as_tool(robot), *carrying}
    return tuple(name for name in robot.joint_names if name not in taken_up)


def moved_as_base(robot: Robot) -> tuple[str, ...]:
    """Joints whose zero offsets move the arm as a base does that stands elsewhere.

    Those whose axes stand still in the base, whatever the joints before them do: slides on slides,
    the joint of a positioner that turns the base, and the first joint of the arm, unless something
    slides across its axis or turns about another one.
    """
    if isinstance(robot.chain, GearedChain):
        return _constant(robot, of_tip=False)
    stands = _stands(robot)
    return tuple(name for j, name in enumerate(robot.joint_names) if stands[:j, j].all())


def moved_as_tool(robot: Robot) -> tuple[str, ...]:
    """Joints whose zero offsets move the tool point as another one would be placed on the tip.

    The same seen from the tip: the last joint, and those that slide along its axis, or turn about
    the line that it slides along.
    """
    if isinstance(robot.chain, GearedChain):
        return _constant(robot, of_tip=True)
    stands = _stands(robot)
    return tuple(name for j, name in enumerate(robot.joint_names) if stands[j + 1 :, j].all())


_CONSTANT = 1e-6
"""Change of a twist over postures that is rounding [m, rad per unit]."""


def _constant(robot: Robot, *, of_tip: bool) -> tuple[str, ...]:
    """Return joints that move base or tip by the same twist at all postures.

    Of arms with joints that follow others, whose own axes do not tell how they move the tip.
    """
    share = np.random.default_rng(0).random((8, robot.n))
    state = robot.state(robot.lower + share * robot.joint_range)
    J = state.jacobian(state.p_base_tip if of_tip else np.zeros((8, 3)))
    if of_tip:
        back = np.swapaxes(state.R_base_tip, -1, -2)
        J = np.concatenate([back @ J[:, :3], back @ J[:, 3:]], axis=1)
    off = np.abs(J - J[0]).max(axis=(0, 1))
    return tuple(name for name, by in zip(robot.joint_names, off, strict=True) if by < _CONSTANT)


def _stands(robot: Robot) -> BoolArray:
    """Return of each joint (row) if it leaves the motion of another one (column) as it is."""
    at_zero, slides = robot.chain.forward(np.zeros(robot.n)), robot.sliding

    def stands(moved_by: int, axis: int) -> bool:
        one, two = at_zero.axes[moved_by], at_zero.axes[axis]
        across = np.linalg.norm(np.cross(one, two)) > np.sin(PARALLEL_RAD)
        if slides[moved_by]:
            return bool(slides[axis] or not across)
        apart = at_zero.origins[axis] - at_zero.origins[moved_by]
        aside = not slides[axis] and np.linalg.norm(np.cross(apart, one)) > SAME_LINE_M
        return not (across or aside)

    n = range(robot.n)
    return np.array([[stands(j, k) for k in n] for j in n], dtype=bool)


def posture_section(robot: Robot, q: FloatArray) -> BasePoseSection:
    """The section of a cell that has a posture ``(n,)`` [rad, m] for its base pose."""
    shown = robot.shown(q)
    return BasePoseSection(
        positioner_deg=shown[: robot.floor][::-1].tolist(),
        slides_mm=shown[robot.sliding].tolist(),
        posture_deg=shown[robot.arm_turns].tolist(),
    )


def posture_of_section(robot: Robot, section: BasePoseSection) -> FloatArray:
    """Posture ``(n,)`` [rad, m] of the base pose."""
    table, arm = np.deg2rad(section.positioner_deg[::-1]), np.deg2rad(section.posture_deg)
    slides = np.array(section.slides_mm) / 1e3
    if len(arm) != np.count_nonzero(robot.arm_turns):
        return np.concatenate([table, slides, arm])  # of no use, and told so where it is checked
    q = np.empty(robot.n)
    q[: robot.floor], q[robot.sliding], q[robot.arm_turns] = table, slides, arm
    return q


def _base_posture(config: CellConfig, robot: Robot, path: Path) -> FloatArray:
    degrees = np.array(config.base_pose.posture_deg)
    key = "base_pose.posture_deg"
    slides = np.array(config.base_pose.slides_mm)
    if len(slides) and np.abs(slides).max() < _MOST_METRES and (slides % 1.0).any():
        raise FileFormatError(
            f"looks like metres (largest value {np.abs(slides).max():g})",
            path=path,
            key="base_pose.slides_mm",
            hint="give millimetres, and whole ones where it really stands so near its zero",
        )
    table = np.array(config.base_pose.positioner_deg)
    finer = np.abs(table - table.round(1)) > 1e-3  # than people set a table to
    if finer.any() and np.abs(table).max() <= MOST_RADIANS:
        raise FileFormatError(
            f"looks like radians (largest value {np.abs(table).max():g})",
            path=path,
            key="base_pose.positioner_deg",
            hint="give degrees, and whole tenths where it really stands so near its zero",
        )
    turning = robot.joint_names[: robot.floor]
    slide = [n for n, slides_ in zip(robot.joint_names, robot.sliding, strict=True) if slides_]
    for what, values, joints in (
        ("slides", slides, slide),
        ("positioner", config.base_pose.positioner_deg, turning[::-1]),
    ):
        if len(values) != len(joints):
            raise FileFormatError(
                f"{len(values)} values for the {what} of {robot.name}: "
                + (", ".join(joints) or "none"),
                path=path,
                key=f"base_pose.{what}_{'mm' if what == 'slides' else 'deg'}",
                hint="give one for each of these joints, where it stands at the base pose"
                if joints
                else "leave it out",
            )
    with naming(path, key):
        posture = robot.check_posture(posture_of_section(robot, config.base_pose))
    fractions = np.count_nonzero(degrees % 1.0)
    if np.abs(degrees).max(initial=0.0) <= MOST_RADIANS and fractions >= min(3, robot.n):
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
