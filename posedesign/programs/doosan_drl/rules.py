"""Doosan DRL programs: the rules that a program is checked by.

``syntax``: statements are as in the grammar. ``indent``: blocks are indented as in Python.
``name``: functions and variables are known; others are noted where they are not nearly known.
``arguments``: functions have those that they take. ``position``, ``range``: ``posj`` has six
numbers within +-720 deg, outputs are from 1 to 16; moves to computed positions are noted.
``standstill``, ``wait-to-measure``: a move that is not blended, and a wait, before an output is set
or a function of the program called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from lark import Token, Tree

from posedesign.programs.doosan_drl.reader import (
    LANGUAGE,
    MOVES,
    alone,
    calls,
    is_relative,
    target_of,
    without_blocks,
)
from posedesign.programs.joint_programs import PLAIN, Standing, check_joints, judged, level_of
from posedesign.programs.language import Statement, nodes, text_of
from posedesign.programs.recorded import Problem

_MOTION = "pos vel acc time radius mod ra v a t r"
FUNCTIONS = {
    "movej": (1, 3, _MOTION),
    "amovej": (1, 3, _MOTION),
    "movel": (1, 3, _MOTION + " ref"),
    "posj": (0, 6, ""),
    "posx": (0, 6, ""),
    "mwait": (0, 1, "time"),
    "wait": (1, 1, "time"),
    "set_digital_output": (1, 2, "index val time val2"),
    "tp_log": (1, 1, "message"),
    "tp_popup": (1, 3, "message pm_type button_type"),
    "get_current_posj": (0, 0, ""),
    "sub_program_run": (1, 1, "name"),
    "set_velj": (1, 1, "vel"),
    "set_accj": (1, 1, "acc"),
    "str": (1, 1, ""),
}
"""Least and most positional arguments, and the names of arguments."""

WORDS = (
    "def if elif else while for try except return pass break continue from import in and or not on"
)
_NAMES = "ON OFF True False None len range print float int list abs round"


def check_doosan_drl(data: bytes, path: Path) -> list[Problem]:
    """Problems in a program, at most 1000. Never fails."""
    text = without_blocks(data.decode("latin-1"))
    rows = text.split("\n")
    return judged(text.encode("latin-1"), LANGUAGE, ("call",), partial(_check, rows))


def _check(rows: list[str], statements: list[Statement]) -> Iterator[Problem]:
    own = {s.word("NAME") for s in statements if s.kind == "define"}
    known = {*FUNCTIONS, *own, *_NAMES.split()}
    known |= {text_of(p) for s in statements for p in nodes(s.tree, "parameter")}
    known |= {text_of(n) for s in statements if s.kind == "assign" for n in nodes(s.tree, "name")}
    meant = " ".join([*known, WORDS, *(named for _, _, named in FUNCTIONS.values())])
    standing = Standing(("mwait", "wait"))
    for s in statements:
        if s.fault:
            word = re.match(r"\w*", s.text)
            level = level_of(word[0] if word else "", meant, "")
            level = "error" if any(name in s.text for name in (*FUNCTIONS, *own)) else level
            yield Problem(s.row, "syntax", s.fault, level)
        called = list(calls(s))
        for name in {*(text_of(n) for n in nodes(s.tree, "name")), *dict(called)} - known:
            if not re.fullmatch(r"DR_[A-Z_\d]+", name):
                yield Problem(s.row, "name", f"{name[:40]} is not known", level_of(name, meant, ""))
        if s.kind == "call" and not any(nodes(s.tree, "arguments")):
            yield Problem(s.row, "name", "a name alone does nothing")
        for name, arguments in called:
            yield from _check_call(s.row, name, arguments)
            moves = re.fullmatch(r"a?move\w*", name) is not None
            blended = re.search(r"\br(?:adius)? *= *(?![0.]+\b)", s.text) is not None
            stops = name == "mwait" or (name[0] == "m" and moves and not blended)
            measures = name in own | {"sub_program_run"}
            measures |= name == "set_digital_output" and "OFF" not in s.text
            yield from standing.check(s.row, moves, stops, name == "wait", measures)
    yield from _check_indents(rows, statements)


def _check_call(row: int, name: str, arguments: list[Tree[Token]]) -> Iterator[Problem]:
    least, most, named = FUNCTIONS.get(name, (0, len(arguments), ""))
    words = [str(a.children[0]) for a in arguments if a.data == "keyword"]
    values = [text_of(a) for a in arguments if a.data == "argument"]
    target = target_of(arguments)
    computed = target is None or alone(target) is None or is_relative(arguments)
    if computed and (name in MOVES or (name == "posj" and len(arguments) == 1)):
        yield Problem(row, "position", f"{name}: a computed position is not read back", "note")
    if any(a.data == "spread" for a in arguments):
        return
    wrong = [word for word in words if name in FUNCTIONS and word not in named.split()]
    wrong += [value for value in values if re.match(r"\(|.+\WO(N|FF)\b", value)]
    if wrong or not least <= len(values) + len(words) or len(values) > most:
        yield Problem(row, "arguments", f"{name[:40]}: {', '.join(wrong)[:40] or 'not so many'}")
    if name == "posj" and len(values) > 1:
        yield from check_joints(row, values)
    output = next(filter(PLAIN.fullmatch, values), "1") if name == "set_digital_output" else "1"
    if not 1 <= abs(float(output[:99])) <= 16:
        yield Problem(row, "range", f"{output[:20]} is no output")


def _check_indents(rows: list[str], statements: list[Statement]) -> Iterator[Problem]:
    levels, opens = [0], False
    for s in statements:
        line = rows[s.row - 1].expandtabs()
        indent = len(line) - len(line.lstrip())
        if opens and indent > levels[-1]:
            levels.append(indent)
        else:
            levels = [level for level in levels if level <= indent]
            if opens or levels[-1] != indent:
                yield Problem(s.row, "indent", "not indented as the lines around it")
        opens = s.kind in ("define", "block")
