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

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeGuard

import numpy as np
from lark import Token, Tree

from calib.errors import InputError
from calib.se3 import rotation_from_wpr, transform
from posedesign.programs.configurations import KukaConfiguration
from posedesign.programs.kuka_krl.frames import UNKNOWN, ActiveFrames, Frame, Frames
from posedesign.programs.kuka_krl.syntax import (
    AXES,
    BEGINS,
    CONFIGURATION,
    EXTERNAL,
    POSE,
    TYPES_OF_POSITIONS,
    Node,
    fields_of,
    items_of,
    key_of,
    kind_of,
    name_of,
    name_of_module,
    statements_of,
    type_of,
    word_of,
    words_of,
)
from posedesign.programs.language import MOST_FAULTS, Statement
from posedesign.programs.numbering import Numbering
from posedesign.programs.reading import at_rest, joint_deg, millimetres, refuse
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

_REMARK = re.compile(r"^[ \t]*;[ \t]*((?:PLAN|P\d|TOOL|XM\[).*)", re.MULTILINE | re.ASCII)
_COMMENT = re.compile(r"^[ \t]*&COMMENT[ \t]+(\S.*)", re.MULTILINE | re.IGNORECASE)
_ALL_FRAMES = re.compile(r"TOOL\s+(\d{1,3})\s+BASE\s+(\d{1,3})", re.ASCII)
_POSE_NAME = re.compile(r"P(\d{1,6}) (.*)", re.ASCII)
_FIRST_REGISTER = re.compile(r"XM\[(\d{1,6})\] IS P(\d{1,6})", re.ASCII)
_NUMBERED = re.compile(r"X?P(\d{1,6})", re.IGNORECASE | re.ASCII)
_ELEMENT = re.compile(r"XM\[(\d{1,6})\]", re.IGNORECASE | re.ASCII)
_MATTERS = re.compile(
    r"[{}]|\$(?:TOOL|BASE|IPO_MODE)\b|\b(?:BAS|FDAT_ACT|(?:E6)?(?:AXIS|POS)|X?P\d+)\b"
    r"|^(?:GLOBAL |DEF|END|S?PTP|S?LIN|S?CIRC|SPL)",
    re.IGNORECASE | re.ASCII,
)
"""What a line may hold that cannot be passed over, although the grammar does not know the line."""

_BINARY = re.compile(rb"[^\t\r\n -~\x80-\xff]")
_WHAT = "name the .dat of a KRL program, or a .src with positions in its motions"


@dataclass(eq=False)
class StoredPosition:
    """One position as it stands in the file.

    ``variable`` is empty for one that stands in a motion instruction. ``fields`` hold the texts of
    the values by their names in capitals. ``other``: no numbered position of the program, such as
    its home. ``frames``: those that it is used in; None where no motion goes to it.
    """

    variable: str
    line: int
    fields: dict[str, str]
    name: str = ""
    other: bool = False
    frames: Frames | None = None

    @property
    def cartesian(self) -> bool:
        """Whether it is a pose of the tool."""
        return not any(axis in self.fields for axis in AXES)

    @property
    def label(self) -> str:
        """What to call it in messages."""
        return self.variable or "the position"


def parse_kuka_krl(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages.

    Raises
    ------
    FileFormatError
        The file is no KRL module, is cut off, or holds no positions, or one that is neither six
        joint angles nor a pose.
    """
    bad = _BINARY.search(data)
    if bad:
        row = data.count(b"\n", 0, bad.start()) + 1
        refuse(f"holds the byte 0x{bad[0][0]:02x}, which is not text", path, row, _WHAT)
    return _Reader(data.removeprefix(b"\xef\xbb\xbf").decode("latin-1"), path).program()


@dataclass
class _Reader:
    """What a file says, statement by statement."""

    text: str
    path: Path | str
    name: str = ""
    kind: str = ""
    mark: PlanMark | None = None
    closed: bool = False
    positions: list[StoredPosition] = field(default_factory=list)
    variables: dict[str, StoredPosition] = field(default_factory=dict)
    pose_names: dict[int, str] = field(default_factory=dict)
    fdat: dict[str, Frames] = field(default_factory=dict)
    forgotten: dict[str, int] = field(default_factory=dict)
    frames: ActiveFrames = field(default_factory=ActiveFrames)
    first_register: tuple[int, int] | None = None
    elsewhere: tuple[str, int] | None = None

    def program(self) -> RecordedProgram:
        """All that is read."""
        self._take_remarks()
        faults = 0
        for statement in statements_of(self.text):
            faults += bool(statement.fault)
            self._take(statement)
        if not self.kind or faults >= MOST_FAULTS:
            refuse("is no KRL program: there is no DEFDAT and no DEF", self.path, 1, _WHAT)
        if not self.closed:
            end = "ENDDAT" if self.is_data else "END"
            row = self.text.count("\n") + 1
            refuse(f"is cut off: there is no {end}", self.path, row, "copy the file again")
        if self.elsewhere is not None:
            name, row = self.elsewhere
            refuse(f"{name} is stored elsewhere", self.path, row, "name the .dat of the program")
        if not self.positions:
            refuse("holds no positions", self.path, hint="name the file that was touched up")
        self._take_frames_of_forms()
        numbering = Numbering(_NUMBERED, _ELEMENT, self.mark, self.pose_names, self.first_register)
        comment = _COMMENT.search(self.text)
        return RecordedProgram(
            self.name,
            comment[1].strip() if comment else "",
            self.mark or PlanMark(),
            _recorded(numbering.of(self.positions, self.path), self.path),
            "kuka",
            empty_registers=numbering.is_untouched(self.positions),
        )

    @property
    def is_data(self) -> bool:
        """Whether this is a ``.dat``."""
        return self.kind == "begin_data"

    def _take_remarks(self) -> None:
        for found in _REMARK.finditer(self.text):
            remark = found[1].strip()
            self.mark = self.mark or PlanMark.found_in(remark)
            if named := _POSE_NAME.fullmatch(remark):
                self.pose_names.setdefault(int(named[1]), named[2].strip())
            elif frames := _ALL_FRAMES.fullmatch(remark):
                self.frames.frames = Frames(Frame(int(frames[1])), Frame(int(frames[2])))
            elif register := _FIRST_REGISTER.fullmatch(remark):
                self.first_register = int(register[1]), int(register[2])

    def _take(self, statement: Statement) -> None:
        kind, row, text = statement.kind, statement.row, statement.text
        if kind in BEGINS:
            # a .src has a routine and then its subroutines, each with its END
            name = name_of_module(statement)
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
            self._take_instruction(statement)

    def _take_instruction(self, statement: Statement) -> None:
        if statement.kind == "motion":
            self._take_motion(statement)
        elif statement.kind == "declaration":
            self._take_declaration(statement)
        elif statement.kind == "assignment":
            self._take_assignment(statement)
        else:
            self._check_no_position(statement)

    def _take_declaration(self, statement: Statement) -> None:
        row, items = statement.row, items_of(statement)
        kind = type_of(statement)
        for item in items:
            name, value = str(item.children[0]), item.children[-1]
            if kind == "FDAT" and _is_aggregate(value):
                self.fdat[name.upper()] = Frames.of_fdat(dict(fields_of(value)))
            elif kind not in TYPES_OF_POSITIONS:
                if kind not in ("FRAME", "LOAD"):
                    self._check_no_position(statement)
            elif _is_aggregate(value):
                self._add(name, value, row)
            elif len(item.children) == 1 == len(items) and self.is_data:
                if _NUMBERED.fullmatch(name):
                    refuse(f"{name} has no value", self.path, row, "touch the position up")
            elif len(item.children) > 1 and not _is_index(value):
                refuse(f"{name}: cannot make sense of {words_of(value)[:30]!r}", self.path, row)

    def _take_assignment(self, statement: Statement) -> None:
        """Add a position that is given its values; refuse what changes one in another way."""
        variable, value = statement.tree.children
        key = key_of(variable)
        plain = "." not in key and "?" not in key
        if not plain or not _is_aggregate(value):
            self._forget(key, statement.row)
        if kind_of(value) in ("FRAME", "LOAD") or key.partition("_DATA[")[1]:
            return
        if plain and not key.startswith("$") and _holds_position(value):
            self._add(name_of(variable), value, statement.row)
        else:
            self._check_no_position(statement)

    def _check_no_position(self, statement: Statement) -> None:
        if any(_holds_position(inside) for inside in statement.all("aggregate")):
            refuse(f"cannot make sense of {statement.text[:30]!r}", self.path, statement.row)

    def _take_motion(self, statement: Statement) -> None:
        word, target, row = word_of(statement), statement.tree.children[1], statement.row
        if word not in ("PTP", "SPTP", "LIN", "SLIN"):
            hint = "name the .dat of the program"
            refuse(f"{word}: only PTP and LIN can be read", self.path, row, hint)
        if isinstance(target, Tree) and target.data == "place":
            refuse("a position with an offset cannot be read", self.path, row)
        if _is_aggregate(target):
            self._add("", target, row)
            self._use(self.positions[-1], statement)
            return
        self._check_no_position(statement)
        key = key_of(target)
        if key in ("XHOME", "HOME") or key.startswith("$"):
            return  # the home of all programs; $AXIS_ACT, where the arm is
        position = self.variables.get(key)
        changed = max(self.forgotten.get(name, 0) for name in (key, key.partition("[")[0]))
        if position is not None and position.line > changed:
            self._use(position, statement)
        elif self.elsewhere is None:
            self.elsewhere = key.partition("[")[0] or words_of(target)[:30], row

    def _use(self, position: StoredPosition, statement: Statement) -> None:
        """A motion goes to a position: in the frames that are active there."""
        frames, row = self.frames.of_motion(statement), statement.row
        if position.cartesian and frames.external_tool:
            self._refuse_external_tool(position, "$IPO_MODE #TCP", row)
        if position.cartesian and position.frames is not None and position.frames != frames:
            reason = f"{position.label} is used in other frames than before"
            refuse(reason, self.path, row, "use each position with one tool and one base")
        position.frames = frames

    def _refuse_external_tool(self, position: StoredPosition, how: str, row: int) -> None:
        reason = f"{position.label}: a tool that stands in the cell ({how}) cannot be read"
        refuse(reason, self.path, row, "measure with the tool at the flange")

    def _forget(self, key: str, row: int) -> None:
        """A variable gets values that are not in the file; those at motions before stay."""
        # of an index that is computed nobody knows which element it is
        name = key.partition(".")[0].replace("[?]", "")
        if self.is_data and name in self.variables:
            refuse(f"{name} is changed in part", self.path, row, "store the position whole")
        self.forgotten[name] = row

    def _add(self, variable: str, aggregate: Tree[Token], row: int) -> None:
        fields = fields_of(aggregate)
        position = StoredPosition(variable, row, dict(fields))
        if len(position.fields) < len(fields):
            names = [name for name, _ in fields]
            twice = next(name for name in names if names.count(name) > 1)
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


def _is_aggregate(node: Node) -> TypeGuard[Tree[Token]]:
    return isinstance(node, Tree) and node.data == "aggregate"


def _is_index(node: Node) -> bool:
    return isinstance(node, Tree) and node.data == "index"


def _holds_position(node: Node) -> TypeGuard[Tree[Token]]:
    """Whether it begins as a position does."""
    fields = fields_of(node) if _is_aggregate(node) else []
    return bool(fields) and fields[0][0] in ("A1", "X") and kind_of(node) not in ("FRAME", "LOAD")


def _recorded(
    numbered: Sequence[tuple[int, StoredPosition]], path: Path | str
) -> tuple[RecordedPosition, ...]:
    """Stored positions with their numbers as recorded ones."""
    for _, position in numbered:
        _check_names(position, path)
    own = [position for _, position in numbered if not position.other]
    at_rest(_external_axes(own or [position for _, position in numbered]), path)
    poses = iter(_poses([position for _, position in numbered if position.cartesian], path))
    found = []
    for n, position in numbered:
        frames, posed = position.frames or Frames(), position.cartesian
        found.append(
            RecordedPosition(
                n,
                position.name,
                position.line,
                shown_deg=None if posed else _joints(position, path),
                T_user_tool=next(poses) if posed else None,
                configuration=_configuration(position, path) if posed else None,
                user_frame=frames.base.number,
                tool_frame=frames.tool.number,
                T_world_user=frames.base.value if posed else None,
                T_tip_tool=frames.tool.value if posed else None,
            )
        )
    return tuple(found)


def _check_names(position: StoredPosition, path: Path | str) -> None:
    label, row, names = position.label, position.line, position.fields.keys()
    strange = [n for n in names if n not in {*AXES, *POSE, *EXTERNAL, *CONFIGURATION}]
    if strange:
        refuse(f"{label}: {strange[0]} is no joint of a six-joint arm", path, row)
    mixed = [name for name in (*POSE, *CONFIGURATION) if name in names]
    if mixed and not position.cartesian:
        refuse(f"{label} has {mixed[0]} beside A1 to A6", path, row)
    for name in POSE if position.cartesian else AXES:
        if name not in names:
            whole = "a pose has X Y Z A B C" if position.cartesian else "a posture has A1 to A6"
            refuse(f"{label}: {name} is missing", path, row, whole)


def _joints(position: StoredPosition, path: Path | str) -> np.ndarray:
    fields, label, row = position.fields, position.label, position.line
    return np.array([joint_deg(fields[a], f"{label}: {a}", path, row) for a in AXES])


def _poses(positions: Sequence[StoredPosition], path: Path | str) -> np.ndarray:
    """Poses of the tool ``(N, 4, 4)`` [m]: ``Rz(A) Ry(B) Rx(C)``."""
    values = np.empty((len(positions), 6))
    for i, position in enumerate(positions):
        fields, label, row = position.fields, position.label, position.line
        place = [millimetres(fields[a], f"{label}: {a}", path, row) for a in "XYZ"]
        turn = [joint_deg(fields[a], f"{label}: {a}", path, row) for a in "CBA"]
        values[i] = [*place, *turn]
    return transform(rotation_from_wpr(np.deg2rad(values[:, 3:])), values[:, :3] / 1e3)


def _configuration(position: StoredPosition, path: Path | str) -> KukaConfiguration | None:
    """Status and Turn; None where the position has neither."""
    given = [name for name in CONFIGURATION if name in position.fields]
    if not given:
        return None
    if len(given) == 1:
        other = "T" if given == ["S"] else "S"
        refuse(f"{position.label} has {given[0]} and no {other}", path, position.line)
    try:
        return KukaConfiguration.parse(
            ",".join(f"{name} {position.fields[name]}" for name in given)
        )
    except InputError as error:
        refuse(f"{position.label}: {error.message}", path, position.line, error.hint)


def _external_axes(positions: Sequence[StoredPosition]) -> Iterator[tuple[str, str, str, int]]:
    for position in positions:
        for axis in EXTERNAL:
            if axis in position.fields:
                yield position.label, axis, position.fields[axis], position.line
