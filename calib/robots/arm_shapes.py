"""Which links of an arm have no shape, and shapes for them that the description does not give;
and which preset an arm is, by its kinematics.

A body that is not known is not free space: whoever asks for a clearance has to know of every link
that has length. Where the description has no collision geometry, the shapes of a preset with the
same kinematics stand in, or capsules along the chain: from each joint to the next, along their
axes and the common normal between them, as castings usually run. Offsets that cancel between two
links (the upper arm of Universal Robots stands beside its joints) are in no kinematics: capsules
are an estimate, and are said to be one.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calib.errors import RobotModelError
from calib.robots.chain import SLIGHT_M, SerialChain
from calib.robots.controller import POSITIVE_AXES, makers_named
from calib.robots.geared_chain import GearedChain
from calib.robots.presets import preset_info, preset_names
from calib.robots.robot import Robot
from calib.robots.shapes import Body, capsule_between
from calib.se3 import FloatArray, inverse, transform

SHORT_M = SLIGHT_M
"""A link whose joints are no farther apart has no length, and needs no shape of its own: frames of
a calibrated arm have its errors in them, and its wrist is still one."""

SAME_M, SAME_RAD = 5e-3, float(np.deg2rad(1.0))
"""Arms are one for their shapes where no joint axis at zero is farther off: a calibration moves
axes by less, and arms of one family differ by more."""

_PARALLEL = 0.1
"""Sine of the angle between two axes below which they have no common normal worth the name."""


def unshaped_links(robot: Robot) -> tuple[str, ...]:
    """Names of the links that nothing is known of, from the base on.

    Moving links that have length and no body; and any link, the base too, whose description names
    a solid that cannot be had.
    """
    shaped = {body.link for body in robot.bodies}
    lines = enumerate(centre_lines(robot.chain))
    bare = [(j, robot.link_names[j]) for j, line in lines if j and len(line) and j not in shaped]
    return tuple(dict.fromkeys(name for _, name in sorted([*bare, *robot.lost_shapes])))


def bare_links(robot: Robot) -> tuple[str, ...]:
    """Names of links without a shape of what the arm stands on, and of a positioner."""
    shaped = {body.link for body in robot.bodies}
    return tuple(robot.link_names[j] for j in range(robot.floor + 1) if j not in shaped)


def with_capsules(robot: Robot, radius_m: Sequence[float] | FloatArray) -> Robot:
    """The same robot with capsules for the links that have no shape, or have lost one.

    A link without length that has lost its shape gets a ball.

    Parameters
    ----------
    radius_m : sequence of float
        One for all links, or one for the link that each joint moves [m].
    """
    if isinstance(robot.chain, GearedChain):
        raise RobotModelError(
            f"links of {robot.name} follow others, and no capsules run from joint to joint there",
            hint="give collision geometry in the URDF, or say constraints.collisions = false",
            name="capsule_radius_mm",
        )
    if len(radius_m) not in (1, robot.n):
        raise RobotModelError(
            f"{len(radius_m)} radii for the {robot.n} links of {robot.name}",
            hint="give one for all, or one for the link that each joint moves",
            name="capsule_radius_mm",
        )
    radii = np.broadcast_to(np.asarray(radius_m, dtype=float), robot.n)
    lines = centre_lines(robot.chain)
    lost = {name for _, name in robot.lost_shapes}
    bodies = []
    for j in _to_be_shaped(robot):
        name, radius, line = robot.link_names[j], radii[max(j - 1, 0)], lines[j]
        if not len(line) and name in lost:
            line = np.zeros((2, 3))
        for k, (start, end) in enumerate(pairwise(line)):
            label = f"{name}/{k + 1}" if len(line) > 2 else name
            bodies.append(Body(label, j, *capsule_between(start, end, radius)))
    fitted = tuple(dict.fromkeys(robot.link_names[body.link] for body in bodies))
    return replace(_shaped(robot, bodies), fitted_links=fitted)


def with_shapes_of(robot: Robot, preset: str) -> Robot:
    """The same robot with a preset's bodies for the links that have no shape, or have lost one.

    Raises
    ------
    RobotModelError
        There is no such preset, or its joint axes at zero are not those of the robot.
    """
    other = Robot.preset(preset)
    difference = _difference(robot.chain, other.chain)
    if difference:
        same = ", ".join(presets_like(robot))
        raise RobotModelError(
            f"the preset {other.name} is another arm than {robot.name}: {difference}",
            hint=f"of the same kinematics: {same}"
            if same
            else "no preset has its kinematics: set robot.capsule_radius_mm, or give meshes",
            name=preset,
        )
    links = _to_be_shaped(robot)
    own, its = _link_frames(robot.chain), _link_frames(other.chain)
    bodies = [
        replace(body, T_link_body=inverse(own[body.link]) @ its[body.link] @ body.T_link_body)
        for body in other.bodies
        if body.link in links
    ]
    return _shaped(robot, bodies)


def _to_be_shaped(robot: Robot) -> list[int]:
    """Numbers of the arm's own links that have no shape, or have lost one, the base among them."""
    shaped, lost = {body.link for body in robot.bodies}, {name for _, name in robot.lost_shapes}
    links = list(enumerate(robot.link_names))[robot.floor :]
    return [j for j, name in links if j not in shaped or name in lost]


def _shaped(robot: Robot, bodies: Sequence[Body]) -> Robot:
    """The robot with more bodies; what hangs on its links and has lost its shape is still lost."""
    now = {robot.link_names[body.link] for body in bodies}
    return replace(
        robot,
        bodies=(*robot.bodies, *bodies),
        lost_shapes=tuple(lost for lost in robot.lost_shapes if lost[1] not in now),
    )


def presets_like(robot: Robot) -> tuple[str, ...]:
    """Names of the presets whose joint axes at zero are those of a robot."""
    return tuple(
        name for name in preset_names() if not _difference(robot.chain, Robot.preset(name).chain)
    )


def makers_like(robot: Robot) -> tuple[str, ...]:
    """Return makers that an arm may be of: there is evidence, and its joints are counted so.

    Evidence are names (of the robot, its packages, links and joints), then the kinematics of a
    preset. Axes alone are none: most makers count some of them alike.
    """
    own = {preset_info(name)["controller"] for name in presets_like(robot)}
    names = (robot.name, *robot.packages, *robot.link_names, *robot.joint_names)
    named = makers_named(names)
    fitting = []
    for maker in POSITIVE_AXES:
        if maker in named or maker in own:
            with suppress(RobotModelError):
                robot.controlled_by(maker)
                fitting.append(maker)
    return tuple(sorted(fitting, key=lambda maker: (maker not in named, maker not in own)))


def centre_lines(chain: SerialChain) -> list[FloatArray]:
    """Corners ``(K, 3)`` [m] of the line from each joint to the next, in its link, base first.

    Along the axis of the joint to the common normal with the next axis, across, and along the next
    axis to its joint; between parallel axes along the longer part first. Links without length have
    none, nor has a base whose frame is not on the first axis: where it stands is not known. Nor do
    those of a positioner: tables and frames are not along their axes.
    """
    axes = chain.axes
    ahead = (chain.placements[:, :3, :3] @ axes[:, :, None])[..., 0]
    steps = [*chain.placements[:, :3, 3], chain.T_link_tip[:3, 3]]
    first = steps[0]
    foot = first @ ahead[0] * ahead[0]
    lines = [_corners(np.zeros(3), foot) if np.linalg.norm(first - foot) < SHORT_M else _NO_LINE]
    for j, axis in enumerate(axes):
        onward = ahead[j + 1] if j + 1 < chain.n else None
        lines.append(_corners(np.zeros(3), *_feet(axis, onward, steps[j + 1]), steps[j + 1]))
    up = chain.external.positioner
    return [_NO_LINE] * (up + 1) + lines[up + 1 :] if up else lines


_NO_LINE = np.empty((0, 3))


def _feet(axis: FloatArray, onward: FloatArray | None, step: FloatArray) -> list[FloatArray]:
    """Corners between a joint at the origin and the next at ``step``, whose axis is ``onward``."""
    normal = np.zeros(3) if onward is None else np.cross(axis, onward)
    if onward is not None and np.linalg.norm(normal) > _PARALLEL:
        parts = np.linalg.solve(np.column_stack([axis, normal, onward]), step)
        near, far = parts[0] * axis, step - parts[2] * onward
        if np.abs(parts[[0, 2]]).max() <= np.linalg.norm(step) + SHORT_M:
            return [near, far]
    along = step @ axis * axis
    across = step - along
    return [max(along, across, key=lambda part: float(np.linalg.norm(part)))]


def _corners(*points: FloatArray) -> FloatArray:
    """The points that are apart from the one before; none where all are one."""
    kept = [points[0]]
    for point in points[1:]:
        if np.linalg.norm(point - kept[-1]) > SHORT_M:
            kept.append(point)
    return np.array(kept) if len(kept) > 1 else _NO_LINE


def _link_frames(chain: SerialChain) -> FloatArray:
    """Base and links at zero ``(n + 1, 4, 4)``, in the base frame."""
    state = chain.forward(np.zeros(chain.n))
    return np.concatenate([np.eye(4)[None], transform(state.rotations, state.origins)])


def _difference(chain: SerialChain, other: SerialChain) -> str:
    """The joint that sits differently at zero in two arms, in words; empty where none does."""
    if chain.n != other.n:
        return f"it has {other.n} joints, not {chain.n}"
    one, two = (c.forward(np.zeros(c.n)) for c in (chain, other))
    turned = np.arctan2(
        np.linalg.norm(np.cross(one.axes, two.axes), axis=-1), np.sum(one.axes * two.axes, axis=-1)
    )
    off = np.linalg.norm(np.cross(two.origins - one.origins, one.axes), axis=-1)
    for j in np.flatnonzero((turned > SAME_RAD) | (off > SAME_M)).tolist():
        away = f"{1e3 * off[j]:.0f} mm off and turned by {np.rad2deg(turned[j]):.1f} deg"
        return f"at zero, axis {j + 1} is {away}"
    return ""
