"""What an SRDF says beside a URDF: groups of joints, named postures, links that may touch.

The semantic description of ROS (http://wiki.ros.org/srdf, and of MoveIt 2
``disable_default_collisions`` and ``enable_collisions``). The file may come from anywhere: it is
read with document types refused, and an element that is not known is refused by its name. What
only MoveIt has a use for (virtual and passive joints, end effectors, spheres) is known and left.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from xml.etree.ElementTree import Element

from calib.errors import RobotModelError, model_error, near_names
from calib.robots.description.urdf import JointLinks, read_description
from calib.robots.description.urdf_kinematics import numbers, shown
from calib.robots.shapes import Body

_KNOWN = (
    "group",
    "group_state",
    "disable_collisions",
    "disable_default_collisions",
    "enable_collisions",
    "virtual_joint",
    "passive_joint",
    "end_effector",
    "link_sphere_approximation",
    "joint_property",
)

MOST_ELEMENTS = 100_000
"""Every pair of 400 links is 80,000."""


_NONE: Mapping[str, JointLinks] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Srdf:
    """What an SRDF holds."""

    path: Path
    chains: Mapping[str, tuple[str, str]]  # base and tip link of each group that is one chain
    listed: Mapping[str, Sequence[tuple[str, str]]]
    """Of each group that lists joints or links: ``joint`` or ``link``, and the name."""
    groups: tuple[str, ...]  # names of all groups
    states: Mapping[tuple[str, str], Mapping[str, float]]
    """Values of joints [rad, m], by group and name."""
    allowed: frozenset[frozenset[str]]  # pairs of links that may touch
    allowed_of: frozenset[str]  # links that may touch all others
    enabled: frozenset[frozenset[str]]  # pairs that are checked all the same

    def chain(self, group: str, joints: Mapping[str, JointLinks] = _NONE) -> tuple[str, str]:
        """Base and tip link of a group.

        ``joints`` of the robot, by name: a group that lists joints or links is the chain from the
        first to the last of them, if they are all that moves in it.
        """
        if group not in self.groups:
            raise self._fail(f"has no group {shown(group)}", near_names(group, self.groups), group)
        if group in self.chains:
            return self.chains[group]
        hint = "give base and tip themselves" + (
            f"; groups that are a chain: {', '.join(self.chains)}" if self.chains else ""
        )
        names = self.listed.get(group, ())
        above = {links.child: (name, links) for name, links in joints.items()}
        moved = {above[name][0] for tag, name in names if tag == "link" and name in above}
        wanted = {name for tag, name in names if tag == "joint" and name in joints} | moved
        tips = {joints[name].child for name in wanted} - {
            link for name in wanted for link in _links_above(joints[name].parent, above)
        }
        if len(tips) != 1:
            what = "lists joints or links that are no chain in" if wanted else "lists no chain in"
            raise self._fail(f"{what} the group {shown(group)}", hint, group)
        tip = tips.pop()
        path = [above[link] for link in _links_above(tip, above) if link in above]
        listed = [k for k, (name, _) in enumerate(path) if name in wanted]
        between = [name for name, links in path[: listed[-1]] if links.moves and name not in wanted]
        if between:
            what = f"leaves {', '.join(between)}, amid its chain, out of the group {shown(group)}"
            raise self._fail(what, hint, group)
        return path[listed[-1]][1].parent, tip

    def state(self, name: str, group: str | None = None) -> Mapping[str, float]:
        """Values of joints [rad, m] in a state, of one group or of the only one that has it."""
        of = [g for g, state in self.states if state == name and group in (None, g)]
        if not of:
            known = [state for g, state in self.states if group in (None, g)]
            where = "" if group is None else f" of the group {shown(group)}"
            raise self._fail(f"has no state {shown(name)}{where}", near_names(name, known), name)
        if len(of) > 1:
            raise self._fail(
                f"has a state {shown(name)} of the groups {', '.join(of)}", "name the group", name
            )
        return self.states[of[0], name]

    def allows(self, one: str, other: str) -> bool:
        """Whether two links may touch."""
        pair = frozenset((one, other))
        return pair not in self.enabled and (pair in self.allowed or bool(pair & self.allowed_of))

    def _fail(self, what: str, hint: str, name: str) -> RobotModelError:
        return model_error(self.path, f"{what}", hint, name)


def _links_above(link: str, above: Mapping[str, tuple[str, JointLinks]]) -> list[str]:
    """Return a link and those that it hangs on, up to the root."""
    found = [link]
    while found[-1] in above:
        found.append(above[found[-1]][1].parent)
    return found


def load_srdf(path: Path, packages: Iterable[Path] = ()) -> Srdf:
    """Read an SRDF file, or a xacro file that expands to one with its arguments at their defaults.

    Raises
    ------
    RobotModelError
        The file is missing, too large or no SRDF, or something in it is not understood.
    """
    root = read_description(path, packages, hint="give the .srdf of a MoveIt configuration").root
    if len(list(root.iter())) > MOST_ELEMENTS:
        raise model_error(path, f"has more than {MOST_ELEMENTS} elements", "is it an SRDF?")
    for element in root:
        tag = str(element.tag)
        if tag not in _KNOWN:
            is_urdf = tag in ("link", "joint")
            raise model_error(
                path,
                f"the element {shown(tag)} is not known in an SRDF",
                "is it a URDF?" if is_urdf else near_names(tag, _KNOWN),
                tag,
            )

    def pairs(tag: str) -> frozenset[frozenset[str]]:
        found = root.iterfind(tag)
        return frozenset(
            frozenset(_word(e, key, path) for key in ("link1", "link2")) for e in found
        )

    chains, listed = {}, {}
    for group in root.iterfind("group"):
        parts = list(group)
        if parts and all(part.tag in ("joint", "link") for part in parts):
            names = [(str(part.tag), _word(part, "name", path)) for part in parts]
            listed[_word(group, "name", path)] = tuple(names)
        if len(parts) == 1 and parts[0].tag == "chain":
            ends = (_word(parts[0], key, path) for key in ("base_link", "tip_link"))
            chains[_word(group, "name", path)] = next(ends), next(ends)
    every_state = root.iterfind("group_state")
    every = root.iterfind("disable_default_collisions")
    return Srdf(
        path=path,
        chains=MappingProxyType(chains),
        listed=MappingProxyType(listed),
        groups=tuple(_word(group, "name", path) for group in root.iterfind("group")),
        states=MappingProxyType(dict(_state(state, path) for state in every_state)),
        allowed=pairs("disable_collisions"),
        allowed_of=frozenset(_word(element, "link", path) for element in every),
        enabled=pairs("enable_collisions"),
    )


def _word(element: Element, key: str, path: Path) -> str:
    value = element.get(key, "").strip()
    if not value or not value.isprintable():
        raise model_error(
            path,
            f"<{element.tag}> has {key}={shown(element.get(key))}, which names nothing",
            "add it",
            str(element.tag),
        )
    return value


def _state(state: Element, path: Path) -> tuple[tuple[str, str], Mapping[str, float]]:
    name = _word(state, "name", path)
    values = {}
    for element in state.iterfind("joint"):
        joint, value = _word(element, "name", path), numbers(element.get("value", ""))
        if len(value) > 1:  # floating and planar joints have several; no arm has such joints
            continue
        if not value:
            raise model_error(
                path,
                f"the state {shown(name)} has {shown(joint)} at "
                f"{shown(element.get('value'))}, no number",
                "give rad, or m",
                joint,
            )
        values[joint] = value[0]
    return (_word(state, "group", path), name), MappingProxyType(values)


def allowed_contacts(bodies: Sequence[Body], srdf: Srdf) -> tuple[tuple[str, str], ...]:
    """Names of the bodies of a robot that may touch by an SRDF."""
    told = srdf.allowed_of.union(*srdf.allowed, *srdf.enabled)
    links = sorted(told, key=len, reverse=True)

    def link_of(body: str) -> str:
        """Bodies have the name of their link, with a number or a name of their own behind it."""
        return next((link for link in links if f"{body}/".startswith(f"{link}/")), body)

    of = {body.name: link_of(body.name) for body in bodies}
    return tuple(
        (one, other)
        for one, other in combinations(of, 2)
        if of[one] != of[other] and srdf.allows(of[one], of[other])
    )
