"""KUKA KRL as the strict validator sees it: lines, instructions, braces; nothing interpreted.

This shares no code with the reader and the writer, so that a mistake in one of them shows.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

_IGNORE = re.IGNORECASE | re.ASCII
_BEGIN = re.compile(r"(?:GLOBAL +)?(DEFDAT|DEF|DEFFCT +\w+) +([^\s(]+) *(.*)", _IGNORE)
_END = re.compile(r"(ENDDAT|ENDFCT|END)", _IGNORE)
_MOTION = re.compile(r"(S?PTP|S?LIN|S?CIRC|SPL)(_REL)?\b *(.*)", _IGNORE)
_VALUE = re.compile(
    r"(?:DECL +)?(?:GLOBAL +)?(?:CONST +)?(?:(E6AXIS|AXIS|E6POS|POS) +)?"
    r"([A-Z_]\w*(?: *\[[^\]]{0,20}\])?) *= *\{(.*)\} *",
    _IGNORE,
)
_DECLARED = re.compile(
    r"(?:DECL +)?(?:GLOBAL +)?(?:CONST +)?(E6AXIS|AXIS|E6POS|POS) +([A-Z_].*)", _IGNORE
)
_FIELD = re.compile(r"([A-Z]\w*) +(\S+)", _IGNORE)

DECLARES = re.compile(
    r"(?:DECL|EXT|EXTFCT|SIGNAL|STRUC|ENUM|IMPORT)\b|(?:GLOBAL +)?(?:DECL +)?(?:CONST +)?"
    r"(?:INT|REAL|BOOL|CHAR|E6AXIS|AXIS|E6POS|POS|FRAME|FDAT|PDAT|LDAT) +[A-Z_$]",
    _IGNORE,
)
"""How a declaration begins."""

_TARGET = re.compile(r"([A-Z_]\w*(?: *\[[^\]]*\])?)", _IGNORE)
_GLOBAL = {"XHOME", "HOME"}


@dataclass(frozen=True)
class Line:
    """A line of the file; ``code`` is without comment, runs of blanks as one."""

    row: int
    text: str
    code: str


@dataclass(frozen=True)
class Fields:
    """What stands in one pair of braces that holds a position."""

    row: int
    variable: str
    kind: str
    values: tuple[tuple[str, str], ...]
    fault: str

    @property
    def names(self) -> list[str]:
        """Names of the values, in capitals."""
        return [name for name, _ in self.values]


@dataclass
class Module:
    """A file: its routines or its data list."""

    lines: list[Line] = field(default_factory=list)
    begins: list[tuple[int, str, str, str]] = field(default_factory=list)  # row, kind, name, rest
    ends: list[tuple[int, str]] = field(default_factory=list)
    fields: list[Fields] = field(default_factory=list)
    declared: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    motions: list[tuple[int, str, str]] = field(default_factory=list)  # row, word, the rest

    @property
    def is_data(self) -> bool:
        """Whether this is a ``.dat``."""
        return bool(self.begins) and self.begins[0][1] == "DEFDAT"


def split_module(text: str) -> Module:
    """Sort the lines of a file; never fails."""
    module = Module()
    for row, raw in enumerate(text.split("\n"), start=1):
        line = Line(row, raw.rstrip("\r"), " ".join(_code(raw).split()))
        module.lines.append(line)
        if not line.code or line.code.startswith("&"):
            continue
        begin, end = _BEGIN.fullmatch(line.code), _END.fullmatch(line.code)
        if begin:
            module.begins.append((row, begin[1].split()[0].upper(), begin[2], begin[3]))
        elif end:
            module.ends.append((row, end[1].upper()))
        else:
            _sort(module, line)
    return module


def instructions(module: Module) -> Iterator[Line]:
    """Lines that are no comments, headers or blanks."""
    for line in module.lines:
        if line.code and not line.code.startswith("&"):
            yield line


def named_target(target: str) -> str:
    """The variable that a motion goes to; empty for braces, system variables and the home."""
    found = _TARGET.match(target)
    name = found[1].upper().replace(" ", "") if found else ""
    return "" if name in _GLOBAL else name


def _sort(module: Module, line: Line) -> None:
    motion, value, declared = (p.fullmatch(line.code) for p in (_MOTION, _VALUE, _DECLARED))
    if motion:
        word = (motion[1] + (motion[2] or "")).upper()
        module.motions.append((line.row, word, motion[3]))
        inline = re.match(r"\{([^{}]*)\}", motion[3])
        if inline:
            module.fields.append(_fields(line.row, "", "", inline[1]))
    elif value and (value[1] or re.match(r"\s*(?:\w+ *: *)?(?:A1|X)\b", value[3], _IGNORE)):
        name = value[2].upper().replace(" ", "")
        if not name.startswith(("TOOL_DATA", "BASE_DATA")):
            module.fields.append(_fields(line.row, name, value[1] or "", value[3]))
            module.declared.setdefault(name, []).append((line.row, "value"))
    elif declared:
        for part in re.findall(r"[A-Z_]\w*(?: *\[[^\]]{0,20}\])?", declared[2], _IGNORE):
            name = part.upper().replace(" ", "")
            module.declared.setdefault(name, []).append((line.row, ""))


def _code(line: str) -> str:
    """The line without its comment."""
    out, quoted = 0, False
    for piece in re.split(r'([";])', line):
        if piece == ";" and not quoted:
            return line[:out]
        quoted ^= piece == '"'
        out += len(piece)
    return line


def _fields(row: int, variable: str, kind: str, text: str) -> Fields:
    text = re.sub(r"^\s*\w+ *:", "", text)
    found: list[tuple[str, str]] = []
    fault = ""
    for part in text.split(","):
        pair = _FIELD.fullmatch(part.strip())
        if pair:
            found.append((pair[1].upper(), pair[2]))
        else:
            fault = fault or f"{part.strip()[:30]!a} is no name and value"
    return Fields(row, variable, kind.upper(), tuple(found), fault)
