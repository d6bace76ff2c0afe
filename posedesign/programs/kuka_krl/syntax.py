"""KUKA KRL: the statements of a file by its grammar, and what reader and validator ask of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

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
    "posedesign.programs.kuka_krl",
    joined=language.without_remarks("^&.*|;.*", marks="&;"),
    signed=True,
    unary=r"(?<=[{,][A-Z]\ )|(?<=[{,][AE]\d\ )|(?<=[{,]\ [A-Z]\ )|(?<=[{,]\ [AE]\d\ )",
    letters=r"\w$",
)
"""The grammar; one for all files, so that it is made once."""

NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)(E[-+]?0?\d{1,2})?"  # a plain decimal number
_NUMBER = re.compile(NUMBER, re.IGNORECASE | re.ASCII)


class Braces(NamedTuple):
    """What stands between braces: names in capitals, texts of the values, and its own type."""

    names: list[str]
    texts: list[str]
    kind: str

    @property
    def fields(self) -> dict[str, str]:
        """Values by name."""
        return dict(zip(self.names, self.texts, strict=True))


class Value(NamedTuple):
    """A variable or a value of a statement; ``kind``: the grammar's rule or terminal."""

    kind: str
    text: str = ""  # empty of what stands between braces
    braces: Braces | None = None

    @property
    def name(self) -> str:
        """A variable as one word: ``XP1``, ``TABLE[2]``, ``$TOOL.X``; empty for no variable."""
        return self.text if self.kind in ("variable", "NAME") else ""

    @property
    def key(self) -> str:
        """The same in capitals: letters of either case are the same."""
        return self.name.upper()

    @property
    def is_constant(self) -> bool:
        """Whether it can be no number."""
        return self.kind in ("BOOLEAN", "STRING", "ENUM")


def _cells(tree: Tree[Token]) -> Iterator[Node]:
    """Variables and values of a statement: items of a declaration, arguments of a call."""
    for child in tree.children:
        if is_a(child, "item") or (tree.data == "call" and is_a(child, "arguments")):
            yield from child.children
        elif tree.data != "declaration":
            yield child


def _leaves(tree: Tree[Token]) -> Iterator[Node]:
    for cell in _cells(tree):
        yield from (
            cell.children[is_a(cell.children[0], "kind") :] if is_a(cell, "aggregate") else [cell]
        )


def _forms(statement: Statement) -> list[tuple[str, int, str]]:
    """Rule or terminal of each, how many texts it has, and the type of braces."""
    return [
        (
            cell.type if isinstance(cell, Token) else cell.data,
            len([*_leaves(Tree("", [cell]))]),
            kind_of(cell),
        )
        for cell in _cells(statement.tree)
    ]


def values_of(statement: Statement) -> list[Value]:
    """Variables and values of an assignment, a motion or a call."""
    return statement.kept(_values)


def _values(statement: Statement) -> list[Value]:
    texts, at, found = statement.texts(_leaves), 0, []
    for kind, count, typed in statement.once(_forms):
        if kind == "aggregate":
            own = texts[at : at + count]
            names = [key.upper().replace(" ", "") for key in own[::2]]
            found.append(Value(kind, "", Braces(names, own[1::2], typed)))
        else:
            found.append(Value(kind, texts[at]))
        at += count
    return found


def fields_of(node: Tree[Token]) -> list[tuple[str, str]]:
    """Names in capitals and values as text of what stands between braces."""
    first = int(is_a(node.children[0], "kind"))
    keys, values = map(str, node.children[first::2]), map(text_of, node.children[first + 1 :: 2])
    return [*zip([key.upper().replace(" ", "") for key in keys], values, strict=True)]


def as_number(text: str) -> float:
    """A plain decimal number of at most 40 characters; NaN for anything else."""
    return float(text) if len(text) <= 40 and _NUMBER.fullmatch(text) else math.nan


def bas_of(values: Sequence[Value]) -> tuple[str, str]:
    """Command and value of a call of BAS, in capitals: ``TOOL``, ``1``; empty for another call."""
    if values[0].key != "BAS":
        return "", ""
    command, value = [*(v.text for v in values[1:]), "", ""][:2]
    return command.upper().lstrip("# "), value.upper()


def settings_of(statement: Statement) -> Iterator[tuple[str, Value]]:
    """Variables that a motion sets for itself (``WITH``), and their values."""
    for setting in statement.all("setting"):
        variable, value = map(text_of, setting.children)
        kind = setting.children[1]
        yield variable.upper(), Value(kind.type if isinstance(kind, Token) else kind.data, value)


def type_of(declaration: Statement) -> str:
    """Type of what is declared, in capitals."""
    return declaration.texts(_type)[0].upper()


def _type(tree: Tree[Token]) -> Iterator[Node]:
    for given in tree.children:
        if isinstance(given, Tree):
            yield given.children[0]
            return
        if given.type == "NAME":
            yield given
            return


class Item(NamedTuple):
    """What is declared: a name, the size of an array (``[8]``, ``[]``), and a value."""

    name: str
    size: str
    value: Value | None


def items_of(declaration: Statement) -> list[Item]:
    """All that is declared."""
    return declaration.kept(_items)


def _items(declaration: Statement) -> list[Item]:
    values, begins, found = _values(declaration), declaration.once(_begins), list[Item]()
    for k, end in zip(begins, [*begins[1:], len(values)], strict=True):
        sized = end > k + 1 and values[k + 1].kind == "index"
        own = values[k + 1 + sized : end]
        size = values[k + 1].text if sized else ""
        found.append(Item(values[k].text, size, own[0] if own else None))
    return found


def _begins(declaration: Statement) -> list[int]:
    """Where items begin in the values of a declaration."""
    counts = [len(c.children) for c in declaration.tree.children if is_a(c, "item")]
    return [0, *accumulate(counts[:-1])]


def kind_of(node: Node) -> str:
    """Type that braces name for themselves, in capitals: ``FRAME`` of ``{FRAME: X 1}``."""
    kinds = nodes(node, "kind") if isinstance(node, Tree) else iter(())
    return next((text_of(kind).upper() for kind in kinds), "")


def name_of_module(begin: Statement) -> str:
    """Name of the module or routine that a statement begins."""
    tokens = (child for child in begin.tree.children if isinstance(child, Token))
    return next(str(token) for token in tokens if token.type == "NAME")


def word_of(motion: Statement) -> str:
    """The word of a motion, in capitals: ``PTP``, ``LIN_REL``."""
    return values_of(motion)[0].text.upper()
