"""ABB RAPID: where statements end, and what the trees of a module say of its data and calls."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from lark import Token, Tree

from posedesign.programs.language import MOST_LENGTH, Language, Line, Statement, text_of

Node = Tree[Token] | Token
Nested = list["Nested | str"]
Argument = tuple[Node | None, dict[str, Node | None]]
"""A value and its switches."""

MOST_LINES = MOST_STATEMENTS = 250_000
"""Far more than a controller's memory holds."""

ROUTINES = ("proc", "func", "trap")
FRAMES = ("tooldata", "wobjdata")
SHAPES = {"jointtarget": (6, 6), "robtarget": (3, 4, 4, 6)}
"""Numbers in the lists of a position."""

_I = re.IGNORECASE | re.ASCII
_ENDS = ("MODULE", "PROC", "FUNC", "TRAP", "RECORD", "IF", "FOR", "WHILE", "TEST")
_ALONE = frozenset(("ELSE", "UNDO", "BACKWARD", *(f"END{word}" for word in _ENDS)))
_WITH_LINE = frozenset(("MODULE", "PROC", "FUNC", "TRAP", "RECORD", "TEST", "ERROR"))
_STORED = frozenset(("CONST", "PERS", "VAR"))
_FIRST = (_ALONE | _STORED | _WITH_LINE | {"ELSEIF", "CASE", "DEFAULT", "LOCAL"}) - {"TEST"}
"""Words that only begin statements, but for those of parameters."""

_LAST = {"IF": "THEN", "ELSEIF": "THEN", "FOR": "DO", "WHILE": "DO"}
_HEADING = "|".join(sorted(_ALONE | _WITH_LINE | _LAST.keys() | {"CASE", "DEFAULT"}))
_LIST = r"(?:(?:LOCAL|TASK)\s+)?(?:CONST|PERS|VAR)\s[^:;]*\{"
_LIST_BEGINS = re.compile(rf"{_LIST}[^:;]*\}}\s*:=\s*\[", _I)
_PLAIN = re.compile(rf'(?!(?:LOCAL\s+)?(?:{_HEADING})\b|{_LIST})[a-z][^!";:]*(?::=[^!";:]*)*;', _I)
"""A line that is one statement, as most are."""

_ELEMENT = re.compile(r'\[\[[^][!";]*\](?:, ?\[[^][!";]*\])*\],')
_PIECE = re.compile(r'"[^"]*"?|!.*|:=|[][(){},;:]|(?<![\w.])[a-z]\w*', _I)


def divided(lines: Iterator[Line]) -> Iterator[Line]:
    """Statements of lines: they end with a semicolon, headings of blocks with their last word.

    Remarks are left out. A word that only begins statements ends one that lacks its semicolon, and
    elements of a declared list come one by one, each behind its comma.
    """
    divider = _Divider()
    header = count = 0
    for number, line in enumerate(lines):
        if count > MOST_STATEMENTS or number > MOST_LINES:
            yield Line(line.row, ";" * (MOST_LENGTH + 1))  # is refused, as a line so long is
            return
        marks = 0 if count or header > 1 else line.text.count("%%%")
        if marks or header == 1:  # %%% VERSION:1 ... %%% in front of modules of older controllers
            header += marks
            continue
        for statement in divider.take(line.row, line.text):
            count += 1
            yield statement
            if count > MOST_STATEMENTS:
                break
    yield from divider.ended()


@dataclass
class _Divider:
    """The statement that is open at the end of a line; ``listed``: it declares a list."""

    row: int = 0
    parts: list[str] = field(default_factory=list)
    length: int = 0
    word: str = ""
    depth: int = 0
    listed: bool | None = None

    def take(self, row: int, text: str) -> Iterator[Line]:
        """Statements that end in a line."""
        if not self.parts and _PLAIN.fullmatch(text):
            yield Line(row, text)
        elif self.listed and self.parts == [","] and _ELEMENT.fullmatch(text):
            yield Line(row, "," + text[:-1])
        else:
            yield from self._take_pieces(row, text)

    def ended(self, row: int = 0, text: str = "") -> Iterator[Line]:
        """The open statement with its last part, if there is one; nothing is open behind."""
        self._add(row, text)
        if self.parts:
            yield Line(self.row, " ".join(self.parts))
        self.parts, self.length, self.word = [], 0, ""

    def _add(self, row: int, text: str) -> None:
        text = text.strip()
        if text:
            self.row = self.row if self.parts else row
            self.parts.append(text)
            self.length += len(text)

    def _take_pieces(self, row: int, text: str) -> Iterator[Line]:
        last, fresh, stop = 0, True, len(text)
        for piece in _PIECE.finditer(text):
            mark, at = piece[0], piece.start()
            if mark[0] == "!" or at - last > MOST_LENGTH:
                stop = at
                break
            begins = fresh and not self.parts and not text[last:at].strip()
            fresh = False
            if mark[0].isalpha():
                word = mark.upper()
                if word in _FIRST and not begins and self._is_cut_by(word, text[last:at]):
                    yield from self.ended(row, text[last:at])
                    last, self.depth, self.listed, begins = at, 0, None, True
                if begins or self.word in ("LOCAL", "TASK"):
                    self.word = word
            elif mark in "[({":
                if mark == "[" and not self.depth and self.listed is None:
                    opened = " ".join([*self.parts, text[last : at + 1].strip()])
                    self.listed = _LIST_BEGINS.fullmatch(opened) is not None
                self.depth += 1
            elif mark in "])}":
                self.depth = max(0, self.depth - 1)
            if self.listed and (mark, self.depth) in ((",", 1), ("]", 0)):
                yield from self.ended(row, text[last:at])
                last, self.listed = at, None if mark == "]" else True
            elif self._is_ended_by(mark, text[last:at] if mark == ":" else ""):
                yield from self.ended(row, text[last : piece.end()])
                last, self.depth, self.listed, fresh = piece.end(), 0, None, True
        self._add(row, text[last:stop])
        heading = self.word in _WITH_LINE and not self.depth and bool(self.parts)
        named = heading and (self.word == "ERROR" or " " in " ".join(self.parts))
        if named or self.length > MOST_LENGTH:
            yield from self.ended()
            self.depth, self.listed = 0, None

    def _is_cut_by(self, word: str, between: str) -> bool:
        """Whether a statement ends in front of a word that begins the next one."""
        if self.word in ("LOCAL", "TASK"):
            return " ".join([*self.parts, between]).strip().upper() != self.word
        return not (self.word in ("PROC", "FUNC") and self.depth and word in _STORED)

    def _is_ended_by(self, mark: str, before: str) -> bool:
        if mark == ":":  # of a case, or of a label
            label = not self.parts and before.strip().upper() == self.word
            return self.word in ("CASE", "DEFAULT") or (label and bool(self.word))
        if mark == ")":
            return not self.depth and self.word in ("PROC", "FUNC", "ERROR")
        return mark == ";" or mark.upper() in _ALONE or mark.upper() == _LAST.get(self.word)


LANGUAGE = Language("posedesign.programs.abb_rapid", joined=divided)


@dataclass(frozen=True)
class Data:
    """A declaration of data; ``whole`` says whether the end of a list was found."""

    row: int
    storage: str
    kind: str
    name: str
    size: Tree[Token] | None
    value: Node | None
    elements: Sequence[Node] = ()
    whole: bool = True

    @property
    def count(self) -> int | None:
        """Elements that a list of one dimension is declared to have, where it is a number."""
        size = inside(self.size)
        return int(size) if re.fullmatch(r"[0-9]{1,7}", size) else None

    @property
    def values(self) -> list[tuple[str, Node]]:
        """The value, or those of the elements, each with what to call it."""
        if self.value is not None:
            return [(self.name, self.value)]
        return [(f"{self.name}{{{k}}}", node) for k, node in enumerate(self.elements, start=1)]


def declared(statements: Sequence[Statement]) -> Iterator[Data]:
    """Data that statements declare, lists with their elements."""
    for i, statement in enumerate(statements):
        if statement.kind not in ("declaration", "array"):
            continue
        children = list(statement.tree.children)
        if isinstance(children[0], Tree):  # LOCAL, TASK
            del children[0]
        storage, kind, name, *rest = children
        size = next((c for c in rest[:1] if isinstance(c, Tree) and c.data == "sizes"), None)
        rest = rest[1:] if size else rest
        value = rest[0] if rest and statement.kind == "declaration" else None
        elements, j = rest if value is None else [], i + 1
        while j < len(statements) and statements[j].kind == "element":
            elements.append(statements[j].tree.children[0])
            j += 1
        whole = not elements or (j < len(statements) and statements[j].kind == "array_end")
        kinds = str(storage).upper(), str(kind).lower()
        yield Data(statement.row, *kinds, str(name), size, value, elements, whole)


def calls(statement: Statement) -> Iterator[tuple[str, list[Argument]]]:
    """The call that a statement is, or holds: the routine in capitals, and its arguments."""
    if statement.kind not in ("call", "compact_if"):
        return
    for call in statement.all("call"):
        found: list[Argument] = []
        for argument in call.children[1:]:
            value, switches = None, {}
            for node in argument.children:  # type: ignore[union-attr]
                if isinstance(node, Tree) and node.data == "switch":
                    name, *inner = node.children
                    switches[str(name).upper()] = inner[0] if inner else None
                else:
                    value = node
            found.append((value, switches))
        yield str(call.children[0]).upper(), found


def name_of(node: Node | None) -> str:
    """The name in capitals that a value is, without index and component; empty for another."""
    return str(node.children[0]).upper() if is_a(node, "variable") else ""  # type: ignore[union-attr]


def is_a(node: Node | None, kind: str) -> bool:
    """Whether a value is a list, a variable, ..."""
    return isinstance(node, Tree) and node.data == kind


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
