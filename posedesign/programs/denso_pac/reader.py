"""Denso PacScript programs: the reader.

Positions are the joint values ``J(...)`` that ``Move`` goes to, there or in a variable of the
program; moves to what is computed of these are refused. Positions in variables of the controller
(``J[1]``) have no values in the file, and poses (``P(...)``) none that say which posture takes
them: both are left out. Numbers are those of remarks ``' POSE n`` in front of the moves, where a
program has the mark of a plan; others in their order, behind all.
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
_MOVE = re.compile(r"\bmove\b")
_JOINT = re.compile(r"(\bmove\b.*|=.*)\bj *\(")
_NAME = re.compile(r"\b[a-z]\w*[!#%$&]?")
_JOINTS = re.compile(r"\bj *\(")


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


Variables = dict[str, list[str] | None]
"""Texts of the values of joint variables; None: it had some, and may have others now."""


def _bases(variables: Variables) -> set[str]:
    """Names of the variables, without an index; those of the controller are not told of."""
    return {name.partition("[")[0] for name in variables} - {"j"}


def _change(s: Statement, variables: Variables) -> None:
    """Take the values that a statement gives to variables, and forget those it may change."""
    text = s.text.lower()
    if s.fault or s.kind in ("other", "call"):
        words = set(_NAME.findall(text))
        variables |= dict.fromkeys(v for v in variables if v.partition("[")[0] in words)
        variables |= dict.fromkeys(re.findall(r"#define +(\w+) .*\bj *\(", text))
    trees = [child for child in s.tree.children if isinstance(child, Tree)]
    for k, place in enumerate(trees if s.kind in ("assign", "dim") else ()):
        if place.data != "place":
            continue
        name, value = text_of(place).lower(), next(iter(trees[k + 1 : k + 2]), place)
        base, _, index = name.partition("[")
        values = joints_in(value) if value.data == "sum" else None
        if index and not index[:-1].isdigit():
            variables |= dict.fromkeys(v for v in variables if v.partition("[")[0] == base)
            values = None
        if value.data != "sum":
            variables.pop(name, None)
        elif values or name in variables or _JOINTS.search(text_of(value).lower()):
            variables[name] = values


def parse_denso_pac(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    notes = notes_of(text, "'")
    found: list[Found] = []
    variables: Variables = {}
    for s in LANGUAGE.statements(text):
        low = s.text.lower() if s.fault else ""
        moved = set(_NAME.findall(low)) & _bases(variables) if _MOVE.search(low) else ()
        if moved or _JOINT.search(low):
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        for _, target in targets(s):
            name = text_of(next(nodes(target, "sum"))).lower()
            values = joints_in(target) or variables.get(name)
            known = set(_NAME.findall(name)) & _bases(variables) or name in variables
            if not all(map(PLAIN.fullmatch, values or ())) or (
                not values and (known or _JOINTS.search(name))
            ):
                refuse(f"{s.text[:60]!a}: no list of numbers", path, s.row)
            found += [("the position", s.row, values)] if values else []
        _change(s, variables)
    return program_of(found, notes, path, "denso")
