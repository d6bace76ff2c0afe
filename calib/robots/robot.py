"""A serial robot: its joints, its limits, where its tip is, and how its joints get there.

With what loads and takes apart descriptions this is the only place that imports Pinocchio: the
model is built and checked there, and handed on as plain arrays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from calib.errors import InputError, JointLimitError, check_type, model_error
from calib.robots import model_chain as tree
from calib.robots.bounds import LIMIT_TOLERANCE, Bounds, CoupledLimit
from calib.robots.chain import ChainState, ExternalAxes, SerialChain
from calib.robots.controller import Controller, Coupling, controller_of, shown_of
from calib.robots.description.urdf import load_urdf
from calib.robots.geared_chain import GearedChain
from calib.robots.inverse import CLOSURE_TOLERANCE, InverseKinematics, InverseSolutions
from calib.robots.inverse.closed_form import ClosedForm
from calib.robots.inverse.few_axes import AXES_OF_A_POSE, nearest_postures
from calib.robots.inverse.offset_wrist import OffsetWrist
from calib.robots.inverse.on_external_axes import OnExternalAxes
from calib.robots.inverse.redundant import RedundantArm
from calib.robots.inverse.solutions import DampedIteration
from calib.robots.model_chain import HeldJoint, RobotDescription, frame_id, gravity_at, root_id
from calib.robots.presets import coupled_limits_of, describe_preset, preset_info
from calib.robots.shapes import Body
from calib.se3 import BoolArray, FloatArray, check_transforms, numbers, transform

LONGEST_M = 100.0
"""Reach of the longest arm: those of cranes and of space stations are below. In millimetres by
mistake, the smallest arm has more."""

_WORLD = "base"
"""Name that ROS-Industrial gives to the controller's world."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial arm between a base frame and a tip frame, and what moves it against the base.

    Its n joints are external axes (a positioner, then a rail, a gantry, a lift), then those of the
    arm, of which some may slide. Values of what slides are in metres wherever those of the others
    are in radians, and in millimetres where people read degrees.

    Make one with :meth:`from_urdf` or :meth:`preset`.
    """

    name: str
    chain: SerialChain
    """Kinematics from base to tip, as arrays."""
    joint_names: tuple[str, ...]
    """From the base to the tip; the joint's sign and zero are those of the URDF."""
    lower: FloatArray
    upper: FloatArray
    """lower, upper (n,): joint limits [rad, m]."""
    speed: FloatArray
    """(n,): largest joint speeds [rad/s, m/s]; NaN where the description gives none."""
    link_mass: FloatArray
    """(n,): mass of what each joint moves up to the next joint [kg]; zero where none is given."""
    link_com: FloatArray
    """(n, 3): centre of mass of each link, in the frame of its joint [m]."""
    gravity: FloatArray
    """(3,): acceleration of gravity [m/s²] in the base frame; behind a positioner, that of the link
    that stands on the floor (:attr:`floor`). The root of the description is level."""
    stiffness: FloatArray
    """(n,): torsional stiffness of each reducer [Nm/rad]; infinite where none is given."""
    base_frame: str
    tip_frame: str
    notices: tuple[str, ...] = ()
    """What was decided while reading the description, in words."""
    bodies: tuple[Body, ...] = ()
    """Solids of the arm; none where the description has none."""
    lost_shapes: tuple[tuple[int, str], ...] = ()
    """Number and name of the links whose description names a solid that cannot be had: a mesh that
    is not there, say."""
    fitted_links: tuple[str, ...] = ()
    """Links whose solids are estimated from the chain (:mod:`calib.robots.arm_shapes`)."""
    coupled_limits: tuple[CoupledLimit, ...] = ()
    """Limits that several joints have together."""
    allowed_contacts: tuple[tuple[str, str], ...] = ()
    """Names of bodies that may touch, by the semantic description."""
    controller: Controller | None = None
    """What the pendant shows; None where the maker is not known."""
    held: tuple[HeldJoint, ...] = ()
    """Joints of the description that base or tip hang on and that are held where they are."""
    T_floor_world: FloatArray = field(default_factory=lambda: np.eye(4))
    """(4, 4): the frame that a cell describes its surroundings in, in that of the link on the floor
    [m]: the base frame, or behind a positioner the root of the description."""
    outlying_m: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    """(n,): how far the frame of each joint was slid along its axis [m], because the description
    has it far outside the arm; empty where none was."""
    packages: tuple[str, ...] = ()
    """Names of the packages that the description and its meshes lie in."""
    following_among: tuple[str, ...] = ()
    """All joints from base to tip, where some follow others; empty where none does."""
    model: pin.Model = field(default=None, repr=False, compare=False)

    @classmethod
    def from_urdf(
        cls,
        path: Path | str,
        tip: str | None = None,
        base: str | None = None,
        *,
        lock: Iterable[str] = (),
        held_rad: Mapping[str, float] = MappingProxyType({}),
        held_m: Mapping[str, float] = MappingProxyType({}),
        state: Mapping[str, float] = MappingProxyType({}),
        packages: Iterable[Path] = (),
        xacro_args: Iterable[str] = (),
    ) -> Robot:
        """Read a robot from a URDF file, or from a xacro file.

        The arm may be a branch of a bigger tree. Joints that do not lie between base and tip are
        held, at zero where nothing else is said, and what they carry stands still with the base.
        Collision geometry is read, with the meshes that lie in the packages of the file
        (:mod:`calib.robots.description.packages`); visual geometry is not.

        Parameters
        ----------
        path : path
            The file; a xacro needs the package xacro (``posedesign[xacro]``).
        tip : str, optional
            Link that carries the tool: ``tool0``, ``flange``, else the link behind most joints.
        base : str, optional
            Link that positions are given in; the root of the tree by default. One on another
            branch than the tip is carried by a positioner: its joints come first.
        lock : names, optional
            Further joints to hold at zero: a rail between base and tip that stands still, say.
        held_rad, held_m : mappings of str to float, optional
            Joints that turn, and joints that slide, to hold at other values, wherever they are.
            Those that follow one of them (mimic) are where it brings them.
        state : mapping of str to float, optional
            Values [rad, m] for joints of either kind that do not lie between base and tip, as a
            named state of the whole tree has them.
        packages : paths, optional
            Folders to search for packages that the file names and that do not lie around it.
        xacro_args : names with values, optional
            Arguments of a xacro file as its command takes them, each ``NAME:=VALUE``; those not
            given have their defaults.

        Raises
        ------
        RobotModelError
            The file cannot be used (see :func:`calib.robots.description.urdf.load_urdf`), a frame
            or a joint to lock does not exist, or what moves between base and tip is not a row of
            joints with limits.
        """
        check_type(path, (str, PathLike), "path")
        check_type(tip, (str, type(None)), "tip")
        check_type(base, (str, type(None)), "base")
        return cls.from_model(
            load_urdf(Path(path), packages, xacro_args),
            tip,
            base,
            lock=lock,
            held_rad=held_rad,
            held_m=held_m,
            state=state,
        )

    @classmethod
    def preset(cls, name: str, tip: str | None = None, base: str | None = None) -> Robot:
        """Load one of the robots that come with the library (``calib.robots.preset_names()``).

        Raises RobotModelError: there is no preset of that name; the hint lists near names.
        """
        check_type(name, str, "name")
        info, described = preset_info(name), describe_preset(name)
        robot = cls.from_model(described, tip or info["tip"], base)
        if robot.n < described.model.njoints - 1:  # a part of the arm has no controller of its own
            return robot
        limited = replace(robot, coupled_limits=coupled_limits_of(info))
        return limited.controlled_by(info["controller"])

    @classmethod
    def from_model(
        cls,
        model: pin.Model | RobotDescription,
        tip: str | None = None,
        base: str | None = None,
        *,
        lock: Iterable[str] = (),
        held_rad: Mapping[str, float] = MappingProxyType({}),
        held_m: Mapping[str, float] = MappingProxyType({}),
        state: Mapping[str, float] = MappingProxyType({}),
    ) -> Robot:
        """Take the chain between two frames out of a Pinocchio model; other joints are locked."""
        described = model if isinstance(model, RobotDescription) else RobotDescription(model)
        model, said, own = described.model, list(described.notices), described.joint_notices
        to_lock = [lock] if isinstance(lock, str) else list(lock)
        asked = tree.joints_to_lock(model, [*to_lock, *held_rad, *held_m])
        base_id = frame_id(model, base) if base else root_id(model)
        tip_id = frame_id(model, tip) if tip else tree.usual_tip(model, said)
        path = tree.joints_between(model, base_id, tip_id, asked)
        followers = tree.followers_of(described, path)
        tree.check_joints(model, path, described.flaws, followers)
        tree.check_units(model, path)
        said[:0] = [own[name] for name in tree.names_of(model, path.joints) if name in own]
        locked = [i for i in range(1, model.njoints) if i not in path.joints]
        others = tree.links_of_other_branches(model, path.arm[0])
        state = {name: value for name, value in state.items() if name not in to_lock}
        at = tree.values_held(described, locked, held_rad, held_m, state)
        for why, as_asked in (("not between base and tip", False), ("as asked", True)):
            still = [i for i in locked if i not in at and (i in asked) == as_asked]
            if still:
                said.append(f"locked at zero, {why}: {', '.join(tree.names_of(model, still))}")
        if at:
            said.append(f"held: {tree.held_in_words(model, at)}")
        held = tree.held_on_path(model, base_id, tip_id, locked, at)
        if locked:
            frames = model.frames[base_id].name, model.frames[tip_id].name
            model = pin.buildReducedModel(model, locked, tree.configuration(model, at))
            base_id, tip_id = (frame_id(model, name) for name in frames)
            path = tree.joints_between(model, base_id, tip_id)
        joints = [i for i in path.joints if model.names[i] not in followers]
        names = tuple(tree.names_of(model, joints))
        chain = tree.chain_of(model, path, base_id, tip_id)
        lower, upper = tree.limits_of(model, path, followers)
        described_joints = tuple(tree.names_of(model, path.joints))
        if followers:
            chain = tree.geared(model, path, chain, followers)
            said += [f"{name} follows {led.leader}" for name, led in followers.items()]
        if chain.reach_m > LONGEST_M:
            end = model.frames[tip_id].name
            raise model_error(
                described.model.name,
                f"reaches {chain.reach_m:.0f} m from its second joint to {end}",
                "give lengths in metres: a URDF has no other unit",
                end,
                value=chain.reach_m,
                bound=LONGEST_M,
            )
        outlying_m = np.zeros(chain.n) if path.positioner else chain.outlying
        if outlying_m.any():
            model = tree.with_frames_at_arm(model, path, chain)
            chain = tree.chain_of(model, path, base_id, tip_id)
            far = ", ".join(
                f"{name} {abs(by):.3g} m" for name, by in zip(names, outlying_m, strict=True) if by
            )
            said.append(
                f"frames of joints that lie outside the arm are taken at the arm instead: {far} "
                "along the joint axis, which changes no pose"
            )
        columns = [model.joints[i].idx_v for i in joints]
        speed = np.array(model.velocityLimit)[columns]
        if not (speed > 0).all():
            slow = (n for n, s in zip(names, speed, strict=True) if not s > 0)
            said.append(f"no speed given for {', '.join(slow)}")
        # what a positioner moves is carried by no joint behind it
        inertias = [pin.Inertia.Zero() for _ in path.positioner]
        inertias += [model.inertias[i] for i in path.arm if model.names[i] not in followers]
        floor = tree.floor_of(model, path, base_id)
        following = [i for i in path.arm if model.names[i] in followers]
        if any(model.inertias[i].mass for i in path.arm) and following:
            inertias = [pin.Inertia.Zero() for _ in joints]
            said.append("masses of the links are left out: some of them follow others")
        path = tree.Path(path.positioner, [i for i in path.arm if i not in following])
        carried = {link for i in following for link in tree.links_moved_by(model, i)}
        return cls(
            name=model.name,
            chain=chain,
            joint_names=names,
            lower=lower,
            upper=upper,
            speed=np.where(speed > 0, speed, np.nan),
            link_mass=np.array([i.mass for i in inertias]),
            link_com=np.array([i.lever for i in inertias]),
            gravity=gravity_at(floor),
            stiffness=np.array([described.stiffness.get(n, np.inf) for n in names]),
            base_frame=model.frames[base_id].name,
            tip_frame=model.frames[tip_id].name,
            notices=tuple(said),
            bodies=tuple(
                tree.body_of(model, shape, path, base_id, others)
                for shape in described.shapes
                if shape.link not in carried
            ),
            lost_shapes=tuple(
                (0 if name in carried else tree.link_of(model, name, path, base_id)[0], name)
                for name in dict.fromkeys(
                    [
                        *described.lost_shapes,
                        *(s.link for s in described.shapes if s.link in carried),
                    ]
                )
            ),
            following_among=described_joints if followers else (),
            model=model,
            held=held,
            T_floor_world=floor.homogeneous if path.positioner else np.eye(4),
            outlying_m=outlying_m,
            packages=tuple(described.packages),
        )

    def controlled_by(self, maker: str, couplings: Sequence[Coupling] = ()) -> Robot:
        """The same robot with the controller of a maker (``calib.robots.POSITIVE_AXES``).

        Parameters
        ----------
        couplings : sequence of Coupling
            Joints that are shown with a part of another: of arms with a parallel linkage.

        Raises
        ------
        RobotModelError
            The maker is unknown, its arms have other axes or another zero posture, or there are
            no joints that couple so.
        """
        foot = self.link_names[self.n_external] if self.n_external else ""
        world, stands = self._at_zero(_WORLD), self._at_zero(foot)
        seen = controller_of(maker, self.chain, world, couplings, self.joint_names, stands)
        return replace(self, controller=seen)

    def _at_zero(self, link: str) -> FloatArray | None:
        """A link in the base frame ``(4, 4)`` with all joints at zero; None where there is none."""
        if not self.model.existFrame(link, pin.FrameType.BODY):
            return None
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, pin.neutral(self.model))
        base, there = (frame_id(self.model, name) for name in (self.base_frame, link))
        return np.asarray((data.oMf[base].inverse() * data.oMf[there]).homogeneous)

    def __getstate__(self) -> dict[str, object]:
        # the closed-form solver lives in C++ and cannot be sent to a worker, which makes its own
        return {key: value for key, value in self.__dict__.items() if key != "_inverse"}

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.chain.n

    @property
    def external(self) -> ExternalAxes:
        """What moves the whole arm against the base: the first joints."""
        return self.chain.external

    @property
    def n_external(self) -> int:
        """How many of the joints, the first ones, are external axes."""
        return self.chain.external.count

    @property
    def floor(self) -> int:
        """Number of the link that stands on the floor, with all that stands around: 0 is the base.

        Behind a positioner the base turns with what is measured, and this link does not.
        """
        return self.chain.external.positioner

    @cached_property
    def sliding(self) -> BoolArray:
        """Which joints slide, ``(n,)``."""
        return self.external.slides_of(self.n)

    @property
    def arm_joints(self) -> tuple[str, ...]:
        """Names of the joints of the arm itself."""
        return self.joint_names[self.n_external :]

    @property
    def chain_joints(self) -> tuple[str, ...]:
        """Names of all joints from base to tip: ``joint_names``, and those that follow them."""
        return self.following_among or self.joint_names

    @property
    def arm_turns(self) -> BoolArray:
        """Mask ``(n,)`` of the joints of the arm itself that turn."""
        turns = ~self.sliding
        turns[: self.n_external] = False
        return turns

    @property
    def turning_joints(self) -> tuple[str, ...]:
        """Names of the joints of the arm itself that turn."""
        return tuple(np.array(self.joint_names, dtype=object)[self.arm_turns])

    @cached_property
    def joint_labels(self) -> tuple[str, ...]:
        """Short names as controllers give them: E1 for external axes, J1 to J6 for the arm's."""
        return self.external.labels(self.n)

    @cached_property
    def joint_units(self) -> tuple[str, ...]:
        """Units that people read the joints' values in: mm or deg."""
        return tuple("mm" if slides else "deg" for slides in self.sliding)

    @cached_property
    def per_unit(self) -> FloatArray:
        """Millimetres in a metre, degrees in a radian, ``(n,)``."""
        return shown_of(self.n, self.external)

    def shown(self, q: ArrayLike) -> FloatArray:
        """Joint values ``(..., n)`` [rad, m] as people read them [deg, mm]."""
        return np.asarray(q, dtype=float) * self.per_unit

    def of_shown(self, values: ArrayLike) -> FloatArray:
        """Joint values ``(..., n)`` [rad, m] of what people read [deg, mm]."""
        return np.asarray(values, dtype=float) / self.per_unit

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """The link that the first joint hangs on, and the link that each joint moves."""
        return tree.link_names(self.model, self.joint_names, self.base_frame, self.floor)

    def T_base_floor(self, q: ArrayLike) -> FloatArray:
        """The link that stands on the floor in the base frame, ``(..., 4, 4)``, at postures [m]."""
        state = self.state(q)
        if not self.floor:
            return np.broadcast_to(np.eye(4), (*state.origins.shape[:-2], 4, 4))
        at = self.floor - 1
        return transform(state.rotations[..., at, :, :], state.origins[..., at, :])

    @property
    def T_base_root(self) -> FloatArray:
        """Root link of the description in the base frame, ``(4, 4)`` [m]; no joint is between."""
        base = self.model.frames[frame_id(self.model, self.base_frame)].placement
        root = self.model.frames[root_id(self.model)].placement
        return np.asarray((base.inverse() * root).homogeneous)

    @property
    def joint_origins(self) -> FloatArray:
        """Frames of the joints at zero ``(n, 4, 4)`` [m] where a description has them.

        In the link that each hangs on; in the base where no joint is between. Those of a chain, but
        for a positioner, whose joints it passes the other way round.
        """
        if isinstance(self.chain, GearedChain):
            return self.chain.all_placements
        if not self.floor:
            return self.chain.placements
        ids = [self.model.getJointId(name) for name in self.joint_names]
        return np.array([self.model.jointPlacements[i].homogeneous for i in ids])

    @property
    def joint_range(self) -> FloatArray:
        """Upper minus lower limit of each joint, ``(n,)`` [rad]."""
        return self.upper - self.lower

    def state(self, q: ArrayLike) -> ChainState:
        """Where joints and tip are at postures ``(..., n)`` [rad]."""
        return self.chain.forward(self.check_posture(q))

    def fk(self, q: ArrayLike) -> FloatArray:
        """Pose of the tip in the base frame, ``(..., 4, 4)``, at postures ``(..., n)`` [rad]."""
        return self.state(q).T_base_tip

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Jacobian of the tip ``(..., 6, n)`` at postures ``(..., n)`` [rad], in base axes.

        Rows 0 to 2: velocity of the tip's origin [m/rad, m/m]; rows 3 to 5: angular velocity.
        """
        state = self.state(q)
        return state.jacobian(state.p_base_tip)

    def inverse(
        self,
        T_base_tip: ArrayLike,
        near: ArrayLike | None = None,
        margin: float = 0.0,
        every_turn: bool = False,
    ) -> InverseSolutions:
        """Postures that bring the tip to poses ``(N, 4, 4)``: every branch of the arm.

        Each branch is given once, each joint in that full turn which lies inside the limits and
        nearest to ``near``. An arm of seven joints has infinitely many postures for a pose: every
        branch is given at steps of its redundant joint, and the postures nearest to ``near``. What
        external axes move is solved for at steps of them, and where ``near`` has them.
        Of arms that nothing else is known for (six axes that are neither parallel nor meet, eight
        and more) what iteration falls to is given, from ``near`` and from a dozen other starts.

        Parameters
        ----------
        T_base_tip : array_like (N, 4, 4)
        near : array_like (n,), optional
            Posture to stay near [rad]; the middle of the limits by default.
        margin : float
            Distance to keep from every limit [rad], the coupled ones included.
        every_turn : bool
            Give each branch in every combination of full turns inside the limits, not only in the
            nearest.

        Raises
        ------
        InputError
            The poses are no rigid transforms, ``near`` is not one posture, the margin is not a
            finite number, or ``every_turn`` would give millions of postures.
        """
        poses = check_transforms(T_base_tip, "T_base_tip").reshape(-1, 4, 4)
        middle = (self.lower + self.upper) / 2.0
        reference = middle if near is None else self._one_posture(near, "near")
        if not math.isfinite(margin):
            raise InputError(
                f"the margin to the limits is {margin}", hint="give it in radians", name="margin"
            )
        bounds = Bounds.within(self.lower, self.upper, self.coupled_limits, margin, self.external)
        return self._inverse.solve(poses, bounds, reference, every_turn)

    def nearest_poses(
        self,
        T_base_tip: FloatArray,
        p_tip: FloatArray,
        near: FloatArray,
        margin: float = 0.0,
        *,
        same_branch: bool = False,
    ) -> FloatArray:
        """Return poses ``(N, 4, 4)`` that the arm can take, next to those asked for.

        An arm of six joints and more is taken to turn its tip any way. One of fewer keeps a point
        of its tip and takes the orientation there that is nearest; poses that it cannot bring the
        point to are returned as they are.

        Parameters
        ----------
        T_base_tip : array (N, 4, 4)
        p_tip : array (3,) or (N, 3)
            The point in the tip frame [m].
        near : array (n,) or (N, n)
            Posture that is tried first [rad, m].
        margin : float
            Distance to keep from the limits of joints that turn [rad].
        same_branch : bool
            Try no other posture: poses then follow ``near``.
        """
        if self.n >= AXES_OF_A_POSE or not len(T_base_tip):
            return T_base_tip
        bounds = Bounds.within(self.lower, self.upper, (), margin, self.external)
        q, off = nearest_postures(
            self.chain,
            T_base_tip,
            np.broadcast_to(p_tip, (len(T_base_tip), 3)),
            np.broadcast_to(near, (len(T_base_tip), self.n)),
            np.minimum(bounds.lower, bounds.upper),
            np.maximum(bounds.lower, bounds.upper),
            **({"starts": 1} if same_branch else {}),
        )
        there = (off <= CLOSURE_TOLERANCE)[:, None, None]
        return np.where(there, self.fk(q), T_base_tip)

    @cached_property
    def _inverse(self) -> InverseKinematics | OnExternalAxes:
        """The solver that gives most of the postures of the chain."""
        arm = self.chain.arm
        turns = not (arm.external.any_slides or isinstance(arm, GearedChain))
        solver = (
            turns and (ClosedForm.of(arm) or OffsetWrist.of(arm) or RedundantArm.of(arm))
        ) or DampedIteration(arm)
        return OnExternalAxes(self.chain, solver) if self.n_external else solver

    def check_posture(self, q: ArrayLike) -> FloatArray:
        """Return q as a float array after checking that it has n finite values a posture."""
        posture = numbers(q, "the posture")
        found = posture.shape[-1] if posture.ndim else 0
        if found != self.n:
            raise InputError(
                f"{self.name} has {self.n} joints, the posture has {found} values",
                hint=f"give one value for each of {', '.join(self.joint_names)}",
                name="posture",
            )
        if not np.isfinite(posture).all():
            joint = self.joint_names[int(np.argwhere(~np.isfinite(posture))[0][-1])]
            raise InputError(f"the value of {joint} is not a finite number", name=joint)
        return posture

    def _one_posture(self, q: ArrayLike, name: str) -> FloatArray:
        posture = self.check_posture(q)
        if posture.ndim != 1:
            raise InputError(
                f"{name} has shape {posture.shape}, not ({self.n},): it is one posture", name=name
            )
        return posture

    def check_limits(self, q: ArrayLike) -> None:
        """Raise :class:`JointLimitError` for the first limit that posture ``(n,)`` breaks."""
        posture = self._one_posture(q, "posture")
        for j in range(self.n):
            beyond = max(self.lower[j] - posture[j], posture[j] - self.upper[j])
            if beyond > LIMIT_TOLERANCE:
                three = self.per_unit[j] * np.array([posture[j], self.lower[j], self.upper[j]])
                raise JointLimitError(
                    self.joint_names[j], *three.tolist(), unit=self.joint_units[j]
                )
        for limit in self.coupled_limits:
            if limit.margin(posture) < -LIMIT_TOLERANCE:
                value = float(posture @ limit.coefficients)
                raise JointLimitError(
                    limit.name, *np.rad2deg([value, limit.lower, limit.upper]).tolist()
                )


def with_placements(
    robot: Robot, placements: FloatArray, offsets: FloatArray | None = None
) -> Robot:
    """A robot whose joint frames sit elsewhere in the links before them.

    Limits, speeds, masses, solids and controller are kept: those of a link go with its joint.

    Parameters
    ----------
    placements : array (n, 4, 4)
        Frame of each joint at zero, in the frame of the link before it (the first: in the base)
        [m].
    offsets : array (n,), optional
        What joint values are off by in them [rad, m]: joints that follow others are off, too.
    """
    placed = check_transforms(placements, "placements")
    if placed.shape != (robot.n, 4, 4):
        raise InputError(
            f"{robot.name} has {robot.n} joints, the placements have shape {placed.shape}",
            name="placements",
        )
    if isinstance(robot.chain, GearedChain):
        moved = robot.chain.moved(placed, np.zeros(robot.n) if offsets is None else offsets)
        model, every = pin.Model(robot.model), moved.all_placements
        base = model.frames[frame_id(model, robot.base_frame)].placement
        for k, name in enumerate(robot.chain_joints):
            step = pin.SE3(every[k][:3, :3], every[k][:3, 3])
            model.jointPlacements[model.getJointId(name)] = step if k else base * step
        return replace(robot, chain=moved, model=model)
    up, before = robot.floor, robot.chain.placements
    if up and not np.allclose(placed[0], before[0], rtol=0.0, atol=1e-12):
        raise model_error(
            robot.name,
            f"{robot.joint_names[0]} would sit elsewhere in {robot.base_frame}, which it moves",
            "leave its frame as it is: where targets are on it says the same",
            robot.joint_names[0],
        )
    model, found = robot.model, robot
    if model is not None:
        model = pin.Model(model)
        steps = [pin.SE3(T[:3, :3], T[:3, 3]) for T in placed]
        ids = [model.getJointId(name) for name in robot.joint_names]
        if up:  # the arm stands where it stood, and the foot of the positioner elsewhere
            steps[up] = model.jointPlacements[ids[up]] * steps[up].inverse()
            for j in range(up):
                own = steps[j + 1]
                model.jointPlacements[ids[j]] = own if j + 1 == up else own.inverse()
            floor = model.jointPlacements[ids[up - 1]].inverse()
            found = replace(
                found,
                T_floor_world=floor.homogeneous,
                gravity=gravity_at(floor),
                bodies=tuple(
                    _moved_along(body, up, robot.model, model, ids) for body in found.bodies
                ),
            )
        else:
            base = model.frames[frame_id(model, robot.base_frame)].placement
            model.jointPlacements[ids[0]] = base * steps[0]
        for j in range(up + 1 if up else 1, robot.n):
            model.jointPlacements[ids[j]] = steps[j]
    chain = replace(robot.chain, placements=placed)
    return replace(found, chain=chain, model=model)


def _moved_along(body: Body, up: int, old: pin.Model, new: pin.Model, ids: Sequence[int]) -> Body:
    """A solid of a positioner, or of the floor, where it keeps its place in its own link."""
    if not 1 <= body.link <= up:
        return body
    joint = ids[body.link - 1]
    moved = new.jointPlacements[joint].inverse() * old.jointPlacements[joint]
    return replace(body, T_link_body=moved.homogeneous @ body.T_link_body)
