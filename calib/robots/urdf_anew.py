"""A URDF written from what is known of a robot, where there is no file to start from."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np

from calib.robots.description.urdf_kinematics import rpy_of as rpy_of
from calib.robots.description.urdf_kinematics import spread
from calib.robots.robot import Robot

if TYPE_CHECKING:
    from pinocchio import SE3, Frame

WHAT_IT_IS = (
    "Joint origins as identified by a calibration, not as designed. Zero offsets are in them: "
    "master the arm or use this file, not both. What no chain of joints can hold is left out"
)
"""Comment at the head of every file."""

_NOT_WRITTEN = "solids, limits that joints have together, stiffness"


def words_for_comment(left_out: Sequence[str], said: Sequence[str] = ()) -> str:
    """What the comment of a file says, fit to stand in XML."""
    words = ": ".join([WHAT_IT_IS, "; ".join(left_out)]) if left_out else WHAT_IT_IS
    words = ". ".join([words, *said])
    words = words.encode("ascii", "replace").decode()  # fits every encoding
    return re.sub("-(?=-|$)", "- ", "".join(c if c.isprintable() else " " for c in words))


def urdf_of(robot: Robot, comment: str) -> bytes:
    """A URDF with links, joints, limits, masses, base and tip of a robot.

    Parameters
    ----------
    robot : Robot
        Whose joints are all of its Pinocchio model's, as those of :meth:`Robot.preset` are.
    comment : str
        Fit to stand in XML, see :func:`words_for_comment`.
    """
    model = robot.model
    root = Element("robot", name=robot.name)
    root.append(Comment(f" {comment} "))
    root.append(Comment(f" not in this file: {_NOT_WRITTEN} "))
    frames = [f for f in model.frames if f.type.name == "BODY"]
    used = {frame.name for frame in frames}
    links: dict[int, str] = {}
    for joint in range(model.njoints):
        links[joint] = _main_link(frames, joint, used, model.names[joint])
        _add_link(root, robot, links[joint], model.names[joint])
    for frame in frames:
        if frame.name not in links.values():
            SubElement(root, "link", name=frame.name)
    for joint in range(1, model.njoints):
        _add_joint(root, robot, joint, links)
    for frame in frames:
        if frame.name not in links.values():
            name = f"{frame.name}-fixed"
            _add_between(root, name, "fixed", links[frame.parentJoint], frame.name, frame.placement)
    indent(root)
    return f'<?xml version="1.0"?>\n{tostring(root, encoding="unicode")}\n'.encode()


def _main_link(frames: Sequence[Frame], joint: int, used: set[str], joint_name: str) -> str:
    """The link that sits where a joint puts it; named after the joint where there is none."""
    for frame in frames:
        if frame.parentJoint == joint and frame.placement.isIdentity(0.0):
            return str(frame.name)
    name = f"{joint_name}-link"
    while name in used:
        name += "-"
    used.add(name)
    return name


def _add_link(root: Element, robot: Robot, link: str, joint: str) -> None:
    element = SubElement(root, "link", name=link)
    if joint not in robot.joint_names or not robot.link_mass[robot.joint_names.index(joint)]:
        return
    j = robot.joint_names.index(joint)
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=spread(robot.link_com[j].tolist()))
    SubElement(inertial, "mass", value=repr(float(robot.link_mass[j])))
    tensor = np.asarray(robot.model.inertias[robot.model.getJointId(joint)].inertia)
    pairs = {f"i{a}{b}": tensor["xyz".index(a), "xyz".index(b)] for a in "xyz" for b in "xyz"}
    kept = {key: repr(float(v)) for key, v in pairs.items() if key[1] <= key[2]}
    SubElement(inertial, "inertia", kept)


def _add_joint(root: Element, robot: Robot, index: int, links: dict[int, str]) -> None:
    model, name = robot.model, robot.model.names[index]
    j = robot.joint_names.index(name)
    parent = links[model.parents[index]]
    kind = "prismatic" if robot.sliding[j] else "revolute"
    element = _add_between(root, name, kind, parent, links[index], model.jointPlacements[index])
    axis = robot.chain.axes[j] * (-1.0 if j < robot.floor else 1.0)
    SubElement(element, "axis", xyz=spread(axis.tolist()))
    speed = robot.speed[j] if np.isfinite(robot.speed[j]) else 0.0
    limits = {"lower": robot.lower[j], "upper": robot.upper[j], "velocity": speed, "effort": 0.0}
    SubElement(element, "limit", {key: repr(float(value)) for key, value in limits.items()})


def _add_between(
    root: Element, name: str, kind: str, parent: str, child: str, placement: SE3
) -> Element:
    element = SubElement(root, "joint", name=name, type=kind)
    SubElement(element, "parent", link=parent)
    SubElement(element, "child", link=child)
    xyz, rpy = placement.translation, rpy_of(np.asarray(placement.rotation))
    SubElement(element, "origin", xyz=spread(xyz.tolist()), rpy=spread(rpy.tolist()))
    return element
