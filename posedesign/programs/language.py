"""One grammar a language: the text of a program as a list of statements, each with its tree.

The grammars are written for lark (LALR), one ``grammar.lark`` in the folder of each dialect, and
parse one statement at a time: a line, or what the dialect's `Language.joined` makes one. A line
that is wrong then spoils no other, blocks are told by :func:`block_faults`, and statements that
differ in their numbers, texts in quotes and blanks only are parsed once: a table of ten thousand
positions costs one parse a kind of line, and gives the same trees.

For that a grammar must not tell numbers of one form (``7``, ``7.5``, ``.5``) or texts in
quotation marks apart: how large a number may be is for the rules.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from itertools import accumulate
from operator import itemgetter
from typing import Any, NamedTuple, TypeGuard, TypeVar

from lark import Lark, Token, Tree, UnexpectedCharacters, UnexpectedInput
from lark.lexer import PatternStr, TerminalDef

from posedesign.programs.recorded import Problem

MOST_FAULTS = 1000
"""Statements that are told to be wrong; a file with more is no program, and is read no further."""

MOST_LENGTH = 20_000
"""Characters of a statement that is parsed: of programs they have a few hundred at most."""

MOST_STATEMENTS = 250_000  # of a program: one of 10,000 positions has a hundred thousand
MOST_NUMBERS = 600_000
"""Numbers and texts in quotes of a program, those of equal statements once: 10,000 positions have
240,000 at most."""

MOST_PARSED = 1_000_000
"""Characters of statements that differ in more than numbers and texts in quotes: far more than a
controller's memory holds."""

MOST_IN_LONG = 3_000_000
"""Characters in long statements, such as arrays of positions: 20,000 positions."""

_LONG = 1000
_MOST_SHAPES = 2000
_MOST_KEPT = 100
_MOST_DEPTH = 60
_MOST_LINES = 300
_MOST_BEHIND = 3  # shapes behind a shape that are tried first, less one
_MOST_GROUPS = 200  # of a pattern

_PART = 1_000_000  # characters that are divided into lines at once
_FORM_OF_PIECES = r"""("[^"\n]*"
    | SIGN(?<![\w.])(?:\d+(?:\.\d*)?|\.\d+)(?![\w.])
    | (?<=[A-Za-z_])(?!(?<=[AEJaej])(?<!\w[AEJaej])\d\b)\d+(?![\w.]))"""

_PIECE = re.compile(_FORM_OF_PIECES.replace("SIGN", ""), re.ASCII | re.VERBOSE)
"""Texts in quotes, numbers, and numbers behind a name: ``XP12``, but for joints, ``A1``, which are
few."""

_UNARY = r"(?<=[\[(,=])|(?<=[\[(,=]\ )"

_BLANKS = re.compile(r"[ \t\r]{2,}|[\t\r]")
_BLANKS_OR_TEXT = re.compile(rf'("[^"\n]*")|{_BLANKS.pattern}')
_BLANK, _DIGITS = re.compile(r"\\ "), re.compile(r"\d+")  # in the text of a pattern
_AFTER_JOINT = re.compile(r"(?<!\w)[AEJaej]\Z", re.ASCII)  # of one digit behind them see above
_FORM = re.compile(r"-?\d+")
_FORM_OR_TEXT = re.compile(r'(")[^"\n]*"|-?\d+')


def _with_single_blanks(text: str) -> str:
    """A text in which each run of blanks is one, but in quotes."""
    if '"' in text:
        return _BLANKS_OR_TEXT.sub(lambda found: found[1] or " ", text).strip()
    return _BLANKS.sub(" ", text).strip()


class Line(NamedTuple):
    """A line of a file, or several that are one statement: where it begins, and its text."""

    row: int
    text: str


T = TypeVar("T")
Node = Tree[Token] | Token
Build = Callable[[Sequence[str]], Any]
Find = Callable[[Tree[Token]], Iterable[Node]]
Template = list[str | int]  # of a text: what stands there, and which slots


class Shape:
    """What statements share that differ in numbers, texts in quotes and blanks only.

    Trees are built of a statement's own numbers and texts, its ``slots``, where they are asked for.
    """

    def __init__(
        self,
        tree: Tree[Token],
        spans: list[tuple[int, int]],
        pattern: str = "",
        numbers: Sequence[int] = (),
        named: Sequence[int] = (),
    ) -> None:
        self.tree, self.spans = tree, spans
        self.numbers, self.named = numbers, named
        """numbers, named: slots that are numbers, and ends of names."""
        self.kind = str(tree.data)
        self.behind: list[Shape] = []  # of statements that stood behind such ones, the last first
        self.notes: dict[Any, Any] = {}  # what is the same of all, by what asks for it
        self._pattern: str | re.Pattern[str] = pattern
        self._parts: dict[Find, list[tuple[Node, Build | None]]] = {}
        self._texts: dict[Find, Callable[[Sequence[str]], list[str]]] = {}
        self._build: Build | None = None

    def slots_of(self, text: str) -> Sequence[str] | None:
        """Numbers and texts of a statement of this shape; None of another one, or not sure."""
        pattern = self._pattern
        if isinstance(pattern, str):
            if not pattern:
                return None
            pattern = self._pattern = re.compile(pattern, re.ASCII)
        found = pattern.fullmatch(text)
        return found.groups() if found else None

    def whole(self, slots: Sequence[str]) -> Tree[Token]:
        """The tree of a statement."""
        if self._build is None:
            self._build = _builder(self.tree, self.spans) or (lambda slots: self.tree)
        tree: Tree[Token] = self._build(slots)
        return tree

    def parts(self, find: Find, slots: Sequence[str]) -> list[Any]:
        """Nodes that a function finds in the tree, with the numbers and texts of a statement."""
        parts = self._parts.get(find)
        if parts is None:
            parts = [(node, _builder(node, self.spans)) for node in find(self.tree)]
            self._parts[find] = parts
        return [node if build is None else build(slots) for node, build in parts]

    def texts(self, find: Find, slots: Sequence[str]) -> list[str]:
        """Texts of the nodes that a function finds in the tree."""
        told = self._texts.get(find)
        if told is None:
            found = [_template(node, self.spans) for node in find(self.tree)]
            told = self._texts[find] = _texts_by([_simple(parts) for parts in found])
        return told(slots)


class Statement:
    """What one line says."""

    __slots__ = ("_tree", "fault", "kind", "row", "said", "shape", "slots", "text")

    def __init__(
        self, row: int, text: str, shape: Shape, slots: Sequence[str] = (), fault: str = ""
    ) -> None:
        self.row = row  # line of the file where it begins, counted from 1
        self.text = text  # as it stands there
        self.shape, self.slots = shape, slots
        self.kind = shape.kind  # name of the grammar's rule
        self.fault = fault  # what is wrong with it, in words; empty for nothing
        self.said: Any = None  # see `kept`
        self._tree: Tree[Token] | None = None

    @property
    def form(self) -> Hashable:
        """Tells statements apart that differ in more than numbers and texts.

        A word of the language is meant in all names of a form, or in none: of the numbers behind
        names one digit may be a slip.
        """
        shape = self.shape
        if not shape.named:
            return shape
        return shape, *[len(self.slots[k]) == 1 for k in shape.named]

    @property
    def tree(self) -> Tree[Token]:
        """What the grammar makes of it; a tree of the name ``fault`` where nothing."""
        if self._tree is None:
            self._tree = self.shape.whole(self.slots)
        return self._tree

    def all(self, *names: str) -> list[Tree[Token]]:
        """Subtrees of these names, from the left."""
        return self.shape.parts(_of_names(names), self.slots)

    def one(self, name: str) -> Tree[Token] | None:
        """The first subtree of this name."""
        return next(iter(self.all(name)), None)

    def texts_of(self, *names: str) -> list[str]:
        """Their texts without blanks."""
        return self.shape.texts(_of_names(names), self.slots)

    def words(self, *types: str) -> list[str]:
        """Texts of all tokens of these terminals, from the left."""
        return self.shape.texts(_of_types(types), self.slots)

    def word(self, name: str) -> str:
        """The first of them; empty for none."""
        return next(iter(self.words(name)), "")

    def nodes(self, find: Find) -> list[Any]:
        """Nodes that a function finds, which must not look at numbers and texts."""
        return self.shape.parts(find, self.slots)

    def texts(self, find: Find) -> list[str]:
        """Texts of such nodes."""
        return self.shape.texts(find, self.slots)

    def kept(self, take: Callable[[Statement], T]) -> T:
        """What a language takes from the statement, taken once for all that ask."""
        if self.said is None:
            self.said = take(self)
        said: T = self.said
        return said

    def once(self, ask: Callable[[Statement], T]) -> T:
        """What a function says of all statements that differ in numbers and texts only.

        It is asked once: it must not look at them.
        """
        notes = self.shape.notes
        if ask not in notes:
            notes[ask] = ask(self)
        said: T = notes[ask]
        return said


def _named(node: Node, names: tuple[str, ...], kind: type) -> Iterator[Node]:
    """Trees or tokens of these names in a node, itself included, from the left."""
    if isinstance(node, kind) and (node.data if isinstance(node, Tree) else node.type) in names:
        yield node
    for child in node.children if isinstance(node, Tree) else ():
        yield from _named(child, names, kind)


@cache
def _of_types(types: tuple[str, ...]) -> Find:
    return lambda tree: _named(tree, types, Token)


@cache
def _of_names(names: tuple[str, ...]) -> Find:
    return lambda tree: _named(tree, names, Tree)


def nodes(tree: Tree[Token], *names: str) -> Iterator[Tree[Token]]:
    """Subtrees of these names, itself included, from the left."""
    if tree.data in names:
        yield tree
    for child in tree.children:
        if isinstance(child, Tree):
            yield from nodes(child, *names)


def subtrees(tree: Tree[Token]) -> list[Tree[Token]]:
    """What a tree is made of, without its tokens."""
    return [child for child in tree.children if isinstance(child, Tree)]


def words(tree: Tree[Token], *types: str) -> list[str]:
    """Texts of all tokens of these terminals in a tree, from the left."""
    found: list[str] = []
    for child in tree.children:
        if isinstance(child, Tree):
            found += words(child, *types)
        elif child.type in types:
            found.append(str(child))
    return found


def is_a(node: Node | None, kind: str) -> TypeGuard[Tree[Token]]:
    """Whether a node is a tree of this name."""
    return isinstance(node, Tree) and node.data == kind


def text_of(node: Node) -> str:
    """All tokens of a tree as one text without blanks, for messages and comparisons."""
    if isinstance(node, Token):
        return str(node)
    return "".join([c if isinstance(c, Token) else text_of(c) for c in node.children])


_shared: ContextVar[dict[Hashable, Any] | None] = ContextVar("_shared", default=None)


@contextmanager
def shared_statements() -> Iterator[None]:
    """Parse each text once for all that ask for its statements in the meantime."""
    before = _shared.set({})
    try:
        yield
    finally:
        _shared.reset(before)


def shared(key: Hashable, make: Callable[[], T]) -> T:
    """What is made of a key, once inside of `shared_statements`."""
    known = _shared.get()
    if known is None:
        return make()
    if key not in known:
        known[key] = make()
    made: T = known[key]
    return made


NOTHING: Tree[Token] = Tree("fault", [])  # what a grammar makes of a statement that is none
_FAULT = Shape(NOTHING, [])


def _faulty(row: int, text: str, fault: str) -> Statement:
    return Statement(row, text, _FAULT, fault=fault)


@dataclass
class Language:
    """A language of robot programs."""

    package: str  # of the dialect, whose folder holds ``grammar.lark``
    joined: Callable[[Iterator[Line]], Iterator[Line]] | None = None
    """Makes one statement of several lines, or several of one."""
    divided: Callable[[str], Iterator[Line]] | None = None
    """Finds the statements in a text, where lines say nothing."""
    start: str = "statement"  # rule of a statement
    others: tuple[str, ...] = ()
    """Rules that `statement` can be asked for besides: sections with a syntax of their own."""
    name: str = "grammar.lark"  # file of the grammar
    signed: bool | tuple[str, ...] = False
    """A minus sign behind what `unary` finds is of the number behind it, so that statements are
    parsed once whatever their signs; or so in these rules only."""
    unary: str = _UNARY
    """Behind what a minus sign takes nothing away: lookbehinds; a bracket, a comma or an equals
    sign."""
    letters: str = ""
    """Characters of names, as in a set of a regular expression. None of them can stand behind a
    keyword then; empty where words are not separated, as in ``CNT50``."""
    indented: bool = False  # texts of statements keep the blanks before them, which mean something
    _shapes: dict[tuple[str, tuple[str, ...], str], Shape] = field(default_factory=dict, repr=False)
    _parsed: int = field(default=0, repr=False)
    _filled: int = field(default=0, repr=False)
    _kept: dict[tuple[str, str], Statement] = field(default_factory=dict, repr=False)
    _last: dict[str, Shape] = field(default_factory=dict, repr=False)

    @cached_property
    def _signed_piece(self) -> re.Pattern[str]:
        sign = f"(?:(?:{self.unary})-)?"
        return re.compile(_FORM_OF_PIECES.replace("SIGN", sign), re.ASCII | re.VERBOSE)

    @cached_property
    def _behind(self) -> re.Pattern[str]:
        return re.compile(rf"(?:{self.unary})\Z", re.VERBOSE)

    @cached_property
    def parser(self) -> Lark:
        """The parser; made when it is first needed."""
        grammar = files(self.package).joinpath(self.name).read_text(encoding="ascii")
        parser = Lark(
            grammar,
            parser="lalr",
            start=[self.start, *self.others],
            maybe_placeholders=False,
            edit_terminals=self._end_keyword if self.letters else None,
        )
        for terminal in parser.terminals:
            pattern = terminal.pattern
            if isinstance(pattern, PatternStr) and re.search(r"[A-Za-z_]\d+$", pattern.value):
                # such a keyword would be taken for one with another number
                raise ValueError(f"{self.package}: the keyword {pattern.value} ends in a number")
        return parser

    def _end_keyword(self, terminal: TerminalDef) -> None:
        pattern = terminal.pattern
        if isinstance(pattern, PatternStr) and re.search(r"[A-Za-z_]$", pattern.value):
            # the text stays, by which lark tells keywords from names
            whole = pattern.to_regexp() + f"(?![{self.letters}])"
            pattern.to_regexp = lambda: whole  # type: ignore[method-assign]

    def statements(self, text: str) -> list[Statement]:
        """All statements of a text that are not blank; none behind the thousandth fault.

        What stands behind the most that is read of statements, their kinds, or numbers in them, is
        a fault each.
        """
        text = text.replace("\r\n", "\n")  # so that reader and rules ask for the same
        return shared((id(self), text), lambda: self._parse_all(text))

    def _parse_all(self, text: str) -> list[Statement]:
        lines = self.divided(text) if self.divided else lines_of(text, indented=self.indented)
        found: list[Statement] = []
        faults = size = 0
        self._parsed = self._filled = 0
        for line in self.joined(lines) if self.joined else lines:
            size += len(line.text) if len(line.text) > _LONG else 0
            few = self._parsed < MOST_PARSED and self._filled < MOST_NUMBERS
            if few and len(found) < MOST_STATEMENTS and size < MOST_IN_LONG:
                found.append(self.statement(line))
            else:
                fault = "the program is too long to be read so far"
                found.append(_faulty(line.row, line.text[:MOST_LENGTH], fault))
            faults += bool(found[-1].fault)
            if faults >= MOST_FAULTS:
                break
        return found

    def statement(self, line: Line, rule: str = "") -> Statement:
        """The statement of one line; by another rule than `start` where one is named."""
        rule, (row, own) = rule or self.start, line
        last = self._last.get(rule)
        same = self._kept.get((rule, own))
        if same is not None:
            shape, slots = same.shape, same.slots
            found = Statement(row, own, shape, slots)
            found._tree = same.tree
        else:
            for shape in last.behind if last else ():
                if told := shape.slots_of(own):
                    slots = told
                    break
            else:
                parsed = self._shape_of(row, own, rule)
                if isinstance(parsed, Statement):
                    return parsed
                shape, slots = parsed
            self._filled += len(slots)
            found = Statement(row, own, shape, slots)
            if len(own) <= _MOST_KEPT:
                if len(self._kept) >= _MOST_SHAPES:
                    self._kept.clear()
                self._kept[rule, own] = found
        if last is not None and (not last.behind or last.behind[0] is not shape):
            last.behind = [shape, *(s for s in last.behind[:_MOST_BEHIND] if s is not shape)]
        self._last[rule] = shape
        return found

    def _shape_of(
        self, row: int, own: str, rule: str, *, plainly: bool = False
    ) -> Statement | tuple[Shape, Sequence[str]]:
        """Shape and slots of a statement; one with a fault where the grammar has none.

        ``plainly``: each sign is an operator.
        """
        if len(own) > MOST_LENGTH:
            return _faulty(row, own[:100], f"{len(own)} characters in one statement")
        text = _with_single_blanks(own)
        signed = not plainly and (self.signed is True or rule in (self.signed or ()))
        pieces = (self._signed_piece if signed else _PIECE).split(text)
        slots = pieces[1::2]
        # J0 is no slot, and J10 is one: what stands between them is compared, too
        forms = "\n".join(slots)
        forms = _FORM_OR_TEXT.sub(_form, forms) if '"' in text else _FORM.sub("\0", forms)
        key = (rule + "-" * plainly, tuple(pieces[::2]), forms)
        shape = self._shapes.get(key)
        if shape is None:
            pattern = _pattern(pieces, self._behind if signed else None)
            pieces[1::2] = [slot.lstrip("-") for slot in slots]
            text = "".join(pieces)
            self._parsed += len(text)
            if _depth(text) > _MOST_DEPTH:
                return _faulty(row, own, "brackets are too deep")
            try:
                tree = self.parser.parse(text, start=rule)
            except UnexpectedInput as error:
                if signed and any(slot[0] == "-" for slot in slots):
                    return self._shape_of(row, own, rule, plainly=True)
                at, fault = _fault(text, error, self.parser)
                return _faulty(row + text.count("\n", 0, at), own, fault)
            ends = [*accumulate(map(len, pieces))]
            spans = [*zip(ends[:-1:2], ends[1::2], strict=True)]
            if len(self._shapes) >= _MOST_SHAPES:
                self._shapes.clear()
            shape = Shape(_named_plainly(tree), spans, pattern, *_kinds_of_slots(pieces))
            self._shapes[key] = shape
        return shape, slots


def _kinds_of_slots(pieces: Sequence[str]) -> tuple[list[int], list[int]]:
    """Slots that are numbers, and ends of names."""
    numbers, named = list[int](), list[int]()
    for k, (before, slot) in enumerate(zip(pieces[::2], pieces[1::2], strict=False)):
        if slot[0] != '"':
            (named if before[-1:].isalpha() or before[-1:] == "_" else numbers).append(k)
    return numbers, named


def _form(found: re.Match[str]) -> str:
    return '"\0' if found[1] else "\0"


def _pattern(pieces: Sequence[str], unary: re.Pattern[str] | None) -> str:
    """Pattern of statements that differ from one in its slots and blanks only.

    Empty where it would be too long, or quotation marks that nothing closes stand in the text.
    """
    if len(pieces) > _MOST_GROUPS or any('"' in piece for piece in pieces[::2]):
        return ""
    parts = [r"[ \t\r]*"]
    for k, piece in enumerate(pieces):
        if k % 2 == 0:
            parts.append(_BLANK.sub(r"[ \\t\\r]+", re.escape(piece)))
            continue
        before = pieces[k - 1]
        if piece[0] == '"':
            parts.append(r'("[^"\n]*")')
            continue
        digits = r"\\d{2,}" if _AFTER_JOINT.search(before) else r"\\d+"
        minus = "-?" if unary and unary.search(before) else ""
        parts.append(f"({minus}{_DIGITS.sub(digits, re.escape(piece.lstrip('-')))})")
    return "".join([*parts, r"[ \t\r]*"])


def _named_plainly(tree: Tree[Token]) -> Tree[Token]:
    """A tree with plain texts for names, which are compared faster than tokens."""
    for node in tree.iter_subtrees():
        node.data = str(node.data)
    return tree


def _depth(text: str) -> int:
    depth = most = 0
    for mark in re.finditer(r"[([{]|[)\]}]", text):
        depth += 1 if mark[0] in "([{" else -1
        most = max(most, depth)
    return most


def lines_of(text: str, *, indented: bool = False, row: int = 1) -> Iterator[Line]:
    """Lines of a text that are not blank, without the blanks before them where those say nothing.

    Lines without anything cost nothing. ``row``: of the first one.
    """
    at = 0
    while at < len(text):  # in parts: a file may be nothing but line ends
        end = text.find("\n", at + _PART)
        part = text[at : end if end >= 0 else None]
        for k, line in enumerate(part.split("\n"), start=row):
            bare = line.strip()
            if bare:
                yield Line(k, line.rstrip() if indented else bare)
        at, row = at + len(part) + 1, k + 1


_QUOTED = r'("[^"\n]*")'


def without_remarks(
    remark: str, quoted: str = _QUOTED, marks: str = ""
) -> Callable[[Iterator[Line]], Iterator[Line]]:
    """Leave out what is a remark, but in texts in quotes, and lines that are nothing else.

    Patterns of both, letters of either case alike; for `Language.joined`. ``marks``: characters of
    which each remark has one.
    """
    pattern = re.compile(f"{quoted}|{remark}", re.IGNORECASE)

    def joined(lines: Iterator[Line]) -> Iterator[Line]:
        for line in lines:
            if marks and not any(mark in line.text for mark in marks):
                yield line
                continue
            text = pattern.sub(lambda found: found[1] or "", line.text).rstrip()
            if text:
                yield Line(line.row, text)

    return joined


def open_lines(
    remark: str, quoted: str = _QUOTED, brackets: str = "() []", begins: str = "(?!)"
) -> Callable[[Iterator[Line]], Iterator[Line]]:
    """Make one statement of lines while a bracket is open, without remarks.

    What ``begins`` a statement never goes on with another; for `Language.joined`.
    """
    pattern, in_quotes = re.compile(f"{quoted}|{remark}.*"), re.compile(quoted)
    first, pairs = re.compile(begins), [(pair[0], pair[1]) for pair in brackets.split()]

    def joined(lines: Iterator[Line]) -> Iterator[Line]:
        row, parts, opened, length = 0, list[str](), 0, 0
        for line in lines:
            text = line.text
            if remark in text:
                text = pattern.sub(lambda found: found[1] or "", text).rstrip()
            if not text:
                continue
            too_long = length >= MOST_LENGTH or len(parts) >= _MOST_LINES
            if parts and (too_long or first.match(text)):
                yield Line(row, " ".join(parts))
                parts, opened, length = [], 0, 0
            bare = in_quotes.sub("", text) if "'" in text or '"' in text else text
            opened += sum([bare.count(pair[0]) - bare.count(pair[1]) for pair in pairs])
            row = row if parts else line.row
            parts.append(text)
            length += len(text)
            if opened <= 0:
                yield Line(row, " ".join(parts))
                parts, opened, length = [], 0, 0
        if parts:
            yield Line(row, " ".join(parts))

    return joined


def _builder(node: Tree[Token] | Token, spans: list[tuple[int, int]]) -> Build | None:
    """A function that builds the node from the texts of the slots; None where it holds none."""
    if isinstance(node, Tree):
        name = node.data
        built = [(k, _builder(child, spans)) for k, child in enumerate(node.children)]
        parts = [(k, part) for k, part in built if part is not None]
        children = node.children

        def build_tree(slots: Sequence[str]) -> Tree[Token]:
            own = children.copy()
            for k, part in parts:
                own[k] = part(slots)
            return Tree(name, own)

        return build_tree if parts else None
    kind, template = node.type, _simple(_template(node, spans))
    if isinstance(template, str):
        return None
    if isinstance(template, int):
        return lambda slots: _token(kind, slots[template])
    return lambda slots: _token(kind, _filled(template, slots))


def _template(node: Node, spans: list[tuple[int, int]]) -> Template:
    """The text of a node without blanks, of what stands there and of slots."""
    if isinstance(node, Tree):
        return [part for child in node.children for part in _template(child, spans)]
    start, end = node.start_pos or 0, node.end_pos or 0
    first = last = bisect_left(spans, (start, start))
    while last < len(spans) and spans[last][1] <= end:
        last += 1
    text, at, parts = str(node), start, Template()
    for slot in range(first, last):
        parts += [text[at - start : spans[slot][0] - start], slot]
        at = spans[slot][1]
    return [*parts, text[at - start :]]


def _simple(template: Template) -> Template | str | int:
    """A template that is one slot or one text as that."""
    told = [part for part in template if part != ""]
    if not any(isinstance(part, int) for part in told):
        return "".join(map(str, told))
    return told[0] if len(told) == 1 else told


def _texts_by(templates: list[Template | str | int]) -> Callable[[Sequence[str]], list[str]]:
    """A function that makes texts of slots."""
    if len(templates) > 1 and all(isinstance(template, int) for template in templates):
        get = itemgetter(*templates)
        return lambda slots: [*get(slots)]
    fixed = [template for template in templates if isinstance(template, str)]
    if len(fixed) == len(templates):
        return lambda slots: fixed.copy()
    return lambda slots: [
        slots[t] if isinstance(t, int) else t if isinstance(t, str) else _filled(t, slots)
        for t in templates
    ]


def _filled(template: Template, slots: Sequence[str]) -> str:
    return "".join([slots[part] if isinstance(part, int) else part for part in template])


def _token(kind: str, text: str) -> Token:
    """A token that does not know where it stands: half the time of making one that does."""
    token = str.__new__(Token, text)
    token.type, token.value = kind, text
    return token


def _fault(text: str, error: UnexpectedInput, parser: Lark) -> tuple[int, str]:
    at = (error.pos_in_stream or 0) if isinstance(error, UnexpectedCharacters) else None
    if at is None:
        token = getattr(error, "token", None)
        at = len(text) if token is None or token.type == "$END" else token.start_pos
    rest = text[at : at + 24]
    expected = getattr(error, "allowed", None) or getattr(error, "expected", None) or set()
    known = {t.name: t.pattern for t in parser.terminals}
    keywords = sorted(
        known[name].value for name in expected if isinstance(known.get(name), PatternStr)
    )
    hint = f"; one of {' '.join(keywords)} can" if 0 < len(keywords) <= 5 else ""
    if not rest:
        return at, f"{_in_line(text[-30:])} is not complete" + hint
    before = _in_line(text[max(0, at - 20) : at])
    return at, f"{_in_line(rest)} cannot stand behind {before}" + hint


def _in_line(text: str) -> str:
    return ascii(re.sub(r" *\n *", " ", text))


@dataclass(frozen=True)
class Block:
    """Statements that open, divide and close a block, by the names of their rules."""

    closes: str
    divides: tuple[str, ...] = ()


def block_faults(
    statements: Sequence[Statement], blocks: Mapping[str, Block], rule: str = "block"
) -> Iterator[Problem]:
    """Blocks that nothing closes, and what closes or divides none.

    ``blocks`` has them by the rule that opens them, e.g. ``{"if_": Block("endif", ("else_",))}``.
    """
    closing = {block.closes for block in blocks.values()}
    dividing = {name for block in blocks.values() for name in block.divides}
    opened: list[Statement] = []
    for statement in statements:
        kind = statement.kind
        top = blocks[opened[-1].kind] if opened else None
        if kind in closing and top is not None and top.closes == kind:
            opened.pop()
        elif kind in closing:
            reason = f"{statement.text[:30].strip()!a} closes nothing"
            if top is not None:
                line = opened[-1].row
                reason = f"{statement.text[:30].strip()!a} does not close what line {line} opens"
                if any(blocks[other.kind].closes == kind for other in opened):
                    while blocks[opened.pop().kind].closes != kind:
                        pass
            yield Problem(statement.row, rule, reason)
        elif kind in dividing and (top is None or kind not in top.divides):
            yield Problem(
                statement.row, rule, f"{statement.text[:30].strip()!a} is in no such block"
            )
        if kind in blocks:
            opened.append(statement)
    for statement in opened:
        yield Problem(statement.row, rule, f"{statement.text[:30].strip()!a} is never closed")


def indent_faults(statements: Iterable[Statement], *opening: str) -> Iterator[Problem]:
    """Statements that are not indented as Python asks; ``opening``: rules that open a block.

    They are those of a language that is ``indented``.
    """
    levels, opens = [0], False
    for statement in statements:
        text = statement.text.expandtabs()
        indent = len(text) - len(text.lstrip())
        if opens and indent > levels[-1]:
            levels.append(indent)
        else:
            levels = [level for level in levels if level <= indent]
            if opens or levels[-1] != indent:
                yield Problem(statement.row, "indent", "not indented as the lines around it")
        opens = statement.kind in opening
