"""Doosan DRL programs, which are Python, of joint positions.

A file ``NAME.drl``: a ``movej`` to each position, which stands in it. The measuring call is defined
in the program: as written it asks the operator whether the tool is at its target, and logs the
joint values then shown; put another body there to trigger an instrument. Touched-up positions are
typed, or taught, into the moves: the language keeps none. Speeds are percents of the slowest
joint's. Nothing was loaded on a controller.

Read are the joint values that ``movej`` and ``amovej`` go to: ``posj`` or a list of six, there or
in a variable. Moves to values that are computed, and relative ones, are refused; poses of the tool
(``posx``) are left out, since nothing says which posture takes them.

Rules: ``syntax``: statements are as in the grammar. ``indent``: blocks are indented as in Python.
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

from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import (
    PLAIN,
    Found,
    JointDialect,
    Standing,
    check_joints,
    in_moves,
    judged,
    level_of,
)
from posedesign.programs.language import Language, Statement, nodes, open_lines, subtrees, text_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import Problem
from posedesign.programs.writing import NameRule, Phrases

__all__ = ["DoosanDrl"]

_MOTION = "pos vel acc time radius mod ra v a t r"
_FUNCTIONS = {
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

_MOVES = ("movej", "amovej")
_WORDS = """def if elif else while for try except return pass break continue from import in and or
not on"""
_RESERVED = frozenset(map(str.upper, [*_FUNCTIONS, *_WORDS.split()]))
_NAMES = "ON OFF True False None len range print float int list abs round"

_QUOTED = re.compile(r"""(?<!")"[^"\n]+"|(?<!')'[^'\n]+'""")
_JOINT = re.compile(r"""\b(a?movej|posj)\b|\"{3}|'{3}""")
_BLOCK = re.compile(
    r"""(?P<mark>\"{3}|'{3})(?s:.*?)(?P=mark)|"[^"\n]*"|'[^'\n]*'|\#[^\n]*""", re.VERBOSE
)

LANGUAGE = Language(
    __package__ or "",
    joined=open_lines("#", quoted=r"""("[^"\n]*"|'[^'\n]*')""", brackets="() [] {}"),
    signed=True,
    letters=r"\w",
)


def _without_blocks(text: str) -> str:
    """A text with nothing in the quotations of many lines, and its lines where they were."""

    def emptied(found: re.Match[str]) -> str:
        if not found["mark"]:
            return found[0]
        before = text[text.rfind("\n", 0, found.start()) + 1 : found.start()]
        return ('""' if before.strip() else "pass") + "\n" * found[0].count("\n")

    return _BLOCK.sub(emptied, text)


def _calls(s: Statement) -> Iterator[tuple[str, list[Tree[Token]]]]:
    """Names of the functions that a statement calls, and their arguments."""
    for invoke in nodes(s.tree, "invoke"):
        yield str(invoke.children[0]), subtrees(subtrees(invoke)[0])


def _given(arguments: list[Tree[Token]], place: int, name: str) -> list[Tree[Token]]:
    """Values of the argument in this place, and of those with this name."""
    placed = [a for a in arguments[place : place + 1] if a.data == "argument"]
    named = [a for a in arguments if a.data == "keyword" and a.children[0] == name]
    return [subtrees(a)[-1] for a in placed + named]


def _is_relative(arguments: list[Tree[Token]]) -> bool:
    """Whether a move goes on from where the arm stands, or may."""
    mods = map(text_of, _given(arguments, 5, "mod"))
    return any(mod not in ("0", "DR_MV_MOD_ABS") for mod in mods)


def _joints_in(tree: Tree[Token], variables: dict[str, list[str]]) -> list[str] | None:
    """Texts of the joint values that an expression is; None: it is computed, or not known here.

    ``variables`` has those of the variables that are lists of numbers.
    """
    values = subtrees(tree)
    if tree.data == "name":
        return variables.get(text_of(tree))
    if tree.data == "invoke" and tree.children[0] == "posj":
        values = [subtrees(a)[-1] for a in subtrees(values[0])]
        if len(values) == 1:
            return _joints_in(values[0], variables)
    elif tree.data != "list":
        return None
    texts = [text_of(value) for value in values]
    return texts if texts and all(map(PLAIN.fullmatch, texts)) else None


def _changed_in(s: Statement) -> set[str]:
    """Names that may stand for something else behind a statement."""
    if s.fault or s.kind == "import_":
        return set(re.findall(r"\w+", s.text))
    changed = [*nodes(s.tree, "parameter")]
    changed += [name for places in nodes(s.tree, "places") for name in nodes(places, "name")]
    # a method may change what it is of
    changed += [tree for tree in subtrees(s.tree)[:1] if s.kind == "call" and tree.data == "name"]
    return {text_of(name) for name in changed}


def _positions(text: str, path: Path) -> list[Found]:
    """Positions that the program moves to."""
    found: list[Found] = []
    variables: dict[str, list[str]] = {}
    for s in LANGUAGE.statements(text):
        if s.fault and _JOINT.search(_QUOTED.sub("", s.text)):
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        for arguments in [arguments for name, arguments in _calls(s) if name in _MOVES]:
            if _is_relative(arguments):
                refuse(f"{s.text[:60]!a}: is relative to where the arm stands", path, s.row)
            target = next(iter(_given(arguments, 0, "pos")), None)
            values = _joints_in(target, variables) if target else None
            is_pose = target and (target.data, target.children[0]) == ("invoke", "posx")
            if values is None and not is_pose:
                refuse(f"{s.text[:60]!a}: no list of numbers", path, s.row)
            found += [("the position", s.row, values)] if values else []
        for name in _changed_in(s):
            variables.pop(name, None)
        match s.tree.children:
            # a name of another list is none: what changes that one changes it, too
            case Tree(data="places", children=[Tree() as place]), Token(value="="), Tree() as value:
                variables |= {text_of(place): v for v in [_joints_in(value, {})] if v}
    return found


def check_doosan_drl(data: bytes, path: Path) -> list[Problem]:
    """Problems in a program, at most 1000. Never fails."""
    text = _without_blocks(data.decode("latin-1"))
    check = partial(_check, text.split("\n"))
    return judged(LANGUAGE, ("call",), check)(text.encode("latin-1"), path)


def _check(rows: list[str], statements: list[Statement]) -> Iterator[Problem]:
    own = {s.word("NAME") for s in statements if s.kind == "define"}
    known = {*_FUNCTIONS, *own, *_NAMES.split()}
    known |= {text_of(p) for s in statements for p in nodes(s.tree, "parameter")}
    known |= {text_of(n) for s in statements if s.kind == "assign" for n in nodes(s.tree, "name")}
    meant = " ".join([*known, _WORDS, *(named for _, _, named in _FUNCTIONS.values())])
    standing = Standing(("mwait", "wait"))
    for s in statements:
        if s.fault:
            word = re.match(r"\w*", s.text)
            level = level_of(word[0] if word else "", meant, "")
            level = "error" if any(name in s.text for name in (*_FUNCTIONS, *own)) else level
            yield Problem(s.row, "syntax", s.fault, level)
        called = list(_calls(s))
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
    least, most, named = _FUNCTIONS.get(name, (0, len(arguments), ""))
    words = [str(a.children[0]) for a in arguments if a.data == "keyword"]
    values = [text_of(a) for a in arguments if a.data == "argument"]
    targets = _given(arguments, 0, "pos")
    computed = not targets or targets[0].data in ("expr", "operand", "number")
    computed = computed or _is_relative(arguments)
    if computed and (name in _MOVES or (name == "posj" and len(arguments) == 1)):
        yield Problem(row, "position", f"{name}: a computed position is not read back", "note")
    if any(a.data == "spread" for a in arguments):
        return
    wrong = [word for word in words if name in _FUNCTIONS and word not in named.split()]
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


class DoosanDrl(JointDialect):
    """Programs of Doosan arms."""

    name = "doosan-drl"
    title = "Doosan DRL program"
    maker = "doosan"
    suffixes = (".drl",)
    remark = (r"", "# {words}")
    names = NameRule("a DRL name", 32, small=True, reserved=_RESERVED)
    phrases = Phrases(
        note="# {}",
        move=("movej(posj({target}), vel={speed}, acc={speed})", "mwait()"),
        wait="wait({time:.3f})",
        pulse=(
            "set_digital_output({output}, ON)",
            "wait({time:.3f})",
            "set_digital_output({output}, OFF)",
        ),
        call=("{call}({argument})",),
    )
    most_output = 16
    reader = in_moves(_positions, "#", "doosan", _without_blocks)
    rules = check_doosan_drl

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The measuring call, and the steps."""
        measuring = (
            f"def {program.options.measure_call}(number=0):",
            f'    tp_popup("{program.options.question} Pose " + str(number))',
            '    tp_log("POSE " + str(number) + " q=" + str(get_current_posj()))',
        )
        return [*(measuring if program.options.measure_call else ()), *steps]
