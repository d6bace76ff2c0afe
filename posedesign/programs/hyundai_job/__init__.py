"""Hyundai jobs, of joint positions.

A file ``NAME.job`` in HRScript, the language of Hi6 and Hi7: ``move P,tg=Pose(...)`` to each
position, which stands in it; ``accu=0`` stops there. The measuring call is another job, with the
number of the pose as its parameter. Touched-up positions are typed into the moves. Times to wait
are 0.1 to 60 s. Nothing was loaded on a controller; joints are those of the description: arms with
parallel links show joint 3 in another way.

Read are the joint values that moves go to, in degrees: ``tg=Pose(...)``, there or in a variable,
the hidden pose ``[...]`` behind a recorded move, and ``(...)A`` of HRBASIC (Hi4 to Hi5). Poses in
base, robot, user and encoder coordinates are left out. Moves to sums, shifts and to what is changed
are unread.

Rules: ``syntax``: lines are as in the grammar; other commands are noted. ``block``: branches and
loops are closed. ``position``, ``range``: joints are plain numbers within +-720 deg, speeds have a
unit and are up to 100 percent, accuracies 0 to 7, tools 0 to 31, times not negative. ``name``:
variables are declared. To measure, ``end``: the job ends; ``standstill``, ``wait-to-measure``: a
move with accuracy 0, and a delay, before an output is set or a job called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from lark import Token, Tree

from posedesign.programs import joint_programs as joints
from posedesign.programs import language, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import PLAIN, DescribedDialect, Standing
from posedesign.programs.language import (
    Block,
    Language,
    Line,
    Statement,
    nodes,
    subtrees,
    text_of,
)
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import measuring
from posedesign.programs.straight_line import Event, Give, Go, Values
from posedesign.programs.writing import NameRule, Phrases

_LABEL = re.compile(r"\A(s\d{1,4}|\d{1,4}) +(?=[a-z_*])", re.I)


def _steps(lines: Iterator[Line]) -> Iterator[Line]:
    """Lines without remarks, and without the numbers before them."""
    for line in language.without_remarks(r"#.*|'.*")(lines):
        yield Line(line.row, _LABEL.sub("", line.text.lstrip(), count=1))


LANGUAGE = Language(
    __package__ or "",
    joined=_steps,
    signed=True,
    letters=r"\w",
)

SIGNATURES = signatures.table("""
delay seconds:number[0,]
spd,s percent:number(0,100]
accu,a accuracy:whole[0,7]
tool,t number:whole[0,31]
""")
"""What a move and a delay are given (HRScript, 3.2.3 and 5.4); speeds in percent."""

_FIRST = re.compile(r"([a-z_]\w*)")
_WORDS = """move delay call var global local param end return if then else elseif endif for next
switch case default pose until tg spd accu tool"""
_OTHERS = (
    "wait print jump goto gosub import def do fb io tp cpo dly stop relmov smov seltool attach"
)
_MOTION = re.compile(r"(\w*move|smov\w*|relmov\w*)\b", re.I)
_PREDEFINED = re.compile(
    r"_.*|(do|di|dow|dob|gb|v|p|r|lv|lp|lr|s|ls|m\w?)\d+[!$%]?|.*[.\[(].*", re.I
)
_MOVED = re.compile(r"\b(move|tg|pose)\b", re.I)
_JUMPS = re.compile(r"\b(goto|gosub|jump)\b", re.I)
_BLOCKS = {"branch": Block("close", ("divide",)), "loop": Block("again")}


def _values(node: Tree[Token]) -> list[str] | None:
    """Texts of the joint values that an expression is; None: it is no such.

    A pose in other coordinates has the empty list.
    """
    text = text_of(node).lower()
    found = re.fullmatch(r"(pose\(|\[|\()([^()\[\]]*)[\])](\w*)", text)
    if found is None:
        return None
    values, kind = found[2].split(","), found[1]
    return [] if found[3] not in (("a",) if kind == "(" else ("",)) or '"' in text else values


def _targets(s: Statement) -> Iterator[Tree[Token]]:
    """Expressions that a move goes to."""
    for part in subtrees(s.tree) if s.kind == "move" else ():
        name = next((str(c).lower() for c in part.children if isinstance(c, Token)), "")
        own = next(iter(subtrees(part)), part)
        if part.data == "target":
            yield part
        elif name == "tg" or (own is not part and len(part.children) == 1):
            yield own


def _given(s: Statement) -> Iterator[tuple[str, Tree[Token] | None]]:
    """Variables that a statement gives values."""
    if s.kind == "assign":
        place, value, *more = subtrees(s.tree)
        name, _, rest = text_of(place).lower().partition(".")
        yield name, None if rest or more else value
    names = [c for c in s.tree.children if isinstance(c, Token) and c.type == "NAME"]
    for k, child in enumerate(s.tree.children if s.kind == "declare" else ()):
        if isinstance(child, Tree):
            yield str(s.tree.children[k - 1]).lower(), child
    yield from (
        (str(name).lower(), None)
        for name in names
        if s.kind == "declare" and s.text.lower().split()[0] == "param"
    )


def _event(s: Statement, target: Tree[Token], inside: bool, own: set[str]) -> Iterator[Event]:
    values, name = _values(target), text_of(target).lower()
    if values and all(map(PLAIN.fullmatch, values)):
        yield Go(s.row, Values(s.row, tuple(values)), inside)
    elif name in own:
        yield Go(s.row, name, inside)
    elif (values != [] and re.search(r"pose|\)a\b|^\[|^[-+]|shift", name)) or re.search(
        r"\d+ *a$", name
    ):
        yield Go(s.row, "", inside, f"{s.text[:60]!a}: no list of numbers")
    elif {*re.findall(r"[a-z_]\w*", name)} & own:
        yield Go(s.row, "", inside, f"{s.text[:60]!a}: is computed")


def _events(text: str) -> Iterator[Event]:
    """What the steps give to variables, and where they move."""
    statements = LANGUAGE.statements(text)
    own = {name for s in statements for name, value in _given(s) if value and _values(value)}
    jumps, depth = any(_JUMPS.search(s.text) for s in statements), 0
    for s in statements:
        depth += (s.kind in ("branch", "loop")) - (s.kind in ("close", "again"))
        inside = jumps or depth > 0
        for target in _targets(s):
            yield from _event(s, target, inside, own)
        if (s.fault or s.kind == "single") and _MOVED.search(s.text):
            yield Go(s.row, "", inside, f"a position cannot be read: {s.fault or s.text[:40]}")
        if s.fault or s.kind in ("call", "other", "single"):  # may change what it names
            names = {*re.findall(r"[a-z_]\w*", s.text.lower())} & own
            yield from (Give(s.row, name, None, inside) for name in sorted(names))
        for name, value in _given(s):
            values = (_values(value) if value else None) or []
            plain = bool(values) and all(map(PLAIN.fullmatch, values))
            if name in own:
                yield Give(s.row, name, Values(s.row, tuple(values)) if plain else None, inside)


def _check(statements: list[Statement]) -> Iterator[Problem]:
    yield from language.block_faults(statements, _BLOCKS)
    declared = {str(c).lower() for s in statements if s.kind == "declare" for c in s.words("NAME")}
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    standing = Standing(("move with accuracy 0", "delay"))
    if statements[-1].kind != "end":
        yield measuring(statements[-1].row, "end", "the job does not end")
    for s in statements:
        if s.fault or s.kind == "other":
            told = joints.not_known(s, _FIRST, f"{_WORDS} {called}", _OTHERS)
            yield replace(told, level="error") if _MOVED.search(s.text) else told
        if s.kind == "delay":
            given = map(text_of, subtrees(s.tree))
            yield from joints.check_step(s.row, SIGNATURES, "delay", given)
        if s.kind == "move":
            yield from _check_move(s)
        if s.kind == "assign":
            name = text_of(subtrees(s.tree)[0]).lower()
            if not _PREDEFINED.fullmatch(name) and name not in declared:
                yield measuring(s.row, "name", f"{name[:40]} is not declared")
        moves = s.kind == "move" or bool(s.kind != "single" and _MOTION.match(s.text))
        output = s.kind == "assign" and re.match(r"\W*do\d+ *= *[^0 ]", s.text, re.I)
        measures = s.kind == "call" or bool(output)
        yield from standing.check(s.row, moves, _stops(s), s.kind == "delay", measures)


def _check_option(s: Statement, option: Tree[Token]) -> Iterator[Problem]:
    name = text_of(option.children[0]).lower() if len(option.children) > 1 else ""
    value, unit = text_of(next(nodes(option, "sum"))), text_of(option.children[-1])
    if name in ("spd", "s") and (unit == value or not re.fullmatch(r"%|[a-z]+(/[a-z]+)?", unit)):
        yield Problem(s.row, "range", f"{name}={value[:30]} has no unit")
    elif name in SIGNATURES and (name not in ("spd", "s") or unit == "%"):
        yield from joints.check_step(s.row, SIGNATURES, name, [value])
    elif name == "tg" and value[:1] in "([":
        yield Problem(s.row, "position", f"{value[:40]} is no position")
    elif name not in (*SIGNATURES, "tg", ""):
        yield Problem(s.row, "syntax", f"a move has no {name[:30]}")


def _check_move(s: Statement) -> Iterator[Problem]:
    targets, options = [*_targets(s)], s.all("option")
    yield from (problem for option in options for problem in _check_option(s, option))
    names = {text_of(option.children[0]).lower() for option in options}
    if not {"spd", "accu", "tool"} <= names and not {"s", "a"} <= names:
        yield measuring(s.row, "syntax", "speed, accuracy or tool of the move is not there")
    if len(targets) > 1 + s.word("WAY").lower().endswith("c"):
        yield Problem(s.row, "position", f"{len(targets)} targets of one move")
    for target in targets:
        values, text = _values(target), text_of(target)
        if values:
            yield from joints.check_joints(s.row, values, most=32)
        elif values is None and re.match(r"[\d.\"(-]|\w+\((.*,){5}", text):
            yield Problem(s.row, "position", f"{text[:40]!a} is no position")


def _stops(s: Statement) -> bool:
    """Whether the arm stops behind a move: its accuracy is 0."""
    named = [[text_of(c).lower() for c in option.children] for option in s.all("option")]
    return s.kind == "move" and any(texts in (["accu", "0"], ["a", "0"]) for texts in named)


class HyundaiJob(DescribedDialect):
    """Jobs of Hyundai arms of six joints; joints are those of the description."""

    name = "hyundai-job"
    title = "Hyundai job"
    maker = None
    suffixes = (".job",)
    remark = (r"", "     # {words}")
    names = NameRule(
        "a Hyundai job's name",
        32,
        small=True,
        reserved=frozenset(f"{_WORDS} {_OTHERS}".upper().split()),
    )
    limits = replace(joints.LIMITS, settle_s=60.0, pulse_s=(0.0, 60.0))
    phrases = Phrases(
        note="     # {}",
        move=("     move P,tg=Pose({target}),spd={percent}%,accu=0,tool=0",),
        wait="     delay {time:.3f}",
        pulse=("     do{output}=1", "     delay {time:.3f}", "     do{output}=0"),
        call=("     call {call},{argument}",),
        bare=("     call {call}",),
    )
    reader = joints.in_moves(_events, joints.remark_lines("#"), None)
    rules = joints.judged(LANGUAGE, ("move", "end"), _check)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The steps, and the end."""
        return [*steps, "     end"]
