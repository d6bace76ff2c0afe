"""ABB RAPID: where statements end, and what the trees of a module say of its data and calls."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from lark import Token, Tree

from posedesign.programs.language import (
    MOST_LENGTH,
    Language,
    Line,
    Node,
    Statement,
    is_a,
    shared,
    subtrees,
    text_of,
)

Nested = list["Nested | str"]
Argument = tuple[Node | None, dict[str, Node | None]]  # a value and its switches
ROUTINES = ("proc", "func", "trap")
FRAMES = ("tooldata", "wobjdata")
SHAPES = {"jointtarget": (6, 6), "robtarget": (3, 4, 4, 6)}  # numbers in the lists of a position
_I = re.IGNORECASE | re.ASCII
_ENDS = ("MODULE", "PROC", "FUNC", "TRAP", "RECORD", "IF", "FOR", "WHILE", "TEST")
_ALONE = frozenset(("ELSE", "UNDO", "BACKWARD", *(f"END{word}" for word in _ENDS)))
_WITH_LINE = frozenset(("MODULE", "PROC", "FUNC", "TRAP", "RECORD", "TEST", "ERROR"))
_SCOPES = frozenset(("LOCAL", "TASK"))
_MOST_HEADING = 500  # characters of a heading, or of what stands in front of a list
_STORED = frozenset(("CONST", "PERS", "VAR"))
_FIRST = (_ALONE | _STORED | _WITH_LINE | {"ELSEIF", "CASE", "DEFAULT", "LOCAL"}) - {"TEST"}
"""Words that only begin statements, but for those of parameters."""

_LAST = {"IF": "THEN", "ELSEIF": "THEN", "FOR": "DO", "WHILE": "DO"}
_HEADING = "|".join(sorted(_ALONE | _WITH_LINE | _LAST.keys() | {"CASE", "DEFAULT"}))
_LIST = r"(?:(?:LOCAL|TASK)\s+)?(?:CONST|PERS|VAR)\s[^:;]*\{"
_LIST_BEGINS = re.compile(rf"{_LIST}[^:;]*\}}\s*:=\s*\[", _I)
_PLAIN = re.compile(
    rf"(?!(?:LOCAL\s+)?(?:{_HEADING})\b|{_LIST})[a-z][^\";:\n]{{0,400}}(?::=[^\";:\n]{{0,400}})?;",
    _I,
)
"""A statement in one line, as most are."""

_ELEMENT = re.compile(r",\s*\[\[[^][\";]{0,200}\](?:, ?\[[^][\";]{0,200}\])*\](?=,)")
_PIECE = re.compile(
    r'"[^"\n]*"?|:=|[][(){},;:\n]|(?<![\w.\x80-\uffff])[a-z\x80-\uffff][\w\x80-\uffff]*', _I
)
_BEGIN = re.compile(r"\S")
LEFT_OUT = re.compile(
    r'\A\s*%%%(?:[^%]|%(?!%%))*+(?:%%%.*)?|("[^"\n]*"?)|!.*'
    r"|<(?:(VAR|EXP|ARG|ID)|TDN|DDN|RDN|PAR|ALT|DIM|SMT|EIT|CSE)>"
)
"""Remarks, what stands in front of modules of older controllers (%%% VERSION:1 ... %%%), and
placeholders, as the pendant puts them where a statement (<SMT>), a declaration (<DDN>) or a value
(<EXP>) is to be filled in (RAPID kernel, 3HAC16585-1): modules with them are loaded."""


def divided(text: str) -> Iterator[Line]:
    """Statements of a text: they end with a semicolon, headings of blocks with their last word.

    Remarks are left out, and placeholders of values are names. A word that only begins statements
    ends one that lacks its semicolon, and elements of a declared list come one by one, each behind
    its comma.
    """
    text = LEFT_OUT.sub(lambda found: found[1] or found[2] or "\n" * found[0].count("\n"), text)
    row, last, at, listed = 1, 0, 0, False
    while found := _BEGIN.search(text, at):
        start = found.start()
        row += text.count("\n", last, start)
        last = start
        at, listed = _end_of(text, start, listed)
        yield Line(row, text[start:at].rstrip())


def _end_of(text: str, start: int, listed: bool) -> tuple[int, bool]:
    """Where the statement ends that begins there, and whether a list is declared behind it."""
    whole = (_ELEMENT if listed else _PLAIN).match(text, start)
    if whole:
        return whole.end(), listed
    word, depth, asked = "", int(listed), listed
    for piece in _PIECE.finditer(text, start):
        mark, at = piece[0].upper(), piece.start()
        before = text[start:at].strip() if at - start < _MOST_HEADING else "a b"
        if mark[0].isalpha():
            if at > start and mark in _FIRST and _is_cut(word, mark, before, depth):
                return at, False
            word = mark if at == start or word in _SCOPES else word
        elif mark in ("[", "(", "{"):
            if mark == "[" and not depth and not asked:
                asked, listed = True, _LIST_BEGINS.fullmatch(before + mark) is not None
            depth += 1
        elif mark in ("]", ")", "}"):
            depth = max(0, depth - 1)
        if listed and at > start and (mark, depth) in ((",", 1), ("]", 0)):
            return at, True
        if at - start > MOST_LENGTH or _is_end(word, mark, before, depth):
            return piece.end(), False
    return len(text), False


def _is_end(word: str, mark: str, before: str, depth: int) -> bool:
    """Whether a statement ends behind a mark."""
    if mark == "\n":
        return word in _WITH_LINE and not depth and (word == "ERROR" or " " in before)
    if mark == ":":  # of a case, or of a label
        return word in ("CASE", "DEFAULT") or (bool(word) and before.upper() == word)
    if mark == ")":
        return not depth and word in ("PROC", "FUNC", "ERROR")
    return mark == ";" or mark in _ALONE or mark == _LAST.get(word)


def _is_cut(word: str, by: str, before: str, depth: int) -> bool:
    """Whether a statement ends in front of a word that begins the next one."""
    if word in _SCOPES:
        return before.upper() != word
    return not (word in ("PROC", "FUNC") and depth and by in _STORED)


LANGUAGE = Language("posedesign.programs.abb_rapid", divided=divided, signed=True)


@dataclass(frozen=True)
class Data:
    """A declaration of data; ``whole`` says whether the end of a list was found."""

    row: int
    storage: str
    kind: str
    name: str
    statement: Statement
    listed: Sequence[Statement] = ()  # elements of a list, the first in the declaration
    whole: bool = True

    @cached_property
    def size(self) -> Tree[Token] | None:
        """Sizes of a list; None of no list."""
        return next(iter(self.statement.nodes(_sizes)), None)

    @cached_property
    def value(self) -> Node | None:
        """The value; None without one, or where there are elements."""
        return None if self.listed else next(iter(self.statement.nodes(value_of)), None)

    @property
    def count(self) -> int | None:
        """Elements that a list of one dimension is declared to have, where it is a number."""
        size = inside(self.size)
        return int(size) if re.fullmatch(r"[0-9]{1,7}", size) else None

    @property
    def labelled(self) -> list[tuple[str, Statement]]:
        """The value, or those of the elements, each with what to call it."""
        if self.listed:
            return [(f"{self.name}{{{k}}}", s) for k, s in enumerate(self.listed, start=1)]
        return [(self.name, self.statement)] if self.statement.once(_has_value) else []

    @property
    def values(self) -> list[tuple[str, Node]]:
        """The same, as trees."""
        return [(label, s.nodes(value_of)[0]) for label, s in self.labelled]

    @property
    def nested(self) -> list[tuple[str, Nested | str]]:
        """The same, as lists of texts."""
        return [(label, _nested(s)) for label, s in self.labelled]


def _head(tree: Tree[Token]) -> Sequence[Node]:
    """Storage, type and name."""
    return [child for child in tree.children if isinstance(child, Token)][:3]


def _sizes(tree: Tree[Token]) -> list[Node]:
    return [child for child in tree.children if is_a(child, "sizes")]


def value_of(tree: Tree[Token]) -> list[Node]:
    """The value of a declaration, or an element."""
    head = _head(tree) if tree.data != "element" else []
    besides = [c for c in tree.children if is_a(c, "scope") or is_a(c, "sizes")]
    return tree.children[len(head) + len(besides) :]


def _has_value(statement: Statement) -> bool:
    return bool(value_of(statement.tree))


def numbers_in_lists(statement: Statement) -> list[int] | None:
    """How many texts stand in each list of a value that is a list of lists; None of another."""
    value, *_ = value_of(statement.tree)
    if not is_a(value, "list") or not all(is_a(part, "list") for part in value.children):
        return None
    parts = [part.children for part in subtrees(value)]
    plain = all(isinstance(child, Token) for part in parts for child in part)
    return [len(part) for part in parts] if plain else None


def _leaves(tree: Tree[Token]) -> Iterator[Node]:
    for part in subtrees(value_of(tree)[0]):  # type: ignore[arg-type]
        yield from part.children


def _nested(statement: Statement) -> Nested | str:
    counts = statement.once(numbers_in_lists)
    if counts is None:
        return nested(statement.nodes(value_of)[0])
    texts = iter([text.replace(" ", "") for text in statement.texts(_leaves)])
    return [[next(texts) for _ in range(count)] for count in counts]


def declared(statements: Sequence[Statement]) -> list[Data]:
    """Data that statements declare, lists with their elements."""
    return shared(("rapid data", id(statements)), lambda: [*_declared(statements)])


def _declared(statements: Sequence[Statement]) -> Iterator[Data]:
    for i, statement in enumerate(statements):
        if statement.kind not in ("declaration", "array"):
            continue
        storage, kind, name = statement.texts(_head)
        listed, j = [statement] if statement.kind == "array" else [], i + 1
        while j < len(statements) and statements[j].kind == "element":
            listed.append(statements[j])
            j += 1
        whole = not listed or (j < len(statements) and statements[j].kind == "array_end")
        yield Data(statement.row, storage.upper(), kind.lower(), name, statement, listed, whole)


def calls(statement: Statement) -> list[tuple[str, list[Argument]]]:
    """The call that a statement is, or holds: the routine in capitals, and its arguments."""
    return statement.kept(_calls) if statement.kind in ("call", "compact_if") else []


def _calls(statement: Statement) -> list[tuple[str, list[Argument]]]:
    made = []
    for call in statement.all("call"):
        found: list[Argument] = []
        for argument in call.children[1:]:
            value: Node | None = None
            switches: dict[str, Node | None] = {}
            for node in argument.children:  # type: ignore[union-attr]
                if isinstance(node, Tree) and node.data == "switch":
                    name, *inner = node.children
                    switches[str(name).upper()] = inner[0] if inner else None
                else:
                    value = node
            if value is None and found:  # switches behind a comma are of the argument before it
                found[-1][1].update(switches)
            else:
                found.append((value, switches))
        made.append((str(call.children[0]).upper(), found))
    return made


def name_of(node: Node | None) -> str:
    """The name in capitals that a value is, without index and component; empty for another."""
    return str(node.children[0]).upper() if is_a(node, "variable") else ""


def inside(node: Tree[Token] | None) -> str:
    """Sizes of a list, or an index, as a text without its brackets; empty for none."""
    return ",".join(str(nested(child)) for child in (node.children if node else ()))


def nested(node: Node) -> Nested | str:
    """Lists in brackets with the texts of what stands in them."""
    if isinstance(node, Token):
        return str(node).replace(" ", "")
    if node.data == "list":
        return [nested(child) for child in node.children]
    if node.data == "variable":
        rest = (f".{c}" if isinstance(c, Token) else f"{{{inside(c)}}}" for c in node.children[1:])
        return str(node.children[0]) + "".join(rest)
    return text_of(node)


def shape(value: Nested | str) -> tuple[int, ...]:
    """Numbers of values in the lists of a list; zero for a part that is no list of values."""
    if isinstance(value, str):
        return ()
    flat = (isinstance(p, list) and not any(isinstance(x, list) for x in p) for p in value)
    return tuple(len(p) if ok else 0 for p, ok in zip(value, flat, strict=True))
