"""ABB RAPID modules (``.mod``, ``.modx``, ``.prg``): the reader.

All jointtargets and robtargets that are declared with a value are read, arrays of them too, and
those that stand in MoveAbsJ, MoveJ and MoveL themselves. ``p3`` and ``jp3`` are position 3; other
names are numbered behind, in the order of the file. Where a program keeps the touched-up positions
in ``jMeasured``, those stand in the place of the planned ones, and poses not yet measured are left
out as soon as one is measured. Poses have the frames of the motion to them, where the module
declares those with their values.

Both positions of a circle are read. A pose is unread where a program displacement (PDispOn) may be
on as the arm goes there. What would be read wrong in silence is refused with its line: a
position without a value, an external axis that moves, a pose in two frames, one that the program
changes, or of a part that the arm holds. A statement that
the grammar does not know is passed over only where it has nothing to do with any of that.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from lark import Token, Tree

from calib.errors import FileFormatError
from calib.se3 import FloatArray, rotation_from_quaternion, transform
from posedesign.programs import reading
from posedesign.programs.abb_rapid import module
from posedesign.programs.abb_rapid.module import FRAMES, LANGUAGE, SHAPES, Data, Nested, nested
from posedesign.programs.configurations import AbbConfiguration
from posedesign.programs.language import Node, Statement, is_a
from posedesign.programs.numbering import Numbering, Stored
from posedesign.programs.reading import (
    configuration_in,
    joint_deg,
    millimetres,
    no_positions,
    number,
    refuse,
)
from posedesign.programs.recorded import RecordedProgram

NORM_WITHIN = 2e-3
"""Of a quaternion's norm from 1, as people type them; the controller asks for less."""

_FLAGS = re.IGNORECASE | re.ASCII
_REMARK = re.compile(r'"[^"\n]*"?|!([^\n]*)')
_NUMBERED = re.compile(r"[JR]?P(\d{1,6})", _FLAGS)
_ELEMENT = re.compile(r"JMEASURED\{(\d{1,6})\}", _FLAGS)
_UNCONNECTED = re.compile(r"[19]\.?0*E\+?(0*9|10)", re.IGNORECASE)  # 9E9, or as people write it
_MATTERS = re.compile(r"jointtarget|robtarget|tooldata|wobjdata|move|pdisp|\[", _FLAGS)
_WORD = re.compile(r"[a-z]\w*", _FLAGS)
_BRANCHES = ("if", "for", "while", "test", "goto", "compact_if", "label", "fault")
_MOST_NAME = 99
_WHAT = "name a RAPID module saved as text: .mod or .modx"
_MOTION = re.compile(
    r"(?:(ARC|TRIGG)|(?:ARC)?MOVE)(?:(ABSJ)|[JL](?:START|END|[ADG]O|IOS|SYNC)?)", _FLAGS
)
"""Motions to one position, which is their first argument: of those of arc welding and of events
the last one is the tool, of the others the fourth."""


@dataclass(eq=False)
class StoredPosition(Stored):
    """One position as it stands in the file; ``parts`` are the texts of its numbers.

    The frames are those of the motion to it, where the module gives their values.
    """

    kind: str
    parts: list[list[str]]
    T_world_user: FloatArray | None = None
    T_tip_tool: FloatArray | None = None
    key: str = ""
    """Tells one that stands in a motion from the others."""

    @classmethod
    def of(
        cls, variable: str, line: int, kind: str, value: Nested | str, path: Path | str
    ) -> StoredPosition:
        """A position as its value stands in the file; FileFormatError where it is of no such."""
        if module.shape(value) != SHAPES[kind]:
            wanted = ", ".join(map(str, SHAPES[kind]))
            label = variable or "the position"
            refuse(f"{label} has not the lists of {wanted} numbers of a {kind}", path, line)
        return cls(variable, line, kind, value)  # type: ignore[arg-type]

    @property
    def cartesian(self) -> bool:
        return self.kind == "robtarget"

    @property
    def is_empty(self) -> bool:
        """Whether it is a place for a position and no position of the arm."""
        if self.cartesian:
            return set(self.parts[1]) == {"0"}
        return all(map(_UNCONNECTED.fullmatch, self.parts[0]))

    @property
    def has_fewer_axes(self) -> bool:
        """Whether it is of an arm without all of the six joints."""
        return not self.cartesian and any(map(_UNCONNECTED.fullmatch, self.parts[0]))

    @property
    def external(self) -> list[tuple[str, str, str, int]]:
        """Of the axes that are connected."""
        return [
            (self.label, f"eax_{letter}", text, self.line)
            for letter, text in zip("abcdef", self.parts[-1], strict=True)
            if not _UNCONNECTED.fullmatch(text)
        ]

    def numbers(self, path: Path | str) -> list[float]:
        """Joint values [deg], or x, y, z [mm] and q1 to q4."""
        if self.cartesian:
            return place_of(self.label, self.line, self.parts, path)
        values = []
        for j, text in enumerate(self.parts[0], start=1):
            what = f"{self.label}: axis {j}"
            if _UNCONNECTED.fullmatch(text):
                refuse(f"{what} has no value (9E9)", path, self.line, "is it a six-axis arm?")
            values.append(joint_deg(text, what, path, self.line))
        return values

    def details(self, path: Path | str) -> dict[str, Any]:
        if not self.cartesian:
            return {}
        words = f"[{','.join(self.parts[2])}]"
        meant = configuration_in(AbbConfiguration, words, self.label, path, self.line)
        frames = {"T_world_user": self.T_world_user, "T_tip_tool": self.T_tip_tool}
        return {"configuration": meant, **frames}


def place_of(label: str, row: int, lists: Sequence[list[str]], path: Path | str) -> list[float]:
    """x, y, z [mm] and q1 to q4 of a pose; FileFormatError where they are none."""
    names = zip("xyz", lists[0], strict=True)
    place = [millimetres(text, f"{label}: {axis}", path, row) for axis, text in names]
    turn = [
        number(text, f"{label}: q{k}", path, row, 1.0 + NORM_WITHIN)
        for k, text in enumerate(lists[1], start=1)
    ]
    norm = float(np.linalg.norm(turn))
    if abs(norm - 1.0) > NORM_WITHIN:
        refuse(f"{label}: the quaternion's norm is {norm:.4f}, not 1", path, row)
    return [*place, *turn]


def _transforms(places: list[list[float]]) -> FloatArray:
    values = np.reshape(places, (-1, 7))
    return transform(rotation_from_quaternion(values[:, 3:]), values[:, :3] / 1e3)


def frames_of(data: Data, path: Path | str) -> FloatArray:
    """Frames ``(1 or 2, 4, 4)`` [m] of a tool or work object; FileFormatError where it has none."""
    name, row, value = data.name.upper(), data.row, nested(data.value) if data.value else ""
    tool = data.kind == "tooldata"
    if isinstance(value, str) or len(value) != (3 if tool else 5):
        refuse(f"{name} has not the parts of {data.kind}", path, row)
    places = []
    for part in value[1:2] if tool else value[3:]:
        if module.shape(part) != (3, 4):
            refuse(f"{name} has not the lists of 3, 4 numbers of a frame", path, row)
        places.append(place_of(name, row, part, path))  # type: ignore[arg-type]
    return _transforms(places)


@dataclass
class _Reader:
    """What a module says, statement by statement."""

    path: Path | str
    positions: list[StoredPosition] = field(default_factory=list)
    names: set[str] = field(default_factory=set)
    frames: dict[str, Data] = field(default_factory=dict)
    motions: list[tuple[str, str, str, int]] = field(default_factory=list)
    changes: list[tuple[str, bool, int]] = field(default_factory=list)
    switches: list[tuple[int, bool]] = field(default_factory=list)
    """Lines where a program displacement is switched, and whether on."""
    straight: list[range] = field(default_factory=list)  # lines of routines without any branch
    parts: dict[str, Nested | str] = field(default_factory=dict)
    targets: set[str] = field(default_factory=set)  # variables that joint motions go to
    unread: list[FileFormatError] = field(default_factory=list)

    def take(self, statements: Sequence[Statement]) -> None:
        """Take positions, frames, motions, and what changes them."""
        given = [s for s in statements if s.kind in ("assignment", "compact_if")]
        varied = {module.name_of(n.children[0]) for s in given for n in s.all("assignment")}
        self.parts = {
            data.name.upper(): nested(data.value)
            for data in module.declared(statements)
            if data.kind in ("confdata", "extjoint") and is_a(data.value, "list")
            if data.name.upper() not in varied
        }
        for data in module.declared(statements):
            if data.kind in SHAPES:
                self._take_positions(data)
            elif data.kind != "num":
                for label, value in data.values:
                    self._refuse_lost(value, data.row, f"{data.storage} {data.kind} {label}")
                if data.kind in FRAMES and data.value and not data.size:
                    self.frames[data.name.upper()] = data
        begin = 0  # of a routine without any branch up to here
        for statement in statements:
            if statement.kind in ("call", "compact_if", "assignment"):
                self._take_instruction(statement)
            elif statement.fault:
                self._take_fault(statement)
            if statement.kind in module.ROUTINES:
                begin = statement.row
            elif statement.kind in _BRANCHES:
                begin = 0
            elif statement.kind == "endproc" and begin:
                self.straight.append(range(begin, statement.row))

    def _take_positions(self, data: Data) -> None:
        name, row, values = data.name, data.row, data.nested
        numbered = data.storage != "VAR" or values
        missing = bool(numbered and _NUMBERED.fullmatch(name))
        if values and name.upper() in self.names:
            refuse(f"{name} is there twice", self.path, row, "remove one of them")
        if values:
            self.names.add(name.upper())
        if len(name) > _MOST_NAME:
            refuse(f"{name[:30]}... has {len(name)} characters", self.path, row)
        if data.size and values and (not data.whole or data.count != len(values)):
            size = module.inside(data.size)[:20]
            refuse(f"{name}{{{size}}} has {len(values)} elements", self.path, row)
        for label, value in values:
            position = StoredPosition.of(label, row, data.kind, self._filled(value), self.path)
            if not position.is_empty:
                self.positions.append(position)
                missing = False
        if missing and not (data.size and values):
            refuse(f"{name} has no value", self.path, row, "touch the position up")

    def _filled(self, value: Nested | str) -> Nested | str:
        """A value, with the parts that generators of programs give a name: ``conf``, ``extj``."""
        if not self.parts:
            return value
        parts = value if isinstance(value, list) else []
        return [self.parts.get(str(part).upper(), part) for part in parts] or value

    def _take_instruction(self, statement: Statement) -> None:
        row = statement.row
        for node in statement.all("assignment") if ":=" in statement.text else ():
            variable = node.children[0]
            in_part = any(isinstance(c, Token) for c in variable.children[1:])  # type: ignore[union-attr]
            self.changes.append((module.name_of(variable), in_part, row))
        motion = False
        for word, given in module.calls(statement):
            if word in ("PDISPON", "PDISPSET", "PDISPOFF"):
                self.switches.append((row, word != "PDISPOFF"))
            values = [(value, switches) for value, switches in given if value is not None]
            if word == "MOVEC" and len(values) > 4:  # through one position to the next
                for value, _ in values[:2]:
                    self._take_motion("robtarget", value, values[4], row)
            found = _MOTION.fullmatch(word)
            motion = motion or found is not None or word == "MOVEC"
            if found and values and values[0][0] is not None:
                last = values[-1 if found[1] else 3] if len(values) > 3 else None
                kind = "jointtarget" if found[2] else "robtarget"
                self._take_motion(kind, values[0][0], last, row)
        if not motion and "[" in statement.text:
            self._refuse_lost(statement.tree, row, statement.text)

    def _take_motion(
        self, kind: str, target: Node | None, last: module.Argument | None, row: int
    ) -> None:
        """A position that stands in a motion, and the tool and work object of the last argument."""
        name = ""
        if is_a(target, "variable"):
            name = str(nested(target)).upper()
            self.targets.add(name.partition("{")[0])
        elif is_a(target, "list"):
            name = f"[{row}[{len(self.positions)}"
            # a list that has a name in the place of a part is calculated: no position of the file
            value = self._filled(nested(target))
            pairs = zip(target.children, value, strict=True)
            if all(isinstance(c, Token) or not isinstance(v, str) for c, v in pairs):
                position = StoredPosition.of("", row, kind, value, self.path)
                position.key = name
                self.positions.append(position)
        if last is not None and name:  # Offs(p1,...): no motion to a position of the file
            tool, switches = last
            work_object = module.name_of(switches["WOBJ"]) if "WOBJ" in switches else "WOBJ0"
            self.motions.append((name, module.name_of(tool), work_object, row))

    def _refuse_lost(self, tree: Node, row: int, text: str) -> None:
        """Refuse lists of numbers that are a position, and stand where none is read."""
        for node in tree.iter_subtrees() if isinstance(tree, Tree) else ():
            if node.data == "list" and len(node.children) > 1:
                found = module.shape(nested(node))
                if found == (6, 6) or (4, 4, 6) in zip(found, found[1:], found[2:], strict=False):
                    refuse(f"cannot make sense of {text[:30]!r}", self.path, row)

    def _take_fault(self, statement: Statement) -> None:
        """Refuse a statement that is none, where it may be about positions or frames."""
        known = self.names | self.frames.keys()
        words = {word.upper() for word in _WORD.findall(statement.text)}
        if _MATTERS.search(statement.text) or words & known or "characters" in statement.fault:
            reason = f"cannot make sense of {statement.text[:30]!r}: {statement.fault}"
            refuse(reason, self.path, statement.row)

    def give_frames(self) -> None:
        """Give poses the frames of the motions that go to them.

        One that is used in two frames has a fault, and one that the program changes and moves to is
        unread. Raises FileFormatError: a frame is not that of a tool at the flange.
        """
        self._leave_changed()
        posed = [p for p in self.positions if p.kind == "robtarget"]
        poses = {p.key or p.variable.upper(): p for p in posed}
        values: dict[str, FloatArray | None] = {"TOOL0": np.eye(4), "WOBJ0": np.eye(4)}
        values |= {name: None for name, _, _ in self.changes}
        used: dict[str, tuple[str, str]] = {}
        for target, tool, work_object, row in self.motions:
            position = poses.get(target)
            if position is None:
                continue
            if self._may_be_displaced(row):
                reason = f"{position.label} may be displaced (PDispOn)"
                hint = "measure without a program displacement"
                position.fault = FileFormatError(reason, path=self.path, row=row, hint=hint)
            elif used.setdefault(target, (tool, work_object)) != (tool, work_object):
                reason = f"{position.label} is used in other frames than before"
                hint = "use each position with one tool and one work object"
                position.fault = FileFormatError(reason, path=self.path, row=row, hint=hint)
            if position.fault is not None:
                position.T_tip_tool = position.T_world_user = None
            for name, kind in zip((tool, work_object), FRAMES, strict=True):
                if name not in values:
                    values[name] = self._frame(name, kind)
            if position.fault is None:
                position.T_tip_tool, position.T_world_user = values[tool], values[work_object]

    def _may_be_displaced(self, row: int) -> bool:
        """Whether a program displacement may be on at a line.

        It is not in the one routine that switches it, which has no branches, before it is on or
        behind it is off; at its end it is off.
        """
        if not any(on for _, on in self.switches):
            return False
        rows = [at for at, _ in self.switches]
        inside = any({row, *rows} <= {*own} for own in self.straight)
        before = [on for at, on in self.switches if at < row]
        return not inside or self.switches[-1][1] or before[-1:] == [True]

    def _leave_changed(self) -> None:
        """Leave out positions that the program moves to, and gives values that are not known."""
        moved = {name.partition("{")[0] for name, *_ in self.motions} | self.targets
        lost: dict[str, int] = {}
        for name, in_part, row in self.changes:
            if in_part or name in moved:
                lost.setdefault(name, row)
        for p in self.positions:
            at = lost.get(p.variable.upper().partition("{")[0]) if p.variable else None
            if at is not None:
                reason, hint = f"{p.label} is changed by the program", "store the position whole"
                self.unread.append(FileFormatError(reason, path=self.path, row=at, hint=hint))
        kept = [p for p in self.positions if p.variable.upper().partition("{")[0] not in lost]
        for error in self.unread if not kept else ():
            raise error
        self.positions = kept

    def _frame(self, name: str, kind: str) -> FloatArray | None:
        """The frame ``(4, 4)`` [m] of a tool or work object; None where it is another module's."""
        data = self.frames.get(name)
        if data is None or data.kind != kind:
            return None
        # robhold; of a work object also ufprog: it stands where the program says
        usual = ["TRUE"] if kind == "tooldata" else ["FALSE", "TRUE"]
        value = nested(data.value) if data.value else ""
        if [str(part).upper() for part in value[: len(usual)]] != usual:
            what = (
                "a tool that stands in the cell" if len(usual) == 1 else "a work object that moves"
            )
            refuse(f"{name} is {what}", self.path, data.row, "measure with the tool at the flange")
        frames = frames_of(data, self.path)
        return np.asarray(frames[0] if len(frames) == 1 else frames[0] @ frames[1])


def parse_abb_rapid(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages."""
    text = reading.text_of(data, path, _WHAT)
    statements = LANGUAGE.statements(text)
    if not statements or statements[0].kind != "module":
        refuse("is no RAPID module: it does not begin with MODULE", path, 1, _WHAT)
    if statements[-1].kind != "endmodule":
        reason = "is cut off: ENDMODULE is not its end"
        refuse(reason, path, text.count("\n") + 1, "copy the file again")
    reader = _Reader(path)
    reader.take(statements)
    if not reader.positions:
        no_positions(path, "name the module that was touched up")
    reader.give_frames()
    numbering, title = Numbering(_NUMBERED, _ELEMENT), ""
    for remark in (found[1].strip() for found in _REMARK.finditer(text) if found[1] is not None):
        own = numbering.take(remark) or remark.startswith("* ")
        if not (own or title or numbering.mark or numbering.names):
            title = remark
    named = statements[0].word("NAME"), title, "abb"
    return numbering.program(named, reader.positions, _transforms, path, reader.unread)
