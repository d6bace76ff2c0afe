"""Doosan DRL programs, which are Python, of joint positions.

A file ``NAME.drl``: a ``movej`` to each position, which stands in it. The measuring call is defined
in the program: as written it asks the operator whether the tool is at its target, and logs the
joint values then shown; put another body there to trigger an instrument. Touched-up positions are
typed, or taught, into the moves: the language keeps none. Speeds are percents of the slowest
joint's. Nothing was loaded on a controller.

Read are the joint values that ``movej`` and ``amovej`` go to: ``posj`` or a list of six, there or
in a variable. Computed and relative moves are refused. Poses (``posx``) say no posture: left out.

Rules: ``syntax``, ``indent``: Python as in the grammar. ``name``: functions and variables are
known; others are noted where they are not nearly known. ``arguments``: functions have those that
they take. ``position``, ``range``: ``posj`` has six numbers within +-720 deg, outputs are from 1 to
16; moves to computed positions are noted. ``standstill``, ``wait-to-measure``: a move that is not
blended, and a wait, before an output is set or a function of the program called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from lark import Token, Tree

from posedesign.programs import joint_programs as joints
from posedesign.programs import language
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import PLAIN, Variables
from posedesign.programs.language import Statement, nodes, subtrees, text_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import measuring
from posedesign.programs.writing import NameRule, Phrases

_MOVES = ("movej", "amovej")
_MOTION = "pos vel acc time radius mod ra v a t r"
_ONE = "wait:time tp_log:message sub_program_run:name set_velj:vel set_accj:acc"
_FUNCTIONS = {
    **dict.fromkeys(_MOVES, (1, 3, _MOTION)),
    **dict.fromkeys(("movel", "amovel"), (1, 3, _MOTION + " ref app_type")),
    "str": (1, 3, ""),
    **{name: (1, 1, given) for name, given in (one.split(":") for one in _ONE.split())},
    "posj": (0, 6, ""),
    "posx": (0, 8, ""),
    "mwait": (0, 1, "time"),
    "set_digital_output": (1, 2, "index val time val2"),
    "tp_popup": (1, 3, "message pm_type button_type"),
    "get_current_posj": (0, 0, ""),
}
"""Least and most positional arguments, and the names of arguments."""

_WORDS = """def if elif else while for try except return pass break continue from import in and or
not on"""
_RESERVED = frozenset(map(str.upper, [*_FUNCTIONS, *_WORDS.split()]))
_NAMES = """ON OFF True False None len range print float int list abs round min max sum time open
type exit set_velx set_accx get_current_posx set_digital_outputs get_digital_input movec amovec
moveb amoveb movesx movesj amovesx posb trans fkin ikin set_tool set_tcp get_digital_inputs"""
_NAMED = ("name", "owner")
_PURE = {*_FUNCTIONS, *_NAMES.split()}  # they change no list that they are given

_QUOTED = re.compile(r"""(?<!")"[^"\n]+"|(?<!')'[^'\n]+'""")
_ASKED = re.compile(r"([^\W\d]\w*)\s*\.\s*\w+\s*\(")  # a method may change what it is of
_ADDED = re.compile(r"""" *\+ *\([^"'()]*(\([^"'()]*\))?\)""")  # to a text, what may be none
_FORMATS = re.compile(r'"[^"%]*" *%|\) *% *"')  # a text without a place for what is formatted
_JOINT = re.compile(r"""\b(a?movej|posj)\b|\"{3}|'{3}""")
_BLOCK = re.compile(r"""(?P<mark>\"{3}|'{3})(?s:.*?)(?P=mark)|"[^"\n]*"|'[^'\n]*'|#[^\n]*""")
_OPEN = language.open_lines("#", quoted=r"""("[^"\n]*"|'[^'\n]*')""", brackets="() [] {}")
LANGUAGE = language.Language(__package__ or "", _OPEN, signed=True, letters=r"\w", indented=True)


def _without_blocks(text: str) -> str:
    """A text with nothing in the quotations of many lines, and its lines where they were."""

    def emptied(found: re.Match[str]) -> str:
        if not found["mark"]:
            return found[0]
        before = text[text.rfind("\n", 0, found.start()) + 1 : found.start()]
        return ('""' if before.strip() else "pass") + "\n" * found[0].count("\n")

    return _BLOCK.sub(emptied, text)


def _calls(s: Statement) -> list[tuple[str, list[Tree[Token]]]]:
    """Names of the functions that a statement calls, and their arguments."""
    return [(str(t.children[0]), subtrees(subtrees(t)[0])) for t in nodes(s.tree, "invoke")]


def _given(arguments: list[Tree[Token]], place: int, name: str) -> list[Tree[Token]]:
    """Values of the argument in this place, and of those with this name."""
    placed = [a for a in arguments[place : place + 1] if a.data == "argument"]
    named = [a for a in arguments if a.data == "keyword" and a.children[0] == name]
    return [subtrees(a)[-1] for a in placed + named]


def _is_relative(arguments: list[Tree[Token]]) -> bool:
    """Whether a move goes on from where the arm stands, or may."""
    return bool({*map(text_of, _given(arguments, 5, "mod"))} - {"0", "DR_MV_MOD_ABS"})


def _joints_in(tree: Tree[Token], variables: Variables) -> Sequence[str] | None:
    """Texts of the joint values that an expression is; None: it is computed, or not known here."""
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


def _moved_to(s: Statement, variables: Variables) -> Iterator[Sequence[str] | str]:
    """Joint values that a statement moves to, or why they are not read."""
    if s.fault and _JOINT.search(_QUOTED.sub("", s.text)):
        yield f"a position cannot be read: {s.fault}"
    said = " ".join(s.text.split())[:60]
    for arguments in [arguments for name, arguments in _calls(s) if name in _MOVES]:
        target = next(iter(_given(arguments, 0, "pos")), None)
        values = _joints_in(target, variables) if target else None
        if _is_relative(arguments):
            yield f"{said!a}: is relative to where the arm stands"
        elif values:
            yield values
        elif not target or (target.data, target.children[0]) != ("invoke", "posx"):
            yield f"{said!a}: no list of numbers"


def _change(s: Statement, variables: Variables) -> None:
    """Take the values that a statement gives to variables, and forget those it may change."""
    if not variables and s.kind == "call" and not s.text[:1].isspace():
        return
    given = [trees for name, trees in _calls(s) if name not in _PURE]
    given += [subtrees(t) for t in nodes(s.tree, "trailer") if t.children[:1] != ["format"]]
    changed = _ASKED.findall(_QUOTED.sub("", s.text))
    changed += map(text_of, nodes(s.tree, "parameter", "owner"))
    changed += [text_of(n) for trees in given for tree in trees for n in nodes(tree, "name")]
    changed += [str(c).rstrip("= ") for c in s.tree.children if str(c)[-1:] == "="]
    names = re.findall(r"\w+", s.text)
    for name in names if s.fault or s.kind == "import_" else changed:
        if variables.get(name, ()) is not None:
            variables.pop(name, None)
    # what a function changes it changes when it is called: nobody knows such a list any more
    if re.match(r"\s+(global\b|\w+ *[\[.])", s.text):
        variables |= dict.fromkeys(names if s.kind == "global" else names[:1])
    match s.tree.children:
        # a name of another list is none: what changes that one changes it, too
        case Tree(data="places", children=[Tree() as place]), Token(value="="), Tree() as value:
            if variables.get(text_of(place), ()) is not None:
                variables |= {text_of(place): v for v in [_joints_in(value, {})] if v}


def _check(statements: list[Statement]) -> Iterator[Problem]:
    own = {s.word("NAME") for s in statements if s.kind == "define"}
    known = {*_PURE, *own}
    known |= {w for s in statements if s.kind in ("import_", "global") for w in s.words("NAME")}
    for s in statements:
        known |= {text_of(n) for n in nodes(s.tree, "parameter", *_NAMED * (s.kind == "assign"))}
    meant = " ".join([*known, _WORDS, *(named for _, _, named in _FUNCTIONS.values())])
    standing = joints.Standing(("mwait", "wait"))
    for s in statements:
        if s.fault:
            level = joints.level_of(re.split(r"\W", s.text.strip())[0], meant)
            said = any(name in s.text for name in {*_FUNCTIONS, *own} - {"str"})
            yield Problem(s.row, "syntax", s.fault, "error" if said else level)
        called = _calls(s)
        for name in {*(text_of(n) for n in nodes(s.tree, *_NAMED)), *dict(called)} - known:
            if not re.fullmatch(r"DR_[A-Z_\d]+", name):
                level = joints.level_of(name, meant, name * name[-1].isdigit())  # P_2 is not P_1
                yield Problem(s.row, "name", f"{name[:40]} is not known", level)
        if s.kind == "call" and not any(nodes(s.tree, "arguments")):
            yield measuring(s.row, "name", "a name alone does nothing")
        if _ADDED.search(s.text):
            yield measuring(s.row, "arguments", "a number cannot be added to a text")
        if _FORMATS.search(s.text):
            yield Problem(s.row, "arguments", "% formats nothing")
        for name, arguments in called:
            yield from _check_call(s.row, name, arguments)
            moves = re.fullmatch(r"a?move\w*", name) is not None
            blended = re.search(r"\br(?:adius)? *= *(?![0.]+\b)", s.text) is not None
            stops = name == "mwait" or (name[0] == "m" and moves and not blended)
            measures = name in own | {"sub_program_run"}
            measures |= name == "set_digital_output" and "OFF" not in s.text
            yield from standing.check(s.row, moves, stops, name == "wait", measures)
    yield from language.indent_faults(statements, "define", "block")


def _check_call(row: int, name: str, arguments: list[Tree[Token]]) -> Iterator[Problem]:
    least, most, named = _FUNCTIONS.get(name, (0, len(arguments), ""))
    words = [str(a.children[0]) for a in arguments if a.data == "keyword"]
    values = [text_of(a) for a in arguments if a.data == "argument"]
    goes = name in _MOVES or (name == "posj" and len(arguments) == 1)
    known = [t for t in _given(arguments, 0, "pos") if t.data not in ("expr", "operand", "number")]
    if goes and (not known or _is_relative(arguments)):
        yield Problem(row, "position", f"{name}: a computed position is not read back", "note")
    if any(a.data == "spread" for a in arguments):
        return
    wrong = [word for word in words if name in _FUNCTIONS and word not in named.split()]
    wrong += [value for value in values if re.match(r".+\WO(N|FF)\b", value)]
    groups = [t for a in arguments for t in subtrees(a) if t.data == "group"]
    wrong += ["(,)" for t in groups if name in _FUNCTIONS and len(subtrees(t)) != 1]
    if wrong or not least <= len(values) + len(words) or len(values) > most:
        yield Problem(row, "arguments", f"{name[:40]}: {', '.join(wrong)[:40] or 'not so many'}")
    if name == "posj" and len(values) > 1:
        yield from joints.check_joints(row, values)
    if name == "set_digital_output":
        output = next(filter(PLAIN.fullmatch, values), "1").lstrip("-")
        yield from joints.check_range(row, output, "number of an output", 1, 16)


class DoosanDrl(joints.JointDialect):
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
    limits = replace(joints.LIMITS, outputs=(1, 16))
    reader = joints.in_moves(LANGUAGE, _moved_to, _change, ("#", "doosan"), _without_blocks)
    rules = joints.judged(LANGUAGE, ("call", "assign", "define"), _check, _without_blocks)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The measuring call, and the steps."""
        call = (
            f"def {program.options.measure_call}(number=0):",
            f'    tp_popup("{program.options.question} Pose " + str(number))',
            '    tp_log("POSE " + str(number) + " q=" + str(get_current_posj()))',
        )
        return [*(call if program.options.measure_call else ()), *steps]
