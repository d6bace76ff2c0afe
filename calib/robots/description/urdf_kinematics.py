"""Links, joints and masses of a URDF, checked one by one and written anew.

What is wrong with a joint's limits is kept until it is known whether the joint moves: pistons and
fingers beside the arm are held still, and their limits do not matter.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from calib.errors import RobotModelError, model_error, near_names
from calib.se3 import FloatArray, rotation_from_quaternion

MOST_LINKS = 1000
"""Cells of several arms have some two hundred; the reader behind Pinocchio calls itself for each
link of a row, on a stack that ends."""

LARGEST_LENGTH_M = 1000.0
"""No part of a robot is larger; numbers beyond it would overflow further on."""

FARTHEST_M = 1e5
"""No frame of a joint is farther from the one before, nor what is given in it: of axes that are
parallel but for 1e-5 rad the common normal, which calibrated tables place frames at, is 100 km away
(:attr:`calib.robots.chain.SerialChain.outlying`). Rounding is 1e-11 m there."""

LARGEST_MASS_KG = 1e7
LARGEST_TURN_RAD = 100 * 2.0 * math.pi
"""Limits beyond it stand for none at all (some tools write +-1e16)."""

LONGEST_SLIDE_M = 100.0
"""Limits beyond it are no metres: of a rail that was described in millimetres."""

MOVING = ("revolute", "continuous", "prismatic")
JOINT_TYPES = (*MOVING, "fixed", "floating", "planar")
_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_LONGEST_SHOWN = 60
_Fail = Callable[[str, str], RobotModelError]


@dataclass(frozen=True, eq=False)
class Kinematics:
    """A URDF that holds links with their masses and joints with their limits, and nothing else."""

    root: Element
    notices: dict[str, str]  # by joint: what was read otherwise than it stands in the file
    flaws: dict[str, RobotModelError]  # by joint: why it cannot be moved
    led: dict[str, tuple[str, float, float]]
    """By joint that follows another (mimic): that joint, the factor and the offset [rad, m]."""


def read_kinematics(root: Element, path: Path) -> Kinematics:
    """Check the links and joints of a URDF and write them anew.

    Raises
    ------
    RobotModelError
        Links and joints do not make one tree, or a number of them cannot be used.
    """
    links, joints = root.findall("link"), root.findall("joint")
    if not links:
        raise model_error(
            path,
            "has no links",
            "is it a URDF? a xacro that only defines macros needs the file that calls them",
        )
    if len(links) > MOST_LINKS:
        raise model_error(
            path,
            f"has {len(links)} links, more than {MOST_LINKS}",
            "give the arm alone",
            value=len(links),
            bound=MOST_LINKS,
        )
    out = Kinematics(Element("robot", name=printable(root.get("name") or path.stem)), {}, {}, {})
    for joint in joints:
        _add_joint(joint, out, path)
    for link in links:
        _add_link(link, out, path)
    _check_tree(out.root, path)
    return out


def numbers(text: str) -> list[float]:
    """The finite numbers of a text; none at all where one of them is not a finite number."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []


def shown(text: str | None) -> str:
    """A text out of a file as an error tells it: in quotes, on one line, not too long."""
    if text is None or len(text) <= _LONGEST_SHOWN:
        return repr(text)
    return repr(text[: _LONGEST_SHOWN - 3] + "...")


def printable(text: str) -> str:
    """A name out of a file without line breaks and other characters that are not to be seen."""
    return "".join(c if c.isprintable() else " " for c in text)


def spread(values: list[float]) -> str:
    """Numbers as a URDF has them, with every digit."""
    return " ".join(map(repr, values))


def rpy_of(rotation: FloatArray) -> FloatArray:
    """Roll, pitch, yaw ``(3,)`` [rad] of a rotation ``(3, 3)``: W, P, R to the last digit.

    Also next to pitch +-90 deg, where :func:`calib.se3.wpr_from_rotation` sets R to zero and gives
    up a nanoradian: there W is arbitrary, and R makes up for whatever it comes out as.
    """
    R = rotation
    w = np.arctan2(R[2, 1], R[2, 2])
    p = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    sw, cw = np.sin(w), np.cos(w)
    r = np.arctan2(sw * R[0, 2] - cw * R[0, 1], cw * R[1, 1] - sw * R[1, 2])
    return np.array([w, p, r]) + 0.0


def without_quaternions(root: Element, path: Path) -> None:
    """Write ``<origin quat_xyzw>``, which URDF has from version 1.1 on, as roll, pitch and yaw.

    Everywhere in a description, in place: in joints, masses and shapes.

    Raises
    ------
    RobotModelError
        A quaternion is not four finite numbers, stands beside an rpy, or in a file of version 1.0,
        in which it means nothing to other readers.
    """
    for element in root.iter():
        origin = element.find("origin")
        if origin is None or (text := origin.attrib.pop("quat_xyzw", None)) is None:
            continue
        of = f"<{element.tag}> {shown(element.get('name', ''))}"
        values = numbers(text)
        why, hint = "", ""
        if len(values) != 4 or not any(values):
            why, hint = "not four finite numbers that are a rotation", "correct it"
        elif "rpy" in origin.attrib:
            why, hint = f"and rpy={shown(origin.get('rpy'))}", "leave one of them out"
        elif (root.get("version") or "1.0") not in _WITH_QUATERNIONS:
            hint = 'if the quaternion is meant, write <robot version="1.1">'
            why = "which URDF 1.0 does not have: others would read no rotation"
        if why:
            raise model_error(
                path, f"an origin of {of} has quat_xyzw={shown(text)}, {why}", hint, "quat_xyzw"
            )
        x, y, z, w = values
        R = rotation_from_quaternion(np.array([w, x, y, z]) / max(map(abs, values)))
        origin.set("rpy", spread(rpy_of(R).tolist()))


_WITH_QUATERNIONS = ("1.1", "1.2")


def _add_joint(joint: Element, out: Kinematics, path: Path) -> None:
    name, kind = joint.get("name", ""), joint.get("type", "")

    def fail(what: str, hint: str) -> RobotModelError:
        return model_error(path, f"joint {shown(name)} {what}", hint, name)

    if not name or not name.isprintable():
        raise fail("has no name in one line", "name every joint")
    if kind not in JOINT_TYPES:
        raise fail(f"has the unknown type {shown(kind)}", near_names(kind, JOINT_TYPES))
    written = SubElement(out.root, "joint", name=name, type=kind)
    for end in ("parent", "child"):
        element = joint.find(end)
        if element is None or not element.get("link"):
            raise fail(f"has no <{end} link=...>", "add it")
        SubElement(written, end, link=element.get("link", ""))
    origin = SubElement(written, "origin")
    for tag, key in (("origin", "xyz"), ("origin", "rpy"), ("axis", "xyz")):
        element = joint.find(tag)
        text = None if element is None else element.get(key)
        values = [0.0, 0.0, 0.0] if text is None else numbers(text)
        if len(values) != 3:
            raise fail(f"has {tag} {key}={shown(text)}, not three finite numbers", "correct it")
        if tag == "axis":
            if element is not None and kind != "fixed":
                SubElement(written, "axis", xyz=spread(_direction(values, fail)))
            continue
        if key == "xyz" and max(map(abs, values)) > FARTHEST_M:
            raise fail(f"has origin xyz={shown(text)}, beyond {FARTHEST_M:g} m", "give metres")
        origin.set(key, spread(values))
    if kind in MOVING:
        _add_limits(joint, written, out, path)


def _direction(values: list[float], fail: _Fail) -> list[float]:
    largest = max(map(abs, values))
    if largest == 0.0:
        raise fail("has an axis of length zero", "give the direction of the axis")
    scaled = [v / largest for v in values]
    return [v / math.hypot(*scaled) for v in scaled]


def _add_limits(joint: Element, written: Element, out: Kinematics, path: Path) -> None:
    """Write the limits of a moving joint; where they cannot be used, keep the reason."""
    name = written.get("name", "")
    mimic = joint.find("mimic")
    if mimic is not None:
        given = numbers(f"{mimic.get('multiplier', '1')} {mimic.get('offset', '0')}")
        if len(given) == 2:
            out.led[name] = mimic.get("joint", ""), given[0], given[1]
        out.flaws[name] = model_error(
            path,
            f"joint {shown(name)} follows another joint (mimic)",
            "only independent joints can be calibrated: name another base or tip, or hold it "
            "at zero with lock",
            name,
        )
    if written.get("type") == "continuous":  # to which Pinocchio gives two numbers
        written.set("type", "revolute")
        found = joint.find("limit")
        speed = [] if found is None else numbers(found.get("velocity", ""))
        limits = {"lower": -2.0 * math.pi, "upper": 2.0 * math.pi, "velocity": sum(speed[:1])}
        out.notices[name] = f"continuous joint {name} is read as one of +-360 deg"
    else:
        limits = {"lower": 0.0, "upper": 0.0, "velocity": 0.0}
        wrong = _read_limits(joint.find("limit"), limits, written.get("type") == "prismatic")
        if wrong:
            out.flaws.setdefault(
                name,
                model_error(
                    path,
                    f"joint {shown(name)} {wrong[0]}",
                    f"{wrong[1]}, or hold the joint at zero with lock",
                    name,
                ),
            )
            limits = {"lower": 0.0, "upper": 0.0, "velocity": 0.0}
    SubElement(written, "limit", {k: repr(v) for k, v in limits.items()}, effort="0")


def _read_limits(
    found: Element | None, limits: dict[str, float], slides: bool
) -> tuple[str, str] | None:
    """Fill in the limits of a joint; or say what is wrong with them, and what to do."""
    if found is None:
        return "has no <limit>", "add lower, upper and velocity, or make it continuous"
    for key in limits:
        value = numbers(found.get(key, "0"))
        if len(value) != 1:
            return f"has limit {key}={shown(found.get(key))}, not a finite number", "correct it"
        limits[key] = value[0]
    lower, upper = limits["lower"], limits["upper"]
    if lower > upper:
        return (
            f"has its limits reversed: lower {lower:g} is above upper {upper:g}",
            "swap them",
        )
    if slides and max(-lower, upper) > LONGEST_SLIDE_M:
        return f"slides from {lower:g} to {upper:g} m", "give its limits in metres"
    if max(-lower, upper) > LARGEST_TURN_RAD:
        return (
            f"has limits {lower:g} to {upper:g}, more than a hundred turns",
            "give the limits of the arm in rad, or make it continuous",
        )
    return None


def _add_link(link: Element, out: Kinematics, path: Path) -> None:
    """An <inertial> that Pinocchio cannot read it leaves out: the link would weigh nothing."""
    name = link.get("name", "")
    if not name or not name.isprintable():
        raise model_error(
            path, f"link {shown(name)} has no name in one line", "name every link", name
        )
    written = SubElement(out.root, "link", name=name)
    inertial = link.find("inertial")
    if inertial is None:
        return
    copy = SubElement(written, "inertial")
    needed = [("mass", "value"), *(("inertia", f"i{axes}") for axes in _TENSOR)]
    for tag, key in [*needed, ("origin", "xyz"), ("origin", "rpy")]:
        element = inertial.find(tag)
        text = None if element is None else element.get(key)
        if text is None and tag == "origin":
            continue
        values = numbers(text or "")
        if (
            len(values) != (3 if tag == "origin" else 1)
            or (tag == "mass" and not 0.0 <= values[0] <= LARGEST_MASS_KG)
            or (key == "xyz" and max(map(abs, values)) > FARTHEST_M)
        ):
            raise model_error(
                path,
                f"link {shown(name)} has inertial {tag} {key}={shown(text)}",
                "correct it, or leave <inertial> out",
                name,
            )
        place = copy.find(tag)
        (SubElement(copy, tag) if place is None else place).set(key, spread(values))


def _check_tree(root: Element, path: Path) -> None:
    """One root, every link named once, every joint between links that exist."""
    links = [link.get("name", "") for link in root.iterfind("link")]
    joints = list(root.iterfind("joint"))
    for what, names in (("link", links), ("joint", [j.get("name", "") for j in joints])):
        double = [n for n, count in Counter(names).items() if count > 1]
        if double:
            raise model_error(
                path, f"{what} {shown(min(double))} is defined twice", "rename one", min(double)
            )
    known = set(links)
    parent: dict[str, str] = {}
    children: dict[str, list[str]] = {}
    for joint in joints:
        above, below = (_attribute(joint, end) for end in ("parent", "child"))
        for link in (above, below):
            if link not in known:
                raise model_error(
                    path,
                    f"joint {shown(joint.get('name'))} names a missing link {shown(link)}",
                    "add the link or correct the name",
                    link,
                )
        if below in parent:
            raise model_error(
                path, f"link {shown(below)} has two parents", "a URDF is a tree", below
            )
        parent[below] = above
        children.setdefault(above, []).append(below)
    roots = [link for link in links if link not in parent]
    if len(roots) != 1:
        raise model_error(
            path,
            f"has {len(roots)} root links ({', '.join(roots[:5])[:200]}), not one",
            "join them with fixed joints",
        )
    reached = roots
    for link in reached:  # grows as it is gone through
        reached.extend(children.get(link, ()))
    if len(reached) < len(links):
        ring = min(known - set(reached))
        raise model_error(
            path,
            f"link {shown(ring)} hangs on itself, through a ring of joints",
            "a URDF is a tree",
            ring,
        )


def _attribute(joint: Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
