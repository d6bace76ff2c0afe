"""Files of VAL 3 projects as trees: XML with its lines, and the statements of the code in it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from defusedxml import DefusedXmlException, ElementTree
from lark import Token, Tree

from calib.errors import FileFormatError
from posedesign.programs.language import Language, Statement, subtrees, text_of, without_remarks
from posedesign.programs.reading import read_program_bytes

MOST_NODES = 300_000
"""Elements of a file that are read: ten times those of 10,000 poses."""

_MOST_DEPTH = 60


@dataclass(slots=True)
class Node:
    """An element: its name without, and with, the namespace, and the text that stands in it."""

    line: int
    name: str
    tag: str
    attributes: dict[str, str]
    children: list[Node] = field(default_factory=list)
    text: str = ""
    text_line: int = 0

    def get(self, attribute: str) -> str:
        """An attribute; empty where it is not there."""
        return self.attributes.get(attribute, "")

    def all(self, *names: str) -> Iterator[Node]:
        """Elements of these names, itself included, from the top; none inside another of them."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            if node.name in names:
                yield node
            else:
                waiting.extend(reversed(node.children))


class XmlFault(Exception):
    """A file is no XML that is read: its line, what is wrong, and a hint."""

    def __init__(self, line: int, reason: str, hint: str) -> None:
        super().__init__(reason)
        self.line, self.reason, self.hint = max(line, 1), reason, hint


def parse_xml(data: bytes) -> Node:
    """Root of a file; XmlFault where it is no well-formed XML, or has a DTD or entities."""
    builder = _Builder()
    try:
        builder.parser.feed(data)
        builder.parser.close()
    except DefusedXmlException:
        reason, hint = "has a DTD or entities", "save the application again"
        raise XmlFault(builder.line, reason, hint) from None
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        hint = "name the project's data file, NAME.dtx, or copy it again"
        raise XmlFault(builder.line, f"is no whole XML file: {error}"[:200], hint) from None
    return builder.root


def read_xml(path: Path) -> Node | None:
    """Root of a file beside another one; None where it is not there, or no XML that is read."""
    try:
        return parse_xml(read_program_bytes(path))
    except (FileFormatError, XmlFault):
        return None


class _Builder:
    def __init__(self) -> None:
        self.parser = ElementTree.DefusedXMLParser(target=self, forbid_dtd=True)
        self.root = Node(1, "", "", {})
        self.open: list[tuple[Node, list[str]]] = []
        self.count = 0

    @property
    def line(self) -> int:
        return int(self.parser.parser.CurrentLineNumber)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > MOST_NODES or len(self.open) >= _MOST_DEPTH:
            what = "too many" if self.count > MOST_NODES else "too deep"
            raise XmlFault(self.line, f"has {what} elements", "is it the file of a project?")
        node = Node(self.line, tag.rpartition("}")[2], tag, attributes)
        if self.open:
            self.open[-1][0].children.append(node)
        else:
            self.root = node
        self.open.append((node, []))

    def end(self, tag: str) -> None:
        # the parser keeps text back until it ends: its first line is told from its last
        node, pieces = self.open.pop()
        node.text = "".join(pieces)
        node.text_line = self.line - node.text.count("\n")

    def data(self, text: str) -> None:
        self.open[-1][1].append(text)

    def close(self) -> None:
        """Take the end of the file."""


LANGUAGE = Language(__package__ or "", joined=without_remarks("//.*"), letters=r"\w")


def statements_of(code: Node) -> list[Statement]:
    """Statements of a program's code, with their lines of the file."""
    # a quotation mark in a text has a backslash before it
    text = code.text.replace('\\"', "''")
    return LANGUAGE.statements("\n" * (code.text_line - 1) + text)


MOVES = {"movej": 1, "movel": 1, "movec": 2}
"""Functions that move the arm, with how many targets they begin."""

_INDEX = re.compile(r"0*(\d{1,9})", re.ASCII)


def targets_of(statement: Statement) -> Iterator[tuple[str, str]]:
    """Variables that a statement moves to: name, and index; see :func:`index_of`."""
    for function in statement.all("function"):
        for target in subtrees(function)[: MOVES.get(name_of(function).lower(), 0)]:
            if target.data == "place":
                yield name_of(target), index_of(target)


def name_of(tree: Tree[Token]) -> str:
    """Name of a function, program or variable, with its library before a colon."""
    first, *more = tree.children[:2]
    own = [str(child) for child in more if isinstance(child, Token) and child.type == "NAME"]
    return ":".join([str(first), *own])


def index_of(place: Tree[Token]) -> str:
    """First index of a variable: 0 without one, empty where it is computed."""
    indices = subtrees(place)
    found = _INDEX.fullmatch(text_of(indices[0])) if indices else None
    return "" if indices and not found else found[1] if found else "0"
