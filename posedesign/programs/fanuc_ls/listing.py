"""FANUC ``.LS``: a file sorted into its sections, its lines as trees; nothing is judged here.

What the reader takes and what the validator checks is this one listing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from lark import Token, Tree

from posedesign.programs.language import (
    MOST_FAULTS,
    Language,
    Line,
    Statement,
    lines_of,
    words,
)

LANGUAGE = Language(
    "posedesign.programs.fanuc_ls", start="instruction", others=("position_line", "attribute_line")
)

_SECTION = re.compile(r"\s*/(PROG|ATTR|APPL|MN|POS|END)(?![A-Za-z_])[ \t]*(.*)")
_NUMBERED = re.compile(r"([ \t]*)(\d{0,9})[ \t]*:(.*)", re.DOTALL)
_SUB_LINE = re.compile(r" {5,20}\d{1,4}")
MOST_LINES = 100_000
"""Of /MN that are looked at: line numbers have four digits, lines inside of others not many."""

_INSIDE = "       ---"
_VALUES = ("active", "config", "field")


@dataclass(frozen=True)
class Instruction:
    """A numbered line of /MN with its continuation lines.

    ``number`` is None where the file has none; ``head`` what stands before the colon; ``inner``
    whether it stands inside of another one (TC_ONLINE, motions of German controllers), with a
    number of its own.
    """

    row: int
    number: int | None
    head: str
    code: str
    closed: bool
    statement: Statement
    inner: bool = False

    @property
    def kind(self) -> str:
        """Name of the grammar's rule."""
        return self.statement.kind


@dataclass
class Group:
    """One motion group of a position.

    ``fields`` hold for each name the text of the value, its unit, and its line; ``frames`` the
    numbers of UF and UT, None where the file leaves them open (F).
    """

    row: int
    frames: dict[str, int | None] = field(default_factory=dict)
    fields: dict[str, tuple[str, str, int]] = field(default_factory=dict)
    config: str | None = None


@dataclass
class Position:
    """A position of /POS; ``faults`` are lines and what is malformed in them."""

    row: int
    number: int
    name: str
    groups: dict[int, Group] = field(default_factory=dict)
    faults: list[tuple[int, str]] = field(default_factory=list)

    @property
    def label(self) -> str:
        """Its name in the program."""
        return f"P[{self.number}]"


@dataclass
class Listing:
    """A whole file."""

    headings: list[tuple[int, str, str]] = field(default_factory=list)  # line, section, rest
    stray: list[tuple[int, str]] = field(default_factory=list)
    unclear: list[tuple[int, str]] = field(default_factory=list)  # of /ATTR
    attributes: list[tuple[int, str, str]] = field(default_factory=list)  # line, name, its text
    lines: list[Line] = field(default_factory=list)  # of /MN
    positions: list[Position] = field(default_factory=list)
    faults: list[tuple[int, str]] = field(default_factory=list)  # in /POS, outside of positions
    rows: int = 1

    @cached_property
    def instructions(self) -> list[Instruction]:
        """Instructions of /MN, as many as there are up to the thousandth fault."""
        return list(_instructions(self.lines))


def read_listing(text: str) -> Listing:
    """Sort the lines of a file into its sections; never fails."""
    listing = Listing(rows=text.count("\n") + 1)
    positions = _PositionReader(listing)
    section = ""
    for line in lines_of(text, indented=True):
        heading = _SECTION.fullmatch(line.text)
        if heading:
            section = heading[1]
            listing.headings.append((line.row, section, heading[2]))
        elif section == "ATTR":
            _take_attribute(listing, line)
        elif section == "MN" and len(listing.lines) < MOST_LINES:
            listing.lines.append(line)
        elif section == "POS":
            positions.take_line(line)
        elif section != "APPL":
            listing.stray.append((line.row, line.text))
        if max(len(listing.stray), len(listing.unclear), positions.faults) > MOST_FAULTS:
            break
    positions.finish()
    return listing


def _take_attribute(listing: Listing, line: Line) -> None:
    statement = LANGUAGE.statement(line, "attribute_line")
    if statement.fault:
        listing.unclear.append((line.row, statement.fault))
    else:
        listing.attributes.append((line.row, statement.word("KEY"), line.text))


def _instructions(lines: list[Line]) -> Iterator[Instruction]:
    """Instructions of /MN; a long one goes on in lines that have a colon, but no number."""
    faults = 0
    joined: list[list[str]] = []  # of the open instruction
    head: tuple[int, str, int | None] = (0, "", None)
    for line in [*lines, Line(0, "0:")]:
        found = _NUMBERED.fullmatch(line.text)
        if found and not found[2] and joined and not joined[-1][0].rstrip().endswith(";"):
            joined.append([found[3]])
            continue
        if joined and faults < MOST_FAULTS:
            made = _instruction(*head, " ".join(body for (body,) in joined))
            faults += bool(made.statement.fault) or not made.closed
            yield made
        joined = []
        if line.text.startswith(_INSIDE) or not line.text.strip():
            continue
        number = int(found[2]) if found and found[2] else None
        head = (line.row, found[1] + found[2] if found else line.text, number)
        joined = [[found[3] if found else ""]]


def _instruction(row: int, head: str, number: int | None, body: str) -> Instruction:
    closed = body.rstrip().endswith(";")
    code = body.rstrip().removesuffix(";").rstrip()
    statement = LANGUAGE.statement(Line(row, code.strip() or "!"))
    return Instruction(row, number, head, code, closed, statement, bool(_SUB_LINE.fullmatch(head)))


@dataclass
class _PositionReader:
    """Collects the positions of /POS, one element at a time, whatever lines they stand on."""

    listing: Listing
    position: Position | None = None
    group: Group | None = None
    comma: bool = True  # whether a value may follow
    faults: int = 0  # lines that are none of a position

    def take_line(self, line: Line) -> None:
        """Take one more line of the section."""
        statement = LANGUAGE.statement(line, "position_line")
        if statement.fault:
            faults = self.listing.faults if self.position is None else self.position.faults
            faults.append((line.row, statement.fault))
            self.comma = True
            self.faults += 1
            return
        for element in statement.tree.children:
            if isinstance(element, Tree) and not self._take(line.row, element):
                reason = f"{line.text.strip()[:30]!a} is outside a position"
                self.listing.faults.append((line.row, reason))
                self.faults += 1
                return

    def finish(self) -> None:
        """End of the section: no position may be open."""
        if self.position is not None:
            self.position.faults.append((self.position.row, "is not closed by };"))

    def _tell(self, position: Position, row: int, fault: str) -> None:
        position.faults.append((row, fault))
        self.faults += 1

    def _take(self, row: int, element: Tree[Token]) -> bool:
        """Add an element to the open position; False where none is open."""
        kind, position = element.data, self.position
        if kind == "header":
            if position is not None:
                self._tell(position, row, "is not closed by };")
            name = "".join(words(element, "NAME_TEXT")).lstrip(": ").strip(' "')
            number = int(words(element, "INT")[0][:9])
            self.position, self.group, self.comma = Position(row, number, name), None, True
            self.listing.positions.append(self.position)
        elif position is None:
            return False
        elif kind == "close":
            if self.comma and self.group is not None and self.group.fields:
                self._tell(position, row, "has a comma behind its last value")
            self.position = None
        elif kind == "group":
            number = int(words(element, "GROUP")[0][2:5])
            if number in position.groups:
                self._tell(position, row, f"has GP{number} twice")
            self.group, self.comma = Group(row), True
            position.groups[number] = self.group
        elif self.group is None:
            self._tell(position, row, "has a value outside a group")
        elif kind == "comma" or kind in _VALUES:
            if self.comma == (kind == "comma"):
                reason = "has a comma too many" if self.comma else "has no comma before a value"
                self._tell(position, row, reason)
            self.comma = kind == "comma"
            if not self.comma:
                _take_value(position, self.group, row, element)
        return True


def _take_value(position: Position, group: Group, row: int, element: Tree[Token]) -> None:
    tokens = {t.type: str(t) for t in element.children if isinstance(t, Token)}
    if element.data == "active":
        group.frames[tokens["FRAME"]] = None if "OPEN" in tokens else int(tokens["INT"][:5])
    elif element.data == "config":
        group.config = tokens["TEXT"].strip("'\"")
    elif tokens["FIELD"] in group.fields:
        position.faults.append((row, f"has {tokens['FIELD']} twice"))
    else:
        value = tokens.get("NUMBER", tokens.get("STARS", ""))
        group.fields[tokens["FIELD"]] = (value, tokens.get("LENGTH", ""), row)
