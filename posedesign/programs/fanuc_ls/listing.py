"""FANUC ``.LS``: a file sorted into its sections, its lines as trees; nothing is judged here.

What the reader takes and what the validator checks is this one listing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property

from lark import Token, Tree

from posedesign.programs.language import (
    MOST_FAULTS,
    Language,
    Line,
    Node,
    Statement,
    lines_of,
    nodes,
    shared,
    subtrees,
)

LANGUAGE = Language(
    "posedesign.programs.fanuc_ls",
    start="instruction",
    others=("position", "register", "attribute_line"),
    signed=("position",),
)

_SECTION = re.compile(
    r"^[ \t\r]*/(PROG|ATTR|APPL|MN|POS|END)(?![A-Za-z_])[ \t]*(.*)$", re.MULTILINE
)
_NUMBERED = re.compile(r"([ \t]*)(\d{0,9})[ \t]*:(.*)", re.DOTALL)
_SUB_LINE = re.compile(r" {5,20}\d{1,4}")
_POSITION = re.compile(r'\S(?:[^}"\n]++|"[^"\n]*+"?|\n(?![ \t]*P ?\[))*+(?:\}[ \t]*;?)?')
_NUMBER = re.compile(r"P ?\[ ?(\d{1,9})")
_VALUE = re.compile(r"(?<!\w)([A-Z]\w*)[ \t]*[=:]", re.ASCII)
MOST_LINES = 100_000
"""Of /MN that are looked at: line numbers have four digits, lines inside of others not many."""

_INSIDE = "       ---"


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
    """One motion group of a position or register, which begins in a line ``row`` with ``text``.

    ``fields`` hold for each name the text of the value and its unit; ``frames`` the numbers of UF
    and UT, None where the file leaves them open (F). ``twice`` is a name that is there twice.
    """

    row: int
    text: str
    frames: dict[str, int | None] = field(default_factory=dict)
    fields: dict[str, tuple[str, str]] = field(default_factory=dict)
    config: str | None = None
    twice: str = ""

    @classmethod
    def of(cls, row: int, text: str, elements: Iterable[tuple[str, list[str]]]) -> Group:
        """The group of what stands in it; see `elements_of`."""
        group = cls(row, text)
        for kind, (name, *values) in elements:
            if kind == "active":
                group.frames[name] = None if values[0] == "F" else int(values[0][:5])
            elif kind == "config":
                group.config = (values or [name])[-1].strip("'\" ")
            else:
                if kind == "AXIS":
                    values.append("mm" if name in "XYZ" else "deg")
                name = name.replace("EXT", "E")
                group.twice = group.twice or name * (name in group.fields)
                group.fields[name] = values[0], "".join(values[1:])
        return group

    def has_value(self, name: str) -> bool:
        """Whether a value is there, and not only stars."""
        return not self.fields.get(name, ("*", ""))[0].startswith("*")

    @cached_property
    def _rows(self) -> dict[str, int]:
        found = [(f[1].replace("EXT", "E"), f.start()) for f in _VALUE.finditer(self.text)]
        return {name: self.row + self.text.count("\n", 0, at) for name, at in reversed(found)}

    def row_of(self, name: str) -> int:
        """Line of a value."""
        return self._rows.get(name, self.row)


@dataclass
class Position:
    """A position of /POS."""

    row: int
    number: int
    name: str
    statement: Statement
    groups: dict[int, Group] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Its name in the program."""
        return f"P[{self.number}]"


@dataclass
class Listing:
    """A whole file; ``faults`` are lines of /POS and what is malformed, ``broken`` its numbers."""

    headings: list[tuple[int, str, str]] = field(default_factory=list)  # line, section, rest
    stray: list[tuple[int, str]] = field(default_factory=list)
    unclear: list[tuple[int, str]] = field(default_factory=list)  # of /ATTR
    attributes: list[tuple[int, str, str]] = field(default_factory=list)  # line, name, its text
    lines: list[Line] = field(default_factory=list)  # of /MN
    positions: list[Position] = field(default_factory=list)
    faults: list[tuple[int, str]] = field(default_factory=list)
    broken: set[int] = field(default_factory=set)
    rows: int = 1

    @property
    def english(self) -> bool:
        """Whether the controller speaks English."""
        return any(name == "LINE_COUNT" for _, name, _ in self.attributes)

    @cached_property
    def instructions(self) -> list[Instruction]:
        """Instructions of /MN, as many as there are up to the thousandth fault."""
        return list(_instructions(self.lines))


def read_listing(text: str) -> Listing:
    """Sort the lines of a file into its sections; never fails."""
    return shared(("ls", text), lambda: _sorted(text))


def _sorted(text: str) -> Listing:
    listing = Listing(rows=text.count("\n") + 1)
    row, section, start = 1, "", 0
    for heading in [*_SECTION.finditer(text), None]:
        body = text[start : heading.start() if heading else None]
        _take(listing, section, row, body)
        if heading:
            row += body.count("\n")
            section, start = heading[1], heading.end()
            listing.headings.append((row, section, heading[2].rstrip()))
    return listing


def _take(listing: Listing, section: str, row: int, body: str) -> None:
    if section == "POS":
        _take_positions(listing, row, body)
        return
    for line in lines_of(body, indented=True, row=row):
        if section == "ATTR":
            statement = LANGUAGE.statement(line, "attribute_line")
            if statement.fault:
                listing.unclear.append((line.row, statement.fault))
            else:
                listing.attributes.append((line.row, str(statement.tree.children[0]), line.text))
        elif section == "MN" and len(listing.lines) < MOST_LINES:
            listing.lines.append(line)
        elif section not in ("MN", "APPL"):
            listing.stray.append((line.row, line.text))
        if max(len(listing.stray), len(listing.unclear)) > MOST_FAULTS:
            break


def _take_positions(listing: Listing, row: int, body: str) -> None:
    last = 0
    for found in _POSITION.finditer(body):
        row += body.count("\n", last, found.start())
        last = found.start()
        statement = LANGUAGE.statement(Line(row, found[0]), "position")
        number = _NUMBER.match(found[0])
        label = f"P[{int(number[1])}] " if number else ""
        if statement.fault:
            listing.faults.append((statement.row, label + statement.fault))
            listing.broken.add(int(number[1]) if number else 0)
            if len(listing.faults) > MOST_FAULTS:
                break
            continue
        name = statement.word("NAME_TEXT").lstrip(": ").strip(' "')
        position = Position(row, int(statement.word("INT")[:9]), name, statement)
        listing.positions.append(position)
        at = 0
        for motion, elements in elements_of(statement):
            start = found[0].index(motion, at)
            at = start + 1
            group = Group.of(row + found[0].count("\n", 0, start), found[0][start:], elements)
            for twice in (motion * (int(motion[2:5]) in position.groups), group.twice):
                if twice:
                    listing.faults.append((group.row_of(twice), f"{label}has {twice} twice"))
            position.groups[int(motion[2:5])] = group


def elements_of(statement: Statement) -> Iterator[tuple[str, list[tuple[str, list[str]]]]]:
    """What stands in each motion group of a position, or in a register: kinds and texts.

    With the name of the group, which is empty of a register.
    """
    texts = iter(statement.texts(_tokens))
    for named, kinds in statement.once(_kinds):
        motion = next(texts) if named else ""
        yield motion, [(kind, [next(texts) for _ in range(count)]) for kind, count in kinds]


def _tokens(tree: Tree[Token]) -> Iterator[Token]:
    for group in nodes(tree, "group", "registered"):
        yield from group.children[: group.data == "group"]  # type: ignore[misc]
        for element in subtrees(group):
            yield from element.children  # type: ignore[misc]


def _kinds(statement: Statement) -> list[tuple[bool, list[tuple[str, int]]]]:
    found = []
    for group in statement.all("group", "registered"):
        parts = [(element.data, element.children) for element in subtrees(group)]
        kinds = [
            ("AXIS" if kind == "field" and own[0].type == "AXIS" else kind, len(own))  # type: ignore[union-attr]
            for kind, own in parts
        ]
        found.append((group.data == "group", kinds))
    return found


def places_of(statement: Statement) -> list[str]:
    """Positions that an instruction names: ``P[3]``, or `CHOSEN`."""
    return statement.kept(_places)


def _places(statement: Statement) -> list[str]:
    found = [CHOSEN] if statement.once(_is_chosen) else []
    return [*found, *(f"P[{int(n[:9])}]" for n in dict.fromkeys(statement.texts(_numbers)))]


CHOSEN = "P[R]"  # a position that a register chooses


def _indices(tree: Tree[Token]) -> Iterator[Node]:
    places = (t for t in nodes(tree, "target", "indexed") if str(t.children[0]) == "P")
    return (next(nodes(place, "index")).children[0] for place in places)


def _numbers(tree: Tree[Token]) -> Iterator[Node]:
    return (n for n in _indices(tree) if isinstance(n, Token) and n.type == "INT")


def _is_chosen(statement: Statement) -> bool:
    return len([*_indices(statement.tree)]) > len([*_numbers(statement.tree)])


def _instructions(lines: list[Line]) -> Iterator[Instruction]:
    """Instructions of /MN; a long one goes on in lines that have a colon, but no number."""
    faults = 0
    joined: list[str] = []  # of the open instruction
    head: tuple[int, str, int | None] = (0, "", None)
    for line in [*lines, Line(0, "0:")]:
        found = _NUMBERED.fullmatch(line.text)
        if found and not found[2] and joined and not joined[-1].rstrip().endswith(";"):
            joined.append(found[3])
            continue
        if joined and faults < MOST_FAULTS:
            made = _instruction(*head, " ".join(joined))
            faults += bool(made.statement.fault) or not made.closed
            yield made
        joined = []
        if line.text.startswith(_INSIDE) or not line.text.strip():
            continue
        number = int(found[2]) if found and found[2] else None
        head = (line.row, found[1] + found[2] if found else line.text, number)
        joined = [found[3] if found else ""]


@cache
def known_words() -> dict[str, str]:
    """Keywords of the grammar and the letters of registers and signals, by their capitals."""
    terminals = LANGUAGE.parser.terminals
    items = next(str(t.pattern.value) for t in terminals if t.name == "ITEM")
    words = [str(t.pattern.value) for t in terminals if t.pattern.type == "str"]
    words += re.findall(r"[A-Za-z_]+", items)
    return {w.upper(): w for w in words if re.fullmatch(r"[A-Za-z_]{2,}", w)}


def _instruction(row: int, head: str, number: int | None, body: str) -> Instruction:
    closed = body.rstrip().endswith(";")
    code = body.rstrip().removesuffix(";").rstrip()
    statement = LANGUAGE.statement(Line(row, code.strip() or "!"))
    if statement.kind in ("fault", "other"):
        # controllers take words in any spelling, and store theirs
        pattern, known = r"'[^']*'|:[^\]]*|[A-Za-z_]+", known_words()
        spelled = re.sub(pattern, lambda word: known.get(word[0].upper(), word[0]), code.strip())
        other = LANGUAGE.statement(Line(row, spelled))
        statement = statement if other.kind in ("fault", "other") else other
    return Instruction(row, number, head, code, closed, statement, bool(_SUB_LINE.fullmatch(head)))
