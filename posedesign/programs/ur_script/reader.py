"""Universal Robots URScript programs (``.script``): the reader of what is written and generated.

Positions are the targets of ``movej``, ``movel`` and ``movep`` in their order: lists of joints and
poses ``p[...]``, there or in variables (``q1=[...]``, ``global Waypoint_1_q=[...]``), also inside
``get_inverse_kin`` and ``pose_trans``; a target that is moved to again is one position. Without any
move the lists of joints in variables are taken: all of a file that is nothing but lists, those that
PolyScope names (``Waypoint_1_q``) of a program, whose other lists are speeds and forces. Numbers
are those of comments ``# POSE n name`` above the moves, where there are any: other targets then
stand behind all.

A pose whose joints stand beside it has both: PolyScope stores ``Waypoint_1_p`` and ``Waypoint_1_q``
together, and below ``# POSE n`` the joints are those planned. Any other ``qnear`` only says which
arm position is near, and a pose with it is a pose alone. What cannot be known from the text, like
``movej(pose_add(...))`` or a list that an element of was assigned to, is refused, but for moves
that are none of the numbered poses.

Poses are in the base frame, or in the frames of ``pose_trans``, and of the TCP that ``set_tcp`` has
set above the move, or that ``get_inverse_kin`` names. A TCP that cannot be known from the text, or
is set in a branch, a loop or a function in another way, leaves the tool frame open. A pose that is
moved to with two TCPs is refused.

What the robot did is in the log of a run, not in the script: see :mod:`.log`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from lark import Token, Tree

from calib.se3 import FloatArray, rotation_exp, transform
from posedesign.programs.language import (
    MOST_FAULTS,
    MOST_LENGTH,
    Block,
    Language,
    Line,
    Statement,
    text_of,
    words,
)
from posedesign.programs.numbering import Announced
from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM, number, refuse
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import RecordedPosition, RecordedProgram
from posedesign.programs.ur_script.functions import MOVES, PARAMETERS

Node = Tree[Token] | Token

JOINTS = 6
MOST_JOINT_RAD = float(np.radians(MOST_JOINT_DEG))

BLOCKS = {
    "define": Block("end"),
    "thread": Block("end"),
    "secondary": Block("end"),
    "if_": Block("end", ("elif_", "else_")),
    "while_": Block("end"),
}

_MOST_LINES = 300
"""Of one statement."""

_QUOTED_OR_REMARK = re.compile(r'("[^"\n]*")|#([^\n]*)')
_SAID = re.compile(r'"[^"\n]*"|#([ \t]*(?:POSE\s+\d|PLAN|Title:)[^\n]*)|#[^\n]*')
_KEYWORD_FIRST = re.compile(r"\s*(?:def|thread|sec|if|elif|else|while|end|global|local|return)\b")
_OPENS = re.compile(r"\s*(?:def|thread|if|while|for|sec|switch)\b.*:\s*")
_MATTERS = re.compile(r"\b(?:move[jlpc]|set_tcp)\b|[\[=]")
"""A statement that may hold a position or change a frame, where it cannot be read."""
_LONG = 100
"""Characters of a statement that may hold anything."""

_DEGREES = re.compile(r"d2r\(([-+.\deE]{1,40})\)", re.ASCII)
_TITLE = re.compile(r"\s*Title:\s*(.*)")
_STEM = re.compile(r"(.+)_[qp]")


def join_lines(lines: Iterator[Line]) -> Iterator[Line]:
    """Leave remarks out, and make one statement of lines while a bracket is open."""
    row, parts, opened, length = 0, [""], 0, 0
    for line in lines:
        code = line.text
        if code[0] == "#":
            continue
        if "#" in code:
            code = _QUOTED_OR_REMARK.sub(lambda found: found[1] or "", code)
        bare = _QUOTED_OR_REMARK.sub("", code) if '"' in code else code
        goes_on = opened > 0 and length < MOST_LENGTH and len(parts) < _MOST_LINES
        if not goes_on or _KEYWORD_FIRST.match(code):
            yield from _whole(row, parts)
            row, parts, opened, length = line.row, [], 0, 0
        parts.append(code)
        length += len(code)
        opened += bare.count("(") + bare.count("[") - bare.count(")") - bare.count("]")
    yield from _whole(row, parts)


def _whole(row: int, parts: list[str]) -> Iterator[Line]:
    text = parts[0] if len(parts) == 1 else " ".join(parts)
    if text and not text.isspace():
        yield Line(row, text)


LANGUAGE = Language(__package__, joined=join_lines, signed=True)


def arguments(call: Tree[Token]) -> list[tuple[str, Node]]:
    """Keywords, empty for none, and expressions of the arguments of a call."""
    given: list[tuple[str, Node]] = []
    for argument in call.children:
        if isinstance(argument, Tree) and argument.data == "argument":
            *keyword, value = argument.children
            given.append((str(keyword[0]) if keyword else "", value))
    return given


def by_name(name: str, given: Sequence[tuple[str, Node]]) -> dict[str, Node]:
    """Arguments of a function by the names of its parameters; a move has its target as ``q``."""
    parameters = PARAMETERS[name][1]
    out = {}
    for k, (keyword, value) in enumerate(given):
        if keyword or k < len(parameters):
            out[keyword or parameters[k]] = value
    if name in MOVES and "pose" in out:
        out.setdefault("q", out.pop("pose"))
    return out


def shown(node: Node | None) -> str:
    """An expression as it stands, for messages."""
    return text_of(node) if isinstance(node, Tree) else str(node or "")


def elements(node: Tree[Token]) -> list[Node]:
    """What stands between the brackets and commas of a list or a pose."""
    return node.children[1:-1:2]


def six(parts: Sequence[str], what: str, most: float, path: Path | str, row: int) -> list[float]:
    """Six numbers within ``+-most`` of the elements of a list or a pose [rad, m]."""
    if len(parts) != JOINTS:
        refuse(f"{what} has {len(parts)} values, not six", path, row, "is this another robot's?")
    values = []
    for j, part in enumerate(parts, start=1):
        degrees = _DEGREES.fullmatch(part) if part.startswith("d2r") else None
        value = number(degrees[1] if degrees else part, f"{what}: value {j}", path, row, 1e9)
        values.append(float(np.radians(value)) if degrees else value)
        if abs(values[-1]) > most:
            reason = f"{what}: value {j} is {part[:30]}, beyond +-{most:.4g}"
            refuse(reason, path, row, "joints are in radians, coordinates in metres")
    return values


def parse_ur_script(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; see the module.

    Raises
    ------
    FileFormatError
        The file is no script, is cut off, or holds a position that cannot be read.
    """
    text = text_of_file(data, path, "name a text file", strict=True)
    reader = _Reader(path)
    remarks = _remarks(text)
    remark = next(remarks, None)
    statements = LANGUAGE.statements(text)
    if sum(1 for statement in statements if statement.fault) >= MOST_FAULTS:
        refuse("is no script: hardly a line of it can be read", path, statements[0].row)
    for statement in statements:
        while remark is not None and remark[0] <= statement.row:
            reader.remark(*remark)
            remark = next(remarks, None)
        reader.take(statement)
    for said in chain([remark] if remark else [], remarks):
        reader.remark(*said)
    if reader.depth > 0:
        row = text.count("\n") + 1
        refuse("is cut off: a def, if, while, ... has no end", path, row, "copy it again")
    positions = reader.positions()
    if not positions:
        refuse("holds no positions", path, None, "name a script with movej, or the log of its run")
    name = reader.name or Path(path).stem
    return RecordedProgram(name, reader.title, reader.announced.mark, positions, "ur")


def _remarks(text: str) -> Iterator[tuple[int, str]]:
    """Lines and texts of the remarks that say something of poses, plan or title."""
    row, last = 1, 0
    for found in _SAID.finditer(text):
        if found[1]:
            row += text.count("\n", last, found.start())
            last = found.start()
            yield row, found[1]


@dataclass(frozen=True)
class Target:
    """A list of joints, or a pose, or both: in a variable, where that has a name.

    ``frames`` are those that the pose is in, from the base frame on; ``tcp`` is the TCP that is
    brought there, where the script says which.
    """

    row: int
    variable: str
    joints: Tree[Token] | None = None
    pose: Tree[Token] | None = None
    frames: tuple[Tree[Token], ...] = ()
    tcp: Tree[Token] | None = None

    @property
    def name(self) -> str:
        """The variable's name without PolyScope's _q and _p."""
        stem = _STEM.fullmatch(self.variable)
        return stem[1] if stem else self.variable

    @property
    def key(self) -> tuple[str, int]:
        """Tells it from all others."""
        return self.variable, self.row


class _Reader:
    """Goes through the statements."""

    def __init__(self, path: Path | str) -> None:
        self.path = path
        self.name = self.title = ""
        self.announced = Announced(path)
        self.depth = 0
        self._is_program = False
        self._lists: dict[str, Target] = {}
        self._changed: tuple[str, int] | None = None
        self._tcp: Tree[Token] | None = None
        self._found: dict[tuple[str, int], Target] = {}
        self._unknown: tuple[str, int] | None = None

    def remark(self, row: int, text: str) -> None:
        """Take what stands behind a hash."""
        title = _TITLE.fullmatch(text)
        if title:
            self.title = self.title or title[1].strip()
        else:
            self.announced.take(text, row)

    def take(self, statement: Statement) -> None:
        """Take one more statement."""
        row, text = statement.row, statement.text
        if statement.fault and (len(text) >= _LONG or _MATTERS.search(text)):
            refuse(statement.fault, self.path, row)
        opens = statement.kind in BLOCKS or (statement.fault and _OPENS.fullmatch(text))
        if opens:
            self.depth += 1
            self._is_program = True
        elif statement.kind == "end":
            self.depth -= 1
        elif statement.kind == "assign":
            self._assign(statement)
        if statement.kind == "define" and not self.name:
            self.name = statement.word("NAME")
        if "move" not in text and "set_tcp" not in text:
            return
        for call in statement.all("call"):
            if call.children[0] == "set_tcp":
                self._set_tcp(call, row)
            elif call.children[0] in (*MOVES, "movec"):
                self._move(call, row)

    def _assign(self, statement: Statement) -> None:
        """Keep a list; one that an element of is assigned to is not known any more."""
        place, value = statement.tree.children
        if isinstance(place, Token):
            kept = self._target(value, statement.row)
            if isinstance(value, Tree) and value.data in ("list", "pose") and kept is not None:
                self._lists[place] = replace(kept, variable=str(place))
            else:
                self._lists.pop(place, None)
            return
        names = words(place, "NAME", "POSE") if isinstance(place, Tree) else []
        name = names[0].rstrip(" [") if names else ""
        if self._lists.pop(name, None):
            self._changed = self._changed or (name, statement.row)

    def _target(self, node: Node | None, row: int, *, planned: bool = False) -> Target | None:
        """What an expression is; None where its text does not tell.

        ``planned``: joints beside a pose in the move itself are those of the pose.
        """
        if not isinstance(node, Tree):
            return self._lists.get(str(node))
        if node.data == "list":
            return Target(row, "", joints=node)
        if node.data == "pose":
            return Target(row, "", pose=node)
        if node.data != "call" or node.children[0] not in ("pose_trans", "get_inverse_kin"):
            return None
        given = by_name(str(node.children[0]), arguments(node))
        if node.children[0] == "get_inverse_kin":
            return self._inverse(given, row, planned=planned)
        frame = self._target(given.get("p_from"), row)
        inner = self._target(given.get("p_from_to"), row)
        if inner is None or inner.pose is None or frame is None or frame.pose is None:
            return None
        return replace(inner, frames=(*frame.frames, frame.pose, *inner.frames))

    def _inverse(self, given: dict[str, Node], row: int, *, planned: bool) -> Target | None:
        pose = self._target(given.get("x"), row)
        if pose is None or pose.pose is None:
            return None
        if shown(given.get("tcp")) not in ("", "active_tcp", '""', '"active_tcp"'):
            named = self._target(given["tcp"], row)
            if named is None or named.pose is None or named.frames:
                return None
            pose = replace(pose, tcp=named.pose)
        near = self._target(given.get("qnear"), row)
        if near is None or near.joints is None:
            return pose
        pair = (f"{pose.name}_p", f"{pose.name}_q")
        in_pair = bool(pose.variable) and (pose.variable, near.variable) == pair
        in_move = planned and not pose.variable and not near.variable
        return replace(pose, joints=near.joints) if in_pair or in_move else pose

    def _set_tcp(self, call: Tree[Token], row: int) -> None:
        target = self._target(by_name("set_tcp", arguments(call)).get("pose"), row)
        tcp = target.pose if target is not None and not target.frames else None
        # inside a branch, a loop or a function nobody knows when it is set
        self._tcp = tcp if self.depth <= 1 or tcp == self._tcp else None

    def _move(self, call: Tree[Token], row: int) -> None:
        kind = str(call.children[0])
        place = by_name(kind, arguments(call)).get("q") if kind in MOVES else None
        target = self._target(place, row, planned=self.announced.waiting is not None)
        if target is None:
            self.announced.end()
            self._unknown = self._unknown or (shown(place or call), row)
            return
        if target.pose is not None and target.tcp is None:
            target = replace(target, tcp=self._tcp)
        if self._found.setdefault(target.key, target).tcp != target.tcp:
            reason = f"moves to {target.variable[:30]} with another TCP than before"
            refuse(reason, self.path, row, "give it one TCP, or move to joints")
        self.announced.move(target.key, target.variable or "the target")

    def positions(self) -> tuple[RecordedPosition, ...]:
        """All positions, numbered."""
        self.announced.end()
        if self._unknown is not None and not self.announced.found:
            text, row = self._unknown
            reason = f"the target {text[:40]!a} cannot be known from the text"
            refuse(reason, self.path, row, "move to a list of joints, or read the log of a run")
        found = self._found or self._listed()
        numbers = self.announced.numbered([(key, t.name) for key, t in found.items()], {})
        out: list[RecordedPosition] = []
        posed: list[tuple[int, Target]] = []
        frames = next((target.frames for target in found.values() if target.pose is not None), ())
        for (n, name), target in zip(numbers, found.values(), strict=True):
            what = f"position {n}"
            joints = None
            if target.joints is not None:
                values = [shown(node) for node in elements(target.joints)]
                joints = np.degrees(six(values, what, MOST_JOINT_RAD, self.path, target.row))
            if target.pose is not None:
                posed.append((len(out), target))
                if target.frames != frames:
                    reason = f"{what} is in another frame than positions before"
                    hint = "use one frame in pose_trans, or joints"
                    refuse(reason, self.path, target.row, hint)
            out.append(RecordedPosition(n, name, target.row, joints))
        if posed:
            self._add_poses(out, posed, frames)
        return tuple(out)

    def _listed(self) -> dict[tuple[str, int], Target]:
        """Lists of joints of a file without moves, each with the pose that PolyScope stores."""
        if self._changed is not None:
            name, row = self._changed
            reason = f"an element of {name[:30]} is changed: what it is then is not known"
            refuse(reason, self.path, row, "give whole lists")
        out = {}
        for name, target in self._lists.items():
            named = name.endswith("_q")
            if target.joints is None or (self._is_program and not named):
                continue
            if len(elements(target.joints)) == JOINTS:
                beside = self._lists.get(f"{target.name}_p") if named else None
                out[target.key] = replace(target, pose=beside.pose if beside else None)
        return out

    def _add_poses(
        self,
        out: list[RecordedPosition],
        posed: list[tuple[int, Target]],
        frames: tuple[Tree[Token], ...],
    ) -> None:
        """Give positions their poses and frames, all in the same user frame."""
        T_world_user = np.eye(4)
        for frame in frames:
            (T,) = self._transforms([(frame, "the frame", posed[0][1].row)])
            T_world_user = T_world_user @ T
        rows = {target.tcp: target.row for _, target in reversed(posed) if target.tcp is not None}
        tools = {tcp: self._transforms([(tcp, "the TCP", row)])[0] for tcp, row in rows.items()}
        poses = self._transforms(
            [(t.pose, f"position {out[i].number}", t.row) for i, t in posed if t.pose is not None]
        )
        for (i, target), pose in zip(posed, poses, strict=True):
            out[i] = replace(
                out[i],
                T_user_tool=pose,
                T_world_user=T_world_user,
                T_tip_tool=None if target.tcp is None else tools[target.tcp],
            )

    def _transforms(self, poses: Sequence[tuple[Tree[Token], str, int]]) -> FloatArray:
        """Poses ``(N, 4, 4)`` with what they are and their lines."""
        most = MOST_POSITION_MM / 1e3
        values = np.array(
            [
                six([shown(node) for node in elements(pose)], what, most, self.path, row)
                for pose, what, row in poses
            ]
        )
        return transform(rotation_exp(values[:, 3:]), values[:, :3])
