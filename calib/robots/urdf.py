"""Reading a URDF that may come from anywhere: checked before Pinocchio sees it.

Pinocchio's own reader prints to the terminal from C++ and names no joint when something is
missing. The file is therefore read here first with XML entities and external references refused,
and its structure is checked joint by joint.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError, tostring

import defusedxml
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from calib.errors import RobotModelError, near_names

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LARGEST_URDF_BYTES = 20_000_000
"""Kinematics of the largest cells are well below a megabyte; more is not a robot description."""

MOVING = ("revolute", "continuous", "prismatic")
_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
JOINT_TYPES = (*MOVING, "fixed", "floating", "planar")


def load_urdf(path: Path) -> tuple[pin.Model, list[str], frozenset[str]]:
    """Read a URDF file into a Pinocchio model, without geometry.

    Continuous joints become revolute ones of +-360 deg, which the notices say.

    Returns
    -------
    model : pinocchio.Model
    notices : list of str
        What was read otherwise than it stands in the file.
    mimics : frozenset of str
        Joints that follow another one; they cannot be part of a serial arm.

    Raises
    ------
    RobotModelError
        The file is missing, is no URDF, or a joint in it cannot be used.
    """
    root = _parse(path)
    notices = [note for joint in root.iterfind("joint") for note in _check_joint(joint, path)]
    for link in root.iterfind("link"):
        _check_mass(link, path)
    links = [link.get("name", "") for link in root.iterfind("link")]
    if not links:
        raise RobotModelError(f"{path}: has no links", hint="is it a URDF?", name=str(path))
    _check_tree(root, links, path)
    try:
        model = pin.buildModelFromXML(tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise RobotModelError(
            f"{path}: Pinocchio cannot build a model of it: {str(error).splitlines()[0]}",
            hint="check the file with check_urdf",
            name=str(path),
        ) from error
    mimics = {j.get("name", "") for j in root.iterfind("joint") if j.find("mimic") is not None}
    return model, notices, frozenset(mimics)


def _parse(path: Path) -> Element:
    try:
        with path.open("rb") as file:  # a pipe or a device has no size to ask for
            text = file.read(LARGEST_URDF_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        raise RobotModelError(
            f"{path}: cannot be read: {getattr(error, 'strerror', error)}",
            hint="give the path of a URDF file, or the name of a preset (posedesign robots)",
            name=str(path),
        ) from error
    if len(text) > LARGEST_URDF_BYTES:
        raise RobotModelError(
            f"{path}: more than {LARGEST_URDF_BYTES} bytes is too large for a URDF",
            hint="give the kinematics only",
            name=str(path),
        )
    try:
        root: Element = fromstring(text, forbid_dtd=True)
    except defusedxml.DefusedXmlException as error:
        raise RobotModelError(
            f"{path}: document types and entities are not accepted in a URDF",
            hint="remove the <!DOCTYPE> part",
            name=str(path),
        ) from error
    except (ParseError, LookupError, ValueError) as error:  # the last two: unknown encodings
        raise RobotModelError(
            f"{path}: is not well-formed XML: {error}", hint="mend the file", name=str(path)
        ) from error
    if root.tag != "robot":
        raise RobotModelError(
            f"{path}: the outermost element is <{root.tag}>, not <robot>",
            hint="is it a xacro or an SDF? expand or convert it to a URDF first",
            name=str(path),
        )
    if not root.get("name"):
        root.set("name", path.stem)
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise RobotModelError(
            f"{path}: contains xacro macros",
            hint="expand it first: xacro file.xacro > file.urdf",
            name=str(path),
        )
    for name in ("visual", "collision"):  # only kinematics are read: meshes are never looked for
        for link in root.iterfind("link"):
            for element in link.findall(name):
                link.remove(element)
    return root


def _check_joint(joint: Element, path: Path) -> list[str]:
    name, kind = joint.get("name", ""), joint.get("type", "")

    def fail(what: str, hint: str) -> RobotModelError:
        return RobotModelError(f"{path}: joint {name!r} {what}", hint=hint, name=name)

    if not name:
        raise fail("has no name", "name every joint")
    if kind not in JOINT_TYPES:
        raise fail(f"has the unknown type {kind!r}", near_names(kind, JOINT_TYPES))
    for end in ("parent", "child"):
        element = joint.find(end)
        if element is None or not element.get("link"):
            raise fail(f"has no <{end} link=...>", "add it")
    for tag, key in (("origin", "xyz"), ("origin", "rpy"), ("axis", "xyz")):
        element = joint.find(tag)
        text = None if element is None else element.get(key)
        if text is not None and len(_numbers(text)) != 3:
            raise fail(f"has {tag} {key}={text!r}, not three finite numbers", "correct it")
    if kind not in MOVING:
        return []
    axis = joint.find("axis")
    if axis is not None and not any(_numbers(axis.get("xyz", ""))):
        raise fail("has an axis of length zero", "give the direction of the axis")
    if kind == "continuous":
        _bound_continuous(joint)
        return [f"continuous joint {name} is read as one of +-360 deg"]
    _check_limits(joint, fail)
    return []


def _bound_continuous(joint: Element) -> None:
    """Make a continuous joint, which Pinocchio gives two numbers, a revolute one of +-360 deg."""
    joint.set("type", "revolute")
    for limit in joint.findall("limit"):
        joint.remove(limit)
    turn = str(2.0 * math.pi)
    bounds = {"lower": f"-{turn}", "upper": turn, "effort": "0", "velocity": "0"}
    joint.append(joint.makeelement("limit", bounds))


def _check_limits(joint: Element, fail: Callable[[str, str], RobotModelError]) -> None:
    found = joint.find("limit")
    if found is None:
        raise fail("has no <limit>", "add lower, upper and velocity, or make it continuous")
    values = {k: _numbers(found.get(k, "0")) for k in ("lower", "upper", "velocity", "effort")}
    for key, value in values.items():
        if len(value) != 1:
            raise fail(f"has limit {key}={found.get(key)!r}, not a finite number", "correct it")
        found.set(key, repr(value[0]))
    if values["lower"][0] > values["upper"][0]:
        raise fail(
            f"has its limits reversed: lower {values['lower'][0]:g} is above "
            f"upper {values['upper'][0]:g}",
            "swap them",
        )


def _check_mass(link: Element, path: Path) -> None:
    """An <inertial> that Pinocchio cannot read it leaves out: the link would weigh nothing."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    needed = [("mass", "value"), *(("inertia", f"i{axes}") for axes in _TENSOR)]
    for tag, key in [*needed, ("origin", "xyz"), ("origin", "rpy")]:
        element = inertial.find(tag)
        text = None if element is None else element.get(key)
        if text is None and tag == "origin":
            continue
        values = _numbers(text or "")
        if len(values) != (3 if tag == "origin" else 1) or (tag == "mass" and values[0] < 0):
            name = link.get("name", "")
            raise RobotModelError(
                f"{path}: link {name!r} has inertial {tag} {key}={text!r}",
                hint="correct it, or leave <inertial> out",
                name=name,
            )


def _check_tree(root: Element, links: list[str], path: Path) -> None:
    """One root, every link named once, every joint between links that exist."""
    joints = list(root.iterfind("joint"))
    for what, names in (("link", links), ("joint", [j.get("name", "") for j in joints])):
        double = {n for n in names if names.count(n) > 1}
        if double:
            raise RobotModelError(
                f"{path}: {what} {min(double)!r} is defined twice",
                hint="rename one",
                name=min(double),
            )
    parent: dict[str, str] = {}
    for joint in joints:
        ends = [_attribute(joint, end) for end in ("parent", "child")]
        for link in ends:
            if link not in links:
                raise RobotModelError(
                    f"{path}: joint {joint.get('name')!r} names a missing link {link!r}",
                    hint="add the link or correct the name",
                    name=link,
                )
        if ends[1] in parent:
            raise RobotModelError(
                f"{path}: link {ends[1]!r} has two parents", hint="a URDF is a tree", name=ends[1]
            )
        parent[ends[1]] = ends[0]
    roots = [link for link in links if link not in parent]
    if len(roots) != 1:
        raise RobotModelError(
            f"{path}: has {len(roots)} root links ({', '.join(roots[:5])}), not one",
            hint="join them with fixed joints",
            name=str(path),
        )
    reached, front = set(roots), set(roots)
    while front:
        front = {child for child, above in parent.items() if above in front}
        reached |= front
    if len(reached) < len(links):
        ring = min(set(links) - reached)
        raise RobotModelError(
            f"{path}: link {ring!r} hangs on itself, through a ring of joints",
            hint="a URDF is a tree",
            name=ring,
        )


def _attribute(joint: Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _numbers(text: str) -> list[float]:
    """The finite numbers of a text; none at all where one of them is not a finite number."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []
