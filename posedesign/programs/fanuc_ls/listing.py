"""FANUC ``.LS``: a file sorted into its sections, its lines as trees; nothing is judged here.

What the reader takes and what the validator checks is this one listing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from lark import Token, Tree

from posedesign.programs.language import MOST_FAULTS, Language, Line, Statement, words

LANGUAGE = Language(
    "posedesign.programs.fanuc_ls", start="instruction", others=("position_line", "attribute_line")
)

_SECTION = re.compile(r"\s*/(PROG|ATTR|APPL|MN|POS|END)(?![A-Za-z_])[ \t]*(.*)")
_NUMBERED = re.compile(r"([ \t]*)(\d{0,9})[ \t]*:(.*)", re.DOTALL)
_SUB_LINE = re.compile(r" {5,20}\d{1,4}")
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
    instructions: list[Instruction] = field(default_factory=list)
    positions: list[Position] = field(default_factory=list)
    faults: list[tuple[int, str]] = field(default_factory=list)  # in /POS, outside of positions
    rows: int = 1


def read_listing(text: str) -> Listing:
    """Sort the lines of a file into its sections; never fails."""
    listing = Listing(rows=text.count("\n") + 1)
    bodies: dict[str, list[Line]] = {"ATTR": [], "MN": [], "POS": []}
    section = ""
    row, last = 1, 0
    for found in re.finditer(r"[^\r\n][^\n]*", text):
        row += text.count("\n", last, found.start())
        last = found.start()
        content = found[0].rstrip("\r")
        heading = _SECTION.fullmatch(content)
        if heading:
            section = heading[1]
            listing.headings.append((row, section, heading[2]))
        elif section in bodies:
            bodies[section].append(Line(row, content))
        elif section != "APPL" and content.strip():
            listing.stray.append((row, content))
        if len(listing.stray) > MOST_FAULTS:
            break
    for line in bodies["ATTR"]:
        statement = LANGUAGE.statement(line, "attribute_line") if line.text.strip() else None
        if statement is not None and statement.fault:
            listing.unclear.append((line.row, statement.fault))
        elif statement is not None:
            listing.attributes.append((line.row, statement.word("KEY"), line.text))
    listing.instructions.extend(_instructions(bodies["MN"]))
    positions = _PositionReader(listing)
    for line in bodies["POS"]:
        if line.text.strip() and len(listing.faults) <= MOST_FAULTS:
            positions.take_line(line)
    positions.finish()
    return listing


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

    def take_line(self, line: Line) -> None:
        """Take one more line of the section."""
        statement = LANGUAGE.statement(line, "position_line")
        faults = self.listing.faults if self.position is None else self.position.faults
        if statement.fault:
            faults.append((line.row, statement.fault))
            self.comma = True
            return
        for element in statement.tree.children:
            if isinstance(element, Tree) and not self._take(line.row, element):
                reason = f"{line.text.strip()[:30]!a} is outside a position"
                self.listing.faults.append((line.row, reason))
                return

    def finish(self) -> None:
        """End of the section: no position may be open."""
        if self.position is not None:
            self.position.faults.append((self.position.row, "is not closed by };"))

    def _take(self, row: int, element: Tree[Token]) -> bool:
        """Add an element to the open position; False where none is open."""
        kind, position = element.data, self.position
        if kind == "header":
            if position is not None:
                position.faults.append((row, "is not closed by };"))
            name = "".join(words(element, "NAME_TEXT")).lstrip(": ").strip(' "')
            number = int(words(element, "INT")[0][:9])
            self.position, self.group, self.comma = Position(row, number, name), None, True
            self.listing.positions.append(self.position)
        elif position is None:
            return False
        elif kind == "close":
            if self.comma and self.group is not None and self.group.fields:
                position.faults.append((row, "has a comma behind its last value"))
            self.position = None
        elif kind == "group":
            number = int(words(element, "GROUP")[0][2:5])
            if number in position.groups:
                position.faults.append((row, f"has GP{number} twice"))
            self.group, self.comma = Group(row), True
            position.groups[number] = self.group
        elif self.group is None:
            position.faults.append((row, "has a value outside a group"))
        elif kind == "comma" or kind in _VALUES:
            if self.comma == (kind == "comma"):
                reason = "has a comma too many" if self.comma else "has no comma before a value"
                position.faults.append((row, reason))
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
