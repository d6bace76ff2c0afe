"""KUKA KRL: the statements of a file by its grammar, and what reader and validator ask of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import TypeGuard

from lark import Token, Tree

from posedesign.programs import language
from posedesign.programs.language import Block, Language, Node, Statement, is_a, nodes, text_of

AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
POSE = ("X", "Y", "Z", "A", "B", "C")
EXTERNAL = ("E1", "E2", "E3", "E4", "E5", "E6")
CONFIGURATION = ("S", "T")

TYPES_OF_POSITIONS = {
    **dict.fromkeys(("E6AXIS", "E3AXIS", "AXIS"), AXES),
    **dict.fromkeys(("E6POS", "E3POS", "POS"), POSE),
}
"""Types that hold where the arm is to be, with what they have at least."""

MOST_TOOL, MOST_BASE = 16, 32
"""Frames that controllers have as delivered. 0 is the flange, and the world."""

BEGINS = {"begin": "end", "begin_function": "end_function", "begin_data": "end_data"}
"""Statements that begin a module or routine, with those that end it."""


BLOCKS = {
    "if_": Block("endif", ("else_",)),
    "for_": Block("endfor"),
    "while_": Block("endwhile"),
    "loop": Block("endloop"),
    "repeat": Block("until"),
    "switch": Block("endswitch", ("case", "default")),
    "spline": Block("endspline"),
}
"""Blocks inside of routines."""

LANGUAGE = Language(
    "posedesign.programs.kuka_krl", joined=language.without_remarks("^&.*|;.*"), letters=r"\w$"
)
"""The grammar; one for all files, so that it is made once."""

NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)(E[-+]?0?\d{1,2})?"  # a plain decimal number
_NUMBER = re.compile(NUMBER, re.IGNORECASE | re.ASCII)


def name_of(node: Node) -> str:
    """A variable as one word: ``XP1``, ``TABLE[2]``, ``$TOOL.X``; empty for no variable."""
    known = is_a(node, "variable") or (isinstance(node, Token) and node.type == "NAME")
    return text_of(node) if known else ""


def key_of(node: Node) -> str:
    """The same in capitals: letters of either case are the same."""
    return name_of(node).upper()


def is_aggregate(node: Node) -> TypeGuard[Tree[Token]]:
    """Whether it stands between braces."""
    return is_a(node, "aggregate")


def fields_of(node: Node) -> list[tuple[str, str]]:
    """Names in capitals and values as text of what stands between braces; none of another node."""
    if not is_aggregate(node):
        return []
    first = int(is_a(node.children[0], "kind"))
    keys, values = map(str, node.children[first::2]), map(text_of, node.children[first + 1 :: 2])
    return [*zip([key.upper().replace(" ", "") for key in keys], values, strict=True)]


def as_number(text: str) -> float:
    """A plain decimal number of at most 40 characters; NaN for anything else."""
    return float(text) if len(text) <= 40 and _NUMBER.fullmatch(text) else math.nan


def arguments_of(statement: Statement) -> list[Node]:
    """What a call is given; empty brackets are none."""
    brackets = statement.tree.children[1]
    found = list(brackets.children) if isinstance(brackets, Tree) else []
    return [] if len(found) == 1 and text_of(found[0]) == "" else found


def bas_of(statement: Statement) -> tuple[str, str]:
    """Command and value of a call of BAS, in capitals: ``TOOL``, ``1``; empty for another call."""
    if key_of(statement.tree.children[0]) != "BAS":
        return "", ""
    command, value = [*map(text_of, arguments_of(statement)), "", ""][:2]
    return command.upper().lstrip("# "), value.upper()


def settings_of(statement: Statement) -> Iterator[tuple[str, Node]]:
    """Variables that a motion sets for itself (``WITH``), and their values."""
    for setting in statement.all("setting"):
        yield key_of(setting.children[0]), setting.children[1]


def type_of(declaration: Statement) -> str:
    """Type of what is declared, in capitals."""
    for given in declaration.tree.children:
        if isinstance(given, Tree):
            return str(given.children[0]).upper()
        if given.type == "NAME":
            return given.upper()
    raise ValueError("a declaration without a type")


def items_of(declaration: Statement) -> list[Tree[Token]]:
    """What is declared: each has a name, and perhaps an index and a value."""
    children = declaration.tree.children
    return [c for c in children if isinstance(c, Tree) and c.data == "item"]


def size_of(item: Tree[Token]) -> str:
    """Size of an array that is declared: ``[8]``, ``[]``; empty for no array."""
    return next((text_of(child) for child in item.children if is_a(child, "index")), "")


def kind_of(node: Node) -> str:
    """Type that braces name for themselves, in capitals: ``FRAME`` of ``{FRAME: X 1}``."""
    kinds = nodes(node, "kind") if isinstance(node, Tree) else iter(())
    return next((text_of(kind).upper() for kind in kinds), "")


def name_of_module(begin: Statement) -> str:
    """Name of the module or routine that a statement begins."""
    return next(str(child) for child in begin.tree.children if name_of(child))


def word_of(motion: Statement) -> str:
    """The word of a motion, in capitals: ``PTP``, ``LIN_REL``."""
    return text_of(motion.tree.children[0]).upper()
