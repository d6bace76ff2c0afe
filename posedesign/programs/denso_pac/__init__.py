"""Denso PacScript programs, of joint positions.

A file ``NAME.pcs``: a ``Move`` to each position, which stands in it. ``@E`` has the arm stop there,
its encoders asked, before the next step. The measuring call is another program. Touched-up
positions are typed into the moves; positions in the controller's variables (``J[1]``) are not in
the file. Nothing was loaded on a controller.

Read are the joint values ``J(...)`` that ``Move`` goes to, there or in a variable of the program,
also as ``J2P(J(...))``, and those given to a variable ``J12``; moves to what is computed of these
are refused. Positions in variables of the controller have no
values in the file, and poses (``P(...)``) none that say which posture takes them: both are left
out. Numbers are those of remarks ``' POSE n`` in front of the moves, where a program has the mark
of a plan; others in their order, behind all.

Rules: ``syntax``: lines are as in the grammar, of 1024 characters at most; other commands are
noted. ``block``: routines, loops and branches are closed. ``main``: to measure, there is a routine
Main, or a program of PAC. ``arm``: the arm that is moved is taken; a note without Main, as others
may have taken it. ``position``: ``J`` has six to eight plain numbers. ``range``: joints within
+-720 deg, speeds from 0.1 to 100 percent. ``standstill``, ``wait-to-measure``: a move that stops
(``@0``, ``@E``), and a Delay, before an output is set or a program called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice

from lark import Token, Tree

from posedesign.programs import joint_programs as joints
from posedesign.programs import language, rules, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import PLAIN, JointDialect, Standing
from posedesign.programs.language import Block, Language, Node, Statement, nodes, subtrees, text_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.rules import measuring
from posedesign.programs.straight_line import Event, Give, Go, Values
from posedesign.programs.writing import NameRule, Phrases

LANGUAGE = Language(
    __package__ or "",
    joined=language.without_remarks(r"'.*|^\s*rem\b.*"),
    signed=True,
    letters=r"\w",
)

SIGNATURES = signatures.table("""
speed percent:number[0.1,100] acceleration?:number(0,100] deceleration?:number(0,100]
wait milliseconds:number[0,]
""")
"""What Speed and Delay are given (RC8 manual, PacScript reference)."""

_MOVE = re.compile(r"\bmove\b")
_JOINT = re.compile(r"(\bmove\b.*|=.*)\bj *\(")
_FIRST = re.compile(r"([#*]?[a-z]\w*)(?! *[,@)\]])")
_NAME = re.compile(r"\b[a-z]\w*[!#%$&]?")
_JOINTS = re.compile(r"\bj *\(")
_DEFINED = re.compile(r"#define +(\w+) .*\bj *\(")
_ELEMENT = re.compile(r"\w+[!#%$&]?(\[\d+\])?")

_WORDS = """sub end program move delay set reset call takearm givearm speed dim if then else elseif
for next do loop while wend select case keep"""
_OTHERS = "wait depart approach draw drive drivea rotate motor print printdbg accel decel let send"
_MOTION = re.compile(r"(depart|approach|draw|drivea?|rotateh?|archmove)\b", re.I)
_BLOCKS = {
    "sub": Block("finish"),
    "program": Block("halt"),
    "branch": Block("close", ("divide",)),
    "loop": Block("again"),
}


def _joints_in(tree: Tree[Token], of: str = "") -> list[Tree[Token]] | None:
    """Joint values that an expression is, given to a variable; None: it is no such."""
    bare = r"|\([^()]*\)" if re.fullmatch(r"j\d+", of) else ""
    text = text_of(next(nodes(tree, "sum"))).lower()
    if not re.fullmatch(rf"j2p\(j?\([^()]*\)\)|j\([^()]*\){bare}", text):
        return None
    return subtrees([*nodes(tree, "group")][-1])


_Target = tuple[str, str, list[str] | None]


def _targets(s: Statement) -> list[_Target]:
    """How a move stops at each of its targets, the expression, and the joints that it is."""
    return s.kept(_taken) if s.kind == "move" else []


def _taken(s: Statement) -> list[_Target]:
    texts, found = iter(s.texts(_told)), list[_Target]()
    for stops, count in s.once(_forms):
        how, target = next(texts).upper() if stops else "@0", next(texts)
        found.append((how, target, None if count is None else [*islice(texts, count)]))
    return found


def _told(tree: Tree[Token]) -> Iterator[Node]:
    for target in nodes(tree, "target"):
        yield from target.children[: isinstance(target.children[0], Token)]
        yield next(nodes(target, "sum"))
        yield from _joints_in(target) or ()


def _forms(s: Statement) -> list[tuple[bool, int | None]]:
    """Whether each target says how the arm stops, and how many joint values it is."""
    found = [(t.children[0], _joints_in(t)) for t in s.all("target")]
    return [(isinstance(a, Token), None if b is None else len(b)) for a, b in found]


def _within(statements: Sequence[Statement]) -> Iterator[bool]:
    """Whether each statement is in a branch, a loop or another routine than the first."""
    jumps, depth = any(re.search(r"\bgo(to|sub)\b", s.text, re.I) for s in statements), 0
    for k, s in enumerate(statements):
        depth += s.kind in ("branch", "loop") or (s.kind == "sub" and k > 0)
        depth -= s.kind in ("close", "again")
        yield jumps or depth > 0 or s.kind == "single"


def _given(s: Statement) -> Iterator[tuple[str, str, list[str] | None, str]]:
    """Variables that a statement gives values: name, index, joint values, and the expression."""
    trees = subtrees(s.tree) if s.kind in ("assign", "dim") else []
    for k, place in enumerate(trees):
        value = next(iter(trees[k + 1 : k + 2]), place)
        if place.data == "place" and value.data == "sum":
            name = text_of(place).lower()
            base, _, index = name.partition("[")
            found = _joints_in(value, name)
            given = None if found is None else [text_of(joint) for joint in found]
            yield base, index[:-1], given, text_of(value).lower()


def _events(program: str) -> Iterator[Event]:
    """What the steps give to joint variables, and where they move."""
    statements = LANGUAGE.statements(program)
    own = {
        base for s in statements for base, _, given, e in _given(s) if given or _JOINTS.search(e)
    }
    own |= {name for s in statements for name in _DEFINED.findall(s.text.lower())}
    own -= {"j"}  # of the controller
    for s, inside in zip(statements, _within(statements), strict=True):
        low = s.text.lower() if s.fault or s.kind == "single" else ""
        named = {*_NAME.findall(low)} & own
        if (_MOVE.search(low) and named) or _JOINT.search(low):
            reason = s.fault or "nobody knows whether it is moved to"
            yield Go(s.row, "", inside, f"a position cannot be read: {reason}")
        for _, text, given in _targets(s):
            if given and all(map(PLAIN.fullmatch, given)):
                yield Go(s.row, Values(s.row, tuple(given)), inside)
                continue
            target = text.lower()
            base, computed = target.partition("[")[0], {*_NAME.findall(target)} & own
            if base in own and _ELEMENT.fullmatch(target):
                yield Go(s.row, target, inside)
            elif given or computed or _JOINTS.search(target):
                yield Go(s.row, "", inside, f"{s.text[:60]!a}: no list of numbers")
        if s.fault or s.kind in ("other", "call", "single"):  # may change what it names
            names = {*_NAME.findall(s.text.lower())} & own
            yield from (Give(s.row, name, None, inside) for name in sorted(names))
        for base, index, given, _ in _given(s):
            plain = given and all(map(PLAIN.fullmatch, given))
            name = f"{base}[{index}]" if index.isdigit() else base
            if base in own:
                value = Values(s.row, tuple(given)) if plain and given else None
                yield Give(s.row, name, None if index and name == base else value, inside)


def _check(statements: list[Statement]) -> Iterator[Problem]:
    yield from language.block_faults(statements, _BLOCKS)
    has_main = any(s.kind == "sub" and s.word("NAME").lower() == "main" for s in statements)
    if not has_main and all(s.kind != "program" for s in statements):
        yield measuring(1, "main", "there is no routine Main")
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    standing, taken = Standing(("stop", "Delay")), any(s.kind == "arm" for s in statements)
    for s in statements:
        if s.fault or s.kind == "other" or len(s.text) > 1024:
            yield joints.not_known(s, _FIRST, f"{_WORDS} {called}", _OTHERS)
        if s.kind == "move" and not taken:
            level: Level = "error" if has_main else "note"
            yield Problem(s.row, "arm", "nothing takes the arm that is moved", level)
        moves = s.kind == "move" or _MOTION.match(s.text) is not None
        stops = s.kind == "move" and all(how in ("@0", "@E") for how, *_ in _targets(s))
        measures = s.kind == "call" or (s.kind == "output" and s.text[:1].lower() == "s")
        stops = stops and not s.word("NEXT")
        yield from standing.check(s.row, moves, stops, s.kind == "wait", measures)
    steps = (s for s in statements if s.kind == "move" or s.kind in SIGNATURES)
    yield from rules.judged(steps, _check_step)


def _check_step(s: Statement) -> Iterator[Problem]:
    if s.kind in SIGNATURES:
        yield from joints.check_step(s.row, SIGNATURES, s.kind, map(text_of, subtrees(s.tree)))
    for _, text, values in _targets(s):
        if s.word("WAY") not in "sS" and (text[0] in '(-".' or text[0].isdigit()):
            yield Problem(s.row, "position", f"{text[:40]} is no position")
        if values is not None:
            yield from joints.check_joints(s.row, values, most=8)


class DensoPac(JointDialect):
    """Programs of Denso arms with an RC8 or RC9 controller; those of PAC are read."""

    name = "denso-pac"
    title = "Denso PacScript program"
    maker = "denso"
    suffixes = (".pcs", ".pac")
    remark = (r"^[ \t]*(?:Sub|Program)[ \t][^\n]*\n", "  ' {words}")
    names = NameRule("a PacScript name", 32, small=True)  # no limit of its length is known
    newline = "\r\n"
    phrases = Phrases(
        note="  ' {}",
        move=("  Move P, @E J({target})",),
        wait="  Delay {ms:.0f}",
        pulse=("  Set IO[{output}]", "  Delay {ms:.0f}", "  Reset IO[{output}]"),
        call=("  Call {call}({argument})",),
        bare=("  Call {call}",),
    )
    head = ("  TakeArm Keep = 0", "  Speed {percent}")
    reader = joints.in_moves(_events, joints.remark_lines("'"), "denso")
    rules = joints.judged(LANGUAGE, ("sub", "program"), _check)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The routine that a program begins with."""
        return ["Sub Main", *steps, "End Sub"]
