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

from posedesign.programs.kuka_krl.stored import StoredPosition, fields_of, recorded
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
_ACTIVE = re.compile(
    r"BAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\d{1,3})\s*\)"
    r"|\$(TOOL|BASE)\s*=\s*(?:(?:TOOL|BASE)_DATA\s*\[\s*(\d{1,3})\s*\])?",
    _FLAGS,
)
_ALL_FRAMES = re.compile(r"TOOL\s+(\d{1,3})\s+BASE\s+(\d{1,3})\s*", _FLAGS)
_POSE_NAME = re.compile(r"P(\d{1,6}) (.*)")
_FIRST_REGISTER = re.compile(r"XM\[(\d{1,6})\] IS P(\d{1,6})\s*")
_NUMBERED = re.compile(r"X?P(\d{1,6})", _FLAGS)
_ELEMENT = re.compile(r"XM\[(\d{1,6})\]")

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
    variables: set[str] = field(default_factory=set)
    pose_names: dict[int, str] = field(default_factory=dict)
    fdat: dict[str, dict[str, int]] = field(default_factory=dict)
    frames: dict[str, int | None] = field(default_factory=dict)
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
    positions = recorded(_numbered(module, path), path)
    mark = module.mark or PlanMark()
    return RecordedProgram(module.name, module.comment, mark, positions, "kuka")


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
        module.frames |= {"TOOL": int(frames[1]), "BASE": int(frames[2])}
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
    if not _POSITION.search(bare) or _OTHER.search(bare):
        return
    if not assigned:
        refuse(f"cannot make sense of {code[:30]!r}", path, row)
    _add(module, assigned[1] + re.sub(r"\s", "", assigned[2] or ""), assigned[3], path, row)


def _take_instruction(module: _Module, code: str, path: Path | str, row: int) -> None:
    active = _ACTIVE.match(code)
    if active:
        given = active[2] or active[4]
        kind = (active[1] or active[3]).upper()
        module.frames[kind] = int(given) if given else None
        return
    if code.upper().startswith("FDAT_ACT"):
        given_frames = dict(_FDAT_FRAME.findall(code.upper()))
        for kind in ("TOOL", "BASE"):
            module.frames[kind] = int(given_frames[kind]) if kind in given_frames else None
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
    if name[1].upper() + re.sub(r"\s", "", name[2] or "") not in module.variables:
        module.elsewhere = module.elsewhere or (name[1], row)


def _add(module: _Module, variable: str, text: str, path: Path | str, row: int) -> None:
    fields = fields_of(text, variable or "the position", path, row)
    position = StoredPosition(variable, row, fields)
    position.tool_frame = module.frames.get("TOOL")
    position.user_frame = module.frames.get("BASE")
    module.positions.append(position)
    if variable:
        if variable.upper() in module.variables:
            refuse(f"{variable} is there twice", path, row, "remove one of them")
        module.variables.add(variable.upper())


def _numbered(module: _Module, path: Path | str) -> list[tuple[int, StoredPosition]]:
    """Positions with their numbers: measured ones in the place of the planned ones."""
    for position in module.positions:
        frames = module.fdat.get("F" + position.variable.upper().removeprefix("X"))
        if frames is not None and position.variable:
            position.tool_frame = frames.get("TOOL", position.tool_frame)
            position.user_frame = frames.get("BASE", position.user_frame)
    touched = _touched(module)
    kept = {id(position) for position in touched.values()}
    chosen = _by_number([p for p in module.positions if id(p) not in kept])
    if touched:
        measured = module.mark.measured if module.mark else None
        vias = [(n, p) for n, p in chosen if measured is not None and n > measured]
        chosen = sorted(touched.items()) + vias
        if chosen[0][0] < 1:
            position = chosen[0][1]
            refuse(f"{position.variable} is before the first one", path, position.line)
    for n, position in chosen:
        position.other = bool(position.variable) and not (
            _NUMBERED.fullmatch(position.variable) or touched.get(n) is position
        )
        position.name = module.pose_names.get(n, position.variable if position.other else "")
    return chosen


def _touched(module: _Module) -> dict[int, StoredPosition]:
    """Touched-up positions that the program keeps in XM, by the numbers of their poses."""
    if module.first_register is None:
        return {}
    register, first = module.first_register
    found = ((p, _ELEMENT.fullmatch(p.variable.upper())) for p in module.positions)
    return {int(element[1]) - register + first: p for p, element in found if element}


def _by_number(positions: list[StoredPosition]) -> list[tuple[int, StoredPosition]]:
    """Positions by the number in their name, those without behind all others."""
    numbers: list[int | None] = []
    taken: set[int] = set()
    for position in positions:
        found = _NUMBERED.fullmatch(position.variable)
        n = int(found[1]) if found else 0
        numbers.append(n if n and n not in taken else None)
        taken.add(n)
    free = max((n for n in numbers if n is not None), default=0)
    out = []
    for given, position in zip(numbers, positions, strict=True):
        free += given is None
        out.append((free if given is None else given, position))
    return out
