"""Universal Robots programs as PolyScope saves them (``.urp``): XML, packed by gzip.

Written is one script node with the whole URScript program (:mod:`..ur_script`): such a node moves
to the joints that it names. Waypoints are not written: PolyScope takes them through the active TCP,
and public authors saw it refuse those of another one. The function of the script has another name
than the program, of which PolyScope makes a function around the tree.

Read is the tree as a script, node by node: waypoints (``JointAngles``, in radians) as moves, nodes
of scripts as their lines, comments as remarks; branches, loops and threads are blocks. The reader
and the rules of URScript then say what is in it, with the lines of the unpacked file. Refused are
waypoints in another feature than the base, which has perhaps moved since; relative and variable
waypoints; and scripts that move to variables which nodes assign.

Rules: those of URScript, and ``xml``: well-formed, no DTD, one node a line; ``node``: known nodes
have the attributes that they need, with values of their kind; ``joints``: of waypoints, within
+-363 deg. To measure, the kinematics block is there: PolyScope 5.12 loads no program without.

Sources: URP Syntax 1.0.0, sections 1 to 6, by an engineer of Universal Robots (FuNingHu/
urp-generator-5); what PolyScope 5.12 loaded in its simulator (JimothyJohn/UR-Docker,
urp_builder.py); RoboDK's Universal_Robots_URP.py. Nothing was run on a controller.
"""

from __future__ import annotations

import gzip
import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from defusedxml import DefusedXmlException, ElementTree

from posedesign.programs import language
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.joint_programs import PLAIN
from posedesign.programs.program import PoseProgram
from posedesign.programs.reading import MOST_LINES, no_positions, refuse
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.rules import CONTROL, check_bytes, measuring, near, told
from posedesign.programs.ur_script import UrScript
from posedesign.programs.ur_script.reader import MOST_LIMIT_DEG

_KINEMATICS = ("deltaTheta", "a", "d", "alpha", "jointChecksum")
_HEAD = f"""\
<URProgram name="{{0}}" installation="default" installationRelativePath="default" \
directory="/programs" createdIn="5.12.5.10626004" lastSavedIn="5.12.5.10626004" \
robotSerialNumber="">
  <kinematics status="NOT_LINEARIZED" validChecksum="false">
{"".join(f'    <{name} value="0, 0, 0, 0, 0, 0"/>{chr(10)}' for name in _KINEMATICS)}\
  </kinematics>
  <children>
    <MainProgram runOnlyOnce="true" InitVariablesNode="false">
      <children>
        <Script type="File">
          <cachedContents>"""
_END = """\
</cachedContents>
          <file resolves-to="file">/programs/{0}.script</file>
        </Script>
      </children>
    </MainProgram>
  </children>
</URProgram>
"""

_FLAG, _NUMBERS = "true|false", r"[-+.\deE]+(, *[-+.\deE]+){5}"
_NEEDED = {
    "URProgram": {"name": ".+", "installation": ".*", "directory": ".*", "createdIn": ".+"},
    "kinematics": {"status": "[A-Z_]+", "validChecksum": _FLAG},
    **{name: {"value": _NUMBERS} for name in _KINEMATICS},
    "MainProgram": {"runOnlyOnce": _FLAG},
    "Script": {"type": "File|Line|Code"},
    "file": {"resolves-to": "file"},
    "Move": {"motionType": "Move[JLPC]"},
    "Waypoint": {"type": "Fixed|Relative|Variable", "name": ".+"},
    "JointAngles": {"angles": _NUMBERS},
    "Comment": {"comment": "(?s:.*)"},
}
"""Attributes that nodes need, with patterns of their values; one that refers to another has none
of them."""

_OPTIONAL = """installationRelativePath lastSavedIn robotSerialNumber crcValue InitVariablesNode
createdInPolyscopeProgramVersion lastSavedInPolycopeProgramVersion kinematicsFlags positionType
useActiveTCP referencedName"""

_BASE = "Joint_0_name"  # what PolyScope calls the feature Base
_STRAIGHT = ("URProgram", "MainProgram", "Move", "Folder", "SpecialSequence")
"""Nodes whose children run once, in their order."""

_MOST_NODES, _MOST_DEPTH = 400_000, 60


class _FaultError(Exception):
    """A file is no tree that is read."""


@dataclass
class _Node:
    """A node that is open; ``feature``: of its moves; ``own``: the script of its line."""

    name: str
    row: int
    given: dict[str, str]
    texts: list[str] = field(default_factory=list)
    own: list[str] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)  # names of its children
    feature: str = _BASE
    path: tuple[str, ...] = ()  # by which other nodes refer to it


class _Flattened:
    """The script of a tree by line, and what is wrong with its nodes; else why it is none."""

    def __init__(self, data: bytes) -> None:
        self.parser = ElementTree.DefusedXMLParser(target=self, forbid_dtd=True)
        self.open: list[_Node] = []
        self.lines: dict[int, str] = {}
        self.problems: list[Problem] = []
        self.name, self.root, self.count, self.fault = "", "", 0, ""
        self._features: dict[tuple[str, ...], str] = {}
        try:
            if data.count(b"\n") > MOST_LINES:
                raise _FaultError(f"more than {MOST_LINES} lines")
            self.parser.feed(data)
            self.parser.close()
        except DefusedXmlException:
            self.fault = "has a DTD or entities"
        except (_FaultError, ElementTree.ParseError, LookupError, ValueError) as error:
            self.fault = f"is no whole tree: {error}"[:200]
        if not self.fault and self.root != "URProgram":
            self.fault = f"is no program of PolyScope, but <{self.root[:40]}>"

    @property
    def row(self) -> int:
        return max(int(self.parser.parser.CurrentLineNumber), 1)

    def start(self, tag: str, given: dict[str, str]) -> None:
        self.count += 1
        if self.count > _MOST_NODES or len(self.open) >= _MOST_DEPTH:
            raise _FaultError("too many nodes, or too deep ones")
        node, above = _Node(tag, self.row, given), self.open[-1] if self.open else _Node("", 0, {})
        self.name, self.root = (self.name, self.root) if self.open else (given.get("name", ""), tag)
        above.kinds[tag] += 1
        own = f"{tag}[{above.kinds[tag]}]" if above.kinds[tag] > 1 else tag
        node.feature, node.path = above.feature, (*above.path, own)
        self._check(node)
        if tag == "children" and above.name not in _STRAIGHT:
            self._say(node.row, "if True:")
        elif tag == "feature" and above.name == "Move":
            self._take_feature(node, above)
        elif tag == "JointAngles":
            self._waypoint(node)
        elif tag == "Waypoint" and given.get("type") in ("Relative", "Variable"):
            self._say(node.row, f"movej({given['type'].lower()}_waypoint)")
        elif tag == "Comment":
            self._say(node.row, f"# {' '.join(given.get('comment', '').split())}")
        elif tag in ("ExpressionToken", "ExpressionChar"):
            script = next((n for n in self.open[::-1] if n.name == "Script"), node)
            script.own.append(given.get("token", "") + given.get("character", ""))
        elif "name" in given and any(n.name == "Assignment" for n in self.open):
            self._say(node.row, f"{_word(given['name'])} = assigned_value")
        self.open.append(node)

    def _wrong(self, row: int, said: str, rule: str = "node") -> None:
        self.problems.append(Problem(row, rule, said))

    def _check(self, node: _Node) -> None:
        needed = {} if "reference" in node.given else _NEEDED.get(node.name, {})
        for name, pattern in needed.items():
            if name not in node.given or not re.fullmatch(pattern, node.given[name]):
                self._wrong(node.row, f"<{node.name}> has no right {name}")
        known = {*_OPTIONAL.split(), *needed}
        for name in node.given.keys() - known:
            if meant := near(name, known, least=5):
                self._wrong(node.row, f"{name[:40]} of <{node.name[:40]}> is nearly {meant}")

    def _take_feature(self, node: _Node, move: _Node) -> None:
        """The feature of a move: its name, or the path of another move's, from this node on."""
        *up, last = re.split(r"(?<=\.\.)/(?!\.)", node.given.get("reference", ""), maxsplit=1)
        path = node.path[: len(node.path) - sum(part.count("..") for part in up)]
        known = self._features.get((*path, *last.split("/")), "one that cannot be told")
        self._features[node.path] = named = node.given.get("referencedName", known)
        move.feature = _BASE if move.given.get("positionType") == "JointAngles" else named

    def _waypoint(self, node: _Node) -> None:
        waypoint = next((n for n in self.open[::-1] if n.name == "Waypoint"), node)
        name, angles = _word(waypoint.given.get("name", "at")) + "_q", node.given.get("angles", "")
        place = name if node.feature == _BASE else f"in_feature_{_word(node.feature)}"
        waypoint.own.append(name)
        if waypoint.given.get("type", "Fixed") == "Fixed":
            self._say(node.row, f"{name}=[{angles}] movej({place})")
        for text in map(str.strip, angles.split(",")):
            if PLAIN.fullmatch(text) and abs(float(text)) > np.radians(MOST_LIMIT_DEG):
                self._wrong(node.row, f"joint {text[:30]} is beyond all limits [rad]", "joints")

    def end(self, tag: str) -> None:
        node, above = self.open.pop(), self.open[-1] if self.open else _Node("", 0, {})
        text = "".join(node.texts)
        if node.kinds and text.strip():
            self._wrong(node.row, f"text between the nodes of <{tag[:40]}>")
        if tag == "children" and above.name not in _STRAIGHT:
            self._say(self.row, "end")
        elif tag == "file" and re.search(r'[<>"|?*\n]', text.strip()):
            self._wrong(node.row, "<file> is no path")
        elif tag == "cachedContents":
            for k, line in enumerate(text.split("\n"), start=self.row - text.count("\n")):
                self._say(k, line)  # text is kept back until it ends
        elif tag == "Script" and node.own:
            self._say(node.row, "".join(node.own))
        elif tag == "Waypoint" and node.given.get("type") == "Fixed" and not node.own:
            self._say(node.row, "movej(waypoint_without_joints)")
        elif tag == "kinematics" and {*node.kinds} != {*_KINEMATICS}:
            self._wrong(node.row, f"<kinematics> is not of {', '.join(_KINEMATICS)}")
        elif tag == "URProgram" and not {"kinematics", "children"} <= {*node.kinds}:
            said = "there is no <kinematics> and <children> in it"
            self.problems.append(measuring(node.row, "node", said))

    def _say(self, row: int, line: str) -> None:
        if row in self.lines and line.strip():
            raise _FaultError("several nodes on one line: save it by PolyScope")
        self.lines |= {row: line} if line.strip() else {}

    def data(self, text: str) -> None:
        self.open[-1].texts.append(text)

    def close(self) -> None:
        """Take the end of the file."""

    def script(self) -> bytes:
        """The script of the tree, each line where its node begins."""
        rows = range(1, max(self.lines, default=0) + 1)
        text = "\n".join([*(self.lines.get(row, "") for row in rows), ""])
        return text.encode("utf-8", "replace")


def _word(name: str) -> str:
    """A name of the tree as one of a script."""
    return re.sub(r"\W", "_", name, flags=re.ASCII) or "_"


def _flat(data: bytes) -> _Flattened:
    return language.shared(("urp", data), lambda: _Flattened(data))


def parse_ur_urp(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file, unpacked; see the module."""
    tree = _flat(data)
    if tree.fault:
        refuse(tree.fault, path, tree.row)
    if not tree.lines:
        no_positions(path, "save it with its waypoints")
    return replace(UrScript.reader(tree.script(), path), name=tree.name)


def check_ur_urp(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file; never fails."""
    tree, control = _flat(data), check_bytes(data, CONTROL)
    if tree.fault:
        return told([Problem(tree.row, "xml", tree.fault)], control)
    return told(tree.problems, UrScript.rules(tree.script(), path), control)


class UrUrp(Dialect):
    """Universal Robots programs of PolyScope."""

    name = "ur-urp"
    title = "Universal Robots program of PolyScope"
    maker = "ur"
    suffixes = (".urp",)
    remark = (r"<cachedContents>[^\n]*\n", "# {words}")
    names = UrScript.names
    limits = UrScript.limits
    notation = UrScript.notation
    reader = parse_ur_urp
    rules = check_ur_urp

    def packed(self, data: bytes) -> bytes:
        """By gzip, without a date: the same program is the same file."""
        return gzip.compress(data, mtime=0)

    def unchecked(self, arm: Arm) -> tuple[str, ...]:
        """What PolyScope makes of the file."""
        return ("whether PolyScope loads it: others saw 5.12 load such files",)

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The file: the script in its node."""
        ((_, script),) = UrScript().render(program, arm).items()
        name, lines = program.name, script.rstrip("\n").split("\n")
        lines[0], lines[-1] = f"def {name}_poses():", f"{name}_poses()"
        text = _HEAD.format(name) + escape("\n".join([*lines, ""])) + _END.format(name)
        return {f"{name}{self.suffixes[0]}": text}
