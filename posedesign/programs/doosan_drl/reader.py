"""Doosan DRL programs: the reader.

Positions are the joint values that ``movej`` and ``amovej`` go to: ``posj`` or a list of six, there
or in a variable. Moves to values that are computed are refused; poses of the tool (``posx``) are
left out, since nothing says which posture takes them. Numbers are those of remarks ``# POSE n`` in
front of the moves, where a program has the mark of a plan; others in their order, behind all.
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
_REMARK = re.compile(r"""("[^"\n]*"|'[^'\n]*')|#.*""")


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


def joints_in(target: Tree[Token]) -> list[str] | None:
    """Texts of the joint values that an expression gives; None: it is not known here."""
    invoke = next(nodes(target, "invoke"), None)
    if invoke is not None and str(invoke.children[0]) != "posj":
        return None
    found = list(nodes(invoke or target, "list")) or list(nodes(invoke or target, "arguments"))
    values = [text_of(v) for v in found[-1].children if isinstance(v, Tree)] if found else []
    return values if values and all(map(PLAIN.fullmatch, values)) else None


def parse_doosan_drl(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    notes = notes_of(text, "#")
    found: list[Found] = []
    variables: dict[str, list[str] | None] = {}
    for s in LANGUAGE.statements(text):
        if s.fault and re.match(r"a?movej\b|\w+ *= *posj\b", s.text):
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        if s.kind == "assign":
            variables[text_of(s.tree).partition("=")[0]] = joints_in(s.tree)
        for name, arguments in calls(s):
            if name in MOVES and arguments and arguments[0].data == "argument":
                values = joints_in(arguments[0]) or variables.get(text_of(arguments[0]))
                if values is None and "posx" not in s.text:
                    refuse(f"{s.text[:60]!a}: no list of numbers", path, s.row)
                found += [("the position", s.row, values)] if values else []
    return program_of(found, notes, path, "doosan")
