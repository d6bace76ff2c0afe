"""ABB RAPID modules (``.mod``, ``.modx``, ``.prg``): the reader.

All jointtargets and robtargets that are declared with a value are read, arrays of them too, and
those that stand in MoveAbsJ, MoveJ and MoveL themselves. ``p3`` and ``jp3`` are position 3; other
names are numbered behind, in the order of the file. Statements may be divided among lines in any
way. Where a program keeps the touched-up positions in ``jMeasured``, those stand in the place of
the planned ones, and poses not yet measured are left out as soon as one is measured. Poses have the
frames of the motion to them, where the module declares those with their values.

What would be read wrong in silence is refused with its line: circles, positions without a value,
an external axis that moves, a pose in two frames, or of a part that the arm holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from posedesign.programs.abb_rapid.frames import MotionFrames
from posedesign.programs.abb_rapid.stored import (
    StoredPosition,
    nested,
    recorded,
    stored,
)
from posedesign.programs.numbering import Numbering
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import PlanMark, RecordedProgram

_FLAGS = re.IGNORECASE | re.ASCII
_NAME = r"[A-Z]\w{0,99}"
_PIECE = re.compile(r'"[^"\n]*"?|![^\n]*|;')
_HEADER = re.compile(r"\s{0,99}%%%[^%]{0,999}%%%")
_MODULE = re.compile(rf"\s*MODULE\s+({_NAME})(?:\s?\([\w ,]{{0,99}}\))?(?=\s|$)", _FLAGS)
_END = re.compile(r"\bENDMODULE\s*$", _FLAGS)
_DECLARED = re.compile(
    rf"\b(CONST|PERS|VAR) (jointtarget|robtarget) ({_NAME}) ?(\{{[^}}]{{0,40}}\}})? ?(:= ?)?",
    _FLAGS,
)
_MOTION = re.compile(r"\b(MoveAbsJ|MoveJ|MoveL|MoveC)(?:\\\w+(?::=\w+)?)* ?,? ?(?=\[)", _FLAGS)
_QUAD, _SIX = (rf"\[(?:[^\[\],]{{1,30}},){{{n}}}[^\[\],]{{1,30}}\]" for n in (3, 5))
_LOST = re.compile(rf"\[ ?{_SIX} ?, ?{_SIX} ?\]|{_QUAD} ?, ?{_QUAD} ?, ?{_SIX}", _FLAGS)
_NUMBERS = re.compile(r"\bnum\b", _FLAGS)
_ROUTINE = re.compile(rf"\b(?:PROC|FUNC {_NAME}) {_NAME} ?\([^()]*\)", _FLAGS)
_PLACE = re.compile(
    r"\b(?:CONST|PERS|VAR|MoveAbsJ|MoveJ|MoveL|MoveC|PDispOn|PDispSet)\b|:=", _FLAGS
)
_POSE_NAME = re.compile(r"P(\d{1,6}) (.*)")
_FIRST_REGISTER = re.compile(r"jMeasured\{(\d{1,6})\} IS P(\d{1,6})\s*")
_NUMBERED = re.compile(r"[JR]?P(\d{1,6})", _FLAGS)
_ELEMENT = re.compile(r"JMEASURED\{(\d{1,6})\}", _FLAGS)
_BINARY = re.compile(rb"[^\t\r\n -~\x80-\xff]")
_WHAT = "name a RAPID module saved as text: .mod or .modx"


@dataclass
class _Module:
    """What a file says, statement by statement."""

    name: str
    comment: str = ""
    mark: PlanMark | None = None
    positions: list[StoredPosition] = field(default_factory=list)
    variables: set[str] = field(default_factory=set)
    pose_names: dict[int, str] = field(default_factory=dict)
    first_register: tuple[int, int] | None = None
    frames: MotionFrames = field(default_factory=MotionFrames)


def parse_abb_rapid(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; ``path`` is for the messages.

    Raises
    ------
    FileFormatError
        The file is no RAPID module, is cut off, or holds no positions, or one that is neither a
        jointtarget nor a robtarget.
    """
    bad = _BINARY.search(data)
    if bad:
        row = data.count(b"\n", 0, bad.start()) + 1
        refuse(f"holds the byte 0x{bad[0][0]:02x}, which is not text", path, row, _WHAT)
    text = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1").replace("\r\n", "\n")
    header = _HEADER.match(text)
    before = text[: header.end()].count("\n") if header else 0
    statements, remarks = _divided(text[header.end() :] if header else text, before + 1)
    begins = _MODULE.match(statements[0][1]) if statements else None
    if begins is None:
        refuse("is no RAPID module: it does not begin with MODULE", path, 1, _WHAT)
    if not _END.search(statements[-1][1]):
        reason = "is cut off: ENDMODULE is not its end"
        refuse(reason, path, text.count("\n") + 1, "copy the file again")
    module = _Module(begins[1])
    for remark in remarks:
        _take_remark(module, remark)
    for row, statement in statements:
        place = _PLACE.search(statement)
        at = row + statement.count("\n", 0, place.start()) if place else row
        _take(module, _ROUTINE.sub("", " ".join(statement.split())), path, at)
    if not module.positions:
        refuse("holds no positions", path, hint="name the module that was touched up")
    module.frames.give(module.positions, path)
    numbering = Numbering(
        _NUMBERED, _ELEMENT, module.mark, module.pose_names, module.first_register
    )
    return RecordedProgram(
        module.name,
        module.comment,
        module.mark or PlanMark(),
        recorded(numbering.of(module.positions, path), path),
        "abb",
        empty_registers=numbering.is_untouched(module.positions),
    )


def _divided(text: str, row: int) -> tuple[list[tuple[int, str]], list[str]]:
    """Statements with the line that each begins in, and remarks; strings become empty ones."""
    statements: list[tuple[int, str]] = []
    remarks: list[str] = []
    parts: list[str] = []
    begun, last = row, 0
    for at, end, mark in _pieces(text):
        between = text[last:at]
        code = between.lstrip()
        if not parts and (code or mark == '"'):
            begun = row + between.count("\n", 0, len(between) - len(code))
            between = code
        if parts or code:
            parts.append(between)
        row += text.count("\n", last, at)
        last = end
        if mark == ";":
            statements.append((begun, "".join(parts)))
            parts = []
        elif mark == "!":
            remarks.append(text[at + 1 : end].strip())
        elif mark == '"':
            parts.append('""')
    statements.append((begun if parts else row, "".join(parts)))
    return statements, remarks


def _pieces(text: str) -> Iterator[tuple[int, int, str]]:
    """Where strings, remarks and semicolons begin and end, and the end of the text."""
    for piece in _PIECE.finditer(text):
        yield piece.start(), piece.end(), piece[0][0]
    yield len(text), len(text), ""


def _take_remark(module: _Module, remark: str) -> None:
    named, register = _POSE_NAME.fullmatch(remark), _FIRST_REGISTER.fullmatch(remark)
    if remark.startswith("PLAN ") and module.mark is None:
        module.mark = PlanMark.found_in(remark)
    elif named:
        module.pose_names.setdefault(int(named[1]), named[2].strip())
    elif register:
        module.first_register = int(register[1]), int(register[2])
    elif not (remark.startswith("* ") or module.comment or module.mark or module.pose_names):
        module.comment = remark


def _take(module: _Module, code: str, path: Path | str, row: int) -> None:
    """Add the positions of one statement."""
    declared = list(_DECLARED.finditer(code))
    if len(declared) == 1:
        _take_declaration(module, declared[0], code, path, row)
        return
    module.frames.take(code, row)
    motion = _MOTION.search(code)
    if declared or (motion is None and _LOST.search(code) and not _NUMBERS.search(code)):
        refuse(f"cannot make sense of {code[:30]!r}", path, row)
    if motion is None:
        return
    if motion[1].upper() == "MOVEC":
        refuse("MoveC: only MoveAbsJ, MoveJ and MoveL can be read", path, row)
    text = _brackets(code[motion.end() :])
    value = nested(text, "the position", path, row)
    kind = "jointtarget" if motion[1].upper() == "MOVEABSJ" else "robtarget"
    module.positions.append(stored("", kind, value, path, row))


def _brackets(text: str) -> str:
    """The text up to the bracket that closes its first one."""
    depth = 0
    for mark in re.finditer(r"[\[\]]", text):
        depth += 1 if mark[0] == "[" else -1
        if depth == 0:
            return text[: mark.end()]
    return text


def _take_declaration(
    module: _Module, declared: re.Match[str], code: str, path: Path | str, row: int
) -> None:
    storage, kind, name, size = (declared[k] for k in range(1, 5))
    if not declared[5]:
        rest = code[declared.end() :].strip()
        if rest:
            refuse(f"{name}: cannot make sense of {rest[:30]!r}", path, row)
        if storage.upper() != "VAR" and _NUMBERED.fullmatch(name):
            refuse(f"{name} has no value", path, row, "touch the position up")
        return
    value = nested(code[declared.end() :], name, path, row)
    if name.upper() in module.variables:
        refuse(f"{name} is there twice", path, row, "remove one of them")
    module.variables.add(name.upper())
    if not size:
        position = stored(name, kind.lower(), value, path, row)
        if not position.is_empty:
            module.positions.append(position)
        elif _NUMBERED.fullmatch(name):
            refuse(f"{name} has no value", path, row, "touch the position up")
        return
    count = re.fullmatch(r"\{ ?(\d{1,6}) ?\}", size)
    if count is None or int(count[1]) != len(value):
        refuse(f"{name}{size} has {len(value)} elements", path, row)
    for k, item in enumerate(value, start=1):
        if not isinstance(item, list):
            refuse(f"{name}{{{k}}}: cannot make sense of {item!r}", path, row)
        position = stored(f"{name}{{{k}}}", kind.lower(), item, path, row)
        if not position.is_empty:
            module.positions.append(position)
