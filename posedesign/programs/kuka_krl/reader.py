"""KUKA KRL programs (``.dat`` and ``.src``): the reader of what controllers and people write.

Of a ``.dat`` the declared positions are read (AXIS, E6AXIS, POS, E6POS, elements of arrays), with
the frames of their FDAT; of a ``.src`` those that stand in PTP and LIN instructions, or that it
assigns. ``XP3`` and ``P3`` are position 3; other names are numbered behind, in the order of the
file. FOLDs of inline forms are comments. Where a program keeps the touched-up positions in ``XM``,
those stand in the place of the planned ones, and poses not yet measured are left out as soon as one
is measured.

What would be read wrong in silence is refused with its line: relative motions, circles, offsets,
positions without a value, an external axis that moves, a ``.src`` whose positions stand elsewhere,
and lines that the grammar does not know where they could hold a position or change the frames.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lark import Token, Tree

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.programs.configurations import KukaConfiguration
from posedesign.programs.kuka_krl import syntax as krl
from posedesign.programs.kuka_krl.syntax import (
    AXES,
    BEGINS,
    BLOCKS,
    CONFIGURATION,
    EXTERNAL,
    POSE,
    Braces,
    Value,
)
from posedesign.programs.language import MOST_FAULTS, Statement
from posedesign.programs.numbering import Numbering, Stored
from posedesign.programs.reading import (
    NoPositionsError,
    configuration_in,
    joint_deg,
    no_positions,
    pose_values,
    poses_of,
    read_program_bytes,
    refuse,
)
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import RecordedProgram

_ENDS = {block.closes for block in BLOCKS.values()}
_PARTS = {part for block in BLOCKS.values() for part in block.divides}
_KINDS = ("TOOL", "BASE")


@dataclass(frozen=True)
class Frame:
    """A tool or base: its number, its value X Y Z [mm] C B A [deg], or neither where not known."""

    number: int | None = None
    value: tuple[float, ...] | None = None

    @property
    def transform(self) -> FloatArray | None:
        """The value ``(4, 4)`` [m]."""
        return None if self.value is None else poses_of(self.value)[0]


UNKNOWN = Frame()


@dataclass(frozen=True)
class Frames:
    """What is active at a motion; ``external_tool``: the tool stands in the cell."""

    tool: Frame = UNKNOWN
    base: Frame = UNKNOWN
    external_tool: bool = False

    def having(self, kind: str, frame: Frame) -> Frames:
        """These, with another ``TOOL`` or ``BASE``."""
        if kind == "TOOL":
            return replace(self, tool=frame)
        return replace(self, base=frame) if kind == "BASE" else self

    @classmethod
    def of_fdat(cls, fields: Mapping[str, str]) -> Frames:
        """The frames that the data of an inline form name."""
        tool, base = (_of_number(fields.get(name, "")) for name in ("TOOL_NO", "BASE_NO"))
        return cls(tool, base, fields.get("IPO_FRAME", "").upper() == "#TCP")


@dataclass
class ActiveFrames:
    """Tool and base, statement by statement of a routine."""

    frames: Frames = field(default_factory=Frames)
    _opened: list[Frames] = field(default_factory=list)

    def take(self, statement: Statement) -> bool:
        """Follow a statement; return whether it does nothing else than to set frames."""
        kind, frames = statement.kind, self.frames
        if kind == "call":
            command, number = krl.bas_of(krl.values_of(statement))
            if command == "FRAMES":
                self.frames = replace(frames, tool=UNKNOWN, base=UNKNOWN)
                return True
            self.frames = frames.having(command, _of_number(number))
            return command in _KINDS
        if kind == "assignment":
            variable, value = krl.values_of(statement)
            return self._take_assignment(variable.key, value)
        if kind in BLOCKS:
            self._opened.append(frames)
        elif kind in _PARTS or kind in _ENDS:  # what one branch sets is not known behind it
            before = self._opened[-1] if self._opened else Frames()
            if kind in _ENDS and self._opened:
                self._opened.pop()
            tool = frames.tool if frames.tool == before.tool else UNKNOWN
            base = frames.base if frames.base == before.base else UNKNOWN
            self.frames = replace(frames, tool=tool, base=base)
        return False

    def of_motion(self, statement: Statement) -> Frames:
        """The frames of a motion."""
        found = self.frames
        for name, _ in krl.settings_of(statement):  # from the data of its inline form
            found = found.having(name.removeprefix("$"), UNKNOWN)
        return found

    def _take_assignment(self, name: str, value: Value) -> bool:
        whole, _, part = name.partition(".")
        if whole in ("$TOOL", "$BASE"):
            self.frames = self.frames.having(whole[1:], UNKNOWN if part else _frame(value))
        elif whole == "FDAT_ACT":
            fdat = Frames.of_fdat(value.braces.fields if value.braces else {})
            self.frames = replace(self.frames, tool=fdat.tool, base=fdat.base)
        elif whole == "$IPO_MODE":
            external = value.text.upper() == "#TCP"
            self.frames = replace(self.frames, external_tool=external)
        return whole in ("$TOOL", "$BASE", "FDAT_ACT", "$IPO_MODE")


def _of_number(text: str) -> Frame:
    return Frame(int(text)) if text.isdigit() and len(text) <= 3 else UNKNOWN


def _frame(value: Value) -> Frame:
    """What is assigned to $TOOL or $BASE: a frame of a number, or all its six values."""
    name = value.key
    if name.startswith(("TOOL_DATA[", "BASE_DATA[")):
        return _of_number(name[10:-1])
    if name == "$NULLFRAME":
        return Frame(value=(0.0,) * 6)
    names, texts, _ = value.braces or krl.Braces([], [], "")
    values = dict(zip(names, map(krl.as_number, texts), strict=True))
    if len(names) != 6 or set(values) != set(POSE) or any(map(math.isnan, values.values())):
        return UNKNOWN  # KRL leaves values that are not given as they are
    return Frame(value=tuple(values[axis] for axis in "XYZCBA"))


_REMARK = re.compile(r"^[ \t]*;[ \t]*((?:PLAN|P\d|TOOL|XM\[).*)", re.MULTILINE | re.ASCII)
_COMMENT = re.compile(r"^[ \t]*&COMMENT[ \t]+(\S.*)", re.MULTILINE | re.IGNORECASE)
_ALL_FRAMES = re.compile(r"TOOL\s+(\d{1,3})\s+BASE\s+(\d{1,3})", re.ASCII)
_NUMBERED = re.compile(r"X?P(\d{1,6})", re.IGNORECASE | re.ASCII)
_ELEMENT = re.compile(r"XM\[(\d{1,6})\]", re.IGNORECASE | re.ASCII)
_MATTERS = re.compile(
    r"[{}]|\$(?:TOOL|BASE|IPO_MODE)\b|\b(?:BAS|FDAT_ACT|(?:E6)?(?:AXIS|POS)|X?P\d+)\b"
    r"|^(?:GLOBAL |DEF|END|S?PTP|S?LIN|S?CIRC|SPL)",
    re.IGNORECASE | re.ASCII,
)
"""What a line may hold that cannot be passed over, although the grammar does not know the line."""

_GIVEN = re.compile(
    r"^[ \t]*([A-Z]\w*)[ \t]*(?:\[[^\]\n]*\][ \t]*)?(?:\.[ \t]*\w+[ \t]*)?=(?!=)", re.I | re.M
)
_GONE_TO = re.compile(
    r"^[ \t]*S?(?:PTP|LIN|CIRC)[ \t]+(?:([A-Z]\w*)[^\n,]*|\{[^\n}]*\}[ \t]*)(?:,[ \t]*([A-Z]\w*))?",
    re.I | re.M,
)
_ANGLE = re.compile(r",[ \t]*CA\b", re.I)  # of a circle
_COMPUTED = re.compile(r"\[(?![\d,]*\]).*")  # an index of which nobody knows the element
_WHAT = "name the .dat of a KRL program, or a .src with positions in its motions"


@dataclass(eq=False)
class StoredPosition(Stored):
    """One position as it stands in the file.

    ``fields`` hold the texts of the values by their names in capitals. ``frames``: those that it
    is used in; None where no motion goes to it.
    """

    fields: dict[str, str]
    frames: Frames | None = None

    @property
    def cartesian(self) -> bool:
        return not any(axis in self.fields for axis in AXES)

    @property
    def external(self) -> list[tuple[str, str, str, int]]:
        present = [axis for axis in EXTERNAL if axis in self.fields]
        return [(self.label, axis, self.fields[axis], self.line) for axis in present]

    def numbers(self, path: Path | str) -> list[float]:
        """Joints A1 to A6 [deg], or X, Y, Z [mm] and C, B, A [deg] of a pose."""
        label, row, names = self.label, self.line, self.fields.keys()
        strange = [n for n in names if n not in {*AXES, *POSE, *EXTERNAL, *CONFIGURATION}]
        if strange:
            refuse(f"{label}: {strange[0]} is no joint of a six-joint arm", path, row)
        mixed = [name for name in (*POSE, *CONFIGURATION) if name in names]
        if mixed and not self.cartesian:
            refuse(f"{label} has {mixed[0]} beside A1 to A6", path, row)
        for name in POSE if self.cartesian else AXES:
            if name not in names:
                whole = "a pose has X Y Z A B C" if self.cartesian else "a posture has A1 to A6"
                refuse(f"{label}: {name} is missing", path, row, whole)
        if self.cartesian:
            return pose_values([self.fields[a] for a in "XYZCBA"], "XYZCBA", label, path, row)
        return [joint_deg(self.fields[a], f"{label}: {a}", path, row) for a in AXES]

    def details(self, path: Path | str) -> dict[str, Any]:
        """Status and Turn, where the position has them, and the frames."""
        frames = self.frames or Frames()
        numbers = {"user_frame": frames.base.number, "tool_frame": frames.tool.number}
        if not self.cartesian:
            return numbers
        given = [name for name in CONFIGURATION if name in self.fields]
        if len(given) == 1:
            other = "T" if given == ["S"] else "S"
            refuse(f"{self.label} has {given[0]} and no {other}", path, self.line)
        words = ",".join(f"{name} {self.fields[name]}" for name in given)
        meant = given and configuration_in(KukaConfiguration, words, self.label, path, self.line)
        values = {"T_world_user": frames.base.transform, "T_tip_tool": frames.tool.transform}
        return {"configuration": meant or None, **values, **numbers}


def parse_kuka_krl(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages."""
    return _Reader(text_of_file(data, path, _WHAT), path).program()


@dataclass
class _Reader:
    """What a file says, statement by statement."""

    text: str
    path: Path | str
    name: str = ""
    kind: str = ""
    closed: bool = False
    numbering: Numbering = field(default_factory=lambda: Numbering(_NUMBERED, _ELEMENT))
    positions: list[StoredPosition] = field(default_factory=list)
    variables: dict[str, StoredPosition] = field(default_factory=dict)
    fdat: dict[str, Frames] = field(default_factory=dict)
    forgotten: dict[str, int] = field(default_factory=dict)
    frames: ActiveFrames = field(default_factory=ActiveFrames)
    no_positions: set[str] = field(default_factory=set)
    lost: set[str] = field(default_factory=set)
    unread: list[FileFormatError] = field(default_factory=list)

    def program(self) -> RecordedProgram:
        self._take_remarks()
        faults = 0
        for statement in krl.LANGUAGE.statements(self.text):
            faults += bool(statement.fault)
            self._take(statement)
        if not self.kind or faults >= MOST_FAULTS:
            refuse("is no KRL program: there is no DEFDAT and no DEF", self.path, 1, _WHAT)
        if not self.closed:
            end = "ENDDAT" if self.is_data else "END"
            row = self.text.count("\n") + 1
            refuse(f"is cut off: there is no {end}", self.path, row, "copy the file again")
        # a frame is a position where a motion goes to it; what changes before is none
        self.positions = [
            p
            for p in self.positions
            if p.frames
            or not (
                self._is_of_frames(p.variable) or p.variable.upper().partition("[")[0] in self.lost
            )
        ]
        if self.is_data:
            self._leave_changed()
        for error in sorted(self.unread, key=_is_here) if not self.positions else ():
            raise error
        if not self.positions:
            no_positions(self.path, "name the file that was touched up")
        self._take_frames_of_forms()
        comment = _COMMENT.search(self.text)
        named = self.name, comment[1].strip() if comment else "", "kuka"
        return self.numbering.program(named, self.positions, poses_of, self.path, self.unread)

    @property
    def is_data(self) -> bool:
        """Whether this is a ``.dat``."""
        return self.kind == "begin_data"

    def _leave_changed(self) -> None:
        """Leave out what the ``.src`` beside gives other values, and moves to."""
        path = Path(self.path)
        beside = [path.with_suffix(".src"), path.with_suffix(".SRC")]
        found = next((p for p in beside if path.is_file() and p.is_file()), None)
        text = "" if found is None else read_program_bytes(found).decode("latin-1")
        given = {f[1].upper(): f.start(1) for f in _GIVEN.finditer(text)}
        gone = (f for f in _GONE_TO.finditer(text) if given)
        changed = {name.upper() for f in gone for name in f.groups() if name} & given.keys()
        for p in self.positions if found else ():
            name = p.variable.upper().partition("[")[0]
            if name in changed:
                line = text.count("\n", 0, given[name]) + 1
                reason = f"{p.label} is changed in line {line} of {found.name}"  # type: ignore[union-attr]
                self._leave(reason, p.line)
        self.positions = [
            p for p in self.positions if p.variable.upper().partition("[")[0] not in changed
        ]

    def _take_remarks(self) -> None:
        for found in _REMARK.finditer(self.text):
            remark = found[1].strip()
            frames = _ALL_FRAMES.fullmatch(remark)
            if not self.numbering.take(remark) and frames:
                self.frames.frames = Frames(Frame(int(frames[1])), Frame(int(frames[2])))

    def _take(self, statement: Statement) -> None:
        kind, row, text = statement.kind, statement.row, statement.text
        if kind in BEGINS:
            # a .src has a routine and then its subroutines, each with its END
            name = krl.name_of_module(statement)
            if self.kind and (self.is_data or not self.closed):
                refuse(f"{name} begins inside {self.name}", self.path, row, "copy the file again")
            self.name, self.kind = self.name or name, self.kind or kind
            self.closed = False
            if kind != "begin_data":
                self.frames = ActiveFrames()  # those of whoever calls the routine
        elif not self.kind:
            refuse("is no KRL program: it does not begin with DEFDAT or DEF", self.path, row, _WHAT)
        elif self.closed:
            if self.is_data or "{" in text:
                refuse(f"{text[:30]!r} stands behind the end of the program", self.path, row)
        elif kind in BEGINS.values():
            self.closed = True
        elif statement.fault:
            if _MATTERS.search(text):
                refuse(f"cannot make sense of it: {statement.fault}", self.path, row)
        elif self.is_data or not self.frames.take(statement):
            taken = {
                "motion": self._take_motion,
                "declaration": self._take_declaration,
                "assignment": self._take_assignment,
            }
            taken.get(kind, self._check_no_position)(statement)

    def _take_declaration(self, statement: Statement) -> None:
        row, items = statement.row, krl.items_of(statement)
        kind = krl.type_of(statement)
        for name, size, value in items:
            braces = value.braces if value else None
            if kind == "FDAT" and braces:
                self.fdat[name.upper()] = Frames.of_fdat(braces.fields)
            elif kind not in krl.TYPES_OF_POSITIONS:
                if kind in ("FRAME", "LOAD"):
                    self.no_positions.add(name.upper())
                elif kind != "JERK_STRUC" and name[0] != "$":
                    self._check_no_position(statement)
            elif braces:
                self._add(name, braces, row)
            elif value:
                refuse(f"{name}: cannot make sense of {value.text[:30]!r}", self.path, row)
            elif len(items) == 1 and not size and self.is_data and _NUMBERED.fullmatch(name):
                refuse(f"{name} has no value", self.path, row, "touch the position up")

    def _take_assignment(self, statement: Statement) -> None:
        """Add a position that is given its values; refuse what changes one in another way."""
        variable, (_, _, braces) = krl.values_of(statement)
        key = variable.key
        plain = "." not in key and not _COMPUTED.search(key)
        if not plain or braces is None:
            self._forget(key, statement.row)
        known = key.startswith("$") or key.partition("_DATA[")[1]
        is_frame = braces is not None and braces.kind in ("FRAME", "LOAD")
        if is_frame or known or (self.is_data and self._is_of_frames(key)):
            return
        if plain and braces and braces.names[0] in ("A1", "X"):
            self._add(variable.name, braces, statement.row)
        else:
            self._check_no_position(statement)

    def _is_of_frames(self, name: str) -> bool:
        return name.upper().partition("[")[0] in self.no_positions

    def _check_no_position(self, statement: Statement) -> None:
        if not statement.once(_has_position):
            return
        for inside in statement.all("aggregate"):
            # in the structures of a .dat X to C alone are a frame: of a search, of a load
            is_frame = self.is_data and {name for name, _ in krl.fields_of(inside)} <= {*POSE}
            if _holds_position(inside) and not is_frame:
                refuse(f"cannot make sense of {statement.text[:30]!r}", self.path, statement.row)

    def _take_motion(self, statement: Statement) -> None:
        word, *targets = krl.values_of(statement)
        name = word.text.upper()
        circle = name in ("CIRC", "SCIRC")  # through one position to the next
        if circle and _ANGLE.search(statement.text):
            self._leave(f"{name}: where an angle (CA) ends is in no file", statement.row)
        elif circle or name in ("PTP", "SPTP", "LIN", "SLIN"):
            for target in targets[: 1 + circle]:
                self._take_target(target, statement)
        else:
            self._leave(f"{name}: only PTP, LIN and CIRC can be read", statement.row)

    def _take_target(self, target: Value, statement: Statement) -> None:
        row = statement.row
        if target.kind == "place":
            self._leave("a position with an offset cannot be read", row)
            return
        if target.braces:
            self._add("", target.braces, row)
            self._use(self.positions[-1], statement)
            return
        self._check_no_position(statement)
        key = target.key
        if key in ("XHOME", "HOME") or key.startswith("$"):
            return  # the home of all programs; $AXIS_ACT, where the arm is
        position = self.variables.get(key)
        changed = max(self.forgotten.get(name, 0) for name in (key, key.partition("[")[0]))
        if position is not None and position.line > changed:
            self._use(position, statement)
        else:
            name = key.partition("[")[0] or target.text[:30]
            if changed:
                self._leave(f"{name} is changed by the program", row)
                self.lost.add(name)
            else:
                reason = f"{name} is stored elsewhere"
                self.unread.append(NoPositionsError(reason, path=self.path, row=row, hint=_WHAT))

    def _leave(self, reason: str, row: int) -> None:
        """Leave out where a motion goes to, and say why."""
        self.unread.append(FileFormatError(reason, path=self.path, row=row, hint=_WHAT))

    def _use(self, position: StoredPosition, statement: Statement) -> None:
        """A motion goes to a position: in the frames that are active there."""
        frames, row = self.frames.of_motion(statement), statement.row
        if position.cartesian and frames.external_tool:
            self._refuse_external_tool(position, "$IPO_MODE #TCP", row)
        if position.cartesian and position.frames is not None and position.frames != frames:
            reason = f"{position.label} is used in other frames than before"
            hint = "use each position with one tool and one base"
            position.fault = FileFormatError(reason, path=self.path, row=row, hint=hint)
        position.frames = Frames() if position.fault else frames

    def _refuse_external_tool(self, position: StoredPosition, how: str, row: int) -> None:
        reason = f"{position.label}: a tool that stands in the cell ({how}) cannot be read"
        refuse(reason, self.path, row, "measure with the tool at the flange")

    def _forget(self, key: str, row: int) -> None:
        """A variable gets values that are not in the file; those at motions before stay."""
        name = _COMPUTED.sub("", key).partition(".")[0]
        if self.is_data and name in self.variables:
            refuse(f"{name} is changed in part", self.path, row, "store the position whole")
        self.forgotten[name] = row

    def _add(self, variable: str, braces: Braces, row: int) -> None:
        position = StoredPosition(variable, row, braces.fields)
        if len(position.fields) < len(braces.names):
            twice = next(name for name in braces.names if braces.names.count(name) > 1)
            refuse(f"{position.label} has {twice} twice", self.path, row)
        if self.is_data:
            position.frames = self.frames.frames
        self.positions.append(position)
        if variable:
            if variable.upper() in self.variables:
                refuse(f"{variable} is there twice", self.path, row, "remove one of them")
            self.variables[variable.upper()] = position

    def _take_frames_of_forms(self) -> None:
        """Frames of positions that inline forms touched up, as the data beside them say."""
        for position in self.positions:
            fdat = self.fdat.get("F" + position.variable.upper().removeprefix("X"))
            if fdat is None or not position.variable:
                continue
            if position.cartesian and fdat.external_tool:
                self._refuse_external_tool(position, "#TCP", position.line)
            before = position.frames or Frames()
            position.frames = replace(
                before,
                tool=fdat.tool if fdat.tool != UNKNOWN else before.tool,
                base=fdat.base if fdat.base != UNKNOWN else before.base,
            )


def _is_here(error: FileFormatError) -> bool:
    return not isinstance(error, NoPositionsError)


def _holds_position(node: Tree[Token]) -> bool:
    """Whether it begins as a position does."""
    begins = krl.fields_of(node)[0][0] in ("A1", "X")
    return begins and krl.kind_of(node) not in ("FRAME", "LOAD")


def _has_position(statement: Statement) -> bool:
    """Whether something between braces begins as a position does."""
    return any(map(_holds_position, statement.all("aggregate")))
