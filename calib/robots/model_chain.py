"""The chain between two frames of a Pinocchio model, taken out and checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from calib.errors import RobotModelError, near_names
from calib.robots.chain import SerialChain
from calib.robots.shapes import Body, LinkShape
from calib.se3 import FloatArray, transform

STANDARD_GRAVITY = 9.80665
"""[m/s²]"""

USUAL_TIPS = ("tool0", "flange")
"""Names that ROS-Industrial and the makers give to the mounting face, the better one first."""

MOST_JOINTS = 100
"""Snakes have some thirty; Pinocchio's memory grows with the third power (2 GB at 300)."""


def frame_id(model: pin.Model, name: str) -> int:
    """Index of a link's frame; RobotModelError with near names where there is none."""
    # getFrameId returns nframes in silence for a name that does not exist
    if not model.existFrame(name, pin.FrameType.BODY):
        known = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise RobotModelError(
            f"{model.name}: there is no link {name!r}", hint=near_names(name, known), name=name
        )
    return int(model.getFrameId(name, pin.FrameType.BODY))


def root_id(model: pin.Model) -> int:
    """Index of the root link's frame; RobotModelError for a model that has none."""
    for i, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.BODY and frame.parentJoint == 0:
            return i
    raise RobotModelError(
        f"{model.name}: has no link that its first joint hangs on",
        hint="add a frame of type BODY on joint 0, or name a base",
        name=model.name,
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


def gravity_at(model: pin.Model, base_id: int) -> FloatArray:
    """Gravity (3,) [m/s²] in a base frame, which may be tilted against the root."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    down = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    return np.asarray(data.oMf[base_id].rotation.T @ down)


def names_of(model: pin.Model, joints: Sequence[int]) -> list[str]:
    """Names of joints."""
    return [model.names[i] for i in joints]


def joints_to_lock(model: pin.Model, lock: Iterable[str]) -> list[int]:
    """Indices of the moving joints among the names; a fixed joint is locked already."""
    moving = list(model.names)[1:]
    found = []
    for name in [lock] if isinstance(lock, str) else lock:
        if name in moving:
            found.append(int(model.getJointId(name)))
        elif not model.existFrame(name, pin.FrameType.FIXED_JOINT):
            raise RobotModelError(
                f"{model.name}: there is no joint {name!r} to lock",
                hint=near_names(name, moving),
                name=name,
            )
    return sorted(set(found))


def values_held(
    model: pin.Model,
    locked: Sequence[int],
    held_rad: Mapping[str, float],
    held_m: Mapping[str, float],
    state: Mapping[str, float],
    led: Mapping[str, tuple[str, float, float]],
    flaws: Mapping[str, RobotModelError],
) -> dict[int, float]:
    """Values other than zero [rad, m] of locked joints: as asked, or as their leader has it.

    Parameters
    ----------
    held_rad, held_m : mapping of str to float
        As asked, of joints that turn and of joints that slide.
    state : mapping of str to float
        Of joints of either kind, where nothing else is asked; those that are not locked do not
        matter.
    led : mapping of str to (str, float, float)
        Joints that follow another: its name, the factor and the offset.
    flaws : mapping of str to RobotModelError
        Joints whose limits mean nothing.
    """
    for name in (*held_rad, *held_m):
        if not model.existJointName(name):  # one that is fixed passes where joints are locked
            raise RobotModelError(
                f"{model.name}: joint {name} is fixed, and has no value to be held at",
                hint="leave it out",
                name=name,
            )
    held = {**state, **held_rad, **held_m}
    values = {name: float(held.get(name, 0.0)) for name in names_of(model, locked)}
    for name, (leader, factor, offset) in led.items():
        if name in values and name not in held and leader in values:
            values[name] = factor * values[leader] + offset
    found = {}
    for name, value in values.items():
        i = int(model.getJointId(name))
        joint = model.joints[i]
        if name in held and (joint.nq, joint.nv) != (1, 1):
            raise RobotModelError(
                f"{model.name}: joint {name} has no one value to be held at",
                hint="only revolute and prismatic joints have",
                name=name,
            )
        unit, scale = _unit(model, i)
        if name in (held_rad if unit == "mm" else held_m):
            raise RobotModelError(
                f"{model.name}: joint {name} {'slides' if unit == 'mm' else 'turns'}",
                hint=f"give its value in {unit}",
                name=name,
            )
        lower, upper = (float(b[joint.idx_q]) for b in _limits(model))
        if not math.isfinite(value) or (
            name in held and name not in flaws and not lower - 1e-9 <= value <= upper + 1e-9
        ):
            raise RobotModelError(
                f"{model.name}: joint {name} is to be held at {scale * value:g} {unit}, and its "
                f"limits are {scale * lower:g} and {scale * upper:g}",
                hint="hold it inside its limits",
                name=name,
                value=value,
            )
        if value:
            found[i] = value
    return found


def held_in_words(model: pin.Model, values: Mapping[int, float]) -> list[str]:
    """Each joint with the value that it is held at [rad, m], in degrees or mm."""
    units = {i: _unit(model, i) for i in values}
    return [
        f"{model.names[i]} at {units[i][1] * value:.6g} {units[i][0]}"
        for i, value in values.items()
    ]


def configuration(model: pin.Model, values: Mapping[int, float]) -> FloatArray:
    """A configuration of a whole model: joints at values [rad, m], all others at zero."""
    q = np.array(pin.neutral(model))
    for i, value in values.items():
        q[model.joints[i].idx_q] = value
    return q


def _limits(model: pin.Model) -> tuple[FloatArray, FloatArray]:
    return np.asarray(model.lowerPositionLimit), np.asarray(model.upperPositionLimit)


def is_slide(model: pin.Model, joint: int) -> bool:
    """Whether a joint slides along one line; a planar one does not."""
    kind = model.joints[joint]
    return bool(kind.shortname().startswith("JointModelP") and kind.nv == 1)


def _unit(model: pin.Model, joint: int) -> tuple[str, float]:
    """Unit that people give a joint's value in, and the factor from [rad, m]."""
    return ("mm", 1e3) if is_slide(model, joint) else ("deg", math.degrees(1.0))


def joints_between(
    model: pin.Model, base_id: int, tip_id: int, locked: Sequence[int] = ()
) -> list[int]:
    """Joints from the base to the tip, without those that are locked."""
    base, tip = model.frames[base_id], model.frames[tip_id]
    path = list(model.supports[tip.parentJoint])
    if base.parentJoint not in path:
        raise RobotModelError(
            f"{model.name}: {tip.name} does not hang on {base.name}",
            hint="give a base between the root and the tip",
            name=base.name,
        )
    joints = [i for i in path[path.index(base.parentJoint) + 1 :] if i not in locked]
    if not joints:
        raise RobotModelError(
            f"{model.name}: there is no moving joint between {base.name} and {tip.name}",
            hint="name another tip",
            name=tip.name,
        )
    return joints


def check_joints(model: pin.Model, joints: list[int], flaws: Mapping[str, RobotModelError]) -> None:
    """Refuse joints that no serial arm has, nor what carries one."""
    if len(joints) > MOST_JOINTS:
        raise RobotModelError(
            f"{model.name}: has {len(joints)} joints between base and tip, more than {MOST_JOINTS}",
            hint="name another base or tip, or hold joints at zero with lock",
            name=model.name,
            value=len(joints),
            bound=MOST_JOINTS,
        )
    turned = False
    for i in joints:
        name, turns = model.names[i], model.joints[i].shortname().startswith("JointModelR")
        turned |= turns
        if not (turns or is_slide(model, i)):
            raise RobotModelError(
                f"{model.name}: joint {name} is neither revolute nor prismatic",
                hint="name another base or tip, or hold the joint at zero with lock",
                name=name,
            )
        if turned and not turns:
            raise RobotModelError(
                f"{model.name}: joint {name} slides, behind joints that turn",
                hint="slides carry an arm (a rail, a gantry, a lift); hold this one with lock",
                name=name,
            )
        if name in flaws:
            raise flaws[name]
        place = model.joints[i].idx_q  # a floating joint before it has seven values for six speeds
        lower, upper = _limits(model)
        if not lower[place] < upper[place]:
            raise RobotModelError(
                f"{model.name}: joint {name} has no range: its limits are the same",
                hint="correct the limits, make the joint fixed, or hold it at zero with lock",
                name=name,
            )
    if not turned:
        raise RobotModelError(
            f"{model.name}: no joint between base and tip turns", hint="name another tip"
        )


def links_of_other_branches(model: pin.Model, first: int) -> frozenset[str]:
    """Links that are not fixed to the one that the first joint of a chain hangs on.

    Those that the chain carries are among them.
    """
    bodies = (f for f in model.frames if f.type == pin.FrameType.BODY)
    return frozenset(f.name for f in bodies if f.parentJoint != model.parents[first])


def body_of(
    model: pin.Model, shape: LinkShape, joints: list[int], base_id: int, others: frozenset[str]
) -> Body:
    """A solid of a link on the joint of the chain that moves it; of other links, on the base.

    ``others`` are links that are not fixed to the one that the chain hangs on.
    """
    mover = link_number(model, shape.link, joints)
    T_mover_link = model.frames[frame_id(model, shape.link)].placement
    if not mover:
        T_mover_link = model.frames[base_id].placement.inverse() * T_mover_link
    T_mover_body = T_mover_link.homogeneous @ shape.T_link_shape
    other = not mover and shape.link in others
    return Body(shape.name, mover, T_mover_body, shape.solid, other)


def link_number(model: pin.Model, link: str, joints: list[int]) -> int:
    """Number, from 1, of the joint of the chain that moves a link; 0 where none does."""
    mover = model.frames[frame_id(model, link)].parentJoint
    return joints.index(mover) + 1 if mover in joints else 0


def link_names(model: pin.Model, joints: Sequence[str], base: str) -> tuple[str, ...]:
    """Names of the link that the first joint hangs on, and of the link that each joint moves."""
    frames = model.frames
    first = frames[model.getFrameId(joints[0], pin.FrameType.JOINT)].parentFrame
    names = [frames[first].name if frames[first].type == pin.FrameType.BODY else base]
    for joint in joints:
        mover = model.getJointId(joint)
        own = [f for f in frames if f.type == pin.FrameType.BODY and f.parentJoint == mover]
        # a link sits where its joint is, and stands before what is fixed to it
        own.sort(key=lambda frame: not frame.placement.isIdentity(1e-9))
        names.append(own[0].name if own else f"the link of {joint}")
    return tuple(names)


def chain_of(model: pin.Model, joints: list[int], base_id: int, tip_id: int) -> SerialChain:
    """The joints as arrays, from the base frame to the tip frame."""
    placements = np.array([model.jointPlacements[i].homogeneous for i in joints])
    base, tip = model.frames[base_id].placement, model.frames[tip_id].placement
    placements[0] = base.inverse().homogeneous @ placements[0]
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    J = data.J.reshape(6, -1)  # a model of one joint gives a flat array
    slides = sum(is_slide(model, i) for i in joints)
    rows = [slice(0, 3)] * slides + [slice(3, 6)] * (len(joints) - slides)
    columns = [J[part, model.joints[i].idx_v] for i, part in zip(joints, rows, strict=True)]
    axes = np.array([data.oMi[i].rotation.T @ c for i, c in zip(joints, columns, strict=True)])
    return SerialChain(
        placements=placements,
        axes=axes,
        T_link_tip=transform(tip.rotation, tip.translation),
        slides=slides,
    )
