"""KUKA KRL programs (``.dat`` and ``.src``): the reader of what controllers and people write.

Of a ``.dat`` the declared positions are read (AXIS, E6AXIS, POS, E6POS, elements of arrays), with
the frames of their FDAT; of a ``.src`` those that stand in PTP and LIN instructions, or that it
assigns. ``XP3`` and ``P3`` are position 3; other names are numbered behind, in the order of the
file. FOLDs of inline forms are comments. Where a program keeps the touched-up positions in ``XM``,
those stand in the place of the planned ones, and poses not yet measured are left out as soon as one
is measured.

What would be read wrong in silence is refused with its line: relative motions, circles, offsets,
positions without a value, an external axis that moves, and a ``.src`` whose positions stand
elsewhere.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from posedesign.programs.kuka_krl.frames import ActiveFrames, Frame, Frames
from posedesign.programs.kuka_krl.stored import StoredPosition, fields_of, recorded
from posedesign.programs.numbering import Numbering
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import PlanMark, RecordedProgram

_FLAGS = re.IGNORECASE | re.ASCII
_NAME = r"[A-Z_]\w{0,99}"
_MODULE = re.compile(rf"(?:GLOBAL\s+)?(DEFDAT|DEFFCT\s+\w+|DEF)\s+({_NAME})", _FLAGS)
_ENDS = re.compile(r"(?:END|ENDFCT|ENDDAT)", _FLAGS)
_DECLARED = re.compile(
    rf"(?:DECL\s+)?(?:(?:GLOBAL|CONST)\s+){{0,2}}(E6AXIS|AXIS|E6POS|POS)\s+({_NAME})\s*(.*)",
    _FLAGS,
)
_ASSIGNED = re.compile(rf"({_NAME})\s*(\[\s*\d{{1,6}}\s*\])?\s*=\s*\{{([^{{}}]*)\}}", _FLAGS)
_POSITION = re.compile(r"\{\s*(?:\w{1,24}\s*:\s*)?(?:A1|X)\b", _FLAGS)
_OTHER = re.compile(r"\bFRAME\b|\bLOAD\b|(?:TOOL|BASE|LOAD)_DATA\b", _FLAGS)
_VALUE = re.compile(r"=\s*\{([^{}]*)\}", _FLAGS)
_MOTION = re.compile(r"(S?PTP|S?LIN|S?CIRC|SPL)(_REL)?(?![\w$])\s*(.*)", _FLAGS)
_INLINE = re.compile(r"\{([^{}]*)\}\s*(.*)", _FLAGS)
_FDAT = re.compile(rf"(?:DECL\s+)?(?:GLOBAL\s+)?FDAT\s+({_NAME})\s*=\s*\{{(.*)\}}", _FLAGS)
_FDAT_FRAME = re.compile(r"\b(TOOL|BASE)_NO\s+(\d{1,3})\b", _FLAGS)
_EXTERNAL_TOOL = re.compile(r"\bIPO_FRAME\s+#TCP\b", _FLAGS)
_ALL_FRAMES = re.compile(r"TOOL\s+(\d{1,3})\s+BASE\s+(\d{1,3})\s*", _FLAGS)
_POSE_NAME = re.compile(r"P(\d{1,6}) (.*)")
_FIRST_REGISTER = re.compile(r"XM\[(\d{1,6})\] IS P(\d{1,6})\s*")
_NUMBERED = re.compile(r"X?P(\d{1,6})", _FLAGS)
_ELEMENT = re.compile(r"XM\[(\d{1,6})\]", _FLAGS)
_CHANGED = re.compile(rf"({_NAME})\s*(\[[^\]]{{0,20}}\])?\s*(\.\s*\w{{1,24}}\s*)?=(?!=)", _FLAGS)

_BINARY = re.compile(rb"[^\t\r\n -~\x80-\xff]")
_WHAT = "name the .dat of a KRL program, or a .src with positions in its motions"


@dataclass
class _Module:
    """What a file says, line by line."""

    name: str = ""
    kind: str = ""
    comment: str = ""
    mark: PlanMark | None = None
    closed: bool = False
    positions: list[StoredPosition] = field(default_factory=list)
    variables: dict[str, StoredPosition] = field(default_factory=dict)
    pose_names: dict[int, str] = field(default_factory=dict)
    fdat: dict[str, dict[str, int]] = field(default_factory=dict)
    forgotten: dict[str, int] = field(default_factory=dict)
    external_tools: set[str] = field(default_factory=set)
    frames: ActiveFrames = field(default_factory=ActiveFrames)
    first_register: tuple[int, int] | None = None
    elsewhere: tuple[str, int] | None = None


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
    module = _Module()
    lines = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1").split("\n")
    for row, raw in enumerate(lines, start=1):
        code, remark = _divided(raw)
        if remark is not None:
            _take_remark(module, remark.strip())
        if code.startswith("&"):
            _take_header(module, code)
        elif code:
            _take(module, code, path, row)
    if not module.kind:
        refuse("is no KRL program: there is no DEFDAT and no DEF", path, 1, _WHAT)
    if not module.closed:
        end = "ENDDAT" if module.kind == "DEFDAT" else "END"
        refuse(f"is cut off: there is no {end}", path, len(lines), "copy the file again")
    if module.elsewhere is not None:
        name, row = module.elsewhere
        refuse(f"{name} is stored elsewhere", path, row, "name the .dat of the program")
    if not module.positions:
        refuse("holds no positions", path, hint="name the file that was touched up")
    _take_fdat(module, path)
    numbering = Numbering(
        _NUMBERED, _ELEMENT, module.mark, module.pose_names, module.first_register
    )
    positions = recorded(numbering.of(module.positions, path), path)
    return RecordedProgram(
        module.name,
        module.comment,
        module.mark or PlanMark(),
        positions,
        "kuka",
        empty_registers=numbering.is_untouched(module.positions),
    )


def _divided(line: str) -> tuple[str, str | None]:
    """The instruction, blanks in it as one, and the comment behind it."""
    # runs of blanks as one: a damaged line must not be retried for each way to divide them
    if '"' not in line:
        code, semicolon, remark = line.partition(";")
        return " ".join(code.split()), remark if semicolon else None
    quoted = False
    for at, character in enumerate(line):
        quoted ^= character == '"'
        if character == ";" and not quoted:
            return " ".join(line[:at].split()), line[at + 1 :]
    return " ".join(line.split()), None


def _take_header(module: _Module, code: str) -> None:
    word, _, text = code.partition(" ")
    if word.upper() == "&COMMENT":
        module.comment = module.comment or text.strip()


def _take_remark(module: _Module, remark: str) -> None:
    if remark.startswith("PLAN") and module.mark is None:
        module.mark = PlanMark.found_in(remark)
    named = _POSE_NAME.fullmatch(remark)
    if named:
        module.pose_names.setdefault(int(named[1]), named[2].strip())
    frames = _ALL_FRAMES.fullmatch(remark)
    if frames:
        module.frames.give(int(frames[1]), int(frames[2]))
    register = _FIRST_REGISTER.fullmatch(remark)
    if register:
        module.first_register = int(register[1]), int(register[2])


def _take(module: _Module, code: str, path: Path | str, row: int) -> None:
    """Add what one instruction says."""
    begins = _MODULE.match(code)
    if begins:
        # a .src has a routine and then its subroutines, each with its END
        if module.kind and (module.kind == "DEFDAT" or not module.closed):
            refuse(f"{begins[2]} begins inside {module.name}", path, row, "copy the file again")
        module.name, module.kind = module.name or begins[2], module.kind or begins[1].upper()
        module.closed = False
        if module.kind != "DEFDAT":
            module.frames = ActiveFrames()  # those of whoever calls the routine
    elif not module.kind:
        refuse("is no KRL program: it does not begin with DEFDAT or DEF", path, row, _WHAT)
    elif module.closed:
        if module.kind == "DEFDAT" or "{" in code:
            refuse(f"{code[:30]!r} stands behind the end of the program", path, row)
    elif _ENDS.fullmatch(code):
        module.closed = True
    elif module.kind == "DEFDAT":
        _take_data(module, code, path, row)
    else:
        _take_instruction(module, code, path, row)


def _take_data(module: _Module, code: str, path: Path | str, row: int) -> None:
    frames = _FDAT.match(code)
    if frames:
        numbers = {kind.upper(): int(n) for kind, n in _FDAT_FRAME.findall(frames[2])}
        module.fdat[frames[1].upper()] = numbers
        if _EXTERNAL_TOOL.search(frames[2]):
            module.external_tools.add(frames[1].upper())
    elif not _take_declaration(module, code, path, row):
        _take_assignment(module, code, path, row)


def _take_declaration(module: _Module, code: str, path: Path | str, row: int) -> bool:
    """Add a declared position; return whether this is the declaration of one."""
    declared = _DECLARED.fullmatch(code)
    if not declared:
        return False
    name, rest = declared[2], declared[3].strip()
    value = _VALUE.fullmatch(rest)
    if value:
        _add(module, name, value[1], path, row)
    elif rest and not re.match(r"[,\[]", rest):
        refuse(f"{name}: cannot make sense of {rest[:30]!r}", path, row)
    elif not rest and _NUMBERED.fullmatch(name) and module.kind == "DEFDAT":
        refuse(f"{name} has no value", path, row, "touch the position up")
    return True


def _take_assignment(module: _Module, code: str, path: Path | str, row: int) -> None:
    """Add a position that is given its values; refuse other instructions that hold one."""
    assigned = _ASSIGNED.fullmatch(code)
    bare = re.sub(r'"[^"]*"', '""', code)
    changed = _CHANGED.match(bare)
    if changed and (changed[3] or not assigned):
        _forget(module, changed, path, row)
    if not _POSITION.search(bare) or _OTHER.search(bare):
        return
    if not assigned:
        refuse(f"cannot make sense of {code[:30]!r}", path, row)
    _add(module, assigned[1] + re.sub(r"\s", "", assigned[2] or ""), assigned[3], path, row)


def _take_instruction(module: _Module, code: str, path: Path | str, row: int) -> None:
    if module.frames.take(code):
        return
    motion = _MOTION.match(code)
    if motion is None:
        if not _take_declaration(module, code, path, row):
            _take_assignment(module, code, path, row)
        return
    inline = _INLINE.match(motion[3])
    if motion[2] or motion[1].upper() in ("CIRC", "SCIRC", "SPL"):
        word = motion[1].upper() + (motion[2] or "").upper()
        refuse(f"{word}: only PTP and LIN can be read", path, row, "name the .dat of the program")
    if inline:
        if inline[2].startswith(":"):
            refuse("a position with an offset cannot be read", path, row)
        _add(module, "", inline[1], path, row)
        _use(module, module.positions[-1], inline[2], path, row)
    elif "{" in motion[3]:
        refuse(f"cannot make sense of {motion[3][:30]!r}", path, row)
    else:
        _take_target(module, motion[3], path, row)


def _take_target(module: _Module, text: str, path: Path | str, row: int) -> None:
    """A motion to a variable: it must be one that the file gives its values."""
    name = re.match(rf"({_NAME})(\s*\[[^\]]{{0,20}}\])?\s*(:)?", text, _FLAGS)
    if name is None or name[1].upper() in ("XHOME", "HOME"):
        return  # $AXIS_ACT, where the arm is; the home of all programs
    if name[3]:
        refuse("a position with an offset cannot be read", path, row)
    variable = name[1].upper() + re.sub(r"\s", "", name[2] or "").upper()
    position = module.variables.get(variable)
    changed = max(module.forgotten.get(key, 0) for key in (variable, name[1].upper()))
    if position is not None and position.line > changed:
        _use(module, position, text[name.end() :], path, row)
    else:
        module.elsewhere = module.elsewhere or (name[1], row)


def _use(module: _Module, position: StoredPosition, rest: str, path: Path | str, row: int) -> None:
    """A motion goes to a position: in the frames that are active there."""
    frames = module.frames.of_motion(rest)
    if position.cartesian and frames.external_tool:
        reason = f"{position.label}: a tool that stands in the cell ($IPO_MODE #TCP) cannot be read"
        refuse(reason, path, row, "measure with the tool at the flange")
    if position.cartesian and position.frames is not None and position.frames != frames:
        reason = f"{position.label} is used in other frames than before"
        refuse(reason, path, row, "use each position with one tool and one base")
    position.frames = frames


def _forget(module: _Module, changed: re.Match[str], path: Path | str, row: int) -> None:
    """A variable gets values that are not in the file; which it had at motions before stays."""
    name, index = changed[1].upper(), re.sub(r"\s", "", changed[2] or "")
    # of an index that is computed nobody knows which element it is
    key = name + index if index[1:-1].isdigit() else name
    if module.kind == "DEFDAT" and key in module.variables:
        refuse(f"{changed[1]} is changed in part", path, row, "store the position whole")
    module.forgotten[key] = row


def _add(module: _Module, variable: str, text: str, path: Path | str, row: int) -> None:
    fields = fields_of(text, variable or "the position", path, row)
    position = StoredPosition(variable, row, fields)
    if module.kind == "DEFDAT":
        position.frames = module.frames.of_motion("")
    module.positions.append(position)
    if variable:
        name = variable.upper()
        if name in module.variables:
            refuse(f"{variable} is there twice", path, row, "remove one of them")
        module.variables[name] = position


def _take_fdat(module: _Module, path: Path | str) -> None:
    """Frames of positions that inline forms touched up, as the data beside them say."""
    for position in module.positions:
        name = "F" + position.variable.upper().removeprefix("X")
        frames = module.fdat.get(name)
        if frames is None or not position.variable:
            continue
        if position.cartesian and name in module.external_tools:
            reason = f"{position.label}: a tool that stands in the cell (#TCP) cannot be read"
            refuse(reason, path, position.line, "measure with the tool at the flange")
        position.frames = position.frames or Frames()
        for kind, n in frames.items():
            position.frames = position.frames.with_frame(kind, Frame(n))
