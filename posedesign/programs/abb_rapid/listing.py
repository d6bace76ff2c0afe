"""ABB RAPID as the strict validator sees it: lines and statements; hardly anything interpreted.

This shares no code with the reader and the writer, so that a mistake in one of them shows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property

_IGNORE = re.IGNORECASE | re.ASCII
_BLOCK_WORDS = r"MODULE|PROC|FUNC|TRAP|RECORD"
_HEADING = re.compile(
    rf"(?:LOCAL )?(?:{_BLOCK_WORDS}|END(?:{_BLOCK_WORDS}|IF|FOR|WHILE|TEST)|IF|ELSE|ELSEIF|FOR"
    r"|WHILE|TEST|CASE|DEFAULT|ERROR|UNDO|BACKWARD)\b|[A-Z]\w* ?:$",
    _IGNORE,
)
_WORD = re.compile(r"(?:(?:LOCAL|TASK) )?([A-Z]\w*)", _IGNORE)
_DATA = re.compile(
    r"(LOCAL |TASK )?(CONST|PERS|VAR) (\w+) (\w+) ?(\{[^{}]{0,40}\})? ?(?::= ?(.*))?", _IGNORE
)
_MOTION = re.compile(r"(MoveAbsJ|MoveJ|MoveL|MoveC)\b ?(.*)", _IGNORE)


@dataclass(frozen=True)
class Statement:
    """A statement, blanks in it as one, with its strings emptied; ``end`` is what ends it."""

    row: int
    code: str
    end: str

    @cached_property
    def word(self) -> str:
        """Its first word, in capitals, without LOCAL or TASK."""
        found = _WORD.match(self.code)
        return found[1].upper() if found else ""


@dataclass(frozen=True)
class Data:
    """A declaration of data."""

    row: int
    storage: str
    kind: str
    name: str
    size: str
    value: str | None


@dataclass
class Listing:
    """A module, sorted."""

    lines: list[str] = field(default_factory=list)
    strings: list[tuple[int, str]] = field(default_factory=list)  # row, with its quotes
    statements: list[Statement] = field(default_factory=list)
    data: list[Data] = field(default_factory=list)
    motions: list[tuple[int, str, list[str]]] = field(default_factory=list)  # row, word, arguments


def split_listing(text: str) -> Listing:
    """Sort the lines of a module; never fails."""
    listing = Listing([line.rstrip("\r") for line in text.split("\n")])
    open_code: list[str] = []
    begun = 1
    legacy = 0  # lines of the header between %%% and %%%
    for row, line in enumerate(listing.lines, start=1):
        if line.strip().startswith("%%%") and legacy < 2 and not listing.statements:
            legacy += 1 + (line.count("%%%") > 1)
            continue
        if legacy == 1:
            continue
        code = _code(line, row, listing.strings)
        if _HEADING.match(code):
            # headings of blocks and labels end with their line
            if open_code:
                _add(listing, begun, " ".join(open_code), "")
                open_code = []
            listing.statements.append(Statement(row, code.rstrip("; "), "line"))
            continue
        if not open_code:
            begun = row
        *whole, rest = code.split(";")
        for part in whole:
            _add(listing, begun, " ".join([*open_code, part]), ";")
            open_code, begun = [], row
        if rest.strip():
            open_code.append(rest)
    if open_code:
        _add(listing, begun, " ".join(open_code), "")
    return listing


def _code(line: str, row: int, strings: list[tuple[int, str]]) -> str:
    """The line without remark, its strings emptied, blanks as one."""
    out = []
    for piece in re.finditer(r'"[^"]*"?|![^\n]*|[^"!]+', line):
        if piece[0].startswith("!"):
            break
        if piece[0].startswith('"'):
            strings.append((row, piece[0]))
            out.append('""')
        else:
            out.append(piece[0])
    return " ".join("".join(out).split())


def _add(listing: Listing, row: int, text: str, end: str) -> None:
    code = " ".join(text.split())
    listing.statements.append(Statement(row, code, end))
    data, motion = _DATA.fullmatch(code), _MOTION.fullmatch(code)
    if data:
        kind, name, size = data[3].lower(), data[4], data[5] or ""
        listing.data.append(Data(row, data[2].upper(), kind, name, size, data[6]))
    elif motion:
        parts = arguments(motion[2])
        switches = parts[0].startswith("\\") and len(parts) > 1  # MoveJ \Conc, p1, ...
        listing.motions.append((row, motion[1].upper(), parts[1:] if switches else parts))


def arguments(text: str) -> list[str]:
    """Parts of a text between the commas that stand in no brackets."""
    parts, depth, start = [], 0, 0
    for mark in re.finditer(r"[\[\](){},]", text):
        if mark[0] in "[({":
            depth += 1
        elif mark[0] in "])}":
            depth -= 1
        elif depth == 0:
            parts.append(text[start : mark.start()].strip())
            start = mark.end()
    return [*parts, text[start:].strip()]


def elements(text: str) -> list[str] | None:
    """Elements of a list in brackets; None where the text is none."""
    if not (text.startswith("[") and text.endswith("]")):
        return None
    return arguments(text[1:-1])
