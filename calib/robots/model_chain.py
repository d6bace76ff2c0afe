"""The chain between two frames of a Pinocchio model, taken out and checked."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from calib.errors import RobotModelError, model_error, near_names
from calib.robots.chain import ExternalAxes, SerialChain
from calib.robots.geared_chain import GearedChain
from calib.robots.shapes import Body, LinkShape
from calib.se3 import FloatArray, transform

STANDARD_GRAVITY = 9.80665
"""[m/s²]"""

USUAL_TIPS = ("tool0", "flange")
"""Names that ROS-Industrial and the makers give to the mounting face, the better one first."""

MOST_OF_POSITIONER = 3
"""Joints that carry the base: each multiplies the stations that poses are solved for at."""

MOST_TURNS = 4.0
"""Turns to either side of zero that no limit of an arm goes beyond: industrial arms have at most
some two. Limits beyond it are degrees: +-90 in radians are 14 turns."""

MOST_JOINTS = 100
"""Snakes have some thirty; Pinocchio's memory grows with the third power (2 GB at 300)."""


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """What is known of a robot, or of a whole cell of them, before a chain is taken out of it."""

    model: pin.Model
    """Kinematics and masses, without geometry. Continuous joints are revolute ones of +-360 deg."""
    shapes: Sequence[LinkShape] = ()  # collision geometry
    lost_shapes: Sequence[str] = ()
    """Links with collision geometry that cannot be had; ``notices`` say why."""
    notices: Sequence[str] = ()  # what was read otherwise than it stands in the file
    joint_notices: Mapping[str, str] = field(default_factory=dict)
    """The same of single joints, which matters where the joint moves."""
    flaws: Mapping[str, RobotModelError] = field(default_factory=dict)
    """Joints that can be held still but not moved, and why: no limits, or led by another joint."""
    led: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    """Joints that follow another: its name, the factor and the offset [rad, m]."""
    stiffness: Mapping[str, float] = field(default_factory=dict)  # of reducers, by joint [Nm/rad]
    packages: Sequence[str] = ()
    """Names of the package that it lies in, and of those that its meshes lie in."""


def frame_id(model: pin.Model, name: str) -> int:
    """Index of a link's frame; RobotModelError with near names where there is none."""
    # getFrameId returns nframes in silence for a name that does not exist
    if not model.existFrame(name, pin.FrameType.BODY):
        known = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise model_error(model.name, f"there is no link {name!r}", near_names(name, known), name)
    return int(model.getFrameId(name, pin.FrameType.BODY))


def root_id(model: pin.Model) -> int:
    """Index of the root link's frame; RobotModelError for a model that has none."""
    for i, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.BODY and frame.parentJoint == 0:
            return i
    raise model_error(
        model.name,
        "has no link that its first joint hangs on",
        "add a frame of type BODY on joint 0, or name a base",
    )


def usual_tip(model: pin.Model, notices: list[str]) -> int:
    """The mounting face by its usual names, else the link behind most joints, with a notice."""
    for name in USUAL_TIPS:
        if model.existFrame(name, pin.FrameType.BODY):
            return frame_id(model, name)
    bodies = [i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY]

    def depth(i: int) -> tuple[int, float]:  # a flange is farther out than a link's own frame
        frame = model.frames[i]
        return len(model.supports[frame.parentJoint]), float(
            np.linalg.norm(frame.placement.translation)
        )

    deepest = max(bodies, key=depth)
    notices.append(
        f"tip taken to be {model.frames[deepest].name}, the last link of the longest chain"
    )
    return deepest


def floor_of(model: pin.Model, path: Path, base_id: int) -> pin.SE3:
    """Root of a description in the link that stands on the floor: in the base, or behind it."""
    if path.positioner:
        return model.jointPlacements[path.positioner[-1]].inverse()
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    return data.oMf[base_id].inverse()


def gravity_at(floor: pin.SE3) -> FloatArray:
    """Gravity (3,) [m/s²] in a link that the root, which is level, is at a place in."""
    return np.asarray(floor.rotation @ [0.0, 0.0, -STANDARD_GRAVITY])


def names_of(model: pin.Model, joints: Sequence[int]) -> list[str]:
    """Names of joints."""
    return [model.names[i] for i in joints]


def joints_to_lock(model: pin.Model, lock: Iterable[str]) -> list[int]:
    """Indices of the moving joints among the names; a fixed joint is locked already."""
    moving = list(model.names)[1:]
    found = []
    for name in lock:
        if name in moving:
            found.append(int(model.getJointId(name)))
        elif not model.existFrame(name, pin.FrameType.FIXED_JOINT):
            raise model_error(
                model.name, f"there is no joint {name!r} to lock", near_names(name, moving), name
            )
    return sorted(set(found))


def _joint_error(
    model: pin.Model, name: str, what: str, hint: str, **found: object
) -> RobotModelError:
    return model_error(model.name, f"joint {name} {what}", hint, name, **found)


def values_held(
    described: RobotDescription,
    locked: Sequence[int],
    held_rad: Mapping[str, float],
    held_m: Mapping[str, float],
    state: Mapping[str, float],
) -> dict[int, float]:
    """Values other than zero [rad, m] of locked joints: as asked, or as their leader has it.

    As asked of joints that turn and of joints that slide; in a ``state``, of joints of either kind,
    where nothing else is asked.
    """
    model = described.model
    for name in (*held_rad, *held_m):
        if not model.existJointName(name):  # one that is fixed passes where joints are locked
            raise _joint_error(
                model, name, "is fixed, and has no value to be held at", "leave it out"
            )
    held = {**state, **held_rad, **held_m}
    values = {name: float(held.get(name, 0.0)) for name in names_of(model, locked)}
    for name, (leader, factor, offset) in described.led.items():
        if name in values and name not in held and leader in values:
            values[name] = factor * values[leader] + offset
    found = {}
    for name, value in values.items():
        i = int(model.getJointId(name))
        joint = model.joints[i]
        if name in held and (joint.nq, joint.nv) != (1, 1):
            raise _joint_error(
                model,
                name,
                "has no one value to be held at",
                "only revolute and prismatic joints have",
            )
        unit, scale = _unit(model, i)
        if name in (held_rad if unit == "mm" else held_m):
            raise _joint_error(
                model, name, f"{'slides' if unit == 'mm' else 'turns'}", f"give its value in {unit}"
            )
        lower, upper = _limits(model, i)
        limited = name in held and name not in described.flaws
        if not math.isfinite(value) or (limited and not lower - 1e-9 <= value <= upper + 1e-9):
            limits = f"{scale * lower:g} and {scale * upper:g}"
            what = f"is to be held at {scale * value:g} {unit}, and its limits are {limits}"
            raise _joint_error(model, name, what, "hold it inside its limits", value=value)
        if value:
            found[i] = value
    return found


def held_in_words(model: pin.Model, values: Mapping[int, float]) -> str:
    """Each joint with the value that it is held at [rad, m], in degrees or mm."""
    told = ((model.names[i], value, *_unit(model, i)) for i, value in values.items())
    return ", ".join(f"{name} at {scale * value:.6g} {unit}" for name, value, unit, scale in told)


class HeldJoint(NamedTuple):
    """A joint that base or tip hang on, and that is held where it is."""

    name: str
    value: float  # [rad, m]
    slides: bool

    @property
    def per_si(self) -> float:
        """Degrees in a radian, or millimetres in a metre."""
        return 1e3 if self.slides else math.degrees(1.0)


def held_on_path(
    model: pin.Model, base_id: int, tip_id: int, locked: Sequence[int], at: Mapping[int, float]
) -> tuple[HeldJoint, ...]:
    """Held joints that base or tip hang on. ``at``: values other than zero [rad, m]."""
    ends = (model.frames[i].parentJoint for i in (base_id, tip_id))
    carrying = {i for end in ends for i in model.supports[end]}
    return tuple(
        HeldJoint(str(model.names[i]), at.get(i, 0.0), is_slide(model, i))
        for i in locked
        if i in carrying and model.joints[i].nv == 1
    )


def configuration(model: pin.Model, values: Mapping[int, float]) -> FloatArray:
    """A configuration of a whole model: joints at values [rad, m], all others at zero."""
    q = np.array(pin.neutral(model))
    for i, value in values.items():
        q[model.joints[i].idx_q] = value
    return q


def _limits(model: pin.Model, joint: int) -> tuple[float, float]:
    place = model.joints[joint].idx_q  # a floating joint before it has seven values for six speeds
    return float(model.lowerPositionLimit[place]), float(model.upperPositionLimit[place])


def is_slide(model: pin.Model, joint: int) -> bool:
    """Whether a joint slides along one line; a planar one does not."""
    kind = model.joints[joint]
    return bool(kind.shortname().startswith("JointModelP") and kind.nv == 1)


def _unit(model: pin.Model, joint: int) -> tuple[str, float]:
    """Unit that people give a joint's value in, and the factor from [rad, m]."""
    return ("mm", 1e3) if is_slide(model, joint) else ("deg", math.degrees(1.0))


class Path(NamedTuple):
    """Joints between two links of a tree, without those that are locked."""

    positioner: list[int]
    """From the base to where its branch meets that of the tip: those of what carries the base."""
    arm: list[int]  # from there to the tip

    @property
    def joints(self) -> list[int]:
        """All of them, from the base to the tip."""
        return [*self.positioner, *self.arm]


def joints_between(model: pin.Model, base_id: int, tip_id: int, locked: Sequence[int] = ()) -> Path:
    """Joints from the base to the tip, without those that are locked."""
    base, tip = model.frames[base_id], model.frames[tip_id]
    to_base, to_tip = (list(model.supports[frame.parentJoint]) for frame in (base, tip))
    up, down = (
        [i for i in own if i not in other and i not in locked]
        for own, other in ((to_base, to_tip), (to_tip, to_base))
    )
    if not down:
        hangs = base.parentJoint in to_tip
        raise model_error(
            model.name,
            f"there is no moving joint between {base.name} and {tip.name}"
            if hangs
            else f"{model.name}: {tip.name} does not hang on {base.name}, nor on what carries it",
            "name another tip" if hangs else "give a base between the root and the tip",
            tip.name if hangs else base.name,
        )
    return Path(up[::-1], down)


def check_joints(
    model: pin.Model,
    path: Path,
    flaws: Mapping[str, RobotModelError],
    followers: Collection[str] = (),
) -> None:
    """Refuse joints that no serial arm has, nor what carries one or what it measures.

    ``followers``: joints that follow others of the path.
    """
    _check_positioner(model, path.positioner)
    joints = path.joints
    if len(joints) > MOST_JOINTS:
        raise model_error(
            model.name,
            f"has {len(joints)} joints between base and tip, more than {MOST_JOINTS}",
            "name another base or tip, or hold joints at zero with lock",
            value=len(joints),
            bound=MOST_JOINTS,
        )
    for i in joints:
        name, turns = model.names[i], model.joints[i].shortname().startswith("JointModelR")
        if not (turns or is_slide(model, i)):
            raise _joint_error(
                model,
                name,
                "is neither revolute nor prismatic",
                "name another base or tip, or hold the joint at zero with lock",
            )
        if name in followers:
            continue
        if name in flaws:
            raise flaws[name]
        lower, upper = _limits(model, i)
        if not lower < upper:
            raise _joint_error(
                model,
                name,
                "has no range: its limits are the same",
                "correct the limits, make the joint fixed, or hold it at zero with lock",
            )


def check_units(model: pin.Model, path: Path) -> None:
    """Refuse limits of joints of the chain that can only be degrees.

    Raises
    ------
    RobotModelError
        Joints that turn have limits beyond :data:`MOST_TURNS`.
    """
    turning = [i for i in path.joints if not is_slide(model, i)]
    limits = {i: _limits(model, i) for i in turning}
    most = 2.0 * math.pi * MOST_TURNS
    beyond = [i for i in turning if max(map(abs, limits[i])) > most]
    if not beyond:
        return
    low, high = limits[beyond[0]]
    what = "limits" if len(beyond) == 1 else "limits such as"
    named = ", ".join(names_of(model, beyond))
    raise model_error(
        model.name,
        f"{named}: {what} {low:g} to {high:g} rad are {math.degrees(low):.0f} to "
        f"{math.degrees(high):.0f} deg, more than {MOST_TURNS:g} turns",
        f"were they typed in degrees? a URDF has radians: {math.radians(low):.4g} to "
        f"{math.radians(high):.4g}; a joint without limits is continuous",
        names_of(model, beyond)[0],
        value=max(map(abs, limits[beyond[0]])),
        bound=most,
    )


def _check_positioner(model: pin.Model, joints: list[int]) -> None:
    """Refuse what carries the base and is no positioner."""
    if len(joints) > MOST_OF_POSITIONER:
        raise model_error(
            model.name,
            f"{len(joints)} joints carry the base, more than {MOST_OF_POSITIONER}: "
            + ", ".join(names_of(model, joints)),
            "hold some of them with lock, or name another base",
            value=len(joints),
            bound=MOST_OF_POSITIONER,
        )
    for i in joints:
        if is_slide(model, i):
            raise _joint_error(
                model,
                model.names[i],
                "slides, and carries the base",
                "only positioners that turn can carry it; hold this one with lock",
            )


def links_of_other_branches(model: pin.Model, first: int) -> frozenset[str]:
    """Links that are not fixed to the one that the first joint of a chain hangs on.

    Those that the chain carries are among them.
    """
    bodies = (f for f in model.frames if f.type == pin.FrameType.BODY)
    return frozenset(f.name for f in bodies if f.parentJoint != model.parents[first])


def body_of(
    model: pin.Model, shape: LinkShape, path: Path, base_id: int, others: frozenset[str]
) -> Body:
    """A solid of a link, on the link of the chain that it is fixed to.

    ``others`` are links that are not fixed to the one that the arm hangs on.
    """
    number, T_link_mover = link_of(model, shape.link, path, base_id)
    T_mover_shape = model.frames[frame_id(model, shape.link)].placement.homogeneous
    standing = number == len(path.positioner)
    return Body(
        shape.name,
        number,
        T_link_mover.homogeneous @ T_mover_shape @ shape.T_link_shape,
        shape.solid,
        of_other_branch=standing and shape.link in others,
        beside_positioner=bool(path.positioner)
        and standing
        and shape.link != _carrier(model, path.positioner[-1]),
    )


def link_of(model: pin.Model, link: str, path: Path, base_id: int) -> tuple[int, pin.SE3]:
    """Number of the link of a chain that a link is fixed to (0: the base), its joint's place in it.

    A link that a positioner's joint moves against the next one outwards sits at that next joint,
    as the last link of the way back; what no joint moves stands on the floor.
    """
    mover, up = model.frames[frame_id(model, link)].parentJoint, path.positioner
    if mover in path.arm:
        return len(up) + path.arm.index(mover) + 1, pin.SE3.Identity()
    number = up.index(mover) if mover in up else len(up)
    if number == 0:
        return 0, model.frames[base_id].placement.inverse()
    return number, model.jointPlacements[up[number - 1]].inverse()


def links_moved_by(model: pin.Model, joint: int) -> list[str]:
    """Return names of the links that are fixed to what a joint moves."""
    bodies = (f for f in model.frames if f.type == pin.FrameType.BODY)
    return [str(f.name) for f in bodies if f.parentJoint == joint]


def _carrier(model: pin.Model, joint: int) -> str:
    """Name of the link that a joint hangs on; empty where the description has none."""
    frames = model.frames
    own = frames[model.getFrameId(model.names[joint], pin.FrameType.JOINT)].parentFrame
    return str(frames[own].name) if frames[own].type == pin.FrameType.BODY else ""


def link_names(
    model: pin.Model, joints: Sequence[str], base: str, positioner: int = 0
) -> tuple[str, ...]:
    """Names of the links of a chain: the one that its first joint hangs on, and those they move.

    Of so many joints of a positioner, the first ones: the base, and what the others move.
    """
    frames = model.frames

    def moved(joint: str) -> str:
        mover = model.getJointId(joint)
        own = [f for f in frames if f.type == pin.FrameType.BODY and f.parentJoint == mover]
        # a link sits where its joint is, and stands before what is fixed to it
        own.sort(key=lambda frame: not frame.placement.isIdentity(1e-9))
        return str(own[0].name) if own else f"the link of {joint}"

    foot = _carrier(model, model.getJointId(joints[positioner])) or base
    carried = [base, *map(moved, joints[1:positioner])] if positioner else []
    return (*carried, foot, *map(moved, joints[positioner:]))


def chain_of(model: pin.Model, path: Path, base_id: int, tip_id: int) -> SerialChain:
    """The joints as arrays, from the base frame to the tip frame.

    Those of a positioner are passed from what they move to what they hang on: about the axis
    turned over, so that their values keep their sign.
    """
    up, joints = len(path.positioner), path.joints
    base, tip = model.frames[base_id].placement, model.frames[tip_id].placement
    back = [model.jointPlacements[i].inverse() for i in path.positioner]
    steps = [base.inverse(), *back, *(model.jointPlacements[i] for i in path.arm)]
    steps[up : up + 2] = [steps[up] * steps[up + 1]]  # over the floor, to the foot of the arm
    placements = np.array([step.homogeneous for step in steps])
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    J = data.J.reshape(6, -1)  # a model of one joint gives a flat array
    sliding = [is_slide(model, i) for i in joints]
    rows = [slice(0, 3) if slides else slice(3, 6) for slides in sliding]
    columns = [J[part, model.joints[i].idx_v] for i, part in zip(joints, rows, strict=True)]
    axes = np.array([data.oMi[i].rotation.T @ c for i, c in zip(joints, columns, strict=True)])
    axes[:up] *= -1.0
    external = _external_axes(up, sliding[up:])
    own = [joints[external.count + k] for k in external.arm_slides]
    return SerialChain(
        placements=placements,
        axes=axes,
        T_link_tip=transform(tip.rotation, tip.translation),
        external=external,
        strokes_m=tuple(max(map(abs, _limits(model, i))) for i in own),
    )


class Led(NamedTuple):
    """A joint that moves by a factor times a joint that leads, plus an offset [rad, m]."""

    leader: str
    factor: float
    offset: float


def followers_of(described: RobotDescription, path: Path) -> dict[str, Led]:
    """Return the joints of a path that follow others of it, by the joint that leads in the end.

    Those of a positioner, and those that follow what is not on the path, are none.
    """
    names = names_of(described.model, path.arm)
    found = {}
    for name in names:
        leader, factor, offset = name, 1.0, 0.0
        for _ in names:
            if leader not in described.led:
                break
            leader, by, more = described.led[leader]
            factor, offset = factor * by, factor * more + offset
        if leader != name and leader in names and leader not in described.led:
            found[name] = Led(leader, factor, offset)
    return found if not path.positioner else {}


def geared(
    model: pin.Model, path: Path, chain: SerialChain, followers: Mapping[str, Led]
) -> GearedChain:
    """Return a chain, all of whose joints have values, as that of the joints that lead."""
    names = names_of(model, path.joints)
    own = [k for k, name in enumerate(names) if name not in followers]
    gears, rest = np.zeros((len(names), len(own))), np.zeros(len(names))
    for k, name in enumerate(names):
        led = followers.get(name, Led(name, 1.0, 0.0))
        gears[k, own.index(names.index(led.leader))], rest[k] = led.factor, led.offset
    slides = np.array([is_slide(model, i) for i in path.joints])
    every = ExternalAxes(arm_slides=tuple(np.flatnonzero(slides).tolist()))
    strokes = tuple(max(map(abs, _limits(model, i))) for i in path.joints if is_slide(model, i))
    whole = replace(chain, external=every, strokes_m=strokes)
    return GearedChain.of(whole, gears, rest, np.array(own, dtype=np.intp), slides)


def limits_of(
    model: pin.Model, path: Path, followers: Mapping[str, Led]
) -> tuple[FloatArray, FloatArray]:
    """Return limits ``(n,)`` [rad, m] of the joints that lead, which keep those that follow too."""
    found: dict[str, tuple[float, float]] = {}
    for i in path.joints:
        name, (lower, upper) = model.names[i], _limits(model, i)
        led = followers.get(name, Led(name, 1.0, 0.0))
        if name in followers and (not lower < upper or not led.factor):
            continue  # none are given
        ends = sorted(((lower - led.offset) / led.factor, (upper - led.offset) / led.factor))
        low, high = found.get(led.leader, (-np.inf, np.inf))
        found[led.leader] = max(low, ends[0]), min(high, ends[1])
    own = [model.names[i] for i in path.joints if model.names[i] not in followers]
    for name in own:
        if not found[name][0] < found[name][1]:
            raise _joint_error(
                model,
                name,
                "has no range: the joints that follow it have limits that none of its values keeps",
                "correct the limits, or the factors and offsets of <mimic>",
            )
    return np.array([found[n][0] for n in own]), np.array([found[n][1] for n in own])


JOINTS_OF_AN_ARM = 4
"""Joints that an arm has at least, behind slides that carry it. Slides before fewer of them are
axes of the arm itself: a Cartesian robot, with or without a wrist; a SCARA on its own column."""


def _external_axes(positioner: int, sliding: Sequence[bool]) -> ExternalAxes:
    """Tell slides that carry an arm from slides of the arm itself, by which joints slide."""
    carrying = next((k for k, slides in enumerate(sliding) if not slides), len(sliding))
    if positioner == 0 and len(sliding) - carrying < JOINTS_OF_AN_ARM:
        carrying = 0
    of_arm = (k - carrying for k, slides in enumerate(sliding) if slides and k >= carrying)
    return ExternalAxes(positioner, carrying, tuple(of_arm))


def with_frames_at_arm(model: pin.Model, path: Path, chain: SerialChain) -> pin.Model:
    """The model with the frames of joints that lie far outside the arm slid along their axes.

    A joint turns the same wherever along its axis its frame is, so that nothing else changes. But
    errors of a link are turns about the frame of its joint, and capsules run from frame to frame.
    """
    model = pin.Model(model)
    for joint, along in zip(path.joints, chain.axes * chain.outlying[:, None], strict=True):
        if not along.any():
            continue
        slide = pin.SE3(np.eye(3), along)
        back = slide.inverse()
        model.jointPlacements[joint] = model.jointPlacements[joint] * slide
        model.inertias[joint] = back.act(model.inertias[joint])
        for other in range(1, model.njoints):
            if model.parents[other] == joint:
                model.jointPlacements[other] = back * model.jointPlacements[other]
        for frame in model.frames:
            if frame.parentJoint == joint and frame.type != pin.FrameType.JOINT:
                frame.placement = back * frame.placement
    return model
