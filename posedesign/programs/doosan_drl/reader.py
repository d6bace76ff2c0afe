"""Doosan DRL programs: the reader.

Positions are the joint values that ``movej`` and ``amovej`` go to: ``posj`` or a list of six, there
or in a variable. Moves to values that are computed, and relative ones, are refused; poses of the
tool (``posx``) are left out, since nothing says which posture takes them. Numbers are those of
remarks ``# POSE n`` in front of the moves, where a program has the mark of a plan; others in their
order, behind all.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from lark import Token, Tree

from posedesign.programs.joint_programs import PLAIN, Found, notes_of, program_of
from posedesign.programs.language import Language, Line, Statement, nodes, text_of
from posedesign.programs.reading import refuse
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import RecordedProgram

MOVES = ("movej", "amovej")
_MOST_LINES = 300  # of one statement
_QUOTED = re.compile(r"""(?<!")"[^"\n]+"|(?<!')'[^'\n]+'""")
_REMARK = re.compile(r"""("[^"\n]*"|'[^'\n]*')|#.*""")
_JOINT = re.compile(r"""\b(a?movej|posj)\b|\"{3}|'{3}""")
_BLOCK = re.compile(
    r"""(?P<mark>\"{3}|'{3})(?s:.*?)(?P=mark)|"[^"\n]*"|'[^'\n]*'|\#[^\n]*""", re.VERBOSE
)


def without_blocks(text: str) -> str:
    """A text with nothing in the quotations of many lines, and its lines where they were."""

    def emptied(found: re.Match[str]) -> str:
        if not found["mark"]:
            return found[0]
        before = text[text.rfind("\n", 0, found.start()) + 1 : found.start()]
        return ('""' if before.strip() else "pass") + "\n" * found[0].count("\n")

    return _BLOCK.sub(emptied, text)


def _joined(lines: Iterator[Line]) -> Iterator[Line]:
    """One statement of lines while a bracket is open, without remarks."""
    row, parts, opened = 0, list[str](), 0
    for line in lines:
        text = _REMARK.sub(lambda found: found[1] or "", line.text).rstrip()
        if opened <= 0 or len(parts) > _MOST_LINES:
            if parts:
                yield Line(row, " ".join(parts))
            row, parts, opened = line.row, [], 0
        if text:
            parts.append(text)
            bare = _REMARK.sub("", text)
            opened += sum(map(bare.count, "([{")) - sum(map(bare.count, ")]}"))
    if parts:
        yield Line(row, " ".join(parts))


LANGUAGE = Language(__package__ or "", joined=_joined, start="line", signed=True, letters=r"\w")


def calls(s: Statement) -> Iterator[tuple[str, list[Tree[Token]]]]:
    """Names of the functions that a statement calls, and their arguments."""
    for invoke in nodes(s.tree, "invoke"):
        name, arguments = invoke.children
        if isinstance(arguments, Tree):
            yield str(name), [child for child in arguments.children if isinstance(child, Tree)]


def alone(tree: Tree[Token]) -> Tree[Token] | None:
    """The call, list or name that an expression is; None: it is computed of more than one."""
    while tree.data in ("argument", "keyword", "expr", "operand"):
        child = tree.children[-1]
        if not isinstance(child, Tree) or (len(tree.children) > 1 and tree.data != "keyword"):
            return None
        tree = child
    return tree


def target_of(arguments: list[Tree[Token]]) -> Tree[Token] | None:
    """The position among the arguments of a move; None: there is none that can be told."""
    named = [a for a in arguments if a.data == "keyword" and a.children[0] == "pos"]
    first = [a for a in arguments[:1] if a.data == "argument"]
    return next(iter([*first, *named]), None)


def is_relative(arguments: list[Tree[Token]]) -> bool:
    """Whether a move goes on from where the arm stands, or may."""
    named = [a.children[-1] for a in arguments if a.data == "keyword" and a.children[0] == "mod"]
    mods = [*named, *arguments[5:6]] if [a.data for a in arguments[5:6]] == ["argument"] else named
    return any(text_of(mod) not in ("0", "DR_MV_MOD_ABS") for mod in mods if isinstance(mod, Tree))


Variables = dict[str, list[str]]
"""Texts of the values of the variables that are lists of numbers."""


def joints_in(expression: Tree[Token], variables: Variables) -> list[str] | None:
    """Texts of the joint values that an expression is; None: it is computed, or not known here."""
    tree = alone(expression)
    if tree is None or tree.data == "name":
        return variables.get(text_of(tree)) if tree else None
    values = [child for child in tree.children if isinstance(child, Tree)]
    if tree.data == "invoke" and tree.children[0] == "posj":
        values = [child for child in values[0].children if isinstance(child, Tree)]
        if len(values) == 1:
            return joints_in(values[0], variables)
    elif tree.data != "list":
        return None
    texts = [text_of(value) for value in values]
    return texts if texts and all(map(PLAIN.fullmatch, texts)) else None


def changed_in(s: Statement) -> set[str]:
    """Names that may stand for something else behind a statement."""
    if s.fault or s.kind == "import_":
        return set(re.findall(r"\w+", s.text))
    names = {text_of(parameter) for parameter in nodes(s.tree, "parameter")}
    first = s.tree.children[:1]
    if s.kind == "call" and isinstance(first[0], Tree) and first[0].data == "name":
        names.add(text_of(first[0]))  # of a method, which may change it
    for child in s.tree.children if s.kind == "assign" else ():
        if isinstance(child, Token):
            break
        names |= {text_of(child), *(text_of(name) for name in nodes(child, "name"))}
    return names


def parse_doosan_drl(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = without_blocks(text_of_file(data, path))
    notes = notes_of(text, "#")
    found: list[Found] = []
    variables: Variables = {}
    for s in LANGUAGE.statements(text):
        if s.fault and _JOINT.search(_QUOTED.sub("", s.text)):
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        for name, arguments in calls(s):
            if name not in MOVES:
                continue
            target = target_of(arguments)
            if is_relative(arguments):
                refuse(f"{s.text[:60]!a}: is relative to where the arm stands", path, s.row)
            values = joints_in(target, variables) if target else None
            if values is None and not (target and _is_pose(target)):
                refuse(f"{s.text[:60]!a}: no list of numbers", path, s.row)
            found += [("the position", s.row, values)] if values else []
        for name in changed_in(s):
            variables.pop(name, None)
        match s.tree.children if s.kind == "assign" else ():
            # a name of another list is none: what changes that one changes it, too
            case Tree() as place, Token(value="="), Tree() as value:
                variables |= {text_of(place): v for v in [joints_in(value, {})] if v}
    return program_of(found, notes, path, "doosan")


def _is_pose(target: Tree[Token]) -> bool:
    tree = alone(target)
    return tree is not None and tree.data == "invoke" and tree.children[0] == "posx"
