"""Denso PacScript programs: the reader.

Positions are the joint values ``J(...)`` that ``Move`` goes to, there or in a variable of the
program. Positions in variables of the controller (``J[1]``) have no values in the file, and poses
(``P(...)``) none that say which posture takes them: both are left out. Numbers are those of remarks
``' POSE n`` in front of the moves, where a program has the mark of a plan; others in their order,
behind all.
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

_REMARK = re.compile(r"""("[^"\n]*")|'.*|^\s*rem\b.*""", re.I)
_JOINT = re.compile(r"\s*(move\b.*[,\s]j *\(|\w+ *= *j *\()", re.I)


def _without_remarks(lines: Iterator[Line]) -> Iterator[Line]:
    for line in lines:
        text = _REMARK.sub(lambda found: found[1] or "", line.text).rstrip()
        if text:
            yield Line(line.row, text)


LANGUAGE = Language(
    __package__ or "", joined=_without_remarks, start="line", signed=True, letters=r"\w"
)


def joints_in(tree: Tree[Token]) -> list[str] | None:
    """Texts of the values of the ``J(...)`` that an expression is; None: it is no such."""
    text = text_of(next(nodes(tree, "sum")))
    group = next(nodes(tree, "group"), None)
    if group is None or not re.fullmatch(r"[jJ]\([^()]*\)", text):
        return None
    return [text_of(value) for value in group.children if isinstance(value, Tree)]


def targets(s: Statement) -> Iterator[tuple[str, Tree[Token]]]:
    """How a move stops at each of its targets, and where they are."""
    for target in nodes(s.tree, "target") if s.kind == "move" else ():
        stop = target.children[0]
        yield str(stop).upper() if isinstance(stop, Token) else "@0", target


def parse_denso_pac(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    notes = notes_of(text, "'")
    found: list[Found] = []
    variables: dict[str, list[str] | None] = {}
    for s in LANGUAGE.statements(text):
        if s.fault and _JOINT.match(s.text):
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        if s.kind == "assign":
            variables[text_of(next(nodes(s.tree, "place"))).lower()] = joints_in(s.tree)
        for _, target in targets(s):
            name = text_of(next(nodes(target, "sum"))).lower()
            values = joints_in(target) or variables.get(name)
            if values and not all(map(PLAIN.fullmatch, values)):
                refuse(f"{s.text[:60]!a}: no list of numbers", path, s.row)
            found += [("the position", s.row, values)] if values else []
    return program_of(found, notes, path, "denso")
