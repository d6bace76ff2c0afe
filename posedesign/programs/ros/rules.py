"""Lists for ROS: one walk through the tree, lenient for the reader and strict for the validator.

The tools leave out entries of the wrong length without a word, or with one in a log, and those of
robot_calibration pass over unknown keys in silence. The validator asks:

===============  ================================================================================
``utf-8``        text in UTF-8
``yaml``         one well-formed YAML document
``plain-yaml``   no anchors, aliases and tags, no key twice, no deep nesting, not too many values
``keys``         the keys of the format and no others: of lists without times all, else those needed
``joint-names``  at least one joint name, texts that YAML reads as texts, each once
``length``       as many values as joint names
``number``       no quotes and NaN, nor what YAML 1.1 reads in other ways (010, 1e5, 1_000, 1:30)
``range``        joint values within +-720 deg
``entries``      at least one pose
``stamp``        a zero stamp, or now: a fixed one would lie in the past when the message is sent
``frame-id``     frame_id is a text
``time``         sec from 0 to 2147483647 and nanosec from 0 to 999999999, whole numbers
``increasing``   each point later than the one before: ros2_control refuses others
``standstill``   zero velocities at the last point, as ros2_control asks
``ending``       a name that ends in ``.yaml``: the dialog of MoveIt opens no other
``same-joints``  the same joints in each entry of robot_calibration
``features``     features are a list of texts
===============  ================================================================================

Of a trajectory, ``rostopic pub`` and ``ros2 topic pub`` leave what is not said as it is in an empty
message, and take a header that is ``auto`` and a stamp that is ``now``; the parts of a time have
other names in ROS 1. Goals of actions that hold one are taken, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from posedesign.files.yaml_tree import Fault, Node, Plain, documents, text_of
from posedesign.programs.reading import MOST_JOINT_DEG, number
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import MOST_PROBLEMS

_MOST_RAD = math.radians(MOST_JOINT_DEG)
_BILLION = 1_000_000_000
_TIME = {"sec": 2_147_483_647, "nanosec": _BILLION - 1}
_ROS_1 = {"secs": "sec", "nsecs": "nanosec"}
_NEEDED = ("joints", "positions")
_AROUND = ("goal", "trajectory", "joint_trajectory")
"""Keys that a trajectory is found under in messages that hold one."""

_BESIDE = re.compile(
    r"header|goal_id|multi_dof_trajectory|(?:component_)?(?:path|goal)\w*_tolerance"
)
_DECIMAL = r"[-+]?(?:(?:0|[1-9][0-9]{0,8})(?:\.[0-9]{0,20}(?:[eE][-+][0-9]{1,3})?)?|\.[0-9]{1,20})"
_STRICT, _LENIENT = re.compile(f"{_DECIMAL}(?: {_DECIMAL})*"), re.compile(r"[-+.0-9eE ]+")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,18}")
_NO_TEXT = re.compile(
    r"|~|null|y|n|yes|no|true|false|on|off|<<|=|[-+]?\.?[0-9][0-9_.:eExXa-fA-F+-]*"
    r"|[-+]?\.(?:inf|nan)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Layout:
    """Words for people, and keys: of the file, joint names and entries last, and of an entry.

    None of the file where it is the list of entries, none of an entry where it is one of values.
    """

    title: str
    whole: str
    entry: str
    entries: str
    keys: tuple[str, ...] = ()
    entry_keys: tuple[str, ...] = ()

    @property
    def timed(self) -> bool:
        """Whether entries have times, so that the arm can pass through or stand."""
        return "time_from_start" in self.entry_keys


RATES = ("velocities", "accelerations", "effort")
TRAJECTORY = Layout(
    *("trajectory_msgs/msg/JointTrajectory", "the trajectory", "point", "points"),
    ("header", "joint_names", "points"),
    ("positions", *RATES, "time_from_start"),
)
MOVEIT = Layout(
    *("joint states of moveit_calibration", "the file", "row", "joint values"),
    ("joint_names", "joint_values"),
)
CAPTURES = Layout(
    *("capture poses of robot_calibration", "the file", "entry", "poses"),
    entry_keys=("joints", "positions", "features"),
)


def check_list(data: bytes, path: Path, layout: Layout) -> list[Problem]:
    """Problems in the content of a file, at most a thousand; none for a good one."""
    walk = Walk(layout, path, strict=True)
    try:
        walk.entries(only(documents(text_of(data))))
    except Fault as fault:
        walk.problems.append(Problem(fault.line or 1, fault.rule, fault.message))
    if layout is MOVEIT and path.suffix != ".yaml":
        walk.problems.append(Problem(1, "ending", f"the name {path.name!a} does not end in .yaml"))
    return walk.problems


class Entry(NamedTuple):
    """Line, joint names and joint values [rad] of a posture."""

    line: int
    names: tuple[str, ...]
    values_rad: list[float]


@dataclass
class Walk:
    """Finds the entries of a list: a Fault ends a lenient walk, a strict one collects problems."""

    layout: Layout
    path: Path
    strict: bool
    problems: list[Problem] = field(default_factory=list)
    time: int = 0

    def tell(self, rule: str, node: Node, message: str, hint: str = Fault.hint) -> None:
        """Say what is wrong."""
        if not self.strict or len(self.problems) == MOST_PROBLEMS - 2:
            raise Fault(message, node.line, rule, hint)
        self.problems.append(Problem(node.line, rule, message))

    def entries(self, root: Node) -> list[Entry]:
        """The entries, their joint values finite and within +-720 deg."""
        layout, listed = self.layout, root
        names: tuple[str, ...] = ()
        if layout.keys:
            key, last = layout.keys[-2:]
            root = self.inner(root) if layout.timed else root
            fields = self.fields(root, layout.whole, layout.keys, (key, last))
            if self.strict and "header" in fields and fields["header"].value != "auto":
                self.header(fields["header"])
            names = self.names(fields.get(key), key)
            listed = fields.get(last) or Node([], 0)
        elif root.kind == "map" and not self.strict:
            listed = Node([root], root.line)
        items = listed.items(layout.keys[-1] if layout.keys else layout.whole)
        if not items and listed.line:
            self.tell("entries", listed, f"holds no {layout.entries}", "is it the right file?")
        found: list[Entry] = []
        for count, item in enumerate(items, start=1):
            what, values = f"{layout.entry} {count}", item
            if layout.entry_keys:
                fields = self.entry_fields(item, what)
                if not layout.keys:
                    names = self.names(fields.get("joints"), f"{what}: joints")
                if self.strict:
                    self.rest(fields, names, what, last=count == len(items))
                if "positions" not in fields:
                    continue
                what, values = f"{what}: positions", fields["positions"]
            found.append(Entry(item.line, names, self.values(values, names, what, _MOST_RAD)))
            if names != found[0].names and set(names) != set(found[0].names):
                reason = f"{layout.entry} {count} has other joints than entry 1"
                self.tell("same-joints", item, reason, "keep the joints of one arm")
        return found

    def inner(self, root: Node) -> Node:
        """The trajectory in the message that holds it."""
        for _ in _AROUND:
            fields = _by_key(root, self.layout.whole)
            key = next((key for key in _AROUND if key in fields), None)
            if key is None or "points" in fields:
                break
            for node, _ in root.pairs(self.layout.whole) if self.strict else ():
                if node.value != key and not _BESIDE.fullmatch(str(node.value)):
                    self.tell("keys", node, f"a goal has no key {str(node.value)[:60]!a}")
            root = fields[key]
        return root

    def entry_fields(self, entry: Node, what: str) -> dict[str, Node]:
        """The values of an entry that is a map; of a message, those of its joint states."""
        if not (self.strict or self.layout.keys):
            state = _by_key(entry, what).get("joint_states")
            if state is not None:
                found = self.fields(state, f"{what}: joint_states", (), ("name", "position"))
                return {"joints": found["name"], "positions": found["position"]}
        keys = self.layout.entry_keys
        needed = (*_NEEDED, *("time_from_start",) * self.strict)
        return self.fields(entry, what, keys, [key for key in keys if key in needed])

    def fields(
        self, node: Node, what: str, keys: Collection[str], few: Collection[str] = ()
    ) -> dict[str, Node]:
        """The values of a map by key: all keys of the format, or at least a few where lenient."""
        found: dict[str, Node] = {}
        where = "" if what == self.layout.whole else f"{what}: "
        for node_of_key, value in node.pairs(what):
            key = str(node_of_key.value)
            if self.strict and key not in keys:
                self.tell("keys", node_of_key, f"{what} has no key {key[:60]!a}")
            found[key] = value
        for key in keys if self.strict and not self.layout.timed else few:
            if key not in found:
                self.tell("keys", node, f"{where}{key} is missing")
        return found

    def names(self, node: Node | None, what: str) -> tuple[str, ...]:
        """Joint names: at least one, each once."""
        names: list[str] = []
        for item in node.items(what) if node else ():
            text = item.value.strip() if isinstance(item.value, str) else ""
            no_text = self.strict and type(item.value) is Plain and _NO_TEXT.fullmatch(text)
            if not text or no_text:
                self.tell("joint-names", item, f"{what} holds something that is not a name")
            elif item.value in names:
                self.tell("joint-names", item, f"{what} has {item.value[:60]!r} twice")
            names.append(str(item.value))
        if node and not names:
            self.tell("joint-names", node, f"{what} is empty")
        return tuple(names)

    def values(self, node: Node, names: tuple[str, ...], what: str, most: float) -> list[float]:
        """Numbers, one for each name."""
        items = node.items(what)
        if len(items) != len(names):
            reason = f"{what} has {len(items)} values, there are {len(names)} joints"
            self.tell("length", node, reason)
        texts = [item.value for item in items if type(item.value) is Plain]
        usual = _STRICT if self.strict else _LENIENT
        if len(texts) == len(items) and usual.fullmatch(" ".join(texts)):
            with suppress(ValueError):  # said below, with the joint
                values = [float(text) for text in texts]
                if max(map(abs, values)) <= most:
                    return values
        labels = [*names, *["one more"] * len(items)]
        return [self.value(item, f"{what}: {labels[k]}", most) for k, item in enumerate(items)]

    def value(self, item: Node, what: str, most: float) -> float:
        text = item.value if isinstance(item.value, str) else ""
        if item.kind != "value":
            self.tell("number", item, f"{what} is not a number")
        elif type(text) is not Plain:
            reason = f"{what} is {text[:30]!r}, a text in quotes, not a number"
            self.tell("number", item, reason)
        elif not self.strict:
            return number(str(text), what, self.path, item.line, most, "rad")
        elif not re.fullmatch(_DECIMAL, text):
            self.tell("number", item, f"{what} is {text[:30]!a}, not a plain number")
        elif abs(float(text)) > most:
            self.tell("range", item, f"{what} is {text} rad, beyond +-{most:g} rad")
        return 0.0

    def rest(
        self, fields: Mapping[str, Node], names: tuple[str, ...], what: str, *, last: bool
    ) -> None:
        """What only the validator looks at in an entry."""
        for key in RATES:
            if key in fields and fields[key].items(f"{what}: {key}"):
                values = self.values(fields[key], names, f"{what}: {key}", math.inf)
                if last and key == "velocities" and any(values):
                    self.tell("standstill", fields[key], "the arm still moves at the last point")
        if "time_from_start" in fields:
            time = self.nanoseconds(fields["time_from_start"], f"{what}: time_from_start")
            if time is not None and time <= self.time:
                reason = f"{what} is not later than what is before"
                self.tell("increasing", fields["time_from_start"], reason)
            self.time = self.time if time is None else time
        features = fields.get("features")
        for feature in features.items(f"{what}: features") if features else ():
            if not feature.value or feature.kind != "value":
                self.tell("features", feature, f"{what} has a feature that is no text")

    def header(self, header: Node) -> None:
        fields = self.fields(header, "header", ("seq", "stamp", "frame_id"))
        stamp = fields.get("stamp")
        if stamp and stamp.value != "now" and self.nanoseconds(stamp, "stamp"):
            self.tell("stamp", stamp, "the stamp is not zero")
        frame = fields.get("frame_id")
        if frame and (frame.kind != "value" or (not frame.value and type(frame.value) is Plain)):
            self.tell("frame-id", frame, "frame_id is not a text")

    def nanoseconds(self, node: Node, what: str) -> int | None:
        """A time; None where it is none."""
        keys = _ROS_1 if _ROS_1.keys() & _by_key(node, what).keys() else _TIME
        fields = self.fields(node, what, keys)
        if not fields.keys() <= keys.keys():
            return None
        parts = dict.fromkeys(_TIME, 0)
        for key in fields:
            same = _ROS_1.get(key, key)
            text, most = fields[key].value, _TIME[same]
            found = int(text) if type(text) is Plain and _WHOLE.fullmatch(text) else None
            if found is None or found > most:
                reason = f"{what}: {key} is not a whole number of 0 to {most}"
                self.tell("time", fields[key], reason)
                return None
            parts[same] = found
        return parts["sec"] * _BILLION + parts["nanosec"]


def only(roots: list[Node]) -> Node:
    """The document of a file; Fault where there is none, or another one.

    An empty document at the end, as ros2 topic echo adds, does not count.
    """
    roots = [root for root in roots if root.value or type(root.value) is not Plain]
    if not roots:
        raise Fault("is empty", None, hint="is it the right file?")
    if len(roots) > 1:
        raise Fault("holds several documents", roots[1].line, hint="keep one of them")
    return roots[0]


def _by_key(node: Node, what: str) -> dict[str, Node]:
    return {str(key.value): value for key, value in node.pairs(what)}
